//! Straight ways out of the start and into the goal: the end effector goes along a line and does not turn, as what grasps and what is
//! put down has to.

use super::planner::{Certified, Planner, ranges_of};
use super::timing::{CHECKS, STEP};
use super::why::{Place, length};
use super::*;
use crate::math::{Vector, in_space};
use nalgebra::{Matrix3, Matrix6};

/// How far the end effector goes from one configuration to the next at first, and how far off the line it may be half way between them,
/// of the arm's characteristic length; how often the first is halved at most, and of the second the part from which on it is doubled.
const STRIDE: f64 = 0.01;
const OFF: f64 = 1e-4;
const HALVINGS: u32 = 10;
const STRAIGHT: f64 = 1e-3;
/// Steps to a configuration, how near they have to come \[m, rad\], and their damping, of the squared length.
const STEPS: usize = 30;
const PRECISION: f64 = 1e-9;
const DAMPING: f64 = 1e-9;

/// Configurations along a line, from what is nearer to the start of the motion.
pub(super) type Way = Vec<Vec<f64>>;

/// A motion, and how far the end effector is off the lines at its ends, where there are any \[m\].
type InTurn = (Certified, [Option<f64>; 2]);

/// A straight way that ends too soon: what of it is left \[m\], and why, in a sentence.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Short {
    pub left: f64,
    pub why: String,
}

/// Where the end effector is, and how it is turned.
struct Stand {
    place: Vector<3>,
    axes: Matrix3<f64>,
}

impl Stand {
    fn of<R: Jointed<D>, const D: usize>(robot: &R) -> Self {
        Self { place: in_space(&robot.tip()), axes: robot.tip_axes() }
    }

    /// How far and by what angle it would have to move to `other` \[m, rad\], of which the angle is small.
    fn to(&self, other: &Self) -> [Vector<3>; 2] {
        let across = |k: usize| self.axes.column(k).cross(&other.axes.column(k));
        [other.place - self.place, 0.5 * (across(0) + across(1) + across(2))]
    }
}

