//! How an obstacle moves, with its exact velocity and acceleration.

use super::curve::Curve;
use crate::math::quintic::{Coordinates, control_points, horner, piece, tops};
use crate::math::{Point, ThirdOrderFilter, UnitQuaternion, Vector, sin_cos};
use serde::Deserialize;

/// The prescribed motion of an obstacle. It says where the obstacle is, and at way points how it is turned; what turns it
/// otherwise is its angular velocity.
///
/// The values are taken as they are; `scenario` validates them (finite, `times` strictly
/// increasing and as many as `points`).
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::world::{Motion, MotionState};
///
/// let motion = Motion::waypoints(vec![0.0, 2.0], vec![[0.0, 0.0], [1.0, 0.0]]);
/// let MotionState { position, .. } = motion.at(1.0, Vector::<2>::zeros());
/// assert!((position.x - 0.5).abs() < 1e-15);
/// assert!(!motion.is_static());
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Motion<const D: usize> {
    /// Stays at its initial position.
    Static {},
    /// Constant velocity from the initial position at t = 0.
    Linear {
        /// Velocity \[m/s\].
        #[serde(deserialize_with = "Point::read")]
        velocity: [f64; D],
    },
    /// Initial position + `amplitude` · sin(`angular_frequency` · t + `phase`).
    Sinusoid {
        /// Amplitude along each axis \[m\].
        #[serde(deserialize_with = "Point::read")]
        amplitude: [f64; D],
        /// Angular frequency \[rad/s\].
        angular_frequency: f64,
        /// Phase at t = 0 \[rad\].
        #[serde(default)]
        phase: f64,
        /// Whether look-ahead knows it: see [`is_foreseen`](Motion::is_foreseen).
        #[serde(default)]
        foreseen: bool,
    },
    /// From point to point, at constant speed or smoothly. The points *are* the positions, the initial
    /// position of the obstacle is not used. Waits at the first point before `times[0]` and
    /// at the last one after the last time.
    Waypoints {
        /// Instants \[s\], strictly increasing.
        times: Vec<f64>,
        /// Position at each instant \[m\].
        #[serde(deserialize_with = "Point::read_list")]
        points: Vec<[f64; D]>,
        /// What lies between the points.
        #[serde(default)]
        interpolation: Interpolation,
        /// In the plane, angle at each instant \[rad\]. Empty: none.
        #[serde(default)]
        angles: Vec<f64>,
        /// In space, orientation at each instant: quaternions \[w, x, y, z\] of norm 1 within 1 %. Empty: none.
        #[serde(default)]
        orientations: Vec<[f64; 4]>,
        /// Whether look-ahead knows it: see [`is_foreseen`](Motion::is_foreseen).
        #[serde(default)]
        foreseen: bool,
    },
    /// Dragged to a place by hand while the loop runs; no scenario says so.
    #[serde(skip)]
    Dragged(ThirdOrderFilter<D>),
}

/// What lies between way points.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::world::{Interpolation, Motion};
///
/// let mut motion = Motion::waypoints(vec![0.0, 1.0, 2.0], vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]);
/// if let Motion::Waypoints { interpolation, .. } = &mut motion {
///     *interpolation = Interpolation::Smooth;
/// }
/// let [start, middle] = [0.0, 1.0].map(|t| motion.at(t, Vector::<2>::zeros()).velocity.x);
/// assert_eq!([start, middle], [0.0, 1.0]);
/// assert!(motion.top_speed() < 2.5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Constant speed; in the plane a constant rate, in space a rotation about one axis at a constant rate, the shorter way.
    /// Velocities jump at the points.
    #[default]
    Linear,
    /// Quintics from rest to rest, twice continuously differentiable (T177); in space of the quaternions, normalised (T178).
    Smooth,
}

/// Where an obstacle is and how it moves at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionState<const D: usize> {
    /// Position \[m\].
    pub position: Vector<D>,
    /// Velocity \[m/s\]; from the right where it jumps.
    pub velocity: Vector<D>,
    /// Acceleration \[m/s²\]; zero where the velocity jumps.
    pub acceleration: Vector<D>,
    /// For how long parts of it have gone on by themselves \[s\]: 0, but of clouds whose points move (T180).
    pub elapsed: f64,
}

