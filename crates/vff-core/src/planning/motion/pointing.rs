//! Where the end effector points, and whether a straight motion keeps that within what is allowed (T199, T203).
//!
//! What of it was vertical where it is level may lean by so much from the vertical, whichever way it turns about that; and what it has in
//! front of it may be off a point that it keeps in view by so much.

use super::free_space::SHORTEST;
use super::levers::{Jointed, Levers};
use super::ranges_of;
use super::why::{out_of_view, too_tilted};
use crate::interrupt;
use crate::math::{Vector, in_space};
use crate::scenario::ScenarioError;
use crate::trajectory::JointSpline;
use nalgebra::Matrix3;
use std::collections::VecDeque;
use std::f64::consts::PI;
use std::iter;

/// The share of what is allowed that a search leaves for corners to be rounded; what a motion keeps to; and what is certain of that.
const SEARCHED: f64 = 0.85;
const KEPT: f64 = 0.97;
/// The same of a goal.
pub const AT_GOAL: f64 = 0.95;
const RESOLUTION: f64 = 0.03;
/// Near an end where it is off by more it may be off by that and so much of what is allowed, in a search and where corners are rounded;
/// less by so much per angle that its joints have turned from there.
const SLOPE: f64 = 0.3;
const LEFT: [f64; 2] = [0.06, 0.12];
/// What is off by more than it may is brought to less than this share, by steps to the other one: so many at most, of at most this angle
/// \[rad\].
const BRINGS: [f64; 2] = [0.8, 0.6];
const STEPS: usize = 20;
const STRIDE: f64 = 0.5;
/// The damping of these steps.
const DAMPING: f64 = 1e-4;
/// The direction to what passes at speed v in a distance of 1 is accelerated by no more than this v², √(4/3).
const MOST_CURVED: f64 = 1.154_700_538_379_252;

/// What of the end effector has to point where, and how far it may be off.
#[derive(Debug, Clone)]
pub struct Pointing {
    /// A direction of the end effector, in its own axes.
    axis: Vector<3>,
    to: Target,
    /// How far it may be from that \[rad\].
    most: f64,
    /// The ends of motions where it is off by nearly all of that or more, and how far.
    ends: Vec<(Vec<f64>, f64)>,
    /// Whether corners are rounded by now.
    is_rounded: bool,
    /// What a motion may turn it \[rad\] and carry it \[m\] beyond what is looked at.
    beyond: [f64; 2],
}

/// Where something has to point.
#[derive(Debug, Clone, Copy)]
enum Target {
    /// Along a unit vector.
    Along(Vector<3>),
    /// From the end effector to a point \[m\].
    At(Vector<3>),
}

/// Where the end effector points, as a unit vector, where it should, and how far away that is \[m\].
#[derive(Debug, Clone, Copy)]
struct Sight {
    is: Vector<3>,
    should: Vector<3>,
    distance: f64,
}

impl Sight {
    /// The angle between both \[rad\], exact to the last digits however small it is.
    fn angle(&self) -> f64 {
        self.is.cross(&self.should).norm().atan2(self.is.dot(&self.should))
    }
}

/// Refuses other plans that keep to what the end effector has to point at where `plan` leads to where it is off by more.
///
/// # Errors
/// At `replan.tilt` or `replan.view_angle`.
pub fn leads_upright<R: Jointed<D>, const D: usize>(
    robot: &mut R,
    pointings: &[Pointing],
    plan: Option<&JointSpline>,
) -> Result<(), ScenarioError> {
    let Some(plan) = plan else { return Ok(()) };
    robot.update_positions(plan.last());
    for pointing in pointings {
        let off = pointing.of(robot);
        if off > pointing.most_at_goal() {
            let (key, how) = match pointing.to {
                Target::Along(_) => ("tilt", "leans by"),
                Target::At(_) => ("view_angle", "has the point out of its axis by"),
            };
            let least = off / AT_GOAL;
            let requirement = format!(
                "{least:.4} at least, as the end effector {how} {off:.4} rad where the plan ends"
            );
            let path = format!("replan.{key}");
            return Err(ScenarioError::out_of_range(path, &requirement, pointing.most));
        }
    }
    Ok(())
}

