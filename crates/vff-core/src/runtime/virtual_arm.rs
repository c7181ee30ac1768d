//! For robots that take positions or velocities: the closed loop runs on the model, and its state is the set point.
//!
//! The joints of the model have limits of speed, acceleration and jerk ([`LimitedJoint`]), and the law sees what they make of it. If the
//! robot parts from the model, because it is held or its drives are weak, the model comes to the robot within the same limits.

use super::controller::{AnyController, CycleError, MissedStart, Target};
use crate::control::MotionLimits;
use crate::control::output::{BeginError, unwrap};
use crate::math::{JointBounds, JointMotion, LimitedJoint, ScalarOrVec};
use crate::trajectory::{JointSpline, Peaks};
use std::mem::swap;

/// A plan that was made with a limit may exceed it by such a share, by rounding.
const SLIGHT: f64 = 1e-6;
/// A robot at rest has joints that are no faster than this share of their speed limit, or than this \[rad/s, m/s\], as measured.
const AT_REST: [f64; 2] = [0.05, 0.02];

/// What a set point comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Course {
    /// From the law.
    Following,
    /// Robot and model have parted: the model comes to the robot.
    Rejoining,
    /// The robot has not been heard of, or the torque of the law is not finite: the model stops, or stands.
    Waiting,
    /// The end was asked for: it stops.
    Stopping,
    /// It stands.
    Finished,
}

impl Course {
    /// The name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Following => "following",
            Self::Rejoining => "rejoining",
            Self::Waiting => "waiting",
            Self::Stopping => "stopping",
            Self::Finished => "finished",
        }
    }
}

/// What the joints of a robot that takes set points may do, each or all alike.
#[derive(Debug, Clone, PartialEq)]
pub struct SetPointLimits {
    /// \[rad/s, m/s\], > 0; that of the arm if it is not given.
    pub speed: Option<ScalarOrVec>,
    /// \[rad/s², m/s²\], > 0.
    pub acceleration: ScalarOrVec,
    /// \[rad/s³, m/s³\], > 0.
    pub jerk: ScalarOrVec,
    /// How far a joint of the robot may be from its set point \[rad, m\], > 0.
    pub threshold: f64,
}

/// Why there is no such arm.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VirtualArmError {
    /// A number that is none.
    #[error("{name} must be finite and greater than 0, got {given}")]
    NotPositive {
        /// Which.
        name: &'static str,
        /// What it is.
        given: f64,
    },
    /// So many numbers as there are no joints.
    #[error("{name}: expected {expected} numbers, got {given}")]
    Length {
        /// Which.
        name: &'static str,
        /// n.
        expected: usize,
        /// How many there are.
        given: usize,
    },
    /// The reference is a plan that they cannot follow.
    #[error(
        "{name}: the plan of the reference needs up to {asks:.4} of joint {index}, and {given} is allowed; plan more slowly, by limits of \
         acceleration and jerk or a smaller share of all, speed"
    )]
    TooFast {
        /// Which.
        name: &'static str,
        /// Which joint.
        index: usize,
        /// What the plan takes.
        asks: f64,
        /// What there is.
        given: f64,
    },
    /// Neither the arm nor the limits say it.
    #[error("speed: the arm has no velocity_limits, so it must be given")]
    NoSpeed,
    /// A posture that is none.
    #[error("q[{index}] must be finite, got {given}")]
    NotFinite {
        /// Which joint.
        index: usize,
        /// What it is.
        given: f64,
    },
    /// A robot that is not at rest.
    #[error("joint {index} moves at {given:.3} where set points begin, which are at rest")]
    Moves {
        /// Which joint.
        index: usize,
        /// How fast \[rad/s, m/s\].
        given: f64,
    },
    /// A gain that is unstable at this period.
    #[error(transparent)]
    Gain(#[from] BeginError),
    /// No loop begins with this posture.
    #[error(transparent)]
    Elsewhere(#[from] MissedStart),
}

/// The arm that the set points are those of. Nothing allocates after construction.
///
/// # Example
/// ```
/// use vff_core::math::ScalarOrVec;
/// use vff_core::runtime::{
///     AnyArm, AnyController, Course, SetPointLimits, Target, VirtualArm, VirtualArmError,
/// };
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let arm = AnyArm::read(&toml::toml! { model = "panda" })?;
/// let mut controller = AnyController::new(&arm, &toml::Table::new())?;
/// let limits = SetPointLimits {
///     speed: None, // the arm's
///     acceleration: ScalarOrVec::Uniform(5.0),
///     jerk: ScalarOrVec::Uniform(500.0),
///     threshold: 0.1,
/// };
/// let q = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8];
/// let mut model = VirtualArm::new(&mut controller, &limits, 0.001, &q)?;
/// let target = Target { x: &[0.5, 0.0, 0.5], dx: &[0.0; 3], ddx: &[0.0; 3] };
/// for k in 0..100 {
///     model.step(&mut controller, 0.001 * f64::from(k), Some(&target), None)?;
/// }
/// let [_, _, ddq] = model.set_point();
/// assert!(ddq.iter().all(|ddq| ddq.abs() <= 5.0));
/// assert_eq!(model.course(), Course::Following);
/// let refused = VirtualArm::new(&mut controller, &limits, -1.0, &q).unwrap_err();
/// assert!(matches!(refused, VirtualArmError::NotPositive { .. }));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct VirtualArm {
    period: f64,
    threshold: f64,
    joints: Vec<LimitedJoint>,
    /// q, q̇, q̈ as they are handed out.
    out: [Vec<f64>; 3],
    /// What the law wants of the joints.
    wanted: Vec<f64>,
    /// Which joints turn without an end; where the robot is, what it said last of that, and before, with their turns counted.
    endless: Vec<bool>,
    heard_at: Vec<f64>,
    said: Vec<f64>,
    said_before: Vec<f64>,
    /// What the joints can do, as the law has it.
    able: MotionLimits,
    course: Course,
    /// Whether the robot has ever been heard of, and in how many cycles in a row it has not been since.
    heard: bool,
    missed: usize,
    stops: bool,
}