impl<const D: usize> MotionState<D> {
    /// At rest at `position` \[m\].
    pub(super) fn at_rest(position: Vector<D>) -> Self {
        Self { position, velocity: Vector::zeros(), acceleration: Vector::zeros(), elapsed: 0.0 }
    }

    /// At rest at the origin, with parts that have gone on for as long as those of this one.
    #[inline(always)]
    pub(super) fn own_frame(&self) -> Self {
        Self { elapsed: self.elapsed, ..Self::at_rest(Vector::zeros()) }
    }

    /// Goes on for `time` \[s\] at its velocity.
    #[inline(always)]
    pub(super) fn after(&self, time: f64) -> Self {
        Self {
            position: self.position + self.velocity * time,
            elapsed: self.elapsed + time,
            ..*self
        }
    }
}

impl<const D: usize> Default for Motion<D> {
    fn default() -> Self {
        Self::Static {}
    }
}

impl<const D: usize> Motion<D> {
    /// From point to point \[m\] at these instants \[s\], without turning.
    pub fn waypoints(times: Vec<f64>, points: Vec<[f64; D]>) -> Self {
        Self::Waypoints {
            times,
            points,
            interpolation: Interpolation::Linear,
            angles: vec![],
            orientations: vec![],
            foreseen: false,
        }
    }

    /// The same motion elsewhere: where it names points, they are displaced by `shift` \[m\].
    #[must_use]
    pub fn shifted(&self, shift: &Vector<D>) -> Self {
        let mut this = self.clone();
        if let Self::Waypoints { points, .. } = &mut this {
            points.iter_mut().for_each(|point| *point = (Vector::from(*point) + shift).into());
        }
        this
    }

    /// Whether the obstacle stays where it is for ever.
    pub fn is_static(&self) -> bool {
        matches!(self, Self::Static {})
    }

    /// Whether look-ahead takes the obstacle for where this motion has it at later instants, as is known of a door, of another robot
    /// or by a forecast of one's own. Otherwise it goes on at the velocity of the moment.
    ///
    /// # Example
    /// ```
    /// use vff_core::world::Motion;
    ///
    /// let swing: Motion<2> =
    ///     toml::from_str("sinusoid = { amplitude = [0.5, 0.0], angular_frequency = 2.0, foreseen = true }").unwrap();
    /// assert!(swing.is_foreseen());
    /// assert!(!Motion::Linear { velocity: [0.5, 0.0] }.is_foreseen()); // nor does it have to be
    /// ```
    pub fn is_foreseen(&self) -> bool {
        matches!(
            self,
            Self::Sinusoid { foreseen: true, .. } | Self::Waypoints { foreseen: true, .. }
        )
    }

    /// A speed that the obstacle never exceeds \[m/s\].
    pub fn top_speed(&self) -> f64 {
        self.top_speed_within([f64::NEG_INFINITY, f64::INFINITY])
    }

    /// The same from one time to another \[s\].
    pub(super) fn top_speed_within(&self, [from, to]: [f64; 2]) -> f64 {
        let is_within = |leg: [f64; 2]| leg[0] <= to && from <= leg[1];
        match self {
            Self::Static {} => 0.0,
            Self::Linear { velocity } => Vector::from(*velocity).norm(),
            Self::Sinusoid { amplitude, angular_frequency, .. } => {
                Vector::from(*amplitude).norm() * angular_frequency.abs()
            }
            Self::Waypoints { interpolation: Interpolation::Smooth, .. } => self.tops(is_within)[0],
            Self::Waypoints { times, points, .. } => {
                let leg = |i: usize| {
                    let [from, to] = [points[i - 1], points[i]].map(Vector::<D>::from);
                    (to - from).norm() / (times[i] - times[i - 1])
                };
                let legs = 1..times.len().min(points.len());
                let within = legs.filter(|i| is_within([times[i - 1], times[*i]]));
                within.map(leg).fold(0.0, f64::max)
            }
            Self::Dragged(filter) => filter.top_speed(),
        }
    }

