//! `distances`: every pair of link and obstacle, with the derivatives of its distance.

use crate::arm::Arm;
use crate::controller::read_world;
use crate::convert::{as_float_array, finite, wrong_shape, wrong_type};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use vff_core::control::distance::DistanceRate;
use vff_core::robot::Robot;
use vff_core::world::CollisionQuery;

type Indices = Py<PyArray1<i64>>;
type Values = Py<PyArrayDyn<f64>>;

/// Distances at one state or at many; P = n k pairs.
#[pyclass(frozen, get_all, module = "vffnull")]
pub struct Distances {
    link: Indices,
    obstacle: Indices,
    distance: Values,
    gradient: Values,
    rate: Values,
    bias: Values,
    normal: Values,
    point: Values,
    witness: Values,
}

/// Numbers with their shape.
fn read(name: &str, value: &Bound<'_, PyAny>) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let array = as_float_array(name, value)?;
    let array = array.extract::<PyReadonlyArrayDyn<'_, f64>>()?;
    let view = array.as_array();
    let values: Vec<f64> = view.iter().copied().collect();
    finite(name, &values)?;
    Ok((values, view.shape().to_vec()))
}

/// The signed distance of every link from every obstacle, and how it changes.
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
        _ => return Err(wrong_shape("q", q, &format!("({n},) or (batch, {n})"))),
    };
    let (speeds, speeds_shape) = read("dq", dq)?;
    if speeds_shape != shape {
        return Err(wrong_shape("dq", dq, "that of q"));
    }
    let times = match t {
        None => vec![0.0],
        Some(t) => {
            let (times, shape) = read("t", t)?;
            match (&shape[..], batch) {
                ([], _) => times,
                ([count], Some(states)) if *count == states => times,
                _ => return Err(wrong_shape("t", t, "() or (batch,)")),
            }
        }
    };
    let given: Vec<Bound<'_, PyAny>> = obstacles
        .try_iter()
        .map_err(|_| wrong_type("obstacles: expected a sequence of obstacles", obstacles))?
        .collect::<PyResult<_>>()?;
    let mut world = read_world(&given)?;

    let pairs = n * given.len();
    let (mut link, mut obstacle) = (Vec::with_capacity(pairs), Vec::with_capacity(pairs));
    for i in 0..n {
        for j in 0..given.len() {
            link.push(i64::try_from(i)?);
            obstacle.push(i64::try_from(j)?);
        }
    }
    let states = batch.unwrap_or(1);
    let room = |width: usize| Vec::with_capacity(states * pairs * width);
    let [mut distance, mut rate, mut bias] = [room(1), room(1), room(1)];
    let [mut normal, mut point, mut witness] = [room(2), room(2), room(2)];
    let mut gradient = vec![0.0; states * pairs * n];
    py.detach(|| {
        let mut state = arm.arm.state();
        let mut rows = gradient.chunks_exact_mut(n);
        for (b, (q, dq)) in angles.chunks_exact(n).zip(speeds.chunks_exact(n)).enumerate() {
            state.update(q, dq);
            world.update(times[b % times.len()]);
            let bodies = state.bodies();
            world.for_each_contact(
                bodies,
                f64::INFINITY,
                |_, _| (),
                |contact| {
                    let motion = DistanceRate::new(&state, contact);
                    distance.push(contact.distance);
                    rate.push(motion.rate);
                    bias.push(motion.bias);
                    normal.extend_from_slice(contact.normal.as_slice());
                    point.extend_from_slice(contact.point.as_slice());
                    witness.extend_from_slice(contact.witness.as_slice());
                    if let Some(row) = rows.next() {
                        state.point_jacobian_tr_mul(
                            contact.link,
                            &contact.point,
                            &contact.normal,
                            row,
                        );
                    }
                },
            );
        }
    });
    let array = |values: Vec<f64>, width: Option<usize>| -> PyResult<Values> {
        let shape: Vec<usize> = batch.into_iter().chain([pairs]).chain(width).collect();
        Ok(PyArray1::from_vec(py, values).reshape(shape)?.unbind())
    };
    Ok(Distances {
        link: PyArray1::from_vec(py, link).unbind(),
        obstacle: PyArray1::from_vec(py, obstacle).unbind(),
        distance: array(distance, None)?,
        gradient: array(gradient, Some(n))?,
        rate: array(rate, None)?,
        bias: array(bias, None)?,
        normal: array(normal, Some(2))?,
        point: array(point, Some(2))?,
        witness: array(witness, Some(2))?,
    })
}
