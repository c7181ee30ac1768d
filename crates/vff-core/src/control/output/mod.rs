//! What stands between the torque of the law and a robot, after the command and never inside the law.
//!
//! [`Output`] turns a torque of the law into what is sent: friction is
//! compensated (`friction`), gravity is left out where the robot adds it, nothing is beyond a torque limit, and nothing changes
//! faster than the drives allow. `supervision` decides cycle by cycle whether that torque is sent at all: safe start, safe end, watchdog.

mod admission;
mod begin;
mod clock;
mod friction;
mod hold;
mod supervision;

use super::limits::largest_share;
use super::{CommandSettings, Gravity, TorqueRange};
use crate::robot::Robot;
pub(crate) use clock::Clock;
use friction::Friction;

pub(crate) use admission::unwrap;
pub use begin::BeginError;
pub use supervision::{Phase, Supervisor};

/// Share of the torque limits that is used where the robot adds gravity: it does so where it is, a little off where it was measured.
const MEASURED: f64 = 0.998;

/// From a torque of the law to what is sent to the robot. Nothing allocates after construction.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::control::settings::{CommandSettings, Gravity};
/// use vff_core::control::{Output, TorqueRange};
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, Robot, planar::Link};
///
/// let settings = CommandSettings { gravity: Gravity::Robot, ..CommandSettings::default() };
/// let mut arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::new(0.0, -9.81))).state();
/// arm.update(&[0.0; 2], &[0.0; 2]);
/// let mut output = Output::new(&settings, 2);
/// let mut carries = [0.0; 2];
/// arm.gravity_torque(&mut carries);
/// output.convert(&arm, &carries);
/// assert!(output.wanted().iter().all(|tau| tau.abs() < 1e-12)); // the robot adds it
/// assert_eq!(TorqueRange::new(vec![1000.0; 2]).lower.len(), 2); // [N·m/s]
/// ```
#[derive(Debug, Clone)]
pub struct Output {
    gravity: Gravity,
    friction: Option<Friction>,
    /// \[N·m/s\] per joint, empty without limit.
    rate: Vec<f64>,
    /// The least and the most that may be sent, as far as a state is known \[N·m\].
    bounds: Vec<[f64; 2]>,
    /// What is to be sent if the rate allows.
    wanted: Vec<f64>,
    sent: Vec<f64>,
    /// What was sent the last two times before that.
    before: [Vec<f64>; 2],
    /// g, and what is scaled to fit.
    scratch: [Vec<f64>; 2],
}

impl Output {
    /// What `settings` say, for `n` joints. Nothing has been sent yet.
    pub fn new(settings: &CommandSettings, n: usize) -> Self {
        let zeros = || vec![0.0; n];
        let rates = |given: &crate::math::ScalarOrVec| (0..n).map(|i| given.get(i)).collect();
        Self {
            gravity: settings.gravity,
            friction: Friction::new(settings, n),
            rate: settings.torque_rate.as_ref().map_or(vec![], rates),
            bounds: vec![[f64::NEG_INFINITY, f64::INFINITY]; n],
            wanted: zeros(),
            sent: zeros(),
            before: [zeros(), zeros()],
            scratch: [zeros(), zeros()],
        }
    }

    /// What is to be sent, however fast it changes \[N·m, N\].
    pub fn wanted(&self) -> &[f64] {
        &self.wanted
    }

    /// What was sent last \[N·m, N\].
    pub fn sent(&self) -> &[f64] {
        &self.sent
    }

    /// What was sent before that.
    pub fn sent_before(&self) -> &[f64] {
        &self.before[0]
    }

    /// What is to be sent for the torque `tau` of the law at the state of `robot`, however fast it changes \[N·m, N\]; within
    /// the torque limits.
    pub fn convert<R: Robot<D>, const D: usize>(&mut self, robot: &R, tau: &[f64]) -> &[f64] {
        let Self { friction, wanted, .. } = self;
        wanted.copy_from_slice(tau);
        if let Some(friction) = friction {
            friction.compensate(robot.velocity(), &robot.limits().torque, wanted);
        }
        self.look_at(robot);
        let Self { wanted, scratch: [theirs, _], .. } = self;
        wanted.iter_mut().zip(theirs).for_each(|(wanted, theirs)| *wanted -= *theirs);
        self.confine();
        &self.wanted
    }

