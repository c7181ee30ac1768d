//! What drawing asks of shapes.

use crate::convert::{document, float_array, misshapen, values};
use crate::errors::{self, InputError};
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use vff_core::runtime::AnyObstacles;
use vff_core::world::space::faces_of_hull;

/// The faces of the convex hull of points in space.
///
/// Parameters
/// ----------
/// points : (k, 3) array_like
///     The points [m].
///
/// Returns
/// -------
/// list of list of int
///     Of each face the indices of its corners, counter-clockwise from outside. What lies in one plane is
///     one face.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If they have no hull that an obstacle can be made of.
#[pyfunction]
pub fn hull(points: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<usize>>> {
    let array = float_array("points", points)?;
    let [_, 3] = *array.shape() else {
        return Err(misshapen("points", array.shape(), "(k, 3)"));
    };
    let flat = values("points", &array)?;
    let (points, _) = flat.as_chunks::<3>();
    faces_of_hull(points).map_err(|error| InputError::new_err(format!("points: expected {error}")))
}

/// How an obstacle is turned over time, compared with its position at rest.
///
/// Parameters
/// ----------
/// obstacle : dict
///     The obstacle as in a scenario.
/// dimension : int
///     Of the space that it is in, 2 or 3.
/// times : (T,) array_like
///     Instants [s].
///
/// Returns
/// -------
/// (T, dimension, dimension) ndarray or None
///     A rotation matrix per instant; None if the obstacle does not turn.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If it is no obstacle there.
#[pyfunction]
pub fn rotations<'py>(
    py: Python<'py>,
    obstacle: &Bound<'py, PyAny>,
    dimension: usize,
    times: &Bound<'py, PyAny>,
) -> PyResult<Option<Bound<'py, PyArray3<f64>>>> {
    let obstacle = document(obstacle)?;
    let array = float_array("times", times)?;
    let [count] = *array.shape() else {
        return Err(misshapen("times", array.shape(), "(T,)"));
    };
    let mut obstacles = match dimension {
        2 => AnyObstacles::Plane(vec![]),
        _ => AnyObstacles::Space(vec![]),
    };
    obstacles.read(&obstacle).map_err(|error| errors::scenario(&error))?;
    let matrices = obstacles.rotations(&values("times", &array)?);
    matrices
        .map(|matrices| PyArray1::from_vec(py, matrices).reshape([count, dimension, dimension]))
        .transpose()
}