impl VirtualArm {
    /// Share of the threshold within which they have met.
    const MET: f64 = 0.25;
    /// Cycles in a row without a word of the robot after which the model stops.
    const PATIENCE: usize = 20;
    /// A joint that is no faster stands \[rad/s, m/s\], if it can come to rest within a period by what its limits allow.
    const STANDS: f64 = 1e-3;

    /// The model of the arm of `controller`, at rest at `q`, in cycles of `period` \[s\]; see [`begin`](Self::begin).
    ///
    /// # Errors
    /// If a number is not what it has to be, or a joint is far beyond its stops.
    pub fn new(
        controller: &mut AnyController,
        limits: &SetPointLimits,
        period: f64,
        q: &[f64],
    ) -> Result<Self, VirtualArmError> {
        let mut this = Self::anywhere(controller, limits, period)?;
        if q.len() != this.joints.len() {
            let expected = this.joints.len();
            return Err(VirtualArmError::Length { name: "q", expected, given: q.len() });
        }
        this.begin(controller, q)?;
        Ok(this)
    }

    /// What the joints can do.
    pub(super) fn able(&self) -> &MotionLimits {
        &self.able
    }

    /// One that has yet to begin.
    pub(super) fn anywhere(
        controller: &AnyController,
        limits: &SetPointLimits,
        period: f64,
    ) -> Result<Self, VirtualArmError> {
        let n = controller.dof();
        let arm = controller.limits();
        let of_arm = (!arm.velocity.is_empty()).then(|| ScalarOrVec::Each(arm.velocity.clone()));
        let speed = limits.speed.clone().or(of_arm).ok_or(VirtualArmError::NoSpeed)?;
        let SetPointLimits { acceleration, jerk, threshold, .. } = limits;
        for (name, given) in [("speed", &speed), ("acceleration", acceleration), ("jerk", jerk)] {
            let values = given.values();
            if matches!(given, ScalarOrVec::Each(_)) && values.len() != n {
                return Err(VirtualArmError::Length { name, expected: n, given: values.len() });
            }
            values.iter().try_for_each(|value| positive(name, *value))?;
        }
        positive("threshold", *threshold)?;
        positive("period", period)?;
        BeginError::check(controller.settings(), period)?;
        let bounds = |i: usize| JointBounds {
            position: arm.joint.get(i).copied().unwrap_or([f64::NEG_INFINITY, f64::INFINITY]),
            speed: speed.get(i),
            acceleration: acceleration.get(i),
            jerk: jerk.get(i),
        };
        let all = |given: &ScalarOrVec| (0..n).map(|i| given.get(i)).collect();
        let able =
            MotionLimits { speed: all(&speed), acceleration: all(acceleration), jerk: all(jerk) };
        follows(controller.plan().map(JointSpline::peaks).as_ref(), &able)?;
        let zeros = || vec![0.0; n];
        Ok(Self {
            period,
            threshold: *threshold,
            joints: (0..n).map(|i| LimitedJoint::new(bounds(i), 0.0)).collect(),
            out: [zeros(), zeros(), zeros()],
            wanted: zeros(),
            endless: controller.endless(),
            heard_at: zeros(),
            said: zeros(),
            said_before: zeros(),
            able,
            course: Course::Following,
            heard: false,
            missed: 0,
            stops: false,
        })
    }

