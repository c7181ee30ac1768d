//! How far the end effector tilts, and whether a straight motion keeps that within what is allowed (T199).
//!
//! Its tilt is the angle between the vertical and what of it was vertical where it is level, whichever way it turns about that.

use super::free_space::SHORTEST;
use super::levers::Jointed;
use super::ranges_of;
use crate::interrupt;
use crate::math::Vector;
use crate::scenario::ScenarioError;
use crate::trajectory::JointSpline;
use nalgebra::Matrix3;
use std::collections::VecDeque;

/// The share of what is allowed that a search leaves for corners to be rounded; what a motion keeps to; and what is certain of that.
const SEARCHED: f64 = 0.85;
const KEPT: f64 = 0.97;
/// The same of a goal.
const AT_GOAL: f64 = 0.95;
const RESOLUTION: f64 = 0.03;
/// Near an end that is tilted by more it may be tilted by that and so much of what is allowed, in a search and where corners are rounded;
/// less by so much per angle that its joints have turned from there.
const SLOPE: f64 = 0.3;
const LEFT: [f64; 2] = [0.06, 0.12];
/// What is tilted by more than it may is brought to less than this share, by steps to the other one: so many at most, of at most this angle
/// \[rad\].
const BRINGS: [f64; 2] = [0.8, 0.6];
const STEPS: usize = 20;
const STRIDE: f64 = 0.5;
/// The damping of these steps.
const DAMPING: f64 = 1e-4;

/// What the end effector may tilt.
#[derive(Debug, Clone)]
pub struct Tilt {
    /// The direction of the end effector that is to be vertical, and the vertical.
    level: Vector<3>,
    vertical: Vector<3>,
    /// How far it may be from that \[rad\].
    most: f64,
    /// The ends of motions where it is tilted by nearly all of that or more, and how far.
    ends: Vec<(Vec<f64>, f64)>,
    /// Whether corners are rounded by now.
    is_rounded: bool,
    /// What a motion may tilt it beyond what is looked at \[rad\].
    beyond: f64,
}

/// Refuses other plans that keep to `most` \[rad\] from how the end effector stands at `upright` where `plan` leads to where it leans by
/// more.
///
/// # Errors
/// At `replan.tilt`.
pub fn leads_upright<R: Jointed<D>, const D: usize>(
    robot: &mut R,
    upright: &[f64],
    plan: Option<&JointSpline>,
    most: Option<f64>,
) -> Result<(), ScenarioError> {
    let (Some(plan), Some(most)) = (plan, most) else { return Ok(()) };
    let tilt = Tilt::new(robot, upright, most);
    robot.update_positions(plan.last());
    let leans = tilt.of(robot);
    if leans <= tilt.most_at_goal() {
        return Ok(());
    }
    let requirement = format!(
        "{:.4} at least, as the end effector leans by {leans:.4} rad where the plan ends",
        leans / AT_GOAL
    );
    Err(ScenarioError::out_of_range("replan.tilt", &requirement, most))
}

impl Tilt {
    /// At most `most` \[rad\] from how it stands at `level`.
    pub fn new<R: Jointed<D>, const D: usize>(robot: &mut R, level: &[f64], most: f64) -> Self {
        robot.update_positions(level);
        let vertical = robot.vertical();
        let level = robot.tip_axes().tr_mul(&vertical);
        Self { level, vertical, most, ends: vec![], is_rounded: false, beyond: 0.0 }
    }