    /// Writes where the torque of the law may be at the state of `robot` if `sent` is what has been sent until now: what is
    /// made of it changes no faster than the drives allow in `period` \[s\], and is within the torque limits, gravity that the
    /// robot adds included or not. Where both cannot be, the rate holds.
    pub fn write_range<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        sent: &[f64],
        period: f64,
        range: &mut TorqueRange,
    ) {
        self.find_added(robot);
        range.period = period;
        let Self { rate, bounds, scratch: [_, added], .. } = self;
        for (i, rate) in rate.iter().enumerate() {
            let [low, high] = [sent[i] - rate * period, sent[i] + rate * period];
            let [least, most] = bounds[i].map(|bound| bound.max(low).min(high));
            range.lower[i] = least - added[i];
            range.upper[i] = most - added[i];
            range.present[i] = sent[i] - added[i];
        }
    }

    /// Writes which torque of the law acts at the state of `robot` while `sent` is sent \[N·m, N\].
    pub fn write_acting<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        sent: &[f64],
        acting: &mut [f64],
    ) {
        self.find_added(robot);
        self.take_off_added(sent, acting);
    }

    /// The same of what is wanted instead.
    pub fn write_wanted<R: Robot<D>, const D: usize>(&mut self, robot: &R, tau: &mut [f64]) {
        self.find_added(robot);
        self.take_off_added(&self.wanted, tau);
    }

    /// Wants what that torque of the law is at the state of `robot` \[N·m, N\], within the torque limits.
    pub fn want<R: Robot<D>, const D: usize>(&mut self, robot: &R, tau: &[f64]) {
        self.find_added(robot);
        let Self { wanted, scratch: [_, added], .. } = self;
        let torques = wanted.iter_mut().zip(tau).zip(added);
        torques.for_each(|((wanted, tau), added)| *wanted = tau + *added);
        self.confine();
    }

    /// Takes in the state, and finds what is sent beyond the torque of the law, into the second scratch: friction that is compensated,
    /// without gravity that the robot adds.
    fn find_added<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        self.look_at(robot);
        let Self { friction, scratch: [theirs, added], .. } = self;
        added.fill(0.0);
        if let Some(friction) = friction {
            friction.compensate(robot.velocity(), &[], added);
        }
        added.iter_mut().zip(theirs).for_each(|(added, theirs)| *added -= *theirs);
    }

    /// Writes what of a torque is that of the law, after [`find_added`](Self::find_added).
    fn take_off_added(&self, torque: &[f64], law: &mut [f64]) {
        let torques = law.iter_mut().zip(torque).zip(&self.scratch[1]);
        torques.for_each(|((law, torque), added)| *law = torque - added);
    }

    /// Takes in the state: what the robot adds by itself, into the first scratch, and what may be sent beside it. The limits bind what
    /// is sent, and what the drives exert.
    fn look_at<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        let Self { gravity, bounds, scratch: [theirs, _], .. } = self;
        match gravity {
            Gravity::Controller => theirs.fill(0.0),
            Gravity::Robot => robot.gravity_torque(theirs),
        }
        let joints = bounds.iter_mut().zip(theirs).zip(&robot.limits().torque);
        for ((bounds, theirs), limit) in joints {
            *bounds = match gravity {
                Gravity::Controller => [-limit, *limit],
                Gravity::Robot => beside(*theirs, *limit),
            };
        }
    }

    /// Brings what is wanted between the bounds.
    fn confine(&mut self) {
        for (wanted, [least, most]) in self.wanted.iter_mut().zip(&self.bounds) {
            *wanted = wanted.clamp(*least, *most);
        }
    }

    /// What is to be sent to damp the arm: −`d` M q̇ within the torque limits, and gravity if it is ours (T115), with what is
    /// `carried` beside it \[N·m, N\]: nothing if empty.
    pub fn damp<R: Robot<D>, const D: usize>(&mut self, robot: &R, d: f64, carried: &[f64]) {
        self.look_at(robot);
        let Self { gravity, bounds, wanted, scratch: [_, damping], .. } = self;
        gravity.write_ours(robot, wanted);
        wanted.iter_mut().zip(carried).for_each(|(wanted, carried)| *wanted += carried);
        damping_torque(robot, d, wanted, bounds, damping);
        wanted.iter_mut().zip(damping).for_each(|(wanted, damping)| *wanted += *damping);
        self.confine();
    }

    /// Takes but a `share` of what is wanted at the state of `robot`; the rest is gravity if it is ours, what was sent `beside` it before
    /// \[N·m, N\], and damping as above.
    pub fn blend<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        beside: &[f64],
        d: f64,
        share: f64,
    ) {
        let Self { gravity, wanted, bounds, scratch: [rest, damping], .. } = self;
        gravity.write_ours(robot, rest);
        rest.iter_mut().zip(beside).for_each(|(rest, beside)| *rest += beside);
        damping_torque(robot, d, rest, bounds, damping);
        for ((wanted, rest), damping) in wanted.iter_mut().zip(rest).zip(damping) {
            *wanted = share * *wanted + (1.0 - share) * (*rest + *damping);
        }
    }

    /// Adds `times` the gravity that is ours at the state of `robot` to `out` \[N·m, N\].
    pub fn add_gravity<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        times: f64,
        out: &mut [f64],
    ) {
        let Self { gravity, scratch: [ours, _], .. } = self;
        gravity.write_ours(robot, ours);
        out.iter_mut().zip(ours).for_each(|(out, ours)| *out += times * *ours);
    }

    /// Begins as if the robot had been held still where it is: what is sent changes from that torque on.
    pub fn begin_at_rest<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        self.damp(robot, 0.0, &[]);
        self.sent.copy_from_slice(&self.wanted);
    }

    /// Begins as if `sent` had been sent before.
    pub fn begin_at(&mut self, sent: &[f64]) {
        self.sent.copy_from_slice(sent);
    }

    /// Sends what is wanted, within the torque limits, as far as it may change within `period` \[s\]: that comes first, where both
    /// cannot be. Of a joint whose torque is not finite what was sent last is sent.
    pub fn send(&mut self, period: f64) -> &[f64] {
        let Self { rate, bounds, wanted, sent, before: [before, earlier], .. } = self;
        earlier.copy_from_slice(before);
        before.copy_from_slice(sent);
        for ((sent, wanted), [least, most]) in sent.iter_mut().zip(wanted).zip(bounds) {
            if wanted.is_finite() {
                *sent = wanted.clamp(*least, *most);
            }
        }
        for ((sent, before), rate) in sent.iter_mut().zip(before).zip(rate) {
            let most = *rate * period;
            *sent = sent.max(*before - most).min(*before + most); // does not panic, whatever they are
        }
        &self.sent
    }

    /// Brings `beside` \[N·m, N\], which is sent beside what was sent last and was so before, to `tau` as far as that fits: all of it
    /// gives way to the torque limits, and it changes, all of it alike if that can be, as fast as the rate leaves room in `period` \[s\].
    pub fn add(&self, tau: &mut [f64], beside: &mut [f64], period: f64) {
        let Self { rate, bounds, sent, before: [before, _], .. } = self;
        let share = largest_share(sent, tau, bounds.iter().copied()).unwrap_or(0.0);
        tau.iter_mut().for_each(|tau| *tau *= share);
        if rate.is_empty() {
            return beside.copy_from_slice(tau);
        }
        let range = |i: usize, beside: &[f64]| {
            let (last, most) = (before[i] + beside[i], rate[i] * period);
            bounds[i].map(|bound| bound.max(last - most).min(last + most))
        };
        // As a share of the way from what was beside to what is wanted there; else joint by joint.
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        for (i, tau) in tau.iter().enumerate() {
            let [a, b] = range(i, beside).map(|end| end - sent[i] - beside[i]);
            let way = tau - beside[i];
            if way != 0.0 {
                (low, high) = (low.max((a / way).min(b / way)), high.min((a / way).max(b / way)));
            }
        }
        for (i, tau) in tau.iter().enumerate() {
            let [least, most] = range(i, beside);
            let part = if low <= high { high } else { 1.0 };
            let wanted = sent[i] + beside[i] + part * (tau - beside[i]);
            beside[i] = wanted.max(least).min(most) - sent[i];
        }
    }

    /// Takes back what was sent last; twice in a row at most.
    pub fn undo(&mut self) {
        let Self { sent, before: [before, earlier], .. } = self;
        sent.copy_from_slice(before);
        before.copy_from_slice(earlier);
    }
}

