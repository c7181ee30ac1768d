//! Values between Python, TOML documents and slices. The one file for conversions.

use crate::errors::{InputError, InputTypeError};
use crate::loading::load_numpy;
use nalgebra::DMatrix;
use numpy::{
    PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyOverflowError, PyTypeError, PyUnicodeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
use std::fmt;
use toml::{Table, Value};
use vff_core::control::SelfMotionMap;
use vff_core::interrupt;
use vff_core::simulation::DepthPicture;

/// Documents deeper than this are taken for endless: a dict inside itself has no bottom.
const MAX_DEPTH: usize = 32;
/// Values of a document between two looks for signals.
const SIGNALS_EVERY: usize = 1 << 13;
/// The most characters of a user's text that a message quotes.
const QUOTED: usize = 80;

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

/// The document of those keywords that are given.
pub fn keywords(
    name: &str,
    py: Python<'_>,
    given: &[(&str, Option<&Bound<'_, PyAny>>)],
) -> PyResult<Table> {
    let document = PyDict::new(py);
    for (key, value) in given {
        if let Some(value) = value {
            document.set_item(key, value)?;
        }
    }
    named_document(name, &document)
}

/// A scenario in any form that `vffnull.simulate` takes: what is no document yet, the name of a bundled
/// scenario or a path, is read by the Python package.
pub fn scenario(value: &Bound<'_, PyAny>) -> PyResult<Table> {
    if value.is_instance_of::<PyString>() || value.hasattr("__fspath__")? {
        let scenarios = value.py().import("vffnull.model.scenario")?;
        return document(&scenarios.call_method1("document_of", (value,))?);
    }
    document(value)
}

/// Whether an exception says that a value does not fit. Any other is the user's: Ctrl-C, or what a signal handler or
/// a method of the value raises.
fn is_misfit(value: &Bound<'_, PyAny>, error: &PyErr) -> bool {
    let py = value.py();
    error.is_instance_of::<PyTypeError>(py)
        || error.is_instance_of::<PyValueError>(py)
        || error.is_instance_of::<PyOverflowError>(py)
}

/// The sentence in the place of an exception that says that `value` does not fit.
pub fn instead(value: &Bound<'_, PyAny>, error: PyErr, sentence: impl FnOnce() -> PyErr) -> PyErr {
    if is_misfit(value, &error) { sentence() } else { error }
}

/// A number, whatever Python or NumPy type it has.
pub fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|error| {
        instead(value, error, || wrong_type(&format!("{name}: expected a number"), value))
    })
}

/// A whole number.
pub fn whole_number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<i64> {
    value.extract().map_err(|error| {
        instead(value, error, || match value.is_instance_of::<PyInt>() {
            true => too_long(name, value),
            false => wrong_type(&format!("{name}: expected a whole number"), value),
        })
    })
}

/// A whole number from 0 on.
pub fn count(name: &str, value: &Bound<'_, PyAny>) -> PyResult<u64> {
    if let Ok(count) = value.extract::<u64>() {
        return Ok(count);
    }
    let given = whole_number(name, value)?;
    Err(InputError::new_err(format!("{name}: must be 0 or more, got {given}")))
}

/// The fault of a whole number of too many digits to be used, or to be written.
fn too_long(name: &str, value: &Bound<'_, PyAny>) -> PyErr {
    let bits = value.call_method0("bit_length").and_then(|bits| bits.extract::<u64>());
    match bits {
        Ok(bits) if bits <= 256 => match value.str().and_then(|text| Ok(text.to_str()?.to_owned()))
        {
            Ok(digits) => {
                InputError::new_err(format!("{name}: {digits} does not fit into 64 bits"))
            }
            Err(error) => error,
        },
        Ok(bits) => {
            let sentence = format!("{name}: a number of {bits} bits does not fit into 64 bits");
            InputError::new_err(sentence)
        }
        Err(error) => error,
    }
}

/// Text, which not every string of Python is. The name of what it is for is written only where it is none.
pub fn text(name: &(impl ToString + ?Sized), value: &Bound<'_, PyString>) -> PyResult<String> {
    value.to_str().map(ToOwned::to_owned).map_err(|error| {
        if !error.is_instance_of::<PyUnicodeError>(value.py()) {
            return error;
        }
        let name = name.to_string();
        let place = if name.is_empty() { String::new() } else { format!("{name}: ") };
        InputError::new_err(format!("{place}contains half a character (a lone surrogate)"))
    })
}

/// The beginning of a text, where it is long.
pub fn cut(text: &str) -> String {
    match text.char_indices().nth(QUOTED) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// The fault of a value of another type.
pub fn wrong_type(sentence: &str, value: &Bound<'_, PyAny>) -> PyErr {
    let name = value.get_type().qualname().map_or_else(|_| "?".into(), |name| name.to_string());
    InputTypeError::new_err(format!("{sentence}, got {}", cut(&name)))
}

/// Any value that a document can hold; `None` in a table is left out.
pub fn to_toml(value: &Bound<'_, PyAny>, path: &str) -> PyResult<Value> {
    Reader { read: 0 }.value(value, &Path::Root(path), 0)
}

/// Where a value of a document stands; written only where something is wrong with it.
enum Path<'a> {
    Root(&'a str),
    Key(&'a Path<'a>, &'a str),
    Index(&'a Path<'a>, usize),
}

impl fmt::Display for Path<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Root(name) => f.write_str(name),
            Self::Key(Self::Root(""), key) => f.write_str(&cut(key)),
            Self::Key(place, key) => write!(f, "{place}.{}", cut(key)),
            Self::Index(place, index) => write!(f, "{place}[{index}]"),
        }
    }
}

