//! Values between Python, TOML documents and slices. The one file for conversions.

use crate::errors::{InputError, InputTypeError};
use nalgebra::DMatrix;
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
use toml::{Table, Value};

/// Documents deeper than this are taken for endless: a dict inside itself has no bottom.
const MAX_DEPTH: usize = 32;

/// A document from a dict or from an object with `to_dict()`.
pub fn document(value: &Bound<'_, PyAny>) -> PyResult<Table> {
    named_document("", value)
}

/// The same, with a name for the message.
pub fn named_document(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Table> {
    let value = match value.getattr_opt("to_dict")? {
        Some(to_dict) => to_dict.call0()?,
        None => value.clone(),
    };
    match to_toml(&value, name)? {
        Value::Table(table) => Ok(table),
        _ => {
            let place = if name.is_empty() { "a scenario document" } else { name };
            Err(wrong_type(
                &format!("{place}: expected a dict or an object with to_dict()"),
                &value,
            ))
        }
    }
}

/// A scenario in any form that `vffnull.simulate` takes: what is no document yet, the name of a bundled
/// scenario or a path, is read by the Python package.
pub fn scenario_document(value: &Bound<'_, PyAny>) -> PyResult<Table> {
    if value.is_instance_of::<PyString>() || value.hasattr("__fspath__")? {
        let scenarios = value.py().import("vffnull.scenario")?;
        return document(&scenarios.call_method1("document_of", (value,))?);
    }
    document(value)
}

/// A number, whatever Python or NumPy type it has.
pub fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| wrong_type(&format!("{name}: expected a number"), value))
}

/// A whole number.
pub fn whole_number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<i64> {
    value.extract().map_err(|_| match value.is_instance_of::<PyInt>() {
        true => InputError::new_err(format!("{name}: {value} does not fit into 64 bits")),
        false => wrong_type(&format!("{name}: expected a whole number"), value),
    })
}

/// The fault of a value of another type.
pub fn wrong_type(sentence: &str, value: &Bound<'_, PyAny>) -> PyErr {
    let name = value.get_type().qualname().map_or_else(|_| "?".into(), |name| name.to_string());
    InputTypeError::new_err(format!("{sentence}, got {name}"))
}

/// Any value that a document can hold; `None` in a table is left out.
pub fn to_toml(value: &Bound<'_, PyAny>, path: &str) -> PyResult<Value> {
    nested(value, path, 0)
}

fn nested(value: &Bound<'_, PyAny>, path: &str, depth: usize) -> PyResult<Value> {
    if depth > MAX_DEPTH {
        let start: String = path.chars().take(60).collect();
        let sentence = format!("{start}…: nested deeper than {MAX_DEPTH} levels");
        return Err(InputError::new_err(sentence));
    }
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return value.extract().map(Value::Integer).map_err(|_| {
            InputError::new_err(format!("{path}: {value} does not fit into 64 bits"))
        });
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(Value::String(text.to_string()));
    }
    if let Ok(mapping) = value.cast::<PyMapping>() {
        let mut table = Table::new();
        for item in mapping.items()? {
            let (key, inner): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
            let key = match key.cast::<PyString>() {
                Ok(key) => key.to_string(),
                Err(_) => return Err(wrong_type(&format!("{path}: keys must be strings"), &key)),
            };
            if !inner.is_none() {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                table.insert(key, nested(&inner, &path, depth + 1)?);
            }
        }
        return Ok(Value::Table(table));
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let items = value.try_iter()?.enumerate();
        return items
            .map(|(i, item)| nested(&item?, &format!("{path}[{i}]"), depth + 1))
            .collect::<PyResult<_>>()
            .map(Value::Array);
    }
    for method in ["tolist", "to_dict"] {
        // NumPy arrays and scalars; arms, obstacles, settings.
        if let Some(method) = value.getattr_opt(method)? {
            return nested(&method.call0()?, path, depth + 1);
        }
    }
    let place = if path.is_empty() { String::new() } else { format!("{path}: ") };
    Err(wrong_type(&format!("{place}expected numbers, text, lists or tables"), value))
}

/// A document as Python values.
pub fn from_toml<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Boolean(flag) => PyBool::new(py, *flag).to_owned().into_any(),
        Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        Value::Float(number) => number.into_pyobject(py)?.into_any(),
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Datetime(date) => date.to_string().into_pyobject(py)?.into_any(),
        Value::Array(values) => {
            let items = values.iter().map(|value| from_toml(py, value));
            PyList::new(py, items.collect::<PyResult<Vec<_>>>()?)?.into_any()
        }
        Value::Table(table) => table_to_dict(py, table)?.into_any(),
    })
}