impl Gravity {
    /// Writes the gravity that is sent to hold `robot` where it is: none where the robot adds it \[N·m, N\].
    fn write_ours<R: Robot<D>, const D: usize>(self, robot: &R, out: &mut [f64]) {
        match self {
            Self::Controller => robot.gravity_torque(out),
            Self::Robot => out.fill(0.0),
        }
    }
}

/// The least and the most that may be sent to a joint beside the gravity that the robot adds \[N·m, N\]: its torque limit binds what is
/// sent, and what the drive exerts.
fn beside(gravity: f64, limit: f64) -> [f64; 2] {
    let limit = MEASURED * limit;
    [(-limit - gravity.min(0.0)).min(0.0), (limit - gravity.max(0.0)).max(0.0)]
}

/// Between which `ends` the torque of the law may be at the state of `robot` where that adds `gravity`, a workspace \[N·m, N\].
pub(crate) fn write_ends<R: Robot<D>, const D: usize>(
    robot: &R,
    gravity: &mut [f64],
    ends: &mut [[f64; 2]],
) {
    robot.gravity_torque(gravity);
    for ((ends, gravity), limit) in ends.iter_mut().zip(gravity).zip(&robot.limits().torque) {
        *ends = beside(*gravity, *limit).map(|end| end + *gravity);
    }
}

/// `out = −d M q̇`, as much of it as the bounds leave beside `rest`.
fn damping_torque<R: Robot<D>, const D: usize>(
    robot: &R,
    d: f64,
    rest: &[f64],
    bounds: &[[f64; 2]],
    out: &mut [f64],
) {
    robot.mass_mul(robot.velocity(), out);
    out.iter_mut().for_each(|momentum| *momentum *= -d);
    let share = |part: f64, left: f64| if part * left > 0.0 { left / part } else { 1.0 };
    let joints = rest.iter().zip(&*out).zip(bounds);
    let most = joints.fold(1.0_f64, |most, ((rest, part), [least, top])| {
        let end = if *part < 0.0 { least } else { top };
        most.min(share(*part, end - rest))
    });
    out.iter_mut().for_each(|tau| *tau *= most);
}