/// Reads a document, and looks for signals now and then.
struct Reader {
    read: usize,
}

impl Reader {
    fn value(
        &mut self,
        value: &Bound<'_, PyAny>,
        path: &Path<'_>,
        depth: usize,
    ) -> PyResult<Value> {
        self.read += 1;
        if self.read.is_multiple_of(SIGNALS_EVERY) {
            value.py().check_signals()?;
        }
        if let Ok(number) = value.cast_exact::<PyFloat>() {
            return Ok(Value::Float(number.value()));
        }
        if depth > MAX_DEPTH {
            let start: String = path.to_string().chars().take(60).collect();
            let sentence = format!("{start}…: nested deeper than {MAX_DEPTH} levels");
            return Err(InputError::new_err(sentence));
        }
        if value.is_instance_of::<PyBool>() {
            return Ok(Value::Boolean(value.extract()?));
        }
        if value.is_instance_of::<PyInt>() {
            let read = value.extract().map(Value::Integer);
            return read
                .map_err(|error| instead(value, error, || too_long(&path.to_string(), value)));
        }
        if value.is_instance_of::<PyFloat>() {
            return Ok(Value::Float(value.extract()?));
        }
        if let Ok(string) = value.cast::<PyString>() {
            return Ok(Value::String(text(path, string)?));
        }
        if let Ok(list) = value.cast::<PyList>() {
            return self.items(list.iter().map(Ok), list.len(), path, depth);
        }
        if let Ok(tuple) = value.cast::<PyTuple>() {
            return self.items(tuple.iter().map(Ok), tuple.len(), path, depth);
        }
        if let Ok(mapping) = value.cast::<PyMapping>() {
            return self.table(mapping, path, depth);
        }
        for method in ["tolist", "to_dict"] {
            // NumPy arrays and scalars; arms, obstacles, settings.
            if let Some(method) = value.getattr_opt(method)? {
                return self.value(&method.call0()?, path, depth + 1);
            }
        }
        let place = path.to_string();
        let place = if place.is_empty() { place } else { format!("{place}: ") };
        Err(wrong_type(&format!("{place}expected numbers, text, lists or tables"), value))
    }

