//! What the end effector has to do: references x_r(t) with exact ẋ_r and ẍ_r.
//!
//! A scenario describes a reference; [`Trajectory::new`] checks it against the task and prepares it;
//! [`Trajectory::at`] evaluates it without allocating. What a reference is for a kind of pose is said by
//! [`Guided`]: [`plane`] and [`space`] have theirs.

mod error;
mod governor;
mod joints;
mod kept;
mod line;
mod lissajous;
mod piecewise;
pub mod plane;
mod polynomial;
pub mod space;
mod spline;
mod table;
mod taking_over;
mod waypoints;

pub use error::TrajectoryError;
pub use governor::{Governor, GovernorSettings, Pace};
pub use joints::{JointSpline, Peaks};
pub use kept::KeptMargins;
pub use plane::Reference;
pub use space::SpatialReference;

use crate::math::{Pose, Vector, coming_to_rest};
use std::fmt::Debug;
use taking_over::Remainder;

/// The reference at one instant.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::trajectory::Sample;
///
/// let sample = Sample { dx: Vector::<2>::new(1.0, 0.0), ..Sample::at_rest(Vector::<2>::zeros()) };
/// assert_eq!(sample.carried_on(0.5).x, Vector::<2>::new(0.5, 0.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<P, const M: usize> {
    /// Pose x_r.
    pub x: P,
    /// Velocity ẋ_r \[m/s, rad/s\].
    pub dx: Vector<M>,
    /// Acceleration ẍ_r \[m/s², rad/s²\].
    pub ddx: Vector<M>,
}

impl<P: Pose<M>, const M: usize> Sample<P, M> {
    /// At rest at `x`.
    pub fn at_rest(x: P) -> Self {
        Self { x, dx: Vector::zeros(), ddx: Vector::zeros() }
    }

    /// The reference `ahead` \[s\] later, were its velocity to stay.
    #[must_use]
    pub fn carried_on(&self, ahead: f64) -> Self {
        Self { x: self.x.moved(&(self.dx * ahead)), dx: self.dx, ddx: Vector::zeros() }
    }

    /// The reference `since` \[s\] later, of which nothing was heard meanwhile: its acceleration stays for `patience` \[s\], and
    /// then it comes to rest on its path within as long again.
    #[must_use]
    pub fn coasting(&self, since: f64, patience: f64) -> Self {
        // Path time σ with its derivatives.
        let [late, slope, bend] = coming_to_rest(since - patience, patience);
        let sigma = since.clamp(0.0, patience) + late.max(0.0);
        let rate = self.dx + self.ddx * sigma;
        Self {
            x: self.x.moved(&(self.dx * sigma + self.ddx * (0.5 * sigma * sigma))),
            dx: rate * slope,
            ddx: self.ddx * (slope * slope) + rate * bend,
        }
    }
}

/// A kind of pose that references lead.
pub trait Guided<const M: usize>: Pose<M> {
    /// A reference, as it is described in a scenario.
    type Reference;
    /// A reference, ready to be evaluated.
    type Curve: Clone + Debug + PartialEq + Send;

    /// Prepares `reference` for an end effector that is at `start` at t = 0.
    ///
    /// # Errors
    /// See [`Trajectory::new`].
    fn curve(reference: &Self::Reference, start: &Self) -> Result<Self::Curve, TrajectoryError>;
    /// The reference at time `t` \[s\]. Does not allocate.
    fn at(curve: &Self::Curve, t: f64) -> Sample<Self, M>;
    /// The curve that leaves `curve` at time `t` \[s\] for `goal`, smoothly, with the pole `rate` \[1/s\]: a position
    /// \[m\], with which an orientation comes to rest where it is, or a whole pose as it is written.
    fn aim(curve: &Self::Curve, t: f64, goal: &[f64], rate: f64) -> Self::Curve;
    /// The same from a state that no curve has led to.
    fn leave(state: &Sample<Self, M>, t: f64, goal: &[f64], rate: f64) -> Self::Curve;
    /// The plan that `reference` describes, if it is one.
    fn plan(reference: &Self::Reference) -> Option<Knots<'_>>;
    /// From when on the curve is at rest for good \[s\]; None if it never is.
    fn rests_from(curve: &Self::Curve) -> Option<f64>;

