//! `distances`: every pair of link and obstacle, with the derivatives of its distance.

use crate::arm::Arm;
use crate::call::{read_obstacles, sequence};
use crate::convert::{
    array1, float_array, misshapen, points as read_points, values, vector, wrong_type,
};
use crate::errors::InputError;
use crate::watch::interruptible;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use vff_core::math::memory;
use vff_core::perception::surface_distances as of_points;
use vff_core::runtime::{AnyObstacles, AnyState, DistanceTable};

type Indices = Py<PyArray1<i64>>;
type Values = Py<PyArrayDyn<f64>>;
/// Of points: how far each is, and on which link.
type OfPoints<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

/// What `distances` returns; P pairs, one per link and obstacle, link by link.
///
/// In space a link has one pair for each of its shapes.
///
/// For a batch of states every array but `link` and `obstacle` has the batch as its first dimension.
#[pyclass(frozen, get_all, module = "vffnull")]
pub struct Distances {
    /// Link of each pair, from 0 at the base, (P,).
    link: Indices,
    /// Obstacle of each pair, in the order given, (P,).
    obstacle: Indices,
    /// Signed distance d of the two surfaces, (P,) [m]; negative in penetration.
    distance: Values,
    /// Derivative of d by the joint positions, n̂ᵀJ_c, (P, n) [m/rad or m/m].
    gradient: Values,
    /// Rate ḋ, the motion of the obstacle included, (P,) [m/s].
    rate: Values,
    /// Acceleration d̈ while the joints do not accelerate, (P,) [m/s²]: d̈ = gradient @ ddq + bias.
    bias: Values,
    /// Unit vector n̂ from the obstacle towards the link, (P, 2) or (P, 3).
    normal: Values,
    /// Nearest point on the axis of the link, of a box or hull on its surface, (P, 2) or (P, 3) [m].
    point: Values,
    /// Nearest point on the surface of the obstacle, (P, 2) or (P, 3) [m].
    witness: Values,
}

/// Numbers with their shape.
fn read(name: &str, value: &Bound<'_, PyAny>) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let array = float_array(name, value)?;
    Ok((values(name, &array)?, array.shape().to_vec()))
}

#[pymethods]
impl Distances {
    fn __repr__(&self, py: Python<'_>) -> String {
        let shape = self.distance.bind(py).shape().to_vec();
        let (pairs, states) = (shape[shape.len() - 1], shape[..shape.len() - 1].first());
        let batch = states.map_or(String::new(), |states| format!(" at {states} states"));
        format!("<Distances: {pairs} pairs of link and obstacle{batch}>")
    }
}

