//! How far the joints of an arm carry its links.

use super::bundle::Bundle;
use crate::geometry::{Form, gap_between};
use crate::interrupt;
use crate::math::{Capsule, Vector, in_space};
use crate::robot::{Manipulator, PlanarState, Robot, SpatialState};
use nalgebra::Matrix3;

/// What a planner asks of an arm beyond the operators of the law.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::planning::motion::Jointed;
///
/// fn base<R: Jointed<D>, const D: usize>(robot: &R) -> Vector<D> {
///     robot.joint_position(0)
/// }
/// ```
pub trait Jointed<const D: usize>: Robot<D> {
    /// The origin of joint `i` \[m\].
    fn joint_position(&self, i: usize) -> Vector<D>;
    /// The unit vector along joint `i`, in space.
    fn joint_axis(&self, i: usize) -> Vector<3>;
    /// Whether joint `i` slides.
    fn slides(&self, i: usize) -> bool;
    /// Where the end effector is \[m\].
    fn tip(&self) -> Vector<D>;
    /// The axes of the end effector in the world, one per column; in the plane those in space that turn with it.
    fn tip_axes(&self) -> Matrix3<f64>;
    /// The unit vector against gravity; z where there is none, x in the plane, where all that matters is how far it turns.
    fn vertical(&self) -> Vector<3>;
    /// What people call joint `i`.
    fn joint_name(&self, i: usize) -> String;
    /// What people call a link; None is the base.
    fn link_name(&self, link: Option<usize>) -> String;
    /// Bodies that are looked at together first.
    fn bundles(&self) -> Vec<Bundle<D>> {
        vec![]
    }
    /// How far two bodies, of which one is a hull, are apart at least \[m\]: never more than their distance, and less by rounding alone; from
    /// `limit` on, anything that is not below, and −∞ where they overlap. `plane` is the normal of the plane that told them apart last, from
    /// the first to the second, and is asked first; 0 where none is known. What is told is so along the normal that is left there, if
    /// one is.
    fn gap(_bodies: [&Form<'_, D>; 2], _limit: f64, _plane: &mut Vector<D>) -> f64 {
        f64::INFINITY
    }
}

impl Jointed<2> for PlanarState {
    fn joint_position(&self, i: usize) -> Vector<2> {
        Self::joint_position(self, i)
    }

    fn tip(&self) -> Vector<2> {
        Manipulator::<2, 2>::pose(self)
    }

    fn joint_axis(&self, _: usize) -> Vector<3> {
        Vector::<3>::z()
    }

    fn slides(&self, _: usize) -> bool {
        false
    }

    fn tip_axes(&self) -> Matrix3<f64> {
        let (y, x) = Manipulator::<2, 3>::pose(self).0.z.sin_cos();
        Matrix3::new(x, -y, 0.0, y, x, 0.0, 0.0, 0.0, 1.0)
    }

    fn vertical(&self) -> Vector<3> {
        Vector::<3>::x()
    }

    fn joint_name(&self, i: usize) -> String {
        format!("joint {i}")
    }

    fn link_name(&self, link: Option<usize>) -> String {
        link.map_or_else(|| "the base".to_owned(), |link| format!("link {link}"))
    }
}

impl Jointed<3> for SpatialState {
    fn joint_position(&self, i: usize) -> Vector<3> {
        Self::joint_position(self, i)
    }

    fn tip(&self) -> Vector<3> {
        Manipulator::<3, 3>::pose(self)
    }

    fn joint_axis(&self, i: usize) -> Vector<3> {
        Self::joint_axis(self, i)
    }

    fn slides(&self, i: usize) -> bool {
        Self::slides(self, i)
    }

    fn tip_axes(&self) -> Matrix3<f64> {
        self.orientation().matrix()
    }

    fn vertical(&self) -> Vector<3> {
        (-self.arm().gravity()).try_normalize(0.0).unwrap_or_else(Vector::<3>::z)
    }

    fn joint_name(&self, i: usize) -> String {
        self.arm().joint_names().nth(i).map_or_else(String::new, |name| format!("`{name}`"))
    }

    fn link_name(&self, link: Option<usize>) -> String {
        let named = |link| self.arm().link_names().nth(link).map(|name| format!("`{name}`"));
        link.and_then(named).unwrap_or_else(|| "the base".to_owned())
    }

    fn bundles(&self) -> Vec<Bundle<3>> {
        Bundle::of_all(self)
    }