    /// An acceleration that the obstacle never exceeds \[m/s²\]; where its velocity jumps, as it does at linear way points, that is
    /// not counted.
    ///
    /// # Example
    /// ```
    /// use vff_core::world::Motion;
    ///
    /// let swing = Motion::Sinusoid { amplitude: [0.5, 0.0], angular_frequency: 2.0, phase: 0.0, foreseen: false };
    /// assert_eq!(swing.top_acceleration(), 2.0);
    /// ```
    pub fn top_acceleration(&self) -> f64 {
        match self {
            Self::Sinusoid { angular_frequency, .. } => self.top_speed() * angular_frequency.abs(),
            Self::Waypoints { interpolation: Interpolation::Smooth, .. } => self.tops(|_| true)[1],
            Self::Dragged(_) => f64::INFINITY,
            _ => 0.0,
        }
    }

    /// The number of the first orientation that is too far from the one before for a smooth rotation (T178).
    pub fn orientation_apart(&self) -> Option<usize> {
        match self {
            Self::Waypoints {
                times, orientations, interpolation: Interpolation::Smooth, ..
            } => {
                let turn = |q: &[f64; 4]| UnitQuaternion::new(*q).unwrap_or_default();
                let turns: Vec<_> = orientations.iter().map(turn).collect();
                Curve::orientations(times, &turns).err()
            }
            _ => None,
        }
    }

    /// What speed and acceleration never exceed between smooth way points, where that `matters` from one time to another.
    fn tops(&self, matters: impl Fn([f64; 2]) -> bool) -> [f64; 2] {
        let Self::Waypoints { times, points, .. } = self else { return [0.0; 2] };
        let times = &times[..times.len().min(points.len())];
        let tops = |i: usize| {
            let coefficients = piece(times, |i| Vector::from(points[i]), i);
            tops(&coefficients, times[i + 1] - times[i])
        };
        let most = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
        let pieces = 0..times.len().saturating_sub(1);
        pieces.filter(|i| matters([times[*i], times[i + 1]])).map(tops).fold([0.0; 2], most)
    }

    /// The state at time `t` \[s\] of an obstacle whose initial position is `position0` \[m\].
    pub fn at(&self, t: f64, position0: Vector<D>) -> MotionState<D> {
        match self {
            Self::Static {} => MotionState::at_rest(position0),
            Self::Linear { velocity } => {
                let velocity = Vector::from(*velocity);
                MotionState {
                    position: position0 + velocity * t,
                    velocity,
                    acceleration: Vector::zeros(),
                    elapsed: 0.0,
                }
            }
            Self::Sinusoid { amplitude, angular_frequency: omega, phase, .. } => {
                let amplitude = Vector::from(*amplitude);
                let (sin, cos) = sin_cos(omega * t + phase);
                MotionState {
                    position: position0 + amplitude * sin,
                    velocity: amplitude * (omega * cos),
                    acceleration: amplitude * (-omega * omega * sin),
                    elapsed: 0.0,
                }
            }
            Self::Waypoints { times, points, interpolation, .. } => {
                along(times, points, *interpolation, t, position0)
            }
            Self::Dragged(filter) => {
                let [position, velocity, acceleration] = filter.at(t);
                MotionState { position, velocity, acceleration, elapsed: 0.0 }
            }
        }
    }