    /// `sample` with so much more of pose, velocity and acceleration: coordinates of the position before those of the orientation, in
    /// world axes (T179).
    fn displaced(sample: &Sample<Self, M>, by: &[Vector<6>; 3]) -> Sample<Self, M> {
        let [x, dx, ddx] = by.each_ref().map(|by| by.fixed_rows::<M>(0).into_owned());
        Sample { x: sample.x.moved(&x), dx: sample.dx + dx, ddx: sample.ddx + ddx }
    }

    /// What makes `there` of `sample` (T179).
    fn displacement(there: &Sample<Self, M>, sample: &Sample<Self, M>) -> [Vector<6>; 3] {
        [there.x.error(&sample.x), there.dx - sample.dx, there.ddx - sample.ddx]
            .map(|between| Vector::from_fn(|i, _| if i < M { between[i] } else { 0.0 }))
    }
}

/// The knots of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knots<'a> {
    /// Instants \[s\].
    pub times: &'a [f64],
    /// At each of them one number per joint \[rad, of a sliding joint m\].
    pub points: &'a [Vec<f64>],
    /// What each link keeps from obstacles between two of them: the smaller of both \[m\].
    pub margins: Option<&'a [Vec<f64>]>,
    /// Which share of margins of their own it keeps there.
    pub shares: Option<&'a [Vec<f64>]>,
}

impl Knots<'_> {
    /// Whether two in a row are the same and the joints move before and after: then there are several goals.
    pub fn rest_between(&self) -> bool {
        let moves = |pair: &[Vec<f64>]| pair[0] != pair[1];
        let mut pairs = self.points.windows(2).skip_while(|pair| !moves(pair));
        pairs.any(|pair| !moves(pair)) && pairs.any(moves)
    }
}

/// Something that is led by joints: an arm that follows a plan, wherever the real one is.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::math::Vector;
/// use vff_core::planned_reference::follow_plan;
/// use vff_core::robot::{Model, PlanarArm, planar::Link};
/// use vff_core::trajectory::{JointSpline, Trajectory};
///
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::zeros()));
/// let joints = JointSpline::new(&[0.0, 1.0], &[vec![0.0, 0.0], vec![0.5, 0.5]]).unwrap();
/// let trajectory: Trajectory<Vector<2>, 2> = follow_plan(arm.state(), joints);
/// assert_eq!(trajectory.at(0.0).x, Vector::<2>::new(2.0, 0.0)); // a `PlannedReference` within
/// assert_eq!(trajectory.joints().unwrap().last(), [0.5, 0.5]);
/// ```
pub trait PlannedReference<P, const M: usize>: Debug + Send {
    /// Where its end effector is at time `t` \[s\]. Does not allocate.
    fn at(&self, t: f64) -> Sample<P, M>;
    /// Its joints.
    fn joints(&self) -> &JointSpline;
    /// Another one.
    fn copy(&self) -> Box<dyn PlannedReference<P, M>>;
}

/// A reference for poses `P` of a task of dimension `M`, ready to be evaluated.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::trajectory::{Guided, Knots, Trajectory, plane::Reference};
///
/// let line = Reference::Line { start: None, end: vec![1.0, 0.0], duration: 2.0 };
/// let trajectory = Trajectory::<Vector<2>, 2>::new(&line, &Vector::<2>::zeros()).unwrap();
/// assert!((trajectory.at(1.0).x.x - 0.5).abs() < 1e-15);
/// assert_eq!(trajectory.at(2.0).dx, Vector::<2>::zeros());
/// let plan: Option<Knots<'_>> = <Vector<2> as Guided<2>>::plan(&line);
/// assert!(plan.is_none());
/// ```
///
/// # See also
/// [`PlannedReference`], where joints follow a plan; [`follow_plan`](crate::planned_reference::follow_plan) makes one.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory<P: Guided<M>, const M: usize> {
    path: Path<P, M>,
    /// What is left of the reference before, by which this one is displaced.
    before: Option<Box<Remainder<[Vector<6>; 3]>>>,
}

/// What says where the end effector has to be.
#[derive(Debug)]
enum Path<P: Guided<M>, const M: usize> {
    Curve(P::Curve),
    Plan(Box<dyn PlannedReference<P, M>>),
}

impl<P: Guided<M>, const M: usize> Clone for Path<P, M> {
    fn clone(&self) -> Self {
        match self {
            Self::Curve(curve) => Self::Curve(curve.clone()),
            Self::Plan(plan) => Self::Plan(plan.copy()),
        }
    }
}

/// Plans are the same if their joints are.
impl<P: Guided<M>, const M: usize> PartialEq for Path<P, M> {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Curve(a), Self::Curve(b)) => a == b,
            (Self::Plan(a), Self::Plan(b)) => a.joints() == b.joints(),
            _ => false,
        }
    }
}

