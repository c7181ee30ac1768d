//! `distances`: every pair of link and obstacle, with the derivatives of its distance.

use crate::arm::Arm;
use crate::controller::{read_world, sequence};
use crate::convert::{float_array, misshapen, values, wrong_type};
use crate::errors::InputError;
use crate::watch::interruptible;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use vff_core::control::distance::DistanceRate;
use vff_core::interrupt;
use vff_core::math::memory;
use vff_core::robot::{Model, Robot};
use vff_core::world::CollisionQuery;

type Indices = Py<PyArray1<i64>>;
type Values = Py<PyArrayDyn<f64>>;

/// What `distances` returns; P pairs, one per link and obstacle, link by link.
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
    /// Derivative of d by the joint angles, n̂ᵀJ_c, (P, n) [m/rad].
    gradient: Values,
    /// Rate ḋ, the motion of the obstacle included, (P,) [m/s].
    rate: Values,
    /// Acceleration d̈ while the joints do not accelerate, (P,) [m/s²]: d̈ = gradient @ ddq + bias.
    bias: Values,
    /// Unit vector n̂ from the obstacle towards the link, (P, 2).
    normal: Values,
    /// Nearest point on the axis of the link, (P, 2) [m].
    point: Values,
    /// Nearest point on the surface of the obstacle, (P, 2) [m].
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
///     Joint angles [rad] and velocities [rad/s].
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
    let given = sequence(obstacles)?;
    let mut world = read_world(&given)?;

    let (states, pairs) = (batch.unwrap_or(1), n.saturating_mul(given.len()));
    // Seven numbers, three pairs of coordinates counted singly, and a gradient, of every pair.
    let numbers = states.saturating_mul(pairs).saturating_mul(9 + n).saturating_add(2 * pairs);
    memory::fits(numbers).map_err(|error| {
        InputError::new_err(format!(
            "distances of {states} states, {n} links and {} obstacles: {error}",
            given.len()
        ))
    })?;
    let (mut link, mut obstacle) = (Vec::with_capacity(pairs), Vec::with_capacity(pairs));
    for i in 0..n {
        for j in 0..given.len() {
            link.push(i64::try_from(i)?);
            obstacle.push(i64::try_from(j)?);
        }
    }
    let room = |width: usize| Vec::with_capacity(states * pairs * width);
    let [mut distance, mut rate, mut bias] = [room(1), room(1), room(1)];
    let [mut normal, mut point, mut witness] = [room(2), room(2), room(2)];
    let mut gradient = vec![0.0; states * pairs * n];
    interruptible(py, || {
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
                    interrupt::spend(64 + n);
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
    })?;
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