    fn gap(bodies: [&Form<'_>; 2], limit: f64, plane: &mut Vector<3>) -> f64 {
        gap_between(bodies, limit, plane)
    }
}

/// How a link moves now, for a motion of all joints in unit time.
#[derive(Debug, Clone, Copy)]
pub struct Twist {
    /// What of it is at the origin of the world moves so \[m\].
    origin: Vector<3>,
    /// It turns so \[rad\].
    turn: Vector<3>,
}

impl Twist {
    const NONE: Self =
        Self { origin: Vector::<3>::new(0.0, 0.0, 0.0), turn: Vector::<3>::new(0.0, 0.0, 0.0) };

    /// Of all links of `robot` where it is, while the joints go from `a` to `b`.
    pub fn of_links<R: Jointed<D>, const D: usize>(
        robot: &R,
        [a, b]: [&[f64]; 2],
        out: &mut Vec<Self>,
    ) {
        out.clear();
        let mut now = Self::NONE;
        for i in 0..a.len() {
            let step = robot.joint_axis(i) * (b[i] - a[i]);
            if robot.slides(i) {
                now.origin += step;
            } else {
                now.origin -= step.cross(&in_space(&robot.joint_position(i)));
                now.turn += step;
            }
            out.push(now);
        }
    }

    /// As seen by what moves like `other`.
    pub fn beside(self, other: Option<Self>) -> Self {
        let other = other.unwrap_or(Self::NONE);
        Self { origin: self.origin - other.origin, turn: self.turn - other.turn }
    }

    /// How fast any point of `body` moves at most along a unit vector, to and fro \[m\].
    pub fn along<const D: usize>(&self, normal: &Vector<D>, body: &Capsule<D>) -> f64 {
        let normal = in_space(normal);
        let turn = normal.cross(&self.turn); // nᵀ(ω × p) = (n × ω)ᵀp
        let at = |point: Vector<D>| (normal.dot(&self.origin) + turn.dot(&in_space(&point))).abs();
        at(body.start).max(at(body.end())) + body.radius * turn.norm()
    }
}

/// How far a motion carries what belongs to the arm \[m\].
#[derive(Debug, Clone)]
pub struct Levers {
    /// How far a point of link l is from joint i at most, number i·n + l; 1 where joint i slides.
    lever: Vec<f64>,
    /// The same of the tip of the end effector.
    tip: Vec<f64>,
    n: usize,
    /// All of the arm stays within so much of there \[m\].
    origin: Vector<3>,
    reach: f64,
}

impl Levers {
    /// Of `robot`, which is moved to q = 0.
    pub fn new<R: Jointed<D>, const D: usize>(robot: &mut R) -> Self {
        let n = robot.dof();
        robot.update_positions(&vec![0.0; n]);
        let travel = |k: usize| match robot.limits().joint.get(k) {
            Some([lower, upper]) if robot.slides(k) => lower.abs().max(upper.abs()),
            _ => 0.0,
        };
        let mut extent = vec![0.0_f64; n];
        for body in robot.bodies() {
            let from_joint = body.reach_from(&robot.joint_position(body.link));
            extent[body.link] = extent[body.link].max(from_joint);
        }
        let thickest = robot.bodies().map(|body| body.shape.radius).fold(0.0, f64::max);
        let (mut lever, mut tip, mut reach) = (vec![0.0; n * n], vec![0.0; n], 0.0);
        let last = (robot.tip() - robot.joint_position(n - 1)).norm();
        for i in 0..n {
            interrupt::checkpoint(n);
            let mut along = travel(i);
            for link in i..n {
                if i == 0 {
                    reach = f64::max(reach, along + extent[link] + thickest);
                }
                lever[i * n + link] = if robot.slides(i) { 1.0 } else { along + extent[link] };
                if link + 1 < n {
                    let next = robot.joint_position(link + 1) - robot.joint_position(link);
                    along += next.norm() + travel(link + 1);
                }
            }
            tip[i] = if robot.slides(i) { 1.0 } else { along + last };
        }
        Self { lever, tip, n, origin: in_space(&robot.joint_position(0)), reach }
    }

    /// The centre and the radius of a ball in which all of the arm is, wherever its joints are \[m\].
    pub fn ball<const D: usize>(&self) -> (Vector<D>, f64) {
        (Vector::from_fn(|row, _| self.origin[row]), self.reach)
    }

    /// How far `link` goes at most as seen by `from`, the base or a link before it, while the joints go from `a` to `b`.
    pub fn way(&self, [a, b]: [&[f64]; 2], from: Option<usize>, link: usize) -> f64 {
        let first = from.map_or(0, |from| from + 1);
        (first..=link).map(|i| (b[i] - a[i]).abs() * self.lever[i * self.n + link]).sum()
    }

    /// How far the tip of the end effector goes at most while the joints go from `a` to `b`, and how much it is accelerated while they do so
    /// evenly in unit time \[m\].
    pub fn of_tip(&self, [a, b]: [&[f64]; 2]) -> [f64; 2] {
        let steps = a.iter().zip(b).map(|(a, b)| (b - a).abs());
        bent(steps.zip(self.tip.iter().copied()))
    }

