//! The push of the field: forces on the links, their torque, and the power they exchange.

use super::distance::OwnPair;
use super::force::is_pressed;
use super::push_of_many::{Joined, Part, PushOfMany};
use super::settings::SelfCollision;
use super::{Gains, OperationalSpace};
use crate::field::{Field, Response};
use crate::geometry::Body;
use crate::math::dot;
use crate::math::{Nearest, Vector, keep_least};
use crate::robot::Robot;
use crate::world::{CollisionQuery, Contact};
use std::ops::Range;

/// What the virtual force field does to every link at one instant.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::control::{Controller, Gains, Settings, VirtualForces};
/// use vff_core::field::{Field, FieldKind};
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, planar::Link, planar::PlanarWrench};
/// use vff_core::world::plane::{Obstacle, Shape, World};
///
/// let field = Field { kind: FieldKind::Bounded, gain: 10.0, influence: 0.5, ..Field::OFF };
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(0.5, 1.0); 3], Vector::<2>::zeros()));
/// let gains = Gains::new(&Settings { field, ..Settings::default() });
/// let mut controller = Controller::<_, 2, 2>::new(arm.state(), gains);
/// let disc = Obstacle {
///     position: [0.75, 0.3],
///     ..Obstacle::of(Shape::Circle { radius: 0.1 })
/// };
/// controller.observe(&[0.0; 3], &[0.0; 3], &mut World::new(vec![disc]));
/// let forces: &VirtualForces<PlanarWrench, 2> = controller.forces();
/// assert!((forces.clearance()[1] - 0.2).abs() < 1e-12);
/// assert!((forces.magnitude()[1] - 10.0 * 0.36).abs() < 1e-12);
/// assert!(forces.resultant()[1].y < 0.0); // away from the disc
/// ```
#[derive(Debug, Clone)]
pub struct VirtualForces<W, const D: usize> {
    clearance: Vec<f64>,
    resultant: Vec<Vector<D>>,
    magnitude: Vec<f64>,
    torque: Vec<f64>,
    wrenches: Vec<W>,
    /// J_cᵀn̂ of a contact, and a workspace.
    column: Vec<f64>,
    scratch: Vec<f64>,
    /// The bodies, or capsules around them, gathered where they are measured against each other.
    bodies: Vec<Body<'static, D>>,
    self_clearance: f64,
    /// Which links are that near to each other; none for the base.
    nearest_pair: [Option<usize>; 2],
    potential: f64,
    obstacle_power: f64,
    approach_power: f64,
    /// From the first to the last link that is pushed: resultants, magnitudes and wrenches of all
    /// others are zero.
    pushed: Range<usize>,
}

/// What a field does about the motion of link and obstacle.
struct Reaction<const D: usize> {
    /// The force that slides past \[N\].
    slide: Vector<D>,
    /// The one that damps the approach along the normal \[N\], and its power ≤ 0 \[W\].
    damping: f64,
    power: f64,
}

impl<W: Copy + Default, const D: usize> VirtualForces<W, D> {
    /// For an arm of `n` links with so many bodies.
    pub fn new(n: usize, bodies: usize) -> Self {
        Self {
            clearance: vec![f64::INFINITY; n],
            resultant: vec![Vector::zeros(); n],
            magnitude: vec![0.0; n],
            torque: vec![0.0; n],
            wrenches: vec![W::default(); n],
            column: vec![0.0; n],
            scratch: vec![0.0; n],
            bodies: Vec::with_capacity(bodies),
            self_clearance: f64::INFINITY,
            nearest_pair: [None; 2],
            potential: 0.0,
            obstacle_power: 0.0,
            approach_power: 0.0,
            pushed: 0..0,
        }
    }

    /// Makes room for so many bodies again, which one that was cloned does not have.
    pub fn reserve(&mut self, bodies: usize) {
        self.bodies.clear();
        self.bodies.reserve(bodies);
    }

    /// Signed surface distance from each link to the nearest obstacle \[m\]; ∞ without obstacles.
    pub fn clearance(&self) -> &[f64] {
        &self.clearance
    }

    /// The sum of the forces of the field on each link \[N\].
    pub fn resultant(&self) -> &[Vector<D>] {
        &self.resultant
    }