impl Pointing {
    /// Upright as at `level`, but for `most` \[rad\].
    pub fn upright<R: Jointed<D>, const D: usize>(robot: &mut R, level: &[f64], most: f64) -> Self {
        robot.update_positions(level);
        let vertical = robot.vertical();
        Self::new(robot.tip_axes().tr_mul(&vertical), Target::Along(vertical), most)
    }

    /// A point in front of the end effector, but for `most` \[rad\].
    pub fn in_view<const D: usize>(point: &[f64], most: f64) -> Self {
        let front = if D == 2 { Vector::<3>::x() } else { Vector::<3>::z() };
        Self::new(front, Target::At(in_space(&Vector::<D>::from_column_slice(point))), most)
    }

    fn new(axis: Vector<3>, to: Target, most: f64) -> Self {
        Self { axis, to, most, ends: vec![], is_rounded: false, beyond: [0.0; 2] }
    }

    /// Whether it is a point that is kept in view.
    pub fn is_view(&self) -> bool {
        matches!(self.to, Target::At(_))
    }

    /// What more of it would help where there is no motion, in the middle of a list.
    pub fn more(&self) -> &'static str {
        if self.is_view() { ", a greater angle of view" } else { ", a greater tilt" }
    }

    /// For a search of motions from and to these, at one of which it may be off by more.
    pub fn search<R: Jointed<D>, const D: usize>(
        &mut self,
        robot: &mut R,
        start: &[f64],
        goals: &[Vec<f64>],
    ) {
        self.is_rounded = false;
        self.ends.clear();
        for q in iter::once(start).chain(goals.iter().map(Vec::as_slice)) {
            robot.update_positions(q);
            let off = self.of(robot);
            if off > (SEARCHED - LEFT[0]) * self.most {
                self.ends.push((q.to_vec(), off));
            }
        }
    }

    /// From now on for motions whose corners are rounded.
    pub fn round(&mut self) {
        self.is_rounded = true;
    }

    /// For motions on which nothing turns by more than `turns` \[rad\] beyond what is asked for, and the end effector goes no farther than
    /// `way` \[m\] beyond it: it is off by so much more, and may be by as much less as what is allowed falls.
    pub fn and_beyond(&mut self, turns: f64, way: f64) {
        self.beyond = [(1.0 + self.slope()) * turns, way];
    }

    /// By how much what is allowed falls at most, per angle.
    fn slope(&self) -> f64 {
        if self.ends.is_empty() { 0.0 } else { SLOPE }
    }

    /// What it is allowed \[rad\].
    pub fn most(&self) -> f64 {
        self.most
    }

    /// What it is allowed at a goal \[rad\].
    fn most_at_goal(&self) -> f64 {
        AT_GOAL * self.most
    }

    /// Why a goal where `robot` is is of no use.
    pub fn why<R: Jointed<D>, const D: usize>(&self, robot: &R) -> String {
        let say = if self.is_view() { out_of_view } else { too_tilted };
        say(self.of(robot), self.most_at_goal())
    }

    fn sight<R: Jointed<D>, const D: usize>(&self, robot: &R) -> Sight {
        let is = robot.tip_axes() * self.axis;
        match self.to {
            Target::Along(should) => Sight { is, should, distance: f64::INFINITY },
            Target::At(point) => {
                let sight = point - in_space(&robot.tip());
                let distance = sight.norm();
                // What is at the point itself looks at it whichever way it points, until it moves.
                let should = if distance > 0.0 { sight / distance } else { is };
                Sight { is, should, distance }
            }
        }
    }

    /// How far it is off where `robot` is \[rad\].
    pub fn of<R: Jointed<D>, const D: usize>(&self, robot: &R) -> f64 {
        self.sight(robot).angle()
    }

    /// How far it may be off at `q` \[rad\].
    fn allowed(&self, q: &[f64]) -> f64 {
        let rounded = usize::from(self.is_rounded);
        let far = [SEARCHED, KEPT][rounded] * self.most;
        let near = |(end, off): &(Vec<f64>, f64)| {
            let with_room = off + LEFT[rounded] * self.most;
            let most = KEPT * self.most;
            let there = if *off > most { with_room } else { with_room.min(most) };
            there - SLOPE * turn([end, q])
        };
        self.ends.iter().map(near).fold(far, f64::max)
    }

    /// Whether it keeps to that on the straight motion between two ends: as certificates of distances do, halves of halves are asked.
    pub fn is_kept<R: Jointed<D>, const D: usize>(
        &self,
        robot: &mut R,
        levers: &Levers,
        ends: [&[f64]; 2],
    ) -> bool {
        let [a, b] = ends;
        let step: Vec<f64> = a.iter().zip(b).map(|(a, b)| b - a).collect();
        let whole = turn(ends);
        let slope = self.slope();
        let carried = if self.is_view() { levers.of_tip(ends) } else { [0.0; 2] };
        let mut middle = vec![0.0; a.len()];
        let mut parts = VecDeque::from([(0.5, 0.5)]);
        while let Some((at, half)) = parts.pop_front() {
            interrupt::checkpoint(32 * a.len());
            for (m, (a, step)) in middle.iter_mut().zip(a.iter().zip(&step)) {
                *m = a + at * step;
            }
            robot.update_positions(&middle);
            let sight = self.sight(robot);
            let angle = sight.angle();
            let room = self.allowed(&middle) - self.beyond_at(&sight, half * carried[0]) - angle;
            let part = half * whole;
            let change = self.change(robot, &sight, &step, [half, part], carried) + slope * part;
            if room >= change || (room >= 0.0 && change <= RESOLUTION * self.most) {
                continue;
            }
            let is_inside = room >= 0.0; // false for NaN
            if !is_inside || half < SHORTEST {
                return false;
            }
            parts.extend([(at - 0.5 * half, 0.5 * half), (at + 0.5 * half, 0.5 * half)]);
        }
        true
    }

    /// By how much what a motion does beyond what is looked at may put it off, within `way` \[m\] of where it is seen so \[rad\].
    fn beyond_at(&self, sight: &Sight, way: f64) -> f64 {
        let [turns, carried] = self.beyond;
        turns + swept(carried, sight.distance - way)
    }

    /// By how much more it may be off in a part of a motion by `step` that goes so much before and after where `robot` is, on which nothing
    /// turns by more than `part` \[rad\], and the tip is carried so far in all and accelerated so much at most (T203) \[rad\].
    fn change<R: Jointed<D>, const D: usize>(
        &self,
        robot: &R,
        sight: &Sight,
        step: &[f64],
        [half, part]: [f64; 2],
        [carried, bend]: [f64; 2],
    ) -> f64 {
        let Sight { is, should, distance } = *sight;
        let steps = || step.iter().enumerate();
        let turn: Vector<3> = steps().map(|(i, step)| robot.turning_column(i) * *step).sum();
        let turned = turn.cross(&is);
        let bent = 0.5 * part * part;
        let turns = (half * turned.norm() + bent).min(part);
        if !self.is_view() || carried == 0.0 {
            return turns;
        }
        // The point as seen from the tip, which comes no nearer than that.
        let nearest = distance - half * carried;
        if nearest.is_nan() || nearest <= 0.0 {
            return PI;
        }
        let columns = steps().map(|(i, step)| robot.jacobian_column::<D>(i) * *step);
        let velocity = in_space(&columns.sum::<Vector<D>>());
        let seen = (should * should.dot(&velocity) - velocity) / distance;
        let sharpest = bend / nearest + MOST_CURVED * (carried / nearest).powi(2);
        let curved = 0.5 * half * half * sharpest;
        let apart = (half * seen.norm() + curved).min(swept(half * carried, distance));
        // Both go the same way where the motion keeps the point in view: the chord between them tells.
        let chord = (is - should).norm() + half * (turned - seen).norm() + bent + curved;
        let together = 2.0 * (0.5 * chord).min(1.0).asin() - sight.angle();
        (turns + apart).min(together)
    }

    /// Moves `robot` from `q` to where it is off by less than is allowed, within its limits, if it is off by more; whether it was.
    pub fn level<R: Jointed<D>, const D: usize>(&self, robot: &mut R, q: &mut [f64]) -> bool {
        let [above, to] = BRINGS.map(|share| share * self.most);
        let ranges: Vec<_> = (0..q.len()).map(|i| ranges_of(robot.limits(), i)).collect();
        for step in 0..STEPS {
            interrupt::checkpoint(64 * q.len());
            robot.update_positions(q);
            let sight = self.sight(robot);
            let angle = sight.angle();
            if step == 0 && angle <= self.allowed(q) {
                return false;
            }
            if angle <= above {
                break;
            }
            // About the axis that leads straight back; any one across where it points the other way.
            let Sight { is, should, distance } = sight;
            let across = is.cross(&should);
            let axis = if across.norm() > 1e-9 {
                across.normalize()
            } else {
                let other = if is.x.abs() < 0.6 { Vector::x() } else { Vector::y() };
                is.cross(&other).normalize()
            };
            let back = axis * (angle - to).min(STRIDE);
            // What the joints do to where it points as seen from where it should, without turns about that.
            let columns: Vec<Vector<3>> = (0..q.len())
                .map(|i| {
                    let mut column = robot.turning_column(i);
                    if self.is_view() && distance > 0.0 {
                        column +=
                            should.cross(&in_space(&robot.jacobian_column::<D>(i))) / distance;
                    }
                    column - is * column.dot(&is)
                })
                .collect();
            let gram: Matrix3<f64> = columns.iter().map(|c| c * c.transpose()).sum();
            let damped = gram + Matrix3::identity() * DAMPING;
            let Some(weights) = damped.cholesky().map(|it| it.solve(&back)) else { break };
            for ((q, column), [lower, upper]) in q.iter_mut().zip(&columns).zip(&ranges) {
                *q = (*q + column.dot(&weights)).max(*lower).min(*upper);
            }
        }
        true
    }
}