    /// Opposite corners of a box that holds the obstacle from `t0` to `t1` \[s\], `t0` ≤ `t1`: every
    /// position that [`at`](Self::at) returns, rounding included \[m\].
    pub fn extent(&self, t0: f64, t1: f64, position0: Vector<D>) -> [Vector<D>; 2] {
        let ends = [self.at(t0, position0).position, self.at(t1, position0).position];
        match self {
            // Monotone in t along each axis, rounding included: the ends hold the rest.
            Self::Static {} | Self::Linear { .. } => hull(ends),
            Self::Sinusoid { amplitude, angular_frequency: omega, phase, .. } => {
                let middle = omega * (0.5 * (t0 + t1)) + phase;
                let rounding =
                    1e-12 + 1e-15 * (middle.abs() + (omega * (t1 - t0)).abs() + phase.abs());
                let change = (0.5 * omega * (t1 - t0)).abs() + rounding;
                let sin = middle.sin();
                let amplitude = Vector::from(*amplitude);
                hull(
                    [(sin - change).max(-1.0), (sin + change).min(1.0)]
                        .map(|sin| position0 + amplitude * sin),
                )
            }
            Self::Waypoints { times, points, interpolation, .. } => {
                let n = times.len().min(points.len());
                let (times, points) = (&times[..n], &points[..n]);
                let first = times.partition_point(|&time| time <= t0).max(1);
                let last = times.partition_point(|&time| time < t1);
                (first..n.min(last + 1)).fold(hull(ends), |around, next| {
                    let span = [times[next - 1].max(t0), times[next].min(t1)];
                    match interpolation {
                        Interpolation::Linear => {
                            let ends = span.map(|t| leg(times, points, next, t).position);
                            ends.iter().fold(around, with)
                        }
                        Interpolation::Smooth => {
                            let whole = part(times, points, next, [times[next - 1], times[next]]);
                            let size = whole.iter().map(|p| p.amax()).fold(0.0, f64::max);
                            let rounding = ROUNDING * size;
                            part(times, points, next, span).iter().fold(around, |around, p| {
                                let apart = [-rounding, rounding].map(|by| p.add_scalar(by));
                                apart.iter().fold(around, with)
                            })
                        }
                    }
                })
            }
            Self::Dragged(filter) => {
                let goal = filter.goal();
                let span = filter.span() * (1.0 + 1e-12) + 1e-12 * goal.norm();
                [goal.add_scalar(-span), goal.add_scalar(span)]
            }
        }
    }
}

/// Opposite corners of the box around two points, the lower ones first.
fn hull<const D: usize>([a, b]: [Vector<D>; 2]) -> [Vector<D>; 2] {
    [a.inf(&b), a.sup(&b)]
}

/// What rounding takes from a position on a quintic, as a share of the largest of its control points' coordinates.
const ROUNDING: f64 = 1e-13;

/// The box around another point as well.
fn with<const D: usize>([low, high]: [Vector<D>; 2], point: &Vector<D>) -> [Vector<D>; 2] {
    [low.inf(point), high.sup(point)]
}

/// The state at time `t` on the way through `points`; at rest at `fallback` without points.
fn along<const D: usize>(
    times: &[f64],
    points: &[[f64; D]],
    interpolation: Interpolation,
    t: f64,
    fallback: Vector<D>,
) -> MotionState<D> {
    let n = times.len().min(points.len());
    let (times, points) = (&times[..n], &points[..n]);
    let passed = times.partition_point(|&time| time <= t);
    let Some(next) = points.get(passed) else {
        return MotionState::at_rest(points.last().map_or(fallback, |&last| Vector::from(last)));
    };
    if passed == 0 {
        return MotionState::at_rest(Vector::from(*next));
    }
    match interpolation {
        Interpolation::Linear => leg(times, points, passed, t),
        Interpolation::Smooth => {
            let Coordinates { x, dx, ddx } = smooth(times, points, passed, t);
            MotionState { position: x, velocity: dx, acceleration: ddx, elapsed: 0.0 }
        }
    }
}

/// The quintic to point `next` > 0 at time `t`.
fn smooth<const D: usize>(
    times: &[f64],
    points: &[[f64; D]],
    next: usize,
    t: f64,
) -> Coordinates<D> {
    let coefficients = piece(times, |i| Vector::from(points[i]), next - 1);
    horner(&coefficients, t - times[next - 1])
}

/// The control points of that quintic from one instant to the other.
fn part<const D: usize>(
    times: &[f64],
    points: &[[f64; D]],
    next: usize,
    [from, to]: [f64; 2],
) -> [Vector<D>; 6] {
    let [start, end] = [from, to].map(|t| smooth(times, points, next, t));
    control_points(&start, &end, to - from)
}