impl<P: Guided<M>, const M: usize> Trajectory<P, M> {
    /// Prepares `reference`.
    ///
    /// # Arguments
    /// * `start`: pose of the end effector at t = 0, where a line without `start` begins.
    ///
    /// # Errors
    /// When a list does not fit the task or another list, when an orientation is missing or of no use, when
    /// times or a duration are unusable. That numbers are finite is not checked here.
    pub fn new(reference: &P::Reference, start: &P) -> Result<Self, TrajectoryError> {
        Ok(Self { path: Path::Curve(P::curve(reference, start)?), before: None })
    }

    /// The reference of a plan.
    pub fn of_plan(planned: Box<dyn PlannedReference<P, M>>) -> Self {
        Self { path: Path::Plan(planned), before: None }
    }

    /// The same reference, which takes the place of `old` at `pace` of both without a jump of pose, velocity or acceleration: of what
    /// is between them then, less and less is added within `duration` \[s\] of their time, > 0 (T179).
    #[must_use]
    pub fn taking_over(mut self, old: &Self, pace: &Pace, duration: f64) -> Self {
        self.before = None;
        let left = P::displacement(&old.at_pace(pace), &self.at_pace(pace));
        self.before = Some(Box::new(Remainder::new(pace.time, duration, left)));
        self
    }

    /// The same reference, displaced as `other` is.
    #[must_use]
    pub fn displaced_like(mut self, other: &Self) -> Self {
        self.before.clone_from(&other.before);
        self
    }

    /// How far in `D` dimensions an end effector is off it at time `t` \[s\] whose error is `error`, but for what is left of the
    /// reference before: that is no reason to wait \[m\].
    pub fn way_off<const D: usize>(&self, error: &Vector<M>, t: f64) -> f64 {
        let off = error.fixed_rows::<D>(0);
        match self.before.as_ref().and_then(|before| before.at(t)) {
            Some([x, ..]) => (off + x.fixed_rows::<D>(0)).norm(),
            None => off.norm(),
        }
    }

    /// Where it comes to rest for good; None if it never does.
    pub fn end(&self) -> Option<P> {
        Some(self.on_path(self.rests_from()?).x)
    }

    /// From when on it is at rest for good, but for what is left of the reference before \[s\]; None if it never is.
    pub fn rests_from(&self) -> Option<f64> {
        match &self.path {
            Path::Curve(curve) => P::rests_from(curve),
            Path::Plan(plan) => Some(plan.joints().span()[1]),
        }
    }

    /// The joints of the plan that it is, if it is one.
    #[inline]
    pub fn joints(&self) -> Option<&JointSpline> {
        match &self.path {
            Path::Curve(_) => None,
            Path::Plan(plan) => Some(plan.joints()),
        }
    }

    /// Leaves the reference at time `t` \[s\] for `goal`, see [`Guided::aim`].
    pub fn aim(&mut self, t: f64, goal: &[f64], rate: f64) {
        self.path = Path::Curve(match &self.path {
            Path::Curve(curve) if self.before.is_none() => P::aim(curve, t, goal, rate),
            _ => P::leave(&self.at(t), t, goal, rate),
        });
        self.before = None;
    }

    /// The reference at time `t` \[s\]. Does not allocate.
    #[inline]
    pub fn at(&self, t: f64) -> Sample<P, M> {
        self.with_remainder(self.on_path(t), t)
    }

    /// The same at `pace`: ẋ_r = x′σ̇ and ẍ_r = x″σ̇² + x′σ̈ (T74).
    #[inline]
    pub fn at_pace(&self, pace: &Pace) -> Sample<P, M> {
        let Sample { x, dx, ddx } = self.on_path(pace.time);
        let ddx = ddx * (pace.speed * pace.speed) + dx * pace.change;
        self.with_remainder(Sample { x, dx: dx * pace.speed, ddx }, pace.time)
    }

    #[inline]
    fn on_path(&self, t: f64) -> Sample<P, M> {
        match &self.path {
            Path::Curve(curve) => P::at(curve, t),
            Path::Plan(plan) => plan.at(t),
        }
    }

    #[inline]
    fn with_remainder(&self, sample: Sample<P, M>, t: f64) -> Sample<P, M> {
        match &self.before {
            Some(before) => Self::add_remainder(before, sample, t),
            None => sample,
        }
    }

