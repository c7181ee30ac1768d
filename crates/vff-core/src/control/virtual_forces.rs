//! The push of the field: forces on the links, their torque, and the power they exchange.

use super::{OperationalSpace, dot};
use crate::field::{Field, Response};
use crate::math::Vector;
use crate::robot::Robot;
use crate::world::{Contact, Surroundings};

/// What the virtual force field does to every link at one instant.
#[derive(Debug, Clone)]
pub struct VirtualForces<W, const D: usize> {
    clearance: Vec<f64>,
    resultant: Vec<Vector<D>>,
    magnitude: Vec<f64>,
    torque: Vec<f64>,
    wrenches: Vec<W>,
    column: Vec<f64>,
    potential: f64,
    potential_rate: f64,
    /// Whether any pair is within the influence of the field.
    active: bool,
}

impl<W: Copy + Default, const D: usize> VirtualForces<W, D> {
    /// For an arm of `n` links.
    pub fn new(n: usize) -> Self {
        Self {
            clearance: vec![f64::INFINITY; n],
            resultant: vec![Vector::zeros(); n],
            magnitude: vec![0.0; n],
            torque: vec![0.0; n],
            wrenches: vec![W::default(); n],
            column: vec![0.0; n],
            potential: 0.0,
            potential_rate: 0.0,
            active: false,
        }
    }

    /// Signed surface distance from each link to the nearest obstacle [m]; ∞ without obstacles.
    pub fn clearance(&self) -> &[f64] {
        &self.clearance
    }

    /// The sum of the repulsive forces on each link [N].
    pub fn resultant(&self) -> &[Vector<D>] {
        &self.resultant
    }

    /// The magnitudes of the resultants [N].
    pub fn magnitude(&self) -> &[f64] {
        &self.magnitude
    }

    /// τ_vff = Σ J_cᵀF, the paper's virtual external torque τ_e, before projection [N·m].
    pub fn torque(&self) -> &[f64] {
        &self.torque
    }

    /// U, the potential of all pairs [J].
    pub fn potential(&self) -> f64 {
        self.potential
    }

    /// U̇ [W], from the motion of the links and of the obstacles.
    pub fn potential_rate(&self) -> f64 {
        self.potential_rate
    }

    /// Sums the field over all pairs (T26): nearest-only would jump when another pair becomes nearest.
    pub fn refresh<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        surroundings: &impl Surroundings<D>,
    ) {
        if self.active {
            self.resultant.fill(Vector::zeros());
            self.magnitude.fill(0.0);
            self.wrenches.fill(W::default());
            self.torque.fill(0.0);
            (self.potential, self.potential_rate) = (0.0, 0.0);
        }
        self.active = false;
        self.clearance.fill(f64::INFINITY);
        let influence = if field.gain > 0.0 { field.influence } else { f64::NEG_INFINITY };
        let links = (0..robot.dof()).map(|i| robot.link(i));
        let mut clearance = std::mem::take(&mut self.clearance);
        let nearest = |link: usize, d: f64| clearance[link] = clearance[link].min(d);
        surroundings.for_each_contact(links, influence, nearest, |contact| {
            self.push(robot, space, field, contact);
        });
        self.clearance = clearance;
        if self.active {
            robot.wrenches_tr_mul(&self.wrenches, &mut self.torque);
            for (magnitude, force) in self.magnitude.iter_mut().zip(&self.resultant) {
                *magnitude = force.norm();
            }
        }
    }

    fn push<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        contact: &Contact<D>,
    ) {
        self.active = true;
        let Contact { link, point, normal, .. } = contact;
        let response = field.at(contact.distance);
        let closing = normal.dot(&(contact.velocity - robot.point_velocity(*link, point))); // −ḋ
        self.potential += response.potential;
        self.potential_rate += response.force * closing;
        let mut force = response.force;
        if field.approach_damping > 0.0 && closing > 0.0 {
            force += self.approach_damping(robot, space, field, contact, response) * closing;
        }
        let force = normal * force;
        self.resultant[*link] += force;
        robot.add_force(&mut self.wrenches, *link, point, &force);
    }

    /// c = 2 ζ √(k m_n) h(d) [N·s/m], with the mass m_n that the null space shows along the normal,
    /// 1/m_n = n̂ᵀ J_c N M⁻¹ J_cᵀ n̂ (T30).
    fn approach_damping<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        contact: &Contact<D>,
        response: Response,
    ) -> f64 {
        let Contact { link, point, normal, .. } = contact;
        robot.point_jacobian_tr_mul(*link, point, normal, &mut self.column);
        let along_task = space.response(&self.column);
        let in_null_space = robot.point_mobility(*link, point, normal)
            - along_task.dot(&(space.lambda * along_task));
        // No more than the whole arm: a point that the null space cannot move, or at the base, would
        // otherwise show an infinite mass.
        let mass = (1.0 / in_null_space.max(f64::MIN_POSITIVE)).min(robot.total_mass());
        let ratio = field.approach_damping * field.approach_window(contact.distance);
        2.0 * ratio * (response.stiffness * mass).sqrt()
    }

    /// The power of the virtual forces on the arm, q̇ᵀτ_vff [W].
    pub fn power(&self, dq: &[f64]) -> f64 {
        dot(dq, &self.torque)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::FieldKind;
    use crate::math::Capsule;
    use crate::robot::{PlanarArm, planar::Link};
    use crate::world::Feature;
    use std::sync::Arc;

    /// One contact, whatever the links do.
    struct Only(Contact<2>);

    impl Surroundings<2> for Only {
        fn for_each_contact(
            &self,
            _links: impl IntoIterator<Item = Capsule<2>>,
            _reach: f64,
            _distance: impl FnMut(usize, f64),
            mut visit: impl FnMut(&Contact<2>),
        ) {
            visit(&self.0);
        }
    }

    /// A disc that closes in on the base, which cannot move: the effective mass there was infinite
    /// and the torque NaN.
    #[test]
    fn approach_to_the_base_stays_finite() {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 4], Vector::<2>::zeros()));
        let mut state = arm.state();
        state.update(&[0.4, -0.3, 0.8, 0.2], &[0.0; 4]);
        let mut space = OperationalSpace::<2>::new(4, 1e-4);
        space.refresh(&state);
        let field = Field {
            kind: FieldKind::Khatib,
            gain: 1.0,
            influence: 1.0,
            floor: None,
            approach_damping: 0.7,
        };
        let normal = Vector::<2>::new(1.0, 0.0);
        let contact = Contact {
            link: 0,
            obstacle: 0,
            distance: 0.3,
            normal,
            point: Vector::<2>::zeros(),
            witness: normal * -0.3,
            velocity: normal,
            acceleration: Vector::<2>::zeros(),
            feature: Feature::End { distance: 0.3 },
        };
        let mut forces = VirtualForces::new(4);
        forces.refresh(&state, &space, &field, &Only(contact));
        assert!(forces.resultant()[0].norm() > field.at(0.3).force);
        assert!(forces.resultant()[0].norm().is_finite());
        assert_eq!(forces.torque(), [0.0; 4]);
    }
}