/// The state at time `t` on the way to point `next` > 0.
fn leg<const D: usize>(times: &[f64], points: &[[f64; D]], next: usize, t: f64) -> MotionState<D> {
    let (start, duration) = (times[next - 1], times[next] - times[next - 1]);
    let previous = Vector::from(points[next - 1]);
    let velocity = (Vector::from(points[next]) - previous) / duration;
    MotionState {
        position: previous + velocity * (t - start),
        velocity,
        acceleration: Vector::zeros(),
        elapsed: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check_derivatives(motion: &Motion<2>, t: f64, position0: Vector<2>) {
        let h = 1e-4;
        let (before, now, after) =
            (motion.at(t - h, position0), motion.at(t, position0), motion.at(t + h, position0));
        let velocity = (after.position - before.position) / (2.0 * h);
        let acceleration = (after.velocity - before.velocity) / (2.0 * h);
        assert!((now.velocity - velocity).norm() < 1e-5, "{now:?}");
        assert!((now.acceleration - acceleration).norm() < 1e-5, "{now:?}");
    }

    fn smooth(times: Vec<f64>, points: Vec<[f64; 2]>) -> Motion<2> {
        let (interpolation, angles, orientations) = (Interpolation::Smooth, vec![], vec![]);
        Motion::Waypoints { times, points, interpolation, angles, orientations, foreseen: false }
    }

    fn two() -> impl Strategy<Value = [f64; 2]> {
        [-3.0..3.0, -3.0..3.0]
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn derivatives_are_exact(
            amplitude in two(), velocity in two(), position0 in two(),
            angular_frequency in -3.0..3.0, phase in -3.0..3.0, t in -10.0..10.0,
        ) {
            let position0 = Vector::from(position0);
            check_derivatives(&Motion::default(), t, position0);
            check_derivatives(&Motion::Linear { velocity }, t, position0);
            let sinusoid = Motion::Sinusoid { amplitude, angular_frequency, phase, foreseen: false };
            check_derivatives(&sinusoid, t, position0);
        }

        #[test]
        fn waypoints_keep_their_speed_between_the_points(
            points in prop::collection::vec(two(), 4), fraction in 0.01..0.99, leg in 0usize..3,
        ) {
            let times = vec![-1.0, 0.5, 1.0, 4.0];
            let t = times[leg] + fraction * (times[leg + 1] - times[leg]);
            let expected: Vector<2> = Vector::from(points[leg]) * (1.0 - fraction)
                + Vector::from(points[leg + 1]) * fraction;
            let motion = Motion::waypoints(times, points);
            let found = motion.at(t, Vector::zeros()).position;
            prop_assert!((found - expected).norm() < 1e-14);
            check_derivatives(&motion, t, Vector::zeros());
        }

        /// Smooth way points: derivatives are exact and within their bounds, and none of them jumps at a point.
        #[test]
        fn smooth_waypoints_are_twice_differentiable(
            points in prop::collection::vec(two(), 4), fraction in 0.01..0.99, leg in 0usize..3,
        ) {
            let times = vec![-1.0, 0.5, 1.0, 4.0];
            let motion = smooth(times.clone(), points.clone());
            let t = times[leg] + fraction * (times[leg + 1] - times[leg]);
            let at = |t: f64| motion.at(t, Vector::zeros());
            let h = 1e-5;
            let [before, now, after] = [-h, 0.0, h].map(|step| at(t + step));
            let scale = motion.top_acceleration() / 0.1;
            prop_assert!((now.velocity - (after.position - before.position) / (2.0 * h)).norm() < 1e-8 * (1.0 + scale));
            prop_assert!((now.acceleration - (after.velocity - before.velocity) / (2.0 * h)).norm() < 1e-6 * (1.0 + scale));
            prop_assert!(now.velocity.norm() <= motion.top_speed() * (1.0 + 1e-12));
            prop_assert!(now.acceleration.norm() <= motion.top_acceleration() * (1.0 + 1e-12));
            for (time, point) in times.iter().zip(&points) {
                let [before, now] = [at(time - 1e-9), at(*time)];
                prop_assert!((now.position - Vector::from(*point)).norm() < 1e-13);
                prop_assert!((before.velocity - now.velocity).norm() < 1e-8 * (1.0 + scale));
                prop_assert!((before.acceleration - now.acceleration).norm() < 1e-5 * (1.0 + scale));
            }
            for rest in [at(-1.5), at(4.0), at(9.0)] {
                prop_assert_eq!(rest, MotionState::at_rest(rest.position));
            }
        }

        #[test]
        fn every_position_is_inside_the_extent(
            vectors in prop::collection::vec(two(), 6), numbers in [-3.0..3.0, -3.0..3.0],
            exponent in 0i32..3, t0 in -5.0..5.0, duration in 0.0..4.0, fraction in 0.0..=1.0,
        ) {
            // Coordinates from human to astronomical size.
            let scale = 10f64.powi(40 * exponent);
            let [position0, amplitude] = [0, 1].map(|i| vectors[i].map(|x| scale * x));
            let [angular_frequency, phase] = numbers.map(|x| scale * x);
            let position0 = Vector::from(position0);
            let goal = Vector::from(vectors[2].map(|x| scale * x));
            let points: Vec<_> = vectors.iter().map(|v| v.map(|x| scale * x)).collect();
            let (t0, t1) = (t0, t0 + duration);
            let smooth_points = points.clone();
            for motion in [
                Motion::default(),
                Motion::Linear { velocity: amplitude },
                Motion::Sinusoid { amplitude, angular_frequency, phase, foreseen: false },
                Motion::Sinusoid { amplitude, angular_frequency: numbers[0], phase: numbers[1], foreseen: false },
                Motion::waypoints(vec![-3.0, -2.9, 0.5, 1.0, 2.5, 2.501], points),
                Motion::waypoints(vec![], vec![]),
                smooth(vec![-3.0, -2.9, 0.5, 1.0, 2.5, 2.501], smooth_points),
                smooth(vec![], vec![]),
                Motion::Dragged(ThirdOrderFilter::new(t0, [position0, amplitude.into(), amplitude.into()], goal, 7.0)),
            ] {
                let [low, high] = motion.extent(t0, t1, position0);
                for t in [t0, t0 + fraction * duration, t1, 0.5f64.clamp(t0, t1)] {
                    let p = motion.at(t, position0).position;
                    prop_assert!(t > t1 || p.inf(&low) == low && p.sup(&high) == high,
                        "{p} at {t} is not in [{low}, {high}]");
                }
            }
        }
    }

    #[test]
    fn the_paper_obstacle() {
        // Scenario 1: y(t) = 2 − 0.5 sin 0.5t.
        let motion = Motion::Sinusoid {
            amplitude: [0.0, -0.5],
            angular_frequency: 0.5,
            phase: 0.0,
            foreseen: false,
        };
        let state = motion.at(std::f64::consts::PI, Vector::<2>::new(1.5, 2.0));
        assert!((state.position - Vector::<2>::new(1.5, 1.5)).norm() < 1e-15);
        assert!(state.velocity.norm() < 1e-15);
        assert!((state.acceleration - Vector::<2>::new(0.0, 0.125)).norm() < 1e-15);
    }

    #[test]
    fn waypoints_wait_at_both_ends_and_are_right_continuous() {
        let motion =
            Motion::waypoints(vec![1.0, 2.0, 4.0], vec![[0.0, 0.0], [1.0, 0.0], [1.0, 4.0]]);
        let at = |t| motion.at(t, Vector::<2>::new(9.0, 9.0));
        assert_eq!(at(0.0), MotionState::at_rest(Vector::<2>::new(0.0, 0.0)));
        assert_eq!(at(1.0).velocity, Vector::<2>::new(1.0, 0.0));
        assert_eq!(at(2.0).velocity, Vector::<2>::new(0.0, 2.0));
        assert_eq!(at(3.0).position, Vector::<2>::new(1.0, 2.0));
        assert_eq!(at(4.0), MotionState::at_rest(Vector::<2>::new(1.0, 4.0)));
        assert_eq!(at(9.0), at(4.0));
    }

    #[test]
    fn unusable_waypoints_do_not_panic() {
        let position0 = Vector::<2>::new(9.0, 9.0);
        for (times, points) in [
            (vec![], vec![]),
            (vec![0.0, 1.0], vec![]),
            (vec![], vec![[1.0, 1.0]]),
            (vec![0.0], vec![[1.0, 1.0], [2.0, 2.0]]),
            (vec![f64::NAN, 1.0], vec![[1.0, 1.0], [2.0, 2.0]]),
        ] {
            let [linear, smooth] =
                [Motion::waypoints, smooth].map(|way| way(times.clone(), points.clone()));
            for motion in [linear, smooth] {
                motion.top_speed();
                for t in [-1.0, 0.0, 0.5, 2.0, f64::NAN] {
                    motion.at(t, position0);
                    motion.extent(t, t + 1.0, position0);
                }
            }
        }
    }
}
