//! What drawing asks of shapes.

use crate::convert::{float_array, misshapen, values};
use crate::errors::InputError;
use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
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
