//! What a call in somebody else's loop is given: a time, a reference, obstacles.

use crate::convert::{
    count, instead, misshapen, named_document, number, points, read_vector, wrong_type,
};
use crate::errors::{self, InputError};
use pyo3::prelude::*;
use pyo3::types::PySequence;
use toml::Table;
use vff_core::runtime::points::PointUpdate;
use vff_core::runtime::{AnyController, AnyObstacles, Target};
use vff_core::scenario::ScenarioError;

/// A reference in numbers, or none.
pub struct Reference {
    given: bool,
    x: Vec<f64>,
    dx: Vec<f64>,
    ddx: Vec<f64>,
}

impl Reference {
    /// That of a call, where pose, velocity and acceleration have so many numbers.
    pub fn read(
        widths: [usize; 3],
        x_ref: Option<&Bound<'_, PyAny>>,
        dx_ref: Option<&Bound<'_, PyAny>>,
        ddx_ref: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let [mut x, mut dx, mut ddx] = widths.map(|width| vec![0.0; width]);
        x_ref.map_or(Ok(()), |given| read_pose(given, &mut x))?;
        for (name, given, out) in [("dx_ref", dx_ref, &mut dx), ("ddx_ref", ddx_ref, &mut ddx)] {
            given.map_or(Ok(()), |given| read_vector(name, given, out))?;
        }
        Ok(Self { given: x_ref.is_some(), x, dx, ddx })
    }

    /// The reference itself.
    pub fn target(&self) -> Option<Target<'_>> {
        self.given.then_some(self.numbers())
    }

    /// Whether a law can follow it, or none was given.
    pub fn suits(&self, law: &AnyController) -> bool {
        self.target().is_none_or(|target| law.check(&target).is_ok())
    }

    /// Its numbers, zeros where nothing was given.
    pub fn numbers(&self) -> Target<'_> {
        Target { x: &self.x, dx: &self.dx, ddx: &self.ddx }
    }
}

/// The time of a call [s], 0 if none is given.
pub fn finite_time(t: Option<&Bound<'_, PyAny>>) -> PyResult<f64> {
    let t = t.map_or(Ok(0.0), |t| number("t", t))?;
    match t.is_finite() {
        true => Ok(t),
        false => Err(InputError::new_err(format!("t must be finite, got {t}"))),
    }
}

/// The points that replace those of an obstacle, how they move and since when, and which one it is: the first where nothing is
/// said.
pub fn new_points(
    cloud: &Bound<'_, PyAny>,
    obstacle: Option<&Bound<'_, PyAny>>,
    velocities: Option<&Bound<'_, PyAny>>,
    t: Option<&Bound<'_, PyAny>>,
) -> PyResult<(PointUpdate, usize)> {
    let given = points("cloud", cloud)?;
    let rates = velocities.map(|it| points("velocities", it)).transpose()?.unwrap_or_default();
    if velocities.is_some() && rates.len() != given.len() {
        let expected = format!("({}, 3), like cloud", given.len());
        return Err(misshapen("velocities", &[rates.len(), 3], &expected));
    }
    let j = obstacle.map_or(Ok(0), |j| count("obstacle", j))?;
    let time = t.map(|t| finite_time(Some(t))).transpose()?;
    let update = PointUpdate { points: given, velocities: rates, time };
    Ok((update, usize::try_from(j).unwrap_or(usize::MAX)))
}

/// A reference: one vector or, of a pose in space, position and quaternion.
pub fn read_pose(given: &Bound<'_, PyAny>, out: &mut [f64]) -> PyResult<()> {
    match given.cast::<PySequence>() {
        Ok(pair) if out.len() == 7 && pair.len()? == 2 => {
            read_vector("x_ref[0]", &pair.get_item(0)?, &mut out[..3])?;
            read_vector("x_ref[1]", &pair.get_item(1)?, &mut out[3..])
        }
        _ => read_vector("x_ref", given, out),
    }
}

/// The obstacles of a call.
pub fn sequence<'py>(
    name: &str,
    obstacles: &Bound<'py, PyAny>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let sentence = format!("{name}: expected a sequence of obstacles");
    let fault = |error| instead(obstacles, error, || wrong_type(&sentence, obstacles));
    obstacles.try_iter().map_err(fault)?.collect()
}

/// How an obstacle is read: to be measured, or for a controller that is to know of it.
type ReadObstacle = fn(&mut AnyObstacles, &Table) -> Result<(), ScenarioError>;

/// These obstacles in addition to those in `all`, read by `read_one`.
pub fn read_obstacles(
    all: AnyObstacles,
    given: &[Bound<'_, PyAny>],
    read_one: ReadObstacle,
) -> PyResult<AnyObstacles> {
    read_obstacles_of("obstacles", all, given, read_one)
}

/// The same of what is called otherwise.
pub fn read_obstacles_of(
    list: &str,
    mut all: AnyObstacles,
    given: &[Bound<'_, PyAny>],
    read_one: ReadObstacle,
) -> PyResult<AnyObstacles> {
    for (j, obstacle) in given.iter().enumerate() {
        if j % 256 == 255 {
            obstacle.py().check_signals()?;
        }
        let name = format!("{list}[{j}]");
        read_one(&mut all, &named_document(&name, obstacle)?)
            .map_err(|error| errors::scenario(&error.inside(&name)))?;
    }
    Ok(all)
}