    /// Seldom, and not within what runs always.
    #[cold]
    #[inline(never)]
    fn add_remainder(
        before: &Remainder<[Vector<6>; 3]>,
        sample: Sample<P, M>,
        t: f64,
    ) -> Sample<P, M> {
        before.at(t).map_or(sample, |left| P::displaced(&sample, &left))
    }
}

/// `values` as a vector of the task, if there is one for each axis.
fn vector<const M: usize>(
    field: impl Into<String>,
    values: &[f64],
) -> Result<Vector<M>, TrajectoryError> {
    if values.len() == M {
        Ok(Vector::from_column_slice(values))
    } else {
        Err(TrajectoryError::Dimension { field: field.into(), expected: M, given: values.len() })
    }
}

/// What the tests of all kinds share.
#[cfg(test)]
mod testing {
    use super::*;

    /// Checks ẋ and ẍ at `t` against finite differences of x and ẋ; `t ± 1e-4` must lie in
    /// one smooth piece.
    pub(super) fn check_derivatives<P: Guided<M>, const M: usize>(
        trajectory: &Trajectory<P, M>,
        t: f64,
    ) {
        let h = 1e-4;
        let (before, now, after) = (trajectory.at(t - h), trajectory.at(t), trajectory.at(t + h));
        let dx = after.x.error(&before.x) / (2.0 * h);
        let ddx = (after.dx - before.dx) / (2.0 * h);
        let size = now.x.as_slice().iter().map(|x| x.abs()).sum::<f64>();
        let scale = 1.0 + size + now.dx.norm() + now.ddx.norm();
        assert!((now.dx - dx).norm() < 1e-5 * scale, "at {t}: {now:?}, {dx}");
        assert!((now.ddx - ddx).norm() < 1e-5 * scale, "at {t}: {now:?}, {ddx}");
    }

    /// Checks that x, ẋ and ẍ do not jump at `t`.
    pub(super) fn check_continuity<P: Guided<M>, const M: usize>(
        trajectory: &Trajectory<P, M>,
        t: f64,
    ) {
        let h = 1e-9;
        let (before, after) = (trajectory.at(t - h), trajectory.at(t + h));
        assert!(after.x.error(&before.x).norm() < 1e-5, "x jumps at {t}");
        assert!((after.dx - before.dx).norm() < 1e-5, "dx jumps at {t}");
        assert!((after.ddx - before.ddx).norm() < 1e-5, "ddx jumps at {t}");
    }

    pub(super) fn assert_close<const M: usize>(a: Vector<M>, b: Vector<M>, tolerance: f64) {
        assert!((a - b).norm() <= tolerance, "{a} is not {b}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::PlanarPose;

    #[test]
    fn setpoint_rests() {
        let reference = Reference::Setpoint { point: vec![2.8, 1.6, 0.1] };
        let start = PlanarPose(Vector::zeros());
        let trajectory = Trajectory::new(&reference, &start).unwrap();
        let expected = Sample::at_rest(PlanarPose(Vector::<3>::new(2.8, 1.6, 0.1)));
        assert_eq!(trajectory.at(-1.0), expected);
        assert_eq!(trajectory.at(7.0), expected);
    }

    #[test]
    fn errors_name_the_field_and_both_sizes() {
        let reference = Reference::Setpoint { point: vec![2.8, 1.6, 0.1] };
        let error = Trajectory::new(&reference, &Vector::<2>::zeros()).unwrap_err();
        assert_eq!(error.field(), "point");
        let text = error.to_string();
        assert!(text.contains("expected 2") && text.contains("given 3"), "{text}");
    }

    /// A reference that is left keeps its state, arrives, and keeps its orientation.
    #[test]
    fn aiming_does_not_jump() {
        let reference = Reference::Line {
            start: Some(vec![0.0, 1.0, 0.3]),
            end: vec![2.0, 0.0, 0.5],
            duration: 2.0,
        };
        let mut trajectory = Trajectory::new(&reference, &PlanarPose(Vector::zeros())).unwrap();
        let before = trajectory.at(1.0);
        trajectory.aim(1.0, &[4.0, 3.0], 10.0);
        let after = trajectory.at(1.0);
        assert!(after.x.error(&before.x).norm() + (after.dx - before.dx).norm() < 1e-13);
        assert!((after.ddx - before.ddx).norm() < 1e-11);
        let end = PlanarPose(Vector::<3>::new(4.0, 3.0, before.x.0[2]));
        assert!(trajectory.at(9.0).x.error(&end).norm() < 1e-12);
    }
}