/// The signed distance of every link from every obstacle, and exactly how it changes.
///
/// What a barrier or a filter at torque level needs: d̈ = gradient @ ddq + bias holds as long as the same
/// features (end, side, corner, face) remain nearest; where they change, d̈ jumps (docs/theory.md, T60–T62).
///
/// Parameters
/// ----------
/// arm : Arm
///     The arm's model.
/// q, dq : (n,) or (batch, n) array_like
///     Joint positions [rad or m] and velocities.
/// obstacles : sequence of Obstacle or dict
///     The obstacles with their motions.
/// t : float or (batch,) array_like, optional
///     Time [s] at which the motions are taken.
///
/// Returns
/// -------
/// Distances
///     One row per pair of link and obstacle; with a batch, one such table per state.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If an array has the wrong shape or is not finite.
///
/// Examples
/// --------
/// >>> arm = Arm.uniform(2)
/// >>> disc = {"shape": {"kind": "circle", "radius": 0.5}, "position": [1.5, 1.0]}
/// >>> distances(arm, [0.0, 0.0], [0.0, 0.0], [disc]).distance.round(3).tolist()
/// [0.618, 0.5]
#[pyfunction]
#[pyo3(signature = (arm, q, dq, obstacles, t=None), text_signature = "(arm, q, dq, obstacles, t=0.0)")]
pub fn distances(
    py: Python<'_>,
    arm: &Bound<'_, PyAny>,
    q: &Bound<'_, PyAny>,
    dq: &Bound<'_, PyAny>,
    obstacles: &Bound<'_, PyAny>,
    t: Option<&Bound<'_, PyAny>>,
) -> PyResult<Distances> {
    let arm = arm.cast::<Arm>().map_err(|_| wrong_type("arm: expected an Arm", arm))?.get();
    let n = arm.arm.dof();
    let (angles, shape) = read("q", q)?;
    let batch = match shape[..] {
        [last] if last == n => None,
        [count, last] if last == n => Some(count),
        _ => return Err(misshapen("q", &shape, &format!("({n},) or (batch, {n})"))),
    };
    let (speeds, speeds_shape) = read("dq", dq)?;
    if speeds_shape != shape {
        return Err(misshapen("dq", &speeds_shape, "that of q"));
    }
    let times = match t {
        None => vec![0.0],
        Some(t) => {
            let (times, shape) = read("t", t)?;
            match (&shape[..], batch) {
                ([], _) => times,
                ([count], Some(states)) if *count == states => times,
                _ => return Err(misshapen("t", &shape, "() or (batch,)")),
            }
        }
    };
    let given = sequence("obstacles", obstacles)?;
    let nothing = arm.arm.no_obstacles();
    let read = read_obstacles(nothing, &given, AnyObstacles::read)?;
    let states = batch.unwrap_or(1);
    memory::fits(DistanceTable::numbers(&arm.arm, states, given.len())).map_err(|error| {
        InputError::new_err(format!(
            "distances of {states} states, {n} links and {} obstacles: {error}",
            given.len()
        ))
    })?;
    let found = interruptible(py, || arm.arm.distances(read, &angles, &speeds, &times))?;
    let (pairs, d) = (found.pairs.len(), arm.arm.dimension());
    let column = |of: usize| -> PyResult<Indices> {
        let numbers = found.pairs.iter().map(|pair| i64::try_from(pair[of]));
        Ok(PyArray1::from_vec(py, numbers.collect::<Result<_, _>>()?).unbind())
    };
    let array = |values: Vec<f64>, width: Option<usize>| -> PyResult<Values> {
        let shape: Vec<usize> = batch.into_iter().chain([pairs]).chain(width).collect();
        Ok(PyArray1::from_vec(py, values).reshape(shape)?.unbind())
    };
    Ok(Distances {
        link: column(0)?,
        obstacle: column(1)?,
        distance: array(found.distance, None)?,
        gradient: array(found.gradient, Some(n))?,
        rate: array(found.rate, None)?,
        bias: array(found.bias, None)?,
        normal: array(found.normal, Some(d))?,
        point: array(found.point, Some(d))?,
        witness: array(found.witness, Some(d))?,
    })
}

/// How far points are from the surface of an arm, and on which link that is nearest.
///
/// Parameters
/// ----------
/// arm : Arm
///     An arm in space.
/// q : (n,) array_like
///     Joint positions [rad or m].
/// points : (k, 3) array_like
///     Points in the world [m].
///
/// Returns
/// -------
/// distances : (k,) ndarray
///     To the nearest of the shapes `Arm.collision` [m], negative within it; infinite where there is none.
/// links : (k,) ndarray of int
///     Which of `Arm.link_names` has it; -1 is the base.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If the arm is in the plane, or an array has the wrong shape or is not finite.
///
/// Examples
/// --------
/// >>> arm = Arm.named("panda")
/// >>> distances, links = surface_distances(arm, [0, -0.8, 0, -2.4, 0, 1.6, 0.8], [[0.0, 0.0, -1.0]])
/// >>> float(distances[0].round(2)), links.tolist()
/// (0.93, [-1])
#[pyfunction]
pub fn surface_distances<'py>(
    arm: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    points: &Bound<'py, PyAny>,
) -> PyResult<OfPoints<'py>> {
    let py = arm.py();
    let arm = &arm.cast::<Arm>().map_err(|_| wrong_type("arm: expected an Arm", arm))?.get().arm;
    let n = arm.dof();
    let AnyState::Space(state) = arm.at(&vector("q", q, n)?, &vec![0.0; n]) else {
        let sentence = "arm: points are in space, and this arm is in the plane";
        return Err(InputError::new_err(sentence));
    };
    let points = read_points("points", points)?;
    let found = interruptible(py, || of_points(&state, &points))?;
    let distances: Vec<f64> = found.iter().map(|(distance, _)| *distance).collect();
    let number = |link: Option<usize>| link.and_then(|link| i64::try_from(link).ok()).unwrap_or(-1);
    let links = found.into_iter().map(|(_, link)| number(link)).collect();
    Ok((array1(py, &distances), PyArray1::from_vec(py, links)))
}
