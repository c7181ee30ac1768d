//! What the search asks of an arm: where its bodies and its tip are, and what the joints do to them.

use crate::geometry::Body;
use crate::math::{Capsule, Vector, cross, perp};
use crate::robot::{
    Limits, Manipulator, Model, PlanarArm, PlanarState, Robot, SpatialArm, SpatialState,
};
use crate::scenario::CheckReach;
use crate::simulation::{Plane, Space};
use crate::trajectory::Guided;
use std::sync::Arc;

/// An arm in `D`-dimensional space with a task of dimension `M`, as far as a search for motions sees it.
pub trait Chain<const D: usize, const M: usize>: Clone {
    /// What the task means by a pose.
    type Pose: Guided<M>;

    /// Moves to the joint angles `q` \[rad\].
    fn move_to(&mut self, q: &[f64]);
    /// The pose of the tip.
    fn pose(&self) -> Self::Pose;
    /// Column `i` of the tip's Jacobian.
    fn column(&self, i: usize) -> Vector<M>;
    /// What is measured against obstacles.
    fn bodies(&self) -> impl Iterator<Item = Body<'_, D>>;
    /// `out` = the torques of `force` at `point` of link `link`.
    fn torque(&self, link: usize, point: &Vector<D>, force: &Vector<D>, out: &mut [f64]);
    /// What the joints can do.
    fn limits(&self) -> &Limits;
}

impl<R: Manipulator<D, M, Pose: Guided<M>> + Clone, const D: usize, const M: usize> Chain<D, M>
    for R
{
    type Pose = R::Pose;

    fn move_to(&mut self, q: &[f64]) {
        self.update_positions(q);
    }

    fn pose(&self) -> R::Pose {
        Manipulator::pose(self)
    }

    fn column(&self, i: usize) -> Vector<M> {
        self.jacobian_column(i)
    }

    fn bodies(&self) -> impl Iterator<Item = Body<'_, D>> {
        Robot::bodies(self)
    }

    fn torque(&self, link: usize, point: &Vector<D>, force: &Vector<D>, out: &mut [f64]) {
        self.point_jacobian_tr_mul(link, point, force, out);
    }

    fn limits(&self) -> &Limits {
        Robot::limits(self)
    }
}

/// A planar arm whose task is a position. Only its joints are computed, with the sines of the standard library: verdicts
/// on random scenes are of these numbers, bit for bit.
#[derive(Clone)]
pub struct PlanarChain {
    links: Vec<(f64, f64)>,
    limits: Limits,
    /// Positions of the joints and the tip \[m\].
    joints: Vec<Vector<2>>,
}

impl PlanarChain {
    /// Of an arm at q = 0.
    pub fn new(arm: &PlanarArm) -> Self {
        let links: Vec<_> = arm.links().iter().map(|link| (link.length, link.radius)).collect();
        let joints = vec![Vector::zeros(); links.len() + 1];
        let mut chain = Self { limits: arm.limits().clone(), joints, links };
        chain.move_to(&vec![0.0; chain.links.len()]);
        chain
    }
}

impl Chain<2, 2> for PlanarChain {
    type Pose = Vector<2>;

    fn move_to(&mut self, q: &[f64]) {
        let (mut angle, mut place) = (0.0, Vector::<2>::zeros());
        for ((q, (length, _)), joint) in q.iter().zip(&self.links).zip(&mut self.joints[1..]) {
            angle += q;
            place += Vector::<2>::new(angle.cos(), angle.sin()) * *length;
            *joint = place;
        }
    }

    fn pose(&self) -> Vector<2> {
        self.joints[self.links.len()]
    }

    fn column(&self, i: usize) -> Vector<2> {
        perp(self.joints[self.links.len()] - self.joints[i])
    }

    fn bodies(&self) -> impl Iterator<Item = Body<'_, 2>> {
        let ends = self.joints.windows(2).zip(&self.links);
        let capsules = ends.map(|(ends, (_, radius))| Capsule::new(ends[0], ends[1], *radius));
        capsules.enumerate().map(|(link, shape)| Body::new(link, shape))
    }

    fn torque(&self, link: usize, point: &Vector<2>, force: &Vector<2>, out: &mut [f64]) {
        for (i, (out, joint)) in out.iter_mut().zip(&self.joints).enumerate() {
            *out = if i <= link { cross(point - joint, *force) } else { 0.0 };
        }
    }

    fn limits(&self) -> &Limits {
        &self.limits
    }
}

/// Which chain a search takes for the arms and tasks of a space.
pub trait Judged<const D: usize, const M: usize>: CheckReach<D, M> {
    /// The chain.
    type Chain: Chain<D, M, Pose = Self::Pose>;

    /// That of an arm, at q = 0.
    fn chain(arm: &Arc<Self::Arm>) -> Self::Chain;
}

impl Judged<2, 2> for Plane {
    type Chain = PlanarChain;

    fn chain(arm: &Arc<PlanarArm>) -> PlanarChain {
        PlanarChain::new(arm)
    }
}

impl Judged<2, 3> for Plane {
    type Chain = PlanarState;

    fn chain(arm: &Arc<PlanarArm>) -> PlanarState {
        arm.state()
    }
}

impl<const M: usize> Judged<3, M> for Space
where
    Self: CheckReach<3, M>,
{
    type Chain = SpatialState;

    fn chain(arm: &Arc<SpatialArm>) -> SpatialState {
        arm.state()
    }
}
