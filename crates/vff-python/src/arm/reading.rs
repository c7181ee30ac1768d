//! Arms from descriptions: those of scenarios, those that others have read, and chains of equal links.

use super::Arm;
use crate::convert::{number, read_vector, to_toml, whole_number};
use crate::errors::{self, InputError};
use crate::loading::load_numpy;
use crate::run::prepared;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::iter;
use toml::{Table, Value};
use vff_core::robot::description::Frame;
use vff_core::runtime::AnyArm;
use vff_core::scenario::{Scenario, read_load};

impl Arm {
    /// How many joints it has.
    pub(super) fn n(&self) -> usize {
        self.arm.dof()
    }

    /// Reads an arm from its part of a scenario.
    pub(super) fn read(py: Python<'_>, document: Table) -> PyResult<Self> {
        load_numpy(py)?;
        let arm = AnyArm::read(&document).map_err(|error| errors::arm(&error))?;
        let document = arm.document(document);
        Ok(Self { arm, document })
    }
}

/// The part of a scenario that has these values.
pub(super) fn given_values<const N: usize>(
    given: [(&str, Option<&Bound<'_, PyAny>>); N],
) -> PyResult<Table> {
    let values = given.into_iter().filter_map(|(name, value)| Some((name, value?)));
    values.map(|(name, value)| Ok((name.into(), to_toml(value, name)?))).collect()
}

/// The description of a chain of `n` equal links with this length, mass, radius and gravity.
pub(super) fn uniform(
    n: &Bound<'_, PyAny>,
    [length, mass, radius, gravity]: [Option<&Bound<'_, PyAny>>; 4],
) -> PyResult<Table> {
    let n = whole_number("n", n)?;
    let Some(count) = usize::try_from(n).ok().filter(|n| (1..=100_000).contains(n)) else {
        return Err(InputError::new_err(format!("n: must be from 1 to 100000, got {n}")));
    };
    let read = |name, value: Option<&Bound<'_, PyAny>>, default| {
        value.map_or(Ok(default), |value| number(name, value)).map(Value::Float)
    };
    let mut document = Table::new();
    document.insert("lengths".into(), Value::Array(vec![read("length", length, 1.0)?; count]));
    document.insert("masses".into(), read("mass", mass, 1.0)?);
    document.insert("radius".into(), read("radius", radius, 0.0)?);
    document.insert("gravity".into(), read("gravity", gravity, 0.0)?);
    Ok(document)
}

/// An arm of the package's own readers of models, which return its description.
pub(super) fn read_by<'py>(
    reader: &str,
    model: &Bound<'py, PyAny>,
    arguments: &Bound<'py, PyTuple>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Arm> {
    let py = model.py();
    let all: Vec<_> = iter::once(model.clone()).chain(arguments.iter()).collect();
    let all = PyTuple::new(py, all)?;
    let read = py.import("vffnull.arms")?.getattr(reader)?.call(all, options)?;
    Arm::read(py, crate::convert::document(&read)?)
}

/// The physical arm of a scenario document, payload included.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be used.
#[pyfunction]
pub fn plant(py: Python<'_>, document: &Bound<'_, PyAny>) -> PyResult<Arm> {
    let document = crate::convert::document(document)?;
    let (arm, document) =
        prepared(py, &document, |scenario: Scenario| AnyArm::plant(&scenario, &document))?;
    Ok(Arm { arm, document })
}

/// Numbers of a known count, or as many zeros.
fn some<const N: usize>(name: &str, given: Option<&Bound<'_, PyAny>>) -> PyResult<[f64; N]> {
    let mut out = [0.0; N];
    given.map_or(Ok(()), |given| read_vector(name, given, &mut out))?;
    Ok(out)
}

fn listed<const N: usize>(numbers: [f64; N]) -> Value {
    Value::Array(numbers.map(Value::Float).into())
}

/// `arm` with a body at its tip.
pub(super) fn with_load(
    arm: &Arm,
    mass: &Bound<'_, PyAny>,
    com: Option<&Bound<'_, PyAny>>,
    inertia: Option<&Bound<'_, PyAny>>,
    shapes: Option<&Bound<'_, PyAny>>,
) -> PyResult<Arm> {
    let mut given = Table::new();
    given.insert("mass".into(), Value::Float(number("mass", mass)?));
    if let Some(com) = com {
        given.insert("com".into(), listed(some::<3>("com", Some(com))?));
    }
    if let Some(inertia) = inertia {
        given.insert("inertia".into(), listed(some::<6>("inertia", Some(inertia))?));
    }
    if let Some(shapes) = shapes {
        given.insert("shapes".into(), to_toml(shapes, "shapes")?);
    }
    let load = read_load(&given).map_err(|error| errors::arm(&error))?;
    let made = arm.arm.with_load(&load, arm.document.clone());
    made.map(|(arm, document)| Arm { arm, document }).map_err(|error| errors::arm(&error))
}

/// `arm` with its tip elsewhere.
pub(super) fn with_tool(
    arm: &Arm,
    position: &Bound<'_, PyAny>,
    orientation: Option<&Bound<'_, PyAny>>,
) -> PyResult<Arm> {
    let mut tool = Frame { position: some("position", Some(position))?, ..Frame::default() };
    if orientation.is_some() {
        tool.orientation = some("orientation", orientation)?;
    }
    let made = arm.arm.with_tool(tool, arm.document.clone());
    made.map(|(arm, document)| Arm { arm, document }).map_err(|error| errors::arm(&error))
}