    /// Begins anew, at rest at `q`. The controller forgets the past, and the reference of its scenario begins with the first
    /// [`step`](Self::step), at whatever time that is; from where that [is not](super::ErasedController::missed_start), the model stays.
    ///
    /// # Errors
    /// If a number is not finite, or a joint is far beyond its stops: it has not begun then.
    ///
    /// # Panics
    /// If it has the wrong length.
    pub fn begin(
        &mut self,
        controller: &mut AnyController,
        q: &[f64],
    ) -> Result<(), VirtualArmError> {
        assert_eq!(q.len(), self.joints.len());
        if let Some(index) = q.iter().position(|q| !q.is_finite()) {
            return Err(VirtualArmError::NotFinite { index, given: q[index] });
        }
        controller.begin_at_rest(q, Some((&self.able, self.period)))?;
        self.heard_at.copy_from_slice(q);
        self.said.copy_from_slice(q);
        for (joint, q) in self.joints.iter_mut().zip(q) {
            joint.rest_at(*q);
        }
        (self.course, self.heard, self.missed, self.stops) = (Course::Following, false, 0, false);
        self.hand_out();
        Ok(())
    }

    /// Whether a robot with these velocities \[rad/s, m/s\] is at rest, as far as one that is measured can be.
    ///
    /// # Errors
    /// With the joint that is not.
    pub(super) fn rests(&self, dq: &[f64]) -> Result<(), VirtualArmError> {
        let joints = self.joints.iter().zip(dq).enumerate();
        let mut moving = joints.filter(|(_, (joint, dq))| {
            dq.abs() > f64::max(AT_REST[0] * joint.bounds().speed, AT_REST[1])
        });
        let moves =
            |(index, (_, dq)): (usize, (_, &f64))| VirtualArmError::Moves { index, given: *dq };
        moving.next().map_or(Ok(()), |it| Err(moves(it)))
    }

    /// Positions, velocities and accelerations of the joints at the set point, (n) each.
    pub fn set_point(&self) -> [&[f64]; 3] {
        self.out.each_ref().map(Vec::as_slice)
    }

    /// What it comes from.
    pub fn course(&self) -> Course {
        self.course
    }

    /// Stops the model from the next cycle on.
    pub fn stop(&mut self) {
        self.stops = true;
    }

