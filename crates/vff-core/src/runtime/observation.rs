//! What an agent sees of a closed loop: what the law sees.

use crate::math::{Pose, UnitQuaternion};
use crate::robot::{Model, Robot};
use crate::simulation::{ClosedLoop, System};
use crate::world::Positions;

/// How many numbers a pose in space has when it is written.
pub(super) const POSE_IN_SPACE: usize = 7;

/// The axes of a hand that say how it is turned for a task of dimension `m`: two determine the third and, other than
/// quaternions, do not jump where the hand does not (Zhou et al., 2019); to pointing its own z axis alone matters.
pub(super) fn shown_axes(m: usize) -> &'static [usize] {
    if m == 6 { &[0, 1] } else { &[2] }
}

/// Appends these axes of a pose in space, as it is written; of other poses nothing.
fn append_axes(pose: &[f64], m: usize, out: &mut Vec<f64>) {
    if let Ok([_, _, _, w, x, y, z]) = <[f64; POSE_IN_SPACE]>::try_from(pose) {
        let matrix = UnitQuaternion::new([w, x, y, z]).unwrap_or_default().matrix();
        for &axis in shown_axes(m) {
            out.extend_from_slice(matrix.column(axis).as_slice());
        }
    }
}

/// Appends what the controller knows, in the order of [`Task::layout`](super::episode::Task::layout).
pub(super) fn append<S: System<D, M>, const D: usize, const M: usize>(
    inner: &mut ClosedLoop<S, D, M>,
    out: &mut Vec<f64>,
) {
    let controller = inner.controller();
    let (robot, reference) = (controller.robot(), controller.reference());
    let (q, arm) = (robot.configuration(), inner.arm());
    let turning = || (0..q.len()).filter(|&i| !arm.slides(i)).map(|i| q[i]);
    out.extend(turning().map(f64::cos));
    out.extend(turning().map(f64::sin));
    out.extend((0..q.len()).filter(|&i| arm.slides(i)).map(|i| q[i]));
    out.extend_from_slice(robot.velocity());
    out.extend_from_slice(&controller.pose().as_slice()[..D]);
    out.extend_from_slice(&reference.x.as_slice()[..D]);
    out.extend_from_slice(&reference.dx.as_slice()[..D]);
    out.extend_from_slice(controller.error().as_slice());
    if S::Pose::WIDTH == POSE_IN_SPACE {
        append_axes(controller.pose().as_slice(), M, out);
        append_axes(reference.x.as_slice(), M, out);
        out.extend_from_slice(&reference.dx.as_slice()[D..]);
    }
    out.extend_from_slice(controller.external_torque().unwrap_or_default());
    if !inner.knows_obstacles() {
        out.extend_from_slice(controller.forces().clearance());
        return;
    }
    let (n, count) = (robot.dof(), inner.world().count());
    if count == 0 {
        return;
    }
    let first = out.len();
    out.resize(first + (1 + D) * n, f64::INFINITY);
    let (clearance, nearest) = out[first..].split_at_mut(n);
    inner.for_each_pair(|contact| {
        if contact.distance < clearance[contact.link] {
            clearance[contact.link] = contact.distance;
            let way = contact.witness - contact.point;
            nearest[D * contact.link..][..D].copy_from_slice(way.as_slice());
        }
    });
    inner.world().append_to(out);
    for j in 0..count {
        out.extend_from_slice(inner.world().velocity(j).as_slice());
    }
}