    /// For a search of motions from and to these, at one of which it may be tilted by more.
    pub fn search<'a, R: Jointed<D>, const D: usize>(
        &mut self,
        robot: &mut R,
        ends: impl IntoIterator<Item = &'a Vec<f64>>,
    ) {
        self.is_rounded = false;
        self.ends.clear();
        for q in ends {
            robot.update_positions(q);
            let tilted = self.of(robot);
            if tilted > (SEARCHED - LEFT[0]) * self.most {
                self.ends.push((q.clone(), tilted));
            }
        }
    }

    /// From now on for motions whose corners are rounded.
    pub fn round(&mut self) {
        self.is_rounded = true;
    }

    /// For motions on which nothing turns by more than this angle beyond what is asked for \[rad\]: it is tilted by that much more, and
    /// may be by as much less as what is allowed falls.
    pub fn and_beyond(&mut self, beyond: f64) {
        self.beyond = (1.0 + self.slope()) * beyond;
    }

    /// By how much what is allowed falls at most, per angle.
    fn slope(&self) -> f64 {
        if self.ends.is_empty() { 0.0 } else { SLOPE }
    }

    /// What it is allowed \[rad\].
    pub fn most(&self) -> f64 {
        self.most
    }

    /// What it may be tilted by at a goal \[rad\].
    pub fn most_at_goal(&self) -> f64 {
        AT_GOAL * self.most
    }

    /// Where what is level points.
    fn direction<R: Jointed<D>, const D: usize>(&self, robot: &R) -> Vector<3> {
        robot.tip_axes() * self.level
    }

    fn angle(&self, direction: &Vector<3>) -> f64 {
        // Exact to the last digits however small it is.
        direction.cross(&self.vertical).norm().atan2(direction.dot(&self.vertical))
    }

    /// How far it is tilted where `robot` is \[rad\].
    pub fn of<R: Jointed<D>, const D: usize>(&self, robot: &R) -> f64 {
        self.angle(&self.direction(robot))
    }

    /// How far it may be tilted at `q` \[rad\].
    fn allowed(&self, q: &[f64]) -> f64 {
        let rounded = usize::from(self.is_rounded);
        let far = [SEARCHED, KEPT][rounded] * self.most;
        let near = |(end, tilted): &(Vec<f64>, f64)| {
            let with_room = tilted + LEFT[rounded] * self.most;
            let most = KEPT * self.most;
            let there = if *tilted > most { with_room } else { with_room.min(most) };
            there - SLOPE * turn([end, q])
        };
        self.ends.iter().map(near).fold(far, f64::max)
    }

    /// Whether it keeps to that on the straight motion between two ends: as certificates of distances do, halves of halves are asked.
    pub fn is_kept<R: Jointed<D>, const D: usize>(
        &self,
        robot: &mut R,
        [a, b]: [&[f64]; 2],
    ) -> bool {
        let whole = turn([a, b]);
        let slope = self.slope();
        let mut middle = vec![0.0; a.len()];
        let mut parts = VecDeque::from([(0.5, 0.5)]);
        while let Some((at, half)) = parts.pop_front() {
            interrupt::checkpoint(32 * a.len());
            for (m, (a, b)) in middle.iter_mut().zip(a.iter().zip(b)) {
                *m = a + at * (b - a);
            }
            robot.update_positions(&middle);
            let direction = self.direction(robot);
            let room = self.allowed(&middle) - self.beyond - self.angle(&direction);
            let omega: Vector<3> =
                (0..a.len()).map(|i| robot.turning_column(i) * (b[i] - a[i])).sum();
            let part = half * whole;
            let turns = half * omega.cross(&direction).norm() + 0.5 * part * part;
            let change = turns.min(part) + slope * part;
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

    /// Moves `robot` from `q` to where the end effector is tilted by less than is allowed, within its limits, if it is tilted by more; whether
    /// it was.
    pub fn level<R: Jointed<D>, const D: usize>(&self, robot: &mut R, q: &mut [f64]) -> bool {
        let [above, to] = BRINGS.map(|share| share * self.most);
        let ranges: Vec<_> = (0..q.len()).map(|i| ranges_of(robot.limits(), i)).collect();
        for step in 0..STEPS {
            interrupt::checkpoint(64 * q.len());
            robot.update_positions(q);
            let direction = self.direction(robot);
            let angle = self.angle(&direction);
            if step == 0 && angle <= self.allowed(q) {
                return false;
            }
            if angle <= above {
                break;
            }
            // About the axis that leads straight back; any one across where it hangs upside down.
            let across = direction.cross(&self.vertical);
            let axis = if across.norm() > 1e-9 {
                across.normalize()
            } else {
                let other = if direction.x.abs() < 0.6 { Vector::x() } else { Vector::y() };
                direction.cross(&other).normalize()
            };
            let back = axis * (angle - to).min(STRIDE);
            // What the joints do to the direction, without turns about it.
            let columns: Vec<Vector<3>> = (0..q.len())
                .map(|i| {
                    let column = robot.turning_column(i);
                    column - direction * column.dot(&direction)
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

/// The most that anything turns between two configurations, of which joints that slide count as if they turned \[rad\].
fn turn([a, b]: [&[f64]; 2]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (b - a).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::super::levers::tests::lifted;
    use super::*;
    use crate::robot::Robot;
    use proptest::prelude::*;

    proptest! {
        /// What is certified is so at every sample, by an angle that is taken in another way; and what is refused leaves what is allowed, or
        /// comes within the resolution of that.
        #[test]
        fn what_is_kept_is_kept_in_between(
            level in prop::collection::vec(-1.5..1.5, 8), step in prop::collection::vec(-0.5..0.5, 8), most in 0.05..1.0, size in 0.0..1.0,
        ) {
            let mut robot = lifted();
            let mut level = level;
            level[0] *= 0.3;
            let tilt = Tilt::new(&mut robot, &level, most);
            let at = |share: f64| -> Vec<f64> { level.iter().zip(&step).map(|(q, d)| q + size * (share - 0.3) * d).collect() };
            let kept = tilt.is_kept(&mut robot, [&at(0.0), &at(1.0)]);
            robot.update_positions(&level);
            let upright = robot.tip_axes().tr_mul(&Vector::<3>::z());
            let mut worst: f64 = 0.0;
            for k in 0..=200 {
                robot.update_positions(&at(f64::from(k) / 200.0));
                worst = worst.max((robot.tip_axes() * upright).z.clamp(-1.0, 1.0).acos());
            }
            if kept {
                prop_assert!(worst <= (SEARCHED + RESOLUTION) * most + 1e-7, "{worst} of {most}");
            } else {
                prop_assert!(worst >= (SEARCHED - RESOLUTION - 0.01) * most, "{worst} of {most} is enough");
            }
        }

        /// What is righted is upright enough, within the limits, unless the joints that could do it are at them.
        #[test]
        fn it_is_brought_back(q in prop::collection::vec(-0.5..0.5, 8), most in 0.05..0.3) {
            let mut robot = lifted();
            let tilt = Tilt::new(&mut robot, &[0.0, 0.1, -0.2, 0.0, -1.8, 0.0, 1.9, 0.5], most);
            let mut q: Vec<f64> = q.iter().zip([0.0, 0.1, -0.2, 0.0, -1.8, 0.0, 1.9, 0.5]).map(|(d, q)| q + d).collect();
            robot.update_positions(&q);
            let before = tilt.of(&robot);
            let was = q.clone();
            let is_moved = tilt.level(&mut robot, &mut q);
            prop_assert_eq!(is_moved, before > SEARCHED * most);
            prop_assert!(is_moved || q == was);
            robot.update_positions(&q);
            prop_assert!(tilt.of(&robot) <= SEARCHED * most, "{} of {most}", tilt.of(&robot));
            for (i, q) in q.iter().enumerate() {
                let [lower, upper] = ranges_of(robot.limits(), i);
                prop_assert!(lower <= *q && *q <= upper);
            }
        }
    }
}