    /// The magnitudes of the resultants \[N\].
    pub fn magnitude(&self) -> &[f64] {
        &self.magnitude
    }

    /// τ_vff = Σ J_cᵀF, the paper's virtual external torque τ_e, before projection \[N·m\].
    pub fn torque(&self) -> &[f64] {
        &self.torque
    }

    /// U, the potential of all pairs \[J\].
    pub fn potential(&self) -> f64 {
        self.potential
    }

    /// Σ F·v_obstacle, the power that moving obstacles push in through the field \[W\].
    pub fn obstacle_power(&self) -> f64 {
        self.obstacle_power
    }

    /// Σ F_d ḋ ≤ 0, the power that approach damping takes out \[W\] (T30).
    pub fn approach_power(&self) -> f64 {
        self.approach_power
    }

    /// Smallest signed surface distance of two bodies that must not touch each other \[m\]; ∞ where they are not
    /// measured.
    pub fn self_clearance(&self) -> f64 {
        self.self_clearance
    }

    /// The links of these bodies; none for the base, or where nothing is measured.
    pub fn nearest_pair(&self) -> [Option<usize>; 2] {
        self.nearest_pair
    }

    /// Sums the field over all pairs (T26), but what the tip presses on in the direction `pressed`: nearest-only would jump when
    /// another pair becomes nearest. The contacts of a cloud are joined (T192).
    pub fn refresh<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        gains: &Gains<M>,
        surroundings: &mut impl CollisionQuery<D>,
        pressed: Option<&Vector<D>>,
    ) {
        let field = &gains.field;
        let before = std::mem::take(&mut self.pushed);
        self.resultant[before.clone()].fill(Vector::zeros());
        self.magnitude[before.clone()].fill(0.0);
        self.wrenches[before.clone()].fill(W::default());
        (self.potential, self.obstacle_power, self.approach_power) = (0.0, 0.0, 0.0);
        self.clearance.fill(f64::INFINITY);
        let influence = if field.gain > 0.0 { field.influence } else { f64::NEG_INFINITY };
        let bodies = robot.bodies();
        let mut clearance = std::mem::take(&mut self.clearance);
        let nearest = |link: usize, d: f64| keep_least(&mut clearance[link], d);
        // There are no clouds in the plane.
        let is_joined = D > 2 && surroundings.contact_count() > surroundings.obstacle_count();
        let mut many = is_joined.then(PushOfMany::new);
        surroundings.for_each_contact(bodies, influence, nearest, |contact| {
            if !is_pressed(robot, pressed, contact) {
                match &mut many {
                    None => self.push(robot, space, field, contact),
                    Some(many) => self.join(robot, space, field, contact, many),
                }
            }
        });
        if let Some(last) = many.and_then(|mut many| many.finish()) {
            self.push_joined(robot, &last);
        }
        self.clearance = clearance;
        if gains.self_collision != SelfCollision::Ignore {
            let avoid = gains.self_collision == SelfCollision::Avoid;
            let reach = if avoid { influence } else { f64::NEG_INFINITY };
            self.measure_bodies(robot, space, field, reach);
        }
        // Nothing pushes from beyond the last.
        let Range { start, end } = self.pushed;
        robot.wrenches_tr_mul(&self.wrenches[..end], &mut self.torque[..end]);
        if end < before.end {
            self.torque[end..before.end].fill(0.0);
        }
        for i in start..end {
            self.magnitude[i] = self.resultant[i].norm();
        }
    }

    /// Counts link `i` among those that are pushed.
    #[inline]
    fn push_link(&mut self, i: usize) {
        let Range { start, end } = self.pushed;
        self.pushed = if start < end { start.min(i)..end.max(i + 1) } else { i..i + 1 };
    }

    #[inline(always)]
    fn push<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        contact: &Contact<D>,
    ) {
        let Contact { link, point, normal, .. } = contact;
        self.push_link(*link);
        let response = field.at(contact.distance);
        let mut force = response.force;
        if field.feels_motion() {
            let Reaction { slide, damping, power } =
                self.react(robot, space, field, contact, response);
            if field.sliding > 0.0 {
                self.obstacle_power += slide.dot(&contact.velocity);
                self.resultant[*link] += slide;
                robot.add_force(&mut self.wrenches, *link, point, &slide);
            }
            self.approach_power += power;
            force += damping;
        }
        self.potential += response.potential;
        self.obstacle_power += force * normal.dot(&contact.velocity);
        let force = normal * force;
        self.resultant[*link] += force;
        robot.add_force(&mut self.wrenches, *link, point, &force);
    }

    /// Takes in one contact with an obstacle of many, and adds the push of those before if they are of another pair.
    #[inline(never)]
    fn join<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        contact: &Contact<D>,
        many: &mut PushOfMany<D>,
    ) {
        let response = field.at(contact.distance);
        let mut force = contact.normal * response.force;
        let mut damped = 0.0;
        if field.feels_motion() {
            let Reaction { slide, damping, power } =
                self.react(robot, space, field, contact, response);
            force += slide + contact.normal * damping;
            damped = power;
        }
        let powers = [force.dot(&contact.velocity), damped];
        let part = Part { potential: response.potential, point: contact.point, force, powers };
        if let Some(before) = many.add(contact, &part) {
            self.push_joined(robot, &before);
        }
    }

    /// Adds what all contacts of a body with one obstacle push with.
    #[inline(never)]
    fn push_joined<R: Robot<D, Wrench = W>>(&mut self, robot: &R, joined: &Joined<D>) {
        let Joined { link, part: Part { potential, point, force, powers }, moment } = joined;
        self.push_link(*link);
        self.potential += potential;
        self.obstacle_power += powers[0];
        self.approach_power += powers[1];
        self.resultant[*link] += force;
        robot.add_force(&mut self.wrenches, *link, point, force);
        robot.add_torque(&mut self.wrenches, *link, moment);
    }

    /// What the field does about the motion of link and obstacle. Not inlined, for most fields do nothing and the loop over
    /// the pairs needs the registers.
    #[inline(never)]
    fn react<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        contact: &Contact<D>,
        response: Response,
    ) -> Reaction<D> {
        let Contact { link, point, normal, .. } = contact;
        let u = robot.point_velocity(*link, point) - contact.velocity;
        let slide = if field.sliding > 0.0 {
            field.slide(contact.distance, normal, &u)
        } else {
            Vector::zeros()
        };
        let closing = -normal.dot(&u); // −ḋ
        if field.approach_damping > 0.0 && closing > 0.0 {
            robot.point_jacobian_tr_mul(*link, point, normal, &mut self.column);
            let mobility = robot.point_mobility(*link, point, normal);
            let damping = self.damping(robot, space, field, contact.distance, response, mobility);
            let power = -(damping * closing * closing);
            return Reaction { slide, damping: damping * closing, power };
        }
        Reaction { slide, damping: 0.0, power: 0.0 }
    }

    /// Bodies that must not touch each other, each pair measured and, within `reach`, pushed apart like body
    /// and obstacle.
    #[inline(never)]
    fn measure_bodies<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        reach: f64,
    ) {
        self.self_clearance = f64::INFINITY;
        let mut bodies = std::mem::take(&mut self.bodies);
        OwnPair::for_each_within(robot, &mut bodies, f64::INFINITY, |pair| {
            let distance = pair.nearest.distance;
            if distance < self.self_clearance {
                (self.self_clearance, self.nearest_pair) = (distance, pair.links);
            }
            if distance < reach {
                self.push_apart(robot, space, field, pair);
            }
            self.self_clearance.max(reach)
        });
        self.bodies = bodies;
    }

    /// Pushes two bodies of the arm apart.
    fn push_apart<R: Robot<D, Wrench = W>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        pair: &OwnPair<D>,
    ) {
        let OwnPair { links, nearest: Nearest { points, normal, distance, .. }, .. } = pair;
        links.iter().flatten().for_each(|link| self.push_link(*link));
        let response = field.at(*distance);
        let rate = pair.rate(robot);
        let mut force = response.force;
        if field.approach_damping > 0.0 && rate < 0.0 {
            pair.gradient(robot, &mut self.column, &mut self.scratch);
            robot.mass_solve(&self.column, &mut self.scratch);
            let mobility = dot(&self.column, &self.scratch);
            let damping = self.damping(robot, space, field, *distance, response, mobility);
            force -= damping * rate;
            self.approach_power -= damping * rate * rate;
        }
        self.potential += response.potential;
        let force = normal * force;
        for ((link, point), force) in links.iter().zip(points).zip([force, -force]) {
            if let Some(link) = link {
                self.resultant[*link] += force;
                robot.add_force(&mut self.wrenches, *link, point, &force);
            }
        }
    }

    /// c = 2 ζ √(k m_n) h(d) \[N·s/m\], with the mass m_n that the null space shows along the normal,
    /// 1/m_n = n̂ᵀ J_c N M⁻¹ J_cᵀ n̂ (T30); `column` holds J_cᵀn̂, `mobility` is n̂ᵀ J_c M⁻¹ J_cᵀ n̂.
    fn damping<R: Robot<D, Wrench = W>, const M: usize>(
        &self,
        robot: &R,
        space: &OperationalSpace<M>,
        field: &Field,
        distance: f64,
        response: Response,
        mobility: f64,
    ) -> f64 {
        let along_task = space.response(&self.column);
        let in_null_space = mobility - along_task.dot(&(space.lambda * along_task));
        // No more than the whole arm: a point that the null space cannot move, or at the base, would
        // otherwise show an infinite mass.
        let mass = (1.0 / in_null_space.max(f64::MIN_POSITIVE)).min(robot.total_mass());
        let ratio = field.approach_damping * field.approach_window(distance);
        2.0 * ratio * (response.stiffness * mass).sqrt()
    }

    /// The power of the virtual forces on the arm, q̇ᵀτ_vff \[W\].
    pub fn power(&self, dq: &[f64]) -> f64 {
        dot(dq, &self.torque)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Settings, TaskMetric};
    use crate::field::FieldKind;
    use crate::robot::{Model, PlanarArm, planar::Link};
    use crate::world::Feature;
    use std::sync::Arc;

    /// One contact, whatever the links do.
    struct Only(Contact<2>);

    impl CollisionQuery<2> for Only {
        fn obstacle_count(&self) -> usize {
            1
        }

        fn for_each_contact<'a>(
            &mut self,
            _bodies: impl IntoIterator<Item = Body<'a, 2>>,
            _reach: f64,
            _distance: impl FnMut(usize, f64),
            mut visit: impl FnMut(&Contact<2>),
        ) {
            visit(&self.0);
        }

        fn contact_after(&self, _: usize, _: &Body<'_, 2>, _: usize, _: f64) -> Contact<2> {
            self.0
        }
    }

    /// A disc that closes in on the base, which cannot move: the effective mass there was infinite
    /// and the torque NaN.
    #[test]
    fn approach_to_the_base_stays_finite() {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 4], Vector::<2>::zeros()));
        let mut state = arm.state();
        state.update(&[0.4, -0.3, 0.8, 0.2], &[0.0; 4]);
        let mut space = OperationalSpace::<2>::new(4, 1e-4, TaskMetric::new::<2>(1.0));
        space.refresh(&state);
        let field = Field {
            kind: FieldKind::Khatib,
            gain: 1.0,
            influence: 1.0,
            floor: None,
            approach_damping: 0.7,
            sliding: 0.0,
        };
        let normal = Vector::<2>::new(1.0, 0.0);
        let contact = Contact {
            body: 0,
            link: 0,
            obstacle: 0,
            margin: crate::world::PairMargin::USUAL,
            distance: 0.3,
            normal,
            point: Vector::<2>::zeros(),
            axis: normal,
            witness: normal * -0.3,
            velocity: normal,
            acceleration: Vector::<2>::zeros(),
            spin: crate::world::Spin::NONE,
            feature: Feature::End { distance: 0.3 },
        };
        let mut forces = VirtualForces::new(4, 4);
        let settings = Settings { field, ..Settings::default() };
        forces.refresh(&state, &space, &Gains::new(&settings), &mut Only(contact), None);
        assert!(forces.resultant()[0].norm() > field.at(0.3).force);
        assert!(forces.resultant()[0].norm().is_finite());
        assert_eq!(forces.torque(), [0.0; 4]);
    }
}