impl<S: SpaceTypes<D>, const D: usize> Planner<'_, S, D>
where
    S::State: Jointed<D>,
{
    /// The straight way out of the start or into the goal at `q`; where none was asked for, `q` alone.
    pub(super) fn way(&mut self, place: Place, q: &[f64]) -> Result<Way, Short> {
        let leaves = place == Place::Retreat;
        let asked = if leaves { &self.settings.retreat } else { &self.settings.approach };
        let Some(asked) = asked else { return Ok(vec![q.to_vec()]) };
        let robot = self.space.robot();
        robot.update_positions(q);
        // Backwards, as from the goal the way is searched.
        let back = match asked {
            // What the end effector has in front of it: z in space, and along the last link in the plane.
            ScalarOrVec::Uniform(far) => robot.tip_axes().column(if D == 3 { 2 } else { 0 }) * -far,
            ScalarOrVec::Each(along) => {
                let along = Vector::<3>::from_fn(|row, _| along.get(row).copied().unwrap_or(0.0));
                if leaves { along } else { -along }
            }
        };
        let size = self.arm.characteristic_length();
        let mut way = along_line(self.space.robot(), q, &back, size).map_err(|gone| {
            let whole = back.norm();
            let why = format!(
                "{} the end effector can go {} of {}: there its reach or the range of a joint ends; a shorter way, another \
                 direction or another configuration helps",
                if leaves { place.there() } else { "straight back from the goal" },
                length(gone * whole),
                length(whole),
            );
            Short { left: (1.0 - gone) * whole, why }
        })?;
        if !leaves {
            way.reverse();
        }
        Ok(way)
    }

    /// Whether the arm keeps its margins all along `way`.
    pub(super) fn is_free_along(&mut self, way: &Way) -> bool {
        way.windows(2).all(|pair| self.space.is_free_between(&pair[0], &pair[1]))
    }

    /// Why it does not, for people, and how near the arm comes to something \[m\].
    pub(super) fn crossed(&mut self, place: Place, way: &Way) -> (String, f64) {
        let nearest = way.iter().map(|q| (q, self.space.clearance(q)));
        let (q, clearance) = nearest.min_by(|a, b| a.1.total_cmp(&b.1)).expect("it has an end");
        if way.windows(2).all(|pair| self.space.touches_nothing_between(&pair[0], &pair[1])) {
            let why = format!(
                "{} the end effector leans, or looks away from its point, by more than it may; another direction, or a greater tilt or \
                 angle of view, helps",
                place.there()
            );
            return (why, clearance);
        }
        if let Some(found) = self.space.obstruction(q).filter(|found| found.distance() <= 0.0) {
            return (found.sentence(place, self.settings.horizon), found.distance());
        }
        let why = format!(
            "{} the arm comes as near as {} to something; another direction or a smaller margin helps",
            place.there(),
            length(clearance),
        );
        (why, clearance)
    }

    /// The motion from the start to the goal along the straight ways at its ends and a path between them, at rest where one follows the
    /// other; or why there is none.
    pub(super) fn timed_in_turn(
        &mut self,
        [retreat, path, approach]: [&Way; 3],
        limits: &Limits,
    ) -> Result<Result<InTurn, (PlanStatus, String)>, ScenarioError> {
        let mut whole: Option<Certified> = None;
        let mut off = [None; 2];
        let all = [(retreat, Some(0)), (path, None), (approach, Some(1))];
        for (way, end) in all.into_iter().filter(|(way, _)| way.len() > 1) {
            let part = match self.timed(way, limits)? {
                Ok(part) => part,
                Err(why) => return Ok(Err(why)),
            };
            if let Some(end) = end {
                off[end] = Some(self.off_line(&part.0));
            }
            whole = Some(match whole {
                None => part,
                Some(before) => then(before, part),
            });
        }
        Ok(Ok((whole.expect("a path has two ends"), off)))
    }

    /// How far the end effector is off the line between the ends of a motion along it \[m\].
    fn off_line(&mut self, spline: &JointSpline) -> f64 {
        let mut state = [0; 3].map(|_| vec![0.0; self.start.len()]);
        let robot = self.space.robot();
        let mut tip_at = |t: f64| {
            spline.at(t, state.each_mut().map(Vec::as_mut_slice));
            robot.update_positions(&state[0]);
            in_space(&robot.tip())
        };
        let [from, to] = spline.span().map(&mut tip_at);
        let along = (to - from).normalize();
        let mut most: f64 = 0.0;
        for pair in spline.times().windows(2) {
            for k in 0..CHECKS {
                let share = f64::from(k) / f64::from(CHECKS);
                let way = tip_at(pair[0] + (pair[1] - pair[0]) * share) - from;
                most = most.max((way - along * way.dot(&along)).norm());
            }
        }
        most
    }
}

/// Both motions, one after the other, with a rest between them.
fn then((a, [margins, shares]): Certified, (b, [more, and_more]): Certified) -> Certified {
    let [_, end] = a.span();
    let mut points = [a.points(), b.points()].concat();
    // Both to the last bit, as that makes it a rest: where a cubic ends is its last knot but for rounding.
    let meet = a.times().len();
    points[meet - 1..=meet].fill(a.last().to_vec());
    let times: Vec<f64> =
        a.times().iter().copied().chain(b.times().iter().map(|t| end + STEP + t)).collect();
    let whole = JointSpline::new(&times, &points).expect("one after the other");
    (whole, [[margins, more].concat(), [shares, and_more].concat()])
}