/// A table as a dict.
pub fn table_to_dict<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (key, value) in table {
        dict.set_item(key, from_toml(py, value)?)?;
    }
    Ok(dict)
}

/// Copies a vector of known length out of whatever NumPy makes an array of.
pub fn read_vector(name: &str, value: &Bound<'_, PyAny>, out: &mut [f64]) -> PyResult<()> {
    let n = out.len();
    if read_floats(value, out) {
        return finite(name, out);
    }
    let array = match value.extract::<PyReadonlyArray1<'_, f64>>() {
        Ok(array) => array,
        Err(_) => as_float_array(name, value)?
            .extract()
            .map_err(|_| wrong_shape(name, value, &format!("({n},)")))?,
    };
    let array = array.as_array();
    if array.len() != n {
        return Err(wrong_shape(name, value, &format!("({n},)")));
    }
    out.iter_mut().zip(array.iter()).for_each(|(out, value)| *out = *value);
    finite(name, out)
}

/// Copies a list or tuple of as many floats as there is room for, which is what most are and faster
/// than by way of an array. False for anything else.
fn read_floats(value: &Bound<'_, PyAny>, out: &mut [f64]) -> bool {
    let fill = |out: &mut f64, item: Bound<'_, PyAny>| {
        item.cast_exact::<PyFloat>().map(|item| *out = item.value()).is_ok()
    };
    if let Ok(list) = value.cast_exact::<PyList>() {
        list.len() == out.len() && out.iter_mut().zip(list).all(|(out, item)| fill(out, item))
    } else if let Ok(tuple) = value.cast_exact::<PyTuple>() {
        tuple.len() == out.len() && out.iter_mut().zip(tuple).all(|(out, item)| fill(out, item))
    } else {
        false
    }
}

/// A matrix of known shape, row by row, out of whatever NumPy makes an array of.
pub fn read_matrix(name: &str, value: &Bound<'_, PyAny>, shape: [usize; 2]) -> PyResult<Vec<f64>> {
    let array = as_float_array(name, value)?;
    let fault = || wrong_shape(name, value, &format!("({}, {})", shape[0], shape[1]));
    let array: PyReadonlyArray2<'_, f64> = array.extract().map_err(|_| fault())?;
    let array = array.as_array();
    if array.shape() != shape {
        return Err(fault());
    }
    let values: Vec<f64> = array.iter().copied().collect();
    finite(name, &values)?;
    Ok(values)
}

/// Refuses what is not a number or infinite.
pub fn finite(name: &str, values: &[f64]) -> PyResult<()> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(i) => {
            let value = values[i];
            Err(InputError::new_err(format!("{name}[{i}] must be finite, got {value}")))
        }
        None => Ok(()),
    }
}

/// A new vector of length `n`, by [`read_vector`].
pub fn vector(name: &str, value: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<f64>> {
    let mut out = vec![0.0; n];
    read_vector(name, value, &mut out)?;
    Ok(out)
}

/// `np.asarray(value, dtype=float)`.
pub fn as_float_array<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let numpy = value.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (value, "float64"));
    array.map_err(|_| wrong_type(&format!("{name}: expected numbers"), value))
}

/// The fault of an array of another shape.
pub fn wrong_shape(name: &str, value: &Bound<'_, PyAny>, expected: &str) -> PyErr {
    let shape = as_float_array(name, value)
        .and_then(|array| array.extract::<PyReadonlyArrayDyn<'_, f64>>())
        .map(|array| {
            let shape: Vec<_> = array.as_array().shape().iter().map(ToString::to_string).collect();
            let comma = if shape.len() == 1 { "," } else { "" };
            format!("({}{comma})", shape.join(", "))
        });
    match shape {
        Ok(shape) => InputError::new_err(format!("{name}: expected shape {expected}, got {shape}")),
        Err(error) => error,
    }
}

/// A vector as a new array.
pub fn array1<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}

/// Row-major values as a new array of `rows` rows, without a copy.
pub fn array2(
    py: Python<'_>,
    values: Vec<f64>,
    shape: [usize; 2],
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}

/// A matrix as a new array.
pub fn matrix<'py>(py: Python<'py>, matrix: &DMatrix<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let row_major = matrix.transpose().as_slice().to_vec();
    array2(py, row_major, [matrix.nrows(), matrix.ncols()])
}