    /// One cycle, from the set point at `t` \[s\] to the next: by the law of `controller` for this target, or for the reference of
    /// its scenario, or to stay where it is. `measured` is (q, q̇) of the robot, if it has been heard of; numbers that are
    /// none are no word of it.
    ///
    /// # Errors
    /// If the target is no reference, or `controller` has begun another loop since, or has forgotten these after their end; then nothing has changed.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn step(
        &mut self,
        controller: &mut AnyController,
        t: f64,
        target: Option<&Target<'_>>,
        measured: Option<[&[f64]; 2]>,
    ) -> Result<Course, CycleError> {
        if !controller.sets_points() {
            return Err(CycleError::NotBegun);
        }
        target.map_or(Ok(()), |target| controller.check(target))?;
        let measured =
            measured.filter(|state| state.iter().all(|x| x.iter().all(|x| x.is_finite())));
        let measured = measured.filter(|[q, _]| self.hear(q));
        controller.set_point([&self.out[0], &self.out[1]], t, target, &mut self.wanted)?;
        self.course = self.choose(measured.is_some());
        if self.course == Course::Finished {
            controller.end_set_points();
        }
        let rate = MotionLimits::RATE;
        let reacts = controller.settings().fastest_rate();
        self.able.fit(&mut self.wanted, controller.planned_acceleration(), &self.out[1], reacts);
        for (i, joint) in self.joints.iter().enumerate() {
            let JointMotion { q: at, dq: moves, .. } = joint.motion();
            match (self.course, measured) {
                (Course::Following, _) => {}
                (Course::Rejoining, measured) => {
                    let goes = measured.map_or(0.0, |[_, dq]| dq[i]); // it stays, as far as is known
                    let ddq = -rate * rate * (at - self.heard_at[i]) - 2.0 * rate * (moves - goes);
                    let share = MotionLimits::behind_jerk(ddq, 2.0 * rate, joint.bounds().jerk);
                    self.wanted[i] = share * ddq;
                }
                _ => self.wanted[i] = -rate * moves,
            }
        }
        if matches!(self.course, Course::Waiting | Course::Stopping | Course::Finished) {
            self.brake_alike();
        }
        for (joint, wanted) in self.joints.iter_mut().zip(&self.wanted) {
            joint.advance(*wanted, self.period);
        }
        self.hand_out();
        Ok(self.course)
    }

    /// Makes of how all joints would be braked what they can do, and of what changes in this cycle what they can change, all of it alike:
    /// joint by joint, a motion that does not move the end effector would do so as it ends.
    fn brake_alike(&mut self) {
        let Self { joints, wanted, period, .. } = self;
        let mut share = 1.0_f64;
        for (joint, wanted) in joints.iter().zip(&*wanted) {
            let JointBounds { acceleration, jerk, .. } = joint.bounds();
            let soon = MotionLimits::behind_jerk(*wanted, MotionLimits::RATE, *jerk);
            share = share.min(soon).min(acceleration / wanted.abs());
        }
        wanted.iter_mut().for_each(|wanted| *wanted *= share);
        let change = joints.iter().zip(&*wanted).map(|(joint, wanted)| {
            joint.bounds().jerk * *period / (wanted - joint.motion().ddq).abs()
        });
        let share = change.fold(1.0, f64::min);
        for (joint, wanted) in joints.iter().zip(wanted) {
            let ddq = joint.motion().ddq;
            *wanted = ddq + share * (*wanted - ddq);
        }
    }

    /// Whether the robot can be at `q`: what is farther than the threshold from its set point, from where it was, and from what it said
    /// last may be one wild reading.
    fn hear(&mut self, q: &[f64]) -> bool {
        swap(&mut self.said, &mut self.said_before);
        self.said.copy_from_slice(q);
        unwrap(&mut self.said, &self.heard_at, &self.endless);
        let is_near = |there: &[f64]| {
            self.said.iter().zip(there).all(|(q, there)| (q - there).abs() <= self.threshold)
        };
        let can_be =
            [&self.out[0], &self.heard_at, &self.said_before].into_iter().any(|it| is_near(it));
        if can_be {
            self.heard_at.copy_from_slice(&self.said);
        }
        can_be
    }

    /// What the next set point comes from.
    fn choose(&mut self, is_heard: bool) -> Course {
        if self.stops {
            let h = self.period;
            let stands = |joint: &LimitedJoint| {
                let JointBounds { acceleration, jerk, .. } = joint.bounds();
                let most = Self::STANDS.min(0.5 * acceleration * h).min(0.5 * jerk * h * h);
                joint.motion().dq.abs() <= most && joint.motion().ddq.abs() <= 0.5 * jerk * h
            };
            return match self.joints.iter().all(stands) {
                true => Course::Finished,
                false => Course::Stopping,
            };
        }
        if !is_heard {
            self.missed = self.missed.saturating_add(1);
            let waits = self.heard && self.missed >= Self::PATIENCE;
            return match self.course {
                _ if waits || !self.is_defined() => Course::Waiting,
                Course::Rejoining => Course::Rejoining,
                _ => Course::Following,
            };
        }
        (self.heard, self.missed) = (true, 0);
        let apart = self
            .joints
            .iter()
            .zip(&self.heard_at)
            .fold(0.0, |most: f64, (joint, q)| most.max((joint.motion().q - q).abs()));
        let allowed = match self.course {
            Course::Rejoining => Self::MET * self.threshold,
            _ => self.threshold,
        };
        match apart > allowed {
            true => Course::Rejoining,
            false if self.is_defined() => Course::Following,
            false => Course::Waiting,
        }
    }

    /// Whether the law says something.
    fn is_defined(&self) -> bool {
        self.wanted.iter().all(|ddq| ddq.is_finite())
    }

    fn hand_out(&mut self) {
        let [q, dq, ddq] = &mut self.out;
        // Whoever is told a velocity last keeps it.
        let goes = if self.course == Course::Finished { 0.0 } else { 1.0 };
        for (i, joint) in self.joints.iter().enumerate() {
            let motion = joint.motion();
            (q[i], dq[i], ddq[i]) = (motion.q, goes * motion.dq, goes * motion.ddq);
        }
    }
}

/// Whether a plan with these peaks can be followed: what the law wants is cut to what the joints can, and a plan that asks for more is left.
fn follows(plan: Option<&Peaks>, able: &MotionLimits) -> Result<(), VirtualArmError> {
    let Some(Peaks { speeds, accelerations, jerks, .. }) = plan else { return Ok(()) };
    let asked = [
        ("speed", speeds, &able.speed),
        ("acceleration", accelerations, &able.acceleration),
        ("jerk", jerks, &able.jerk),
    ];
    for (name, asks, given) in asked {
        let excess = |i: &usize| asks[*i] / given[*i];
        let worst = (0..asks.len()).max_by(|a, b| excess(a).total_cmp(&excess(b)));
        if let Some(index) = worst.filter(|i| excess(i) > 1.0 + SLIGHT) {
            let (asks, given) = (asks[index], given[index]);
            return Err(VirtualArmError::TooFast { name, index, asks, given });
        }
    }
    Ok(())
}

fn positive(name: &'static str, given: f64) -> Result<(), VirtualArmError> {
    match given.is_finite() && given > 0.0 {
        true => Ok(()),
        false => Err(VirtualArmError::NotPositive { name, given }),
    }
}