    fn items<'py>(
        &mut self,
        items: impl Iterator<Item = PyResult<Bound<'py, PyAny>>>,
        count: usize,
        path: &Path<'_>,
        depth: usize,
    ) -> PyResult<Value> {
        let mut values = Vec::with_capacity(count);
        for (i, item) in items.enumerate() {
            match item.and_then(|item| self.value(&item, &Path::Index(path, i), depth + 1)) {
                Ok(value) => values.push(value),
                Err(error) => {
                    if i > SIGNALS_EVERY {
                        interrupt::leave(values);
                    }
                    return Err(error);
                }
            }
        }
        Ok(Value::Array(values))
    }

    fn table(
        &mut self,
        mapping: &Bound<'_, PyMapping>,
        path: &Path<'_>,
        depth: usize,
    ) -> PyResult<Value> {
        let mut table = Table::with_capacity(mapping.len()?);
        for item in mapping.items()? {
            let (key, inner): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
            let Ok(key) = key.cast::<PyString>() else {
                return Err(wrong_type(&format!("{path}: keys must be strings"), &key));
            };
            let key = text(path, key)?;
            if !inner.is_none() {
                let value = self.value(&inner, &Path::Key(path, &key), depth + 1)?;
                table.insert(key, value);
            }
        }
        Ok(Value::Table(table))
    }
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
            let item = |(i, value): (usize, &Value)| {
                if i % SIGNALS_EVERY == SIGNALS_EVERY - 1 {
                    py.check_signals()?;
                }
                from_toml(py, value)
            };
            let items = values.iter().enumerate().map(item);
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

/// A table in the order in which TOML is written: what is no table first. The library takes any order, but in time that
/// grows with the square of the length. Adds to `values` how many there are.
pub fn values_first(table: Table, values: &mut usize) -> Table {
    let (mut first, mut then) = (Table::with_capacity(table.len()), vec![]);
    for (key, value) in table {
        match ordered(value, values) {
            value if is_table(&value) => then.push((key, value)),
            value => drop(first.insert(key, value)),
        }
    }
    first.extend(then);
    first
}

fn ordered(value: Value, values: &mut usize) -> Value {
    *values += 1;
    match value {
        Value::Table(table) => Value::Table(values_first(table, values)),
        Value::Array(array) => {
            Value::Array(array.into_iter().map(|value| ordered(value, values)).collect())
        }
        value => value,
    }
}

/// Whether a value has a header of its own, or one for each of its items.
fn is_table(value: &Value) -> bool {
    match value {
        Value::Table(_) => true,
        Value::Array(items) => items.first().is_some_and(Value::is_table),
        _ => false,
    }
}

/// Copies a vector of known length out of whatever NumPy makes an array of.
pub fn read_vector(name: &str, value: &Bound<'_, PyAny>, out: &mut [f64]) -> PyResult<()> {
    copy_vector(name, value, out)?;
    finite(name, out)
}

/// The same, finite or not.
pub fn copy_vector(name: &str, value: &Bound<'_, PyAny>, out: &mut [f64]) -> PyResult<()> {
    if !read_floats(value, out) && !read_plain(value, out) {
        let array = float_array(name, value)?;
        if array.shape() != [out.len()] {
            return Err(misshapen(name, array.shape(), &format!("({},)", out.len())));
        }
        out.copy_from_slice(array.readonly().as_slice()?);
    }
    Ok(())
}

/// Copies a plain array of the right length. False for anything else, also for one whose numbers stand at odd places.
fn read_plain(value: &Bound<'_, PyAny>, out: &mut [f64]) -> bool {
    let Ok(array) = value.cast_exact::<PyArray1<f64>>() else { return false };
    let Ok(array) = array.try_readonly() else { return false };
    let Ok(values) = array.as_slice() else { return false };
    let fits = values.len() == out.len();
    if fits {
        out.copy_from_slice(values);
    }
    fits
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
    let array = float_array(name, value)?;
    if array.shape() != shape {
        return Err(misshapen(name, array.shape(), &format!("({}, {})", shape[0], shape[1])));
    }
    values(name, &array)
}

/// The numbers of an array, row by row.
pub fn values(name: &str, array: &Bound<'_, PyArrayDyn<f64>>) -> PyResult<Vec<f64>> {
    let array = array.readonly();
    let (given, mut values) = (array.as_slice()?, vec![]);
    if values.try_reserve_exact(given.len()).is_err() {
        return Err(PyMemoryError::new_err(format!("{name}: no room for {} numbers", given.len())));
    }
    values.extend_from_slice(given);
    finite(name, &values)?;
    Ok(values)
}