/// From `q`, where `robot` is, along `way`; or which share of it there is.
fn along_line<R: Jointed<D>, const D: usize>(
    robot: &mut R,
    q: &[f64],
    way: &Vector<3>,
    size: f64,
) -> Result<Way, f64> {
    let mut all = vec![q.to_vec()];
    if *way == Vector::<3>::zeros() {
        return Ok(all);
    }
    let line = Line { from: Stand::of(robot), way: *way, size };
    let mut gone = 0.0;
    let mut stride = STRIDE * size / way.norm();
    while gone < 1.0 {
        // Not a crumb at the end.
        let next = if gone + 1.5 * stride < 1.0 { gone + stride } else { 1.0 };
        // Joints that slide go straight however far.
        if line.go(robot, [gone, next], HALVINGS, &mut all)? {
            stride *= 2.0;
        }
        gone = next;
    }
    Ok(all)
}

/// What the end effector goes along.
struct Line {
    from: Stand,
    way: Vector<3>,
    /// The arm's characteristic length \[m\].
    size: f64,
}

impl Line {
    fn at(&self, share: f64) -> Stand {
        Stand { place: self.from.place + self.way * share, axes: self.from.axes }
    }

    /// From one share of the way to another one, in halves where the joints would leave the line in between; whether they are straight
    /// enough for larger steps, or the share where the way ends.
    fn go<R: Jointed<D>, const D: usize>(
        &self,
        robot: &mut R,
        [a, b]: [f64; 2],
        halvings: u32,
        all: &mut Way,
    ) -> Result<bool, f64> {
        let last = &all[all.len() - 1];
        let mut next = last.clone();
        let middle = 0.5 * (a + b);
        if self.reach(robot, &mut next, &self.at(b)) {
            let half: Vec<f64> = last.iter().zip(&next).map(|(a, b)| 0.5 * (a + b)).collect();
            robot.update_positions(&half);
            let [off, turned] = Stand::of(robot).to(&self.at(middle)).map(|v| v.norm());
            let is_within = |share: f64| off <= share * OFF * self.size && turned <= share * OFF;
            if is_within(1.0) {
                all.push(next);
                return Ok(is_within(STRAIGHT));
            }
        }
        if halvings == 0 {
            return Err(a);
        }
        self.go(robot, [a, middle], halvings - 1, all)?;
        self.go(robot, [middle, b], halvings - 1, all)?;
        Ok(false)
    }

    /// Moves `q` to where the end effector stands as asked, as little as that takes (T106); whether it came there. A joint that comes to
    /// the end of its range stays there.
    fn reach<R: Jointed<D>, const D: usize>(
        &self,
        robot: &mut R,
        q: &mut [f64],
        there: &Stand,
    ) -> bool {
        let ranges: Vec<_> = (0..q.len()).map(|i| ranges_of(robot.limits(), i)).collect();
        let mut is_held = vec![false; q.len()];
        for _ in 0..STEPS {
            interrupt::checkpoint(128 * q.len());
            robot.update_positions(q);
            let [off, turned] = Stand::of(robot).to(there);
            if off.norm() <= PRECISION && turned.norm() <= PRECISION {
                return true;
            }
            let joined = |a: &Vector<3>, b: &Vector<3>| {
                Vector::<6>::new(a.x, a.y, a.z, self.size * b.x, self.size * b.y, self.size * b.z)
            };
            let columns: Vec<Vector<6>> = (0..q.len())
                .map(|i| {
                    joined(&in_space(&robot.jacobian_column::<D>(i)), &robot.turning_column(i))
                })
                .collect();
            let free = columns.iter().zip(&is_held).filter(|(_, is_held)| !**is_held);
            let gram: Matrix6<f64> = free.map(|(c, _)| c * c.transpose()).sum();
            let damped = gram + Matrix6::identity() * (DAMPING * self.size * self.size);
            let Some(weights) = damped.cholesky().map(|it| it.solve(&joined(&off, &turned))) else {
                return false;
            };
            for (i, [lower, upper]) in ranges.iter().enumerate() {
                if !is_held[i] {
                    q[i] += columns[i].dot(&weights);
                    is_held[i] = !(*lower <= q[i] && q[i] <= *upper);
                    q[i] = q[i].max(*lower).min(*upper);
                }
            }
        }
        false
    }
}