    /// How much `link` is accelerated at most as seen by `from` while the joints go evenly from `a` to `b` in unit time
    /// \[m\]: of two joints, the one before turns what the one behind moves (T195).
    pub fn bend(&self, [a, b]: [&[f64]; 2], from: Option<usize>, link: usize) -> f64 {
        let first = from.map_or(0, |from| from + 1);
        let steps = (first..=link).map(|i| ((b[i] - a[i]).abs(), self.lever[i * self.n + link]));
        bent(steps)[1]
    }
}

/// How far joints with these steps and levers, the first one first, carry a point at most, and how much they accelerate it.
fn bent(steps: impl Iterator<Item = (f64, f64)>) -> [f64; 2] {
    let ([mut way, mut bend], mut before) = ([0.0; 2], 0.0);
    for (step, lever) in steps {
        way += step * lever;
        bend += step * lever * (step + 2.0 * before);
        before += step;
    }
    [way, bend]
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::robot::description::JointKind;
    use crate::robot::models;
    use proptest::prelude::*;
    use std::sync::Arc;

    /// An arm in space with a joint that slides, and joints that turn about any axis of their links: a Panda on a lift, changed.
    pub fn lifted() -> SpatialState {
        let mut panda = models::named("panda").unwrap();
        panda.joints[1].axis = [0.0, 1.0, 0.0];
        panda.joints[3].axis = [-0.6, 0.0, 0.8];
        let mut lift = panda.joints[0].clone();
        lift.kind = JointKind::Prismatic;
        (lift.name, lift.link) = ("lift".into(), "carriage".into());
        panda.joints.insert(0, lift);
        panda.joint_limits.insert(0, [-0.5, 0.5]);
        panda.velocity_limits.insert(0, 1.0);
        panda.torque_limits.insert(0, 1e3);
        Arc::new(panda.build().unwrap()).state()
    }

    properties! {
        /// No point of a body goes farther along a normal than the first two terms of its way say, from the middle of a motion to
        /// both ends, and its acceleration is what they take it for (T195).
        #[test]
        fn no_point_goes_farther_along_a_normal(
            middle in [-1.5..1.5, -1.5..1.5, -1.5..1.5, -1.5..1.5, -1.5..1.5, -1.5..1.5, -1.5..1.5, -1.5..1.5],
            step in [-0.5..0.5, -0.5..0.5, -0.5..0.5, -0.5..0.5, -0.5..0.5, -0.5..0.5, -0.5..0.5, -0.5..0.5],
            normal in [-1.0..1.0, -1.0..1.0, -1.0..1.0], from in 0..8usize,
        ) {
            let mut robot = lifted();
            let reach = Levers::new(&mut robot);
            let normal = Vector::<3>::from(normal).normalize();
            let at = |share: f64| -> Vec<f64> {
                (0..8).map(|i| if i == 0 { 0.3 * middle[i] } else { middle[i] } + share * step[i]).collect()
            };
            let (a, b) = (at(-0.5), at(0.5));
            robot.update_positions(&at(0.0));
            let mut twists = vec![];
            Twist::of_links(&robot, [&a, &b], &mut twists);
            // As seen by a link before it, or by the base.
            for body in 0..robot.body_count() {
                let link = robot.body(body).link;
                let from = from.checked_sub(1).filter(|from| *from < link);
                let seen = |robot: &SpatialState, point: Vector<3>| match from {
                    Some(from) => robot.link_axes(from).tr_mul(&(point - robot.joint_position(from))),
                    None => point,
                };
                let ends = |robot: &SpatialState| {
                    let shape = robot.body(body).shape;
                    [shape.start, shape.end()].map(|end| seen(robot, end))
                };
                robot.update_positions(&at(0.0));
                let shape = robot.body(body).shape;
                let along = match from {
                    Some(from) => robot.link_axes(from).tr_mul(&normal),
                    None => normal,
                };
                let speed = twists[link].beside(from.map(|from| twists[from])).along(&normal, &shape);
                let bend = reach.bend([&a, &b], from, link);
                let before = ends(&robot);
                for half in [-0.5, -0.25, -0.01, 0.01, 0.2, 0.5] {
                    robot.update_positions(&at(half));
                    let most = speed * f64::abs(half) + 0.5 * bend * half * half;
                    for (now, before) in ends(&robot).iter().zip(&before) {
                        let way = along.dot(&(now - before)).abs();
                        prop_assert!(way <= most + 1e-12, "{way} is more than {most}");
                    }
                }
            }
        }
    }
}