/// How far the direction to a point turns at most that is so far away where what looks at it is carried so far \[rad\].
fn swept(way: f64, distance: f64) -> f64 {
    if way <= 0.0 {
        0.0
    } else if way < distance {
        (way / distance).asin()
    } else {
        PI
    }
}

/// The most that anything turns between two configurations, of which joints that slide count as if they turned \[rad\].
fn turn([a, b]: [&[f64]; 2]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (b - a).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::super::levers::tests::lifted;
    use super::*;
    use crate::robot::{Robot, SpatialState};
    use proptest::prelude::*;

    const READY: [f64; 8] = [0.0, 0.1, -0.2, 0.0, -1.8, 0.0, 1.9, 0.5];

    /// By an angle that is taken in another way.
    fn angle_of(robot: &mut SpatialState, pointing: &Pointing, q: &[f64]) -> f64 {
        robot.update_positions(q);
        let should = match pointing.to {
            Target::Along(there) => there,
            Target::At(point) => (point - robot.tip()).normalize(),
        };
        (robot.tip_axes() * pointing.axis).dot(&should).clamp(-1.0, 1.0).acos()
    }

    properties! {
        /// What is certified is so at every sample; and what is refused leaves what is allowed, or comes within the resolution of that.
        #[test]
        fn what_is_kept_is_kept_in_between(
            level in prop::collection::vec(-1.5..1.5, 8), step in prop::collection::vec(-0.5..0.5, 8), most in 0.05..1.0, size in 0.0..1.0,
            seen in prop::option::of(([-1.0..1.0, -1.0..1.0], 0.03_f64..2.0)),
        ) {
            let mut robot = lifted();
            let mut level = level;
            level[0] *= 0.3;
            let levers = Levers::new(&mut robot);
            let pointing = match seen {
                None => Pointing::upright(&mut robot, &level, most),
                // So far in front of where the end effector is, and a little off.
                Some(([x, y], far)) => {
                    robot.update_positions(&level);
                    let off = Vector::<3>::new(0.5 * most * x, 0.5 * most * y, 1.0);
                    let point = robot.tip() + robot.tip_axes() * off * far;
                    Pointing::in_view::<3>(point.as_slice(), most)
                }
            };
            let at = |share: f64| -> Vec<f64> { level.iter().zip(&step).map(|(q, d)| q + size * (share - 0.3) * d).collect() };
            let kept = pointing.is_kept(&mut robot, &levers, [&at(0.0), &at(1.0)]);
            let mut worst: f64 = 0.0;
            for k in 0..=200 {
                worst = worst.max(angle_of(&mut robot, &pointing, &at(f64::from(k) / 200.0)));
            }
            if kept {
                prop_assert!(worst <= (SEARCHED + RESOLUTION) * most + 1e-7, "{worst} of {most}");
            } else {
                prop_assert!(worst >= (SEARCHED - RESOLUTION - 0.01) * most, "{worst} of {most} is enough");
            }
        }

        /// With joints off what is looked at by no more than it was told, it is off by no more than is allowed.
        #[test]
        fn what_is_beyond_is_reckoned_with(
            step in prop::collection::vec(-0.1..0.1, 8), bulge in prop::collection::vec(-0.02..0.02, 8), most in 0.1..0.6, far in 0.1_f64..1.0,
        ) {
            let mut robot = lifted();
            let levers = Levers::new(&mut robot);
            robot.update_positions(&READY);
            let point = robot.tip() + robot.tip_axes().column(2) * far;
            let mut pointing = Pointing::in_view::<3>(point.as_slice(), most);
            let size: Vec<f64> = bulge.iter().map(|b: &f64| b.abs()).collect();
            pointing.and_beyond(size.iter().sum(), levers.of_tip([&[0.0; 8], &size])[0]);
            let at = |share: f64| -> Vec<f64> { READY.iter().zip(&step).map(|(q, d)| q + share * d).collect() };
            if pointing.is_kept(&mut robot, &levers, [&at(0.0), &at(1.0)]) {
                for k in 0..=50 {
                    let q: Vec<f64> = at(f64::from(k) / 50.0).iter().zip(&bulge).map(|(q, b)| q + b).collect();
                    let worst = angle_of(&mut robot, &pointing, &q);
                    prop_assert!(worst <= (SEARCHED + RESOLUTION) * most + 1e-7, "{worst} of {most}");
                }
            }
        }

        /// The tip goes no farther than its levers say, and is accelerated by no more.
        #[test]
        fn the_tip_goes_no_farther(
            middle in prop::collection::vec(-1.5..1.5, 8), step in prop::collection::vec(-0.5..0.5, 8),
        ) {
            let mut robot = lifted();
            let levers = Levers::new(&mut robot);
            let at = |share: f64| -> Vec<f64> { middle.iter().zip(&step).map(|(q, d)| 0.3 * q + share * d).collect() };
            let [way, bend] = levers.of_tip([&at(-0.5), &at(0.5)]);
            let mut tip_at = |share: f64| { robot.update_positions(&at(share)); robot.tip() };
            let here = tip_at(0.0);
            for share in [-0.5, -0.2, 0.1, 0.5] {
                prop_assert!((tip_at(share) - here).norm() <= way * f64::abs(share) + 1e-12);
            }
            let h = 1e-3;
            let curved = (tip_at(h) + tip_at(-h) - here * 2.0).norm() / (h * h);
            prop_assert!(curved <= bend + 1e-6, "{curved} of {bend}");
        }

        /// What is righted is upright enough, within the limits, unless the joints that could do it are at them.
        #[test]
        fn it_is_brought_back(
            q in prop::collection::vec(-0.5..0.5, 8), most in 0.05..0.3, far in prop::option::of(0.5_f64..2.0),
        ) {
            let mut robot = lifted();
            let pointing = match far {
                None => Pointing::upright(&mut robot, &READY, most),
                Some(far) => {
                    robot.update_positions(&READY);
                    let point = robot.tip() + robot.tip_axes().column(2) * far;
                    Pointing::in_view::<3>(point.as_slice(), most)
                }
            };
            let mut q: Vec<f64> = q.iter().zip(READY).map(|(d, q)| q + d).collect();
            robot.update_positions(&q);
            let before = pointing.of(&robot);
            let was = q.clone();
            let is_moved = pointing.level(&mut robot, &mut q);
            prop_assert_eq!(is_moved, before > SEARCHED * most);
            prop_assert!(is_moved || q == was);
            robot.update_positions(&q);
            prop_assert!(pointing.of(&robot) <= SEARCHED * most, "{} of {most}", pointing.of(&robot));
            for (i, q) in q.iter().enumerate() {
                let [lower, upper] = ranges_of(robot.limits(), i);
                prop_assert!(lower <= *q && *q <= upper);
            }
        }
    }
}