/// Points in space, (k, 3).
pub fn points(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 3]>> {
    let array = float_array(name, value)?;
    match array.shape() {
        [_, 3] | [0] => {}
        shape => return Err(misshapen(name, shape, "(k, 3)")),
    }
    let numbers = array.readonly();
    let (points, _) = numbers.as_slice()?.as_chunks::<3>();
    match points.iter().position(|point| !point.iter().all(|x| x.is_finite())) {
        Some(i) => finite(&format!("{name}[{i}]"), &points[i]).map(|()| vec![]),
        None => Ok(points.to_vec()),
    }
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

/// The same, finite or not.
pub fn any_vector(name: &str, value: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<f64>> {
    let mut out = vec![0.0; n];
    copy_vector(name, value, &mut out)?;
    Ok(out)
}

fn misfit(name: &str, value: &Bound<'_, PyAny>, error: PyErr) -> PyErr {
    instead(value, error, || wrong_type(&format!("{name}: expected numbers"), value))
}

/// What NumPy makes an array of, and the kind of what is in it, by NumPy's letter.
///
/// # Errors
/// For masked arrays, whose mask would be dropped without a word, and what is no array.
pub fn any_array<'py>(
    name: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyAny>, String)> {
    load_numpy(value.py())?;
    let numpy = value.py().import("numpy")?;
    let given =
        numpy.call_method1("asanyarray", (value,)).map_err(|error| misfit(name, value, error))?;
    if !given.is_exact_instance_of::<PyUntypedArray>() && given.getattr_opt("mask")?.is_some() {
        let sentence = format!("{name}: expected numbers, got a masked array: fill it first");
        return Err(InputTypeError::new_err(sentence));
    }
    let kind = given.getattr("dtype")?.getattr("kind")?.extract()?;
    Ok((given, kind))
}

/// A copy of whatever NumPy makes an array of numbers of: in rows, and aligned, wherever they stood before.
///
/// # Errors
/// For complex numbers, dates, text and masked arrays, of which a conversion would drop a part without a word.
pub fn float_array<'py>(
    name: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let (given, kind) = any_array(name, value)?;
    let misfit = |error| misfit(name, value, error);
    let numpy = value.py().import("numpy")?;
    if !"fiubO".contains(&kind) {
        let dtype: String = given.getattr("dtype")?.str()?.extract()?;
        let sentence = format!("{name}: expected numbers, got an array of {}", cut(&dtype));
        return Err(InputTypeError::new_err(sentence));
    }
    let keywords = PyDict::new(value.py());
    keywords.set_item("dtype", "float64")?;
    keywords.set_item("order", "C")?;
    let copy = numpy.call_method("array", (given,), Some(&keywords)).map_err(misfit)?;
    Ok(copy.cast_into::<PyArrayDyn<f64>>()?)
}

/// The fault of an array of another shape.
pub fn misshapen(name: &str, shape: &[usize], expected: &str) -> PyErr {
    let numbers: Vec<_> = shape.iter().map(ToString::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    let shape = numbers.join(", ");
    InputError::new_err(format!("{name}: expected shape {expected}, got ({shape}{comma})"))
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

/// What a search of the self-motion has found, by name.
pub fn self_motion_map(
    py: Python<'_>,
    map: Option<SelfMotionMap>,
) -> PyResult<Option<Bound<'_, PyDict>>> {
    let Some(map) = map else { return Ok(None) };
    let found = PyDict::new(py);
    let shape = [map.places, map.instants];
    found.set_item("distances", PyArray1::from_vec(py, map.distances).reshape(shape)?)?;
    let path = map.path.into_iter().map(|place| i64::try_from(place).expect("few places"));
    found.set_item("path", PyArray1::from_iter(py, path))?;
    for (name, value) in [
        ("spacing", map.spacing),
        ("step", map.step),
        ("elapsed", map.elapsed),
        ("margin", map.margin),
        ("clearance", map.clearance),
    ] {
        found.set_item(name, value)?;
    }
    Ok(Some(found))
}

/// Pictures of depth cameras, (rows, columns) each.
pub fn depth_pictures(
    py: Python<'_>,
    pictures: Vec<DepthPicture>,
) -> PyResult<Vec<Bound<'_, PyArray2<f32>>>> {
    let array = |DepthPicture { columns, depths }| {
        let shape = [depths.len() / columns, columns];
        PyArray1::from_vec(py, depths).reshape(shape)
    };
    pictures.into_iter().map(array).collect()
}
