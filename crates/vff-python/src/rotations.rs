//! Orientations as quaternions and as matrices, many at once.

use crate::convert::{float_array, misshapen};
use nalgebra::Matrix3;
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use vff_core::math::UnitQuaternion;

/// Rotation matrices of quaternions.
///
/// Parameters
/// ----------
/// quaternions : (…, 4) array_like
///     [w, x, y, z], of any length but 0.
///
/// Returns
/// -------
/// (…, 3, 3) ndarray
///     The matrices; NaN where a quaternion is no rotation.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If the shape is another one.
///
/// Examples
/// --------
/// >>> from vffnull._core import matrices
/// >>> matrices([0.0, 0.0, 0.0, 1.0]).diagonal()
/// array([-1., -1.,  1.])
#[pyfunction]
pub fn matrices<'py>(
    py: Python<'py>,
    quaternions: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let array = float_array("quaternions", quaternions)?;
    let [outer @ .., 4] = array.shape() else {
        return Err(misshapen("quaternions", array.shape(), "(…, 4)"));
    };
    let given = array.readonly();
    let (rows, _) = given.as_slice()?.as_chunks::<4>();
    let matrix = |row: &[f64; 4]| UnitQuaternion::normalised(*row).matrix().transpose();
    let found: Vec<f64> = rows.iter().flat_map(|row| matrix(row).as_slice().to_vec()).collect();
    Ok(PyArray1::from_vec(py, found).reshape([outer, &[3, 3]].concat())?.into_any())
}

/// Quaternions of rotation matrices.
///
/// Parameters
/// ----------
/// matrices : (…, 3, 3) array_like
///     Rotation matrices.
///
/// Returns
/// -------
/// (…, 4) ndarray
///     Unit quaternions [w, x, y, z] with w ≥ 0; NaN where a matrix is.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If the shape is another one.
///
/// Examples
/// --------
/// >>> from vffnull._core import quaternions
/// >>> quaternions([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
/// array([1., 0., 0., 0.])
#[pyfunction]
pub fn quaternions<'py>(
    py: Python<'py>,
    matrices: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let array = float_array("matrices", matrices)?;
    let [outer @ .., 3, 3] = array.shape() else {
        return Err(misshapen("matrices", array.shape(), "(…, 3, 3)"));
    };
    let given = array.readonly();
    let (rows, _) = given.as_slice()?.as_chunks::<9>();
    let quaternion =
        |row: &[f64; 9]| UnitQuaternion::from_matrix(&Matrix3::from_row_slice(row)).to_array();
    let found: Vec<f64> = rows.iter().flat_map(quaternion).collect();
    Ok(PyArray1::from_vec(py, found).reshape([outer, &[4]].concat())?.into_any())
}
