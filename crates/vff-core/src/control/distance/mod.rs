//! How the distance of a link from an obstacle changes: its gradient, its rate, and the exact
//! acceleration that a torque can shape.
//!
//! ```text
//! ḋ = n̂ᵀ(J_c q̇ − v_o)        d̈ = n̂ᵀJ_c q̈ + bias
//! ```
//!
//! The bias is more than n̂ᵀ(J̇_c q̇ − a_o): the normal turns, and the nearest point slides along the
//! link (T60–T62). A barrier without these terms believes a distance that it does not have. Beside an obstacle that
//! turns, all of it is said as the obstacle sees it (T108).

#[cfg(test)]
mod in_space;
mod own_pair;

pub use own_pair::OwnPair;

use crate::math::{Vector, beside, crossing, smoothstep};
use crate::robot::Robot;
use crate::world::{Contact, Feature, TOUCHING};

/// ḋ, and d̈ while q̈ = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceRate {
    /// ḋ \[m/s\].
    pub rate: f64,
    /// d̈ − n̂ᵀJ_c q̈ \[m/s²\].
    pub bias: f64,
}

/// Sine of the angle beyond the end of a link within which [`DistanceRate::cautious`] fades.
const FADE: f64 = 0.2;

/// How the point of the link moves that is nearest, as the obstacle sees it, and how the link's axis turns.
struct Relative<'a, R, const D: usize> {
    robot: &'a R,
    contact: &'a Contact<D>,
    /// Velocity of the point of the link in the world \[m/s\].
    at_point: Vector<D>,
    /// Ṗ: its velocity relative to the obstacle, which turns \[m/s\].
    velocity: Vector<D>,
}

impl<'a, R: Robot<D>, const D: usize> Relative<'a, R, D> {
    #[inline(always)]
    fn new(robot: &'a R, contact: &'a Contact<D>) -> Self {
        let Contact { link, point, witness, spin, .. } = contact;
        let at_point = robot.point_velocity(*link, point);
        let mut velocity = at_point - contact.velocity;
        if !spin.is_none() {
            velocity -= spin.rate_of(&(point - witness));
        }
        Self { robot, contact, at_point, velocity }
    }

    /// Its acceleration while q̈ = 0, with what the turning of the obstacle adds: Euler's term is none at a constant rate,
    /// there remain those of the centre and of Coriolis \[m/s²\].
    #[inline(always)]
    fn acceleration(&self) -> Vector<D> {
        let Contact { link, point, witness, spin, .. } = self.contact;
        let along = self.robot.point_bias_acceleration(*link, point) - self.contact.acceleration;
        if spin.is_none() {
            return along;
        }
        along - spin.rate_of(&(spin.rate_of(&(point - witness)) + self.velocity * 2.0))
    }

    /// How fast the link's axis along `t` turns towards the normal \[1/s\].
    #[inline(always)]
    fn tilt(&self, t: &Vector<D>) -> f64 {
        let Contact { link, point, normal, spin, .. } = self.contact;
        let rate = self.robot.point_velocity(*link, &(point + t)) - self.at_point;
        let tilt = normal.dot(&rate);
        if spin.is_none() { tilt } else { tilt - normal.dot(&spin.rate_of(t)) }
    }

    /// How the normal turns that is fixed to the link, as the obstacle sees it \[1/s\].
    fn turning(&self) -> Vector<D> {
        let Contact { link, point, normal, spin, .. } = self.contact;
        self.robot.point_velocity(*link, &(point + normal)) - self.at_point - spin.rate_of(normal)
    }
}

impl DistanceRate {
    /// The same without the jump of the bias where the nearest point arrives at an end of the link and stops
    /// sliding: the term −ṡ²/ρ fades out beyond it instead (T66). Never more than the exact one, but where an axis is
    /// nearly parallel to an edge, along which its nearest point would run from one end to the other at once: there that
    /// term fades, too, and the distances of the ends are what has to be kept (T97).
    #[inline]
    pub fn cautious<R: Robot<D>, const D: usize>(robot: &R, contact: &Contact<D>) -> Self {
        if D > 2 {
            if contact.axis == Vector::<D>::zeros() {
                return Self::new(robot, contact); // a ball has no inside to slide along, nor has a face
            }
            if let Feature::Edge { edge, distance } | Feature::Crossing { edge, distance } =
                contact.feature
            {
                return Self::cautious_beside(robot, contact, &edge, distance);
            }
        }
        let mut motion = Self::new(robot, contact);
        if let Feature::End { distance } = contact.feature {
            let t = contact.axis;
            let beyond = contact.normal.dot(&t).abs() / FADE;
            if beyond < 1.0 {
                let relative = Relative::new(robot, contact);
                let sliding = t.dot(&relative.velocity) + distance * relative.tilt(&t);
                let fade = 1.0 - beyond * beyond * (3.0 - 2.0 * beyond);
                motion.bias -= fade * sliding * sliding / distance;
            }
        }
        motion
    }

    /// Close to a straight edge, inside or beyond the ends of the axis.
    fn cautious_beside<R: Robot<D>, const D: usize>(
        robot: &R,
        contact: &Contact<D>,
        edge: &Vector<D>,
        distance: f64,
    ) -> Self {
        let normal = &contact.normal;
        let seen = Relative::new(robot, contact);
        let relative = seen.velocity;
        let rate = normal.dot(&relative);
        let along = seen.acceleration();
        let t = contact.axis;
        let tilt = seen.tilt(&t);
        let cos = t.dot(edge);
        let sin_squared = (t - edge * cos).norm_squared();
        // Squared, it goes to 0 faster than sin².
        let oblique = smoothstep(sin_squared.sqrt() / FADE).powi(2);
        // Were the point of the axis held.
        let held = if distance > TOUCHING {
            beside(&relative, normal, rate, edge, 0.0, distance)
        } else {
            0.0
        };
        let turning = if let Feature::Crossing { .. } = contact.feature {
            oblique * crossing(&relative, [&t, edge], [tilt, 0.0], distance)
                + (1.0 - oblique) * held
        } else if sin_squared > 0.0 {
            let fade = oblique * (1.0 - smoothstep(normal.dot(&t).abs() / FADE));
            // ṡ sin², with which the nearest point would slide along the axis.
            let sliding = (t - edge * cos).dot(&relative) + distance * tilt;
            held - fade * sliding * sliding / (distance * sin_squared)
        } else {
            held
        };
        Self { rate, bias: normal.dot(&along) + turning }
    }

    /// For a face of the link and a corner of the obstacle: what the link sees move is the corner, so that all is said of the
    /// place where that is (T123).
    #[inline(never)]
    fn below_corner<R: Robot<D>, const D: usize>(
        robot: &R,
        contact: &Contact<D>,
        distance: f64,
    ) -> Self {
        let normal = contact.normal;
        let corner = Contact { point: contact.point - normal * distance, ..*contact };
        let seen = Relative::new(robot, &corner);
        Self {
            rate: normal.dot(&seen.velocity),
            bias: normal.dot(&seen.acceleration()) + 2.0 * seen.turning().dot(&seen.velocity),
        }
    }

    /// For the contact of a link of `robot` at its present state.
    #[inline]
    pub fn new<R: Robot<D>, const D: usize>(robot: &R, contact: &Contact<D>) -> Self {
        let Contact { normal, .. } = contact;
        if let Feature::LinkFace { distance } = contact.feature {
            return Self::below_corner(robot, contact, distance);
        }
        let seen = Relative::new(robot, contact);
        let relative = seen.velocity;
        let rate = normal.dot(&relative);
        let along = seen.acceleration();
        let turning = match contact.feature {
            Feature::Side { distance } => {
                let t = contact.axis;
                beside(&relative, normal, rate, &t, seen.tilt(&t), distance)
            }
            Feature::End { distance } => (relative - normal * rate).norm_squared() / distance,
            Feature::Edge { edge, distance } if D > 2 => {
                beside(&relative, normal, rate, &edge, 0.0, distance)
            }
            Feature::Crossing { edge, distance } if D > 2 => {
                let t = contact.axis;
                crossing(&relative, [&t, &edge], [seen.tilt(&t), 0.0], distance)
            }
            // A face. (In the plane there are no edges.)
            _ => 0.0,
        };
        Self { rate, bias: normal.dot(&along) + turning }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::math::{Vector, perp};
    use crate::robot::{Model, PlanarArm, PlanarState, planar::Link};
    use crate::testing::{Case, case};
    use crate::world::plane::{Obstacle, Shape, World};
    use crate::world::{Interpolation, Motion};
    use proptest::prelude::*;
    use std::cell::RefCell;
    use std::f64::consts::{PI, TAU};
    use std::mem::{Discriminant, discriminant};
    use std::sync::Arc;

    const SHAPES: usize = 4;

    fn obstacle() -> impl Strategy<Value = (usize, Obstacle)> {
        let one = || -1.0..1.0f64;
        let two = move || [one(), one()];
        let polygon = (0.1..0.8, 0.1..0.8, 3usize..8, 0.0..TAU).prop_map(|(w, h, n, phase)| {
            let angle = |k: usize| phase + TAU * k as f64 / n as f64;
            let corner = |k| [w * f64::cos(angle(k)), h * f64::sin(angle(k))];
            (3, Shape::Polygon { vertices: (0..n).map(corner).collect() })
        });
        let shape = prop_oneof![
            (0.05..0.5).prop_map(|radius| (0, Shape::Circle { radius })),
            (two(), 0.2..1.0, 0.0..0.4).prop_map(|(a, length, radius)| {
                (1, Shape::Capsule { a, b: [a[0] + length, a[1] - 0.5], radius })
            }),
            [0.1..1.5, 0.1..1.5].prop_map(|size| (2, Shape::Box { size })),
            polygon,
        ];
        let motion = prop_oneof![
            Just(Motion::default()),
            two().prop_map(|velocity| Motion::Linear { velocity }),
            (two(), 0.2..2.0, one()).prop_map(|(amplitude, angular_frequency, phase)| {
                Motion::Sinusoid { amplitude, angular_frequency, phase, foreseen: false }
            }),
            (two(), one(), any::<bool>()).prop_map(|([x, y], angle, is_smooth)| {
                Motion::Waypoints {
                    // Not in the middle of a smooth way, where nothing is accelerated.
                    times: vec![if is_smooth { -0.6 } else { -1.0 }, 1.0],
                    points: vec![[0.0, 0.0], [x, y]],
                    interpolation: if is_smooth {
                        Interpolation::Smooth
                    } else {
                        Interpolation::Linear
                    },
                    angles: vec![0.0, 3.0 * angle],
                    orientations: vec![],
                    foreseen: false,
                }
            }),
        ];
        let rate = prop_oneof![Just(0.0), -2.0..2.0f64];
        (shape, [-3.0..3.0f64, -3.0..3.0], -PI..PI, motion, rate).prop_map(
            |((kind, shape), position, angle, motion, angular_velocity)| {
                (
                    kind,
                    Obstacle { position, angle, angular_velocity, motion, ..Obstacle::of(shape) },
                )
            },
        )
    }

    /// The link, and the arm's state, at time t of the motion q + q̇t + ½q̈t² (`u` is q̈).
    fn at(c: &Case, t: f64) -> PlanarState {
        let q: Vec<_> = (0..c.q.len()).map(|i| c.q[i] + t * (c.dq[i] + 0.5 * t * c.u[i])).collect();
        let dq: Vec<_> = (0..c.q.len()).map(|i| c.dq[i] + t * c.u[i]).collect();
        let mut state = c.arm.state();
        state.update(&q, &dq);
        state
    }

    /// d and what meets what at time t.
    fn distance_at(c: &Case, world: &mut World, t: f64) -> (f64, Discriminant<Feature<2>>) {
        world.update(t);
        let link = c.q.len() - 1;
        let contact = world.contact(link, &at(c, t).body(link), 0);
        (contact.distance, discriminant(&contact.feature))
    }

    /// What five distances in equal steps tell of their derivatives.
    pub(super) struct Differences {
        pub rate: f64,
        pub second: f64,
        /// By how much the second derivative of one step differs from that of two.
        pub curved: f64,
        /// The same for the rate, per step. Beside a kink, `curved` may be 0 by chance, but not both.
        pub uneven: f64,
    }

    /// Of distances that are `h` apart.
    pub(super) fn differences(d: &[f64], h: f64) -> Differences {
        let [near, far] = [(d[3] - d[1]) / (2.0 * h), (d[4] - d[0]) / (4.0 * h)];
        let coarse = (d[4] - 2.0 * d[2] + d[0]) / (4.0 * h * h);
        let fine = (d[3] - 2.0 * d[2] + d[1]) / (h * h);
        Differences {
            rate: (8.0 * (d[3] - d[1]) - (d[4] - d[0])) / (12.0 * h),
            second: (4.0 * fine - coarse) / 3.0,
            curved: (fine - coarse).abs(),
            uneven: (near - far).abs() / h,
        }
    }

    /// ḋ and d̈ are the derivatives of the distance along a motion, for every shape and motion of
    /// obstacles and every pair of features, in penetration too; and all of these were met.
    #[test]
    fn rates_are_derivatives_of_the_distance() {
        let met = RefCell::new(std::collections::HashMap::<_, usize>::new());
        let config =
            ProptestConfig { max_global_rejects: 20_000, ..ProptestConfig::with_cases(3000) };
        proptest!(config, |(c in case(1usize..5), (kind, obstacle) in obstacle())| {
            let mut world = World::new(vec![obstacle]);
            let link = c.q.len() - 1;
            let h = 4e-4;
            let samples: Vec<_> =
                (-2..=2).map(|k| distance_at(&c, &mut world, h * f64::from(k))).collect();
            let d: Vec<f64> = samples.iter().map(|s| s.0).collect();
            prop_assume!(samples.iter().all(|s| s.1 == samples[0].1));
            let Differences { rate, second, curved, uneven } = differences(&d, h);
            // Not across a change to another corner or face, where the rate jumps.
            let scale = 1.0 + second.abs();
            prop_assume!(curved.max(uneven) < 1e-2 * scale);

            world.update(0.0);
            let state = at(&c, 0.0);
            let contact = world.contact(link, &state.body(link), 0);
            let motion = DistanceRate::new(&state, &contact);
            let mut gradient = vec![0.0; c.q.len()];
            state.point_jacobian_tr_mul(link, &contact.point, &contact.normal, &mut gradient);
            let along: f64 = gradient.iter().zip(&c.u).map(|(g, u)| g * u).sum();
            let open = 1e-6 * (1.0 + rate.abs()) + h * curved;
            prop_assert!((motion.rate - rate).abs() < open, "{} {rate}", motion.rate);
            let found = along + motion.bias;
            prop_assert!((found - second).abs() < 1e-4 * scale + 0.1 * curved, "{found} is not {second}: {contact:?}");
            *met.borrow_mut().entry((kind, samples[0].1)).or_default() += 1;
        });
        let [side, end, face] =
            [Feature::Side { distance: 1.0 }, Feature::End { distance: 1.0 }, Feature::Face]
                .map(|f| discriminant(&f));
        let met = met.into_inner();
        for kind in 0..SHAPES {
            for feature in [side, end, face] {
                let expected = kind > 0 || feature != face; // a circle has no faces
                assert_eq!(
                    met.get(&(kind, feature)).copied().unwrap_or(0) > 20,
                    expected,
                    "{met:?}"
                );
            }
        }
    }

    /// A link that is pressed towards a disc by a barrier's own limit, ḧ = −2kḣ − k²h, from the side:
    /// with the exact d̈ it never comes nearer than the margin; without the sliding term it does, by millimetres.
    #[test]
    fn a_barrier_without_the_sliding_term_is_overrun() {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(2.0, 1.0)], Vector::<2>::zeros()));
        let disc = Obstacle {
            position: [0.0, 0.5],
            motion: Motion::Linear { velocity: [0.6, 0.0] },
            ..Obstacle::of(Shape::Circle { radius: 0.1 })
        };
        let (k, margin, dt) = (20.0, 0.03, 1e-4);
        let least = |sliding_term: bool| {
            let mut world = World::new(vec![disc.clone()]);
            let (mut q, mut dq, mut least) = (0.2, 0.0, f64::INFINITY);
            for step in 0..20_000 {
                world.update(f64::from(step) * dt);
                let mut state = arm.state();
                state.update(&[q], &[dq]);
                let link = state.link(0);
                let contact = world.contact(0, &state.body(0), 0);
                least = f64::min(least, contact.distance - margin);
                let mut motion = DistanceRate::new(&state, &contact);
                if let (false, Feature::Side { distance }) = (sliding_term, contact.feature) {
                    let relative = state.point_velocity(0, &contact.point) - contact.velocity;
                    let tilt = contact.normal.dot(&perp(link.direction)) * dq;
                    let sliding = link.direction.dot(&relative) + distance * tilt;
                    motion.bias += sliding * sliding / distance;
                }
                let mut gradient = [0.0];
                state.point_jacobian_tr_mul(0, &contact.point, &contact.normal, &mut gradient);
                let wanted =
                    -2.0 * k * motion.rate - k * k * (contact.distance - margin) - motion.bias;
                // The nominal motion presses against the disc (d falls with q here).
                let ddq = if gradient[0].abs() < 1e-3 {
                    0.0
                } else {
                    let limit = wanted / gradient[0];
                    if gradient[0] < 0.0 { limit.min(30.0 - 5.0 * dq) } else { limit.max(30.0) }
                };
                dq += dt * ddq;
                q += dt * dq;
            }
            least
        };
        assert!(least(true) > -1e-4, "{}", least(true));
        assert!(least(false) < -1e-3, "{}", least(false));
    }

    /// `cautious` is `new` except close behind the end of a link, where it is lower and joins the two.
    #[test]
    fn cautious_has_no_jump_at_the_end_of_a_link() {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0)], Vector::<2>::zeros()));
        let mut state = arm.state();
        state.update(&[0.0], &[2.0]);
        let at = |x: f64| {
            let disc = Obstacle {
                position: [x, 0.5],
                motion: Motion::Linear { velocity: [0.3, 0.0] },
                ..Obstacle::of(Shape::Circle { radius: 0.1 })
            };
            let contact = World::new(vec![disc]).contact(0, &state.body(0), 0);
            (DistanceRate::new(&state, &contact), DistanceRate::cautious(&state, &contact))
        };
        let ((before, _), (after, _)) = (at(1.0 - 1e-9), at(1.0 + 1e-9));
        assert!(after.bias - before.bias > 0.5, "{after:?} {before:?}");
        let grid: Vec<_> = (0..=2000).map(|i| at(0.9 + 1e-4 * f64::from(i)).1.bias).collect();
        assert!(grid.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 1e-2));
        for i in 0..=300 {
            let x = 0.9 + 1e-3 * f64::from(i);
            let (exact, cautious) = at(x);
            assert!(cautious.bias <= exact.bias);
            assert!(cautious == exact || (1.0..1.11).contains(&x));
        }
    }

    /// A link that turns past a disc at rest: without sliding, d̈ would come out too large by ṡ²/ρ.
    /// One link of 1 m about the origin, disc at (0.6, 0.5): d = 0.6 sin(−q) … in closed form
    /// d(q) = 0.5 cos q − 0.6 sin q − r while the foot is inside the link.
    #[test]
    fn sliding_lowers_the_acceleration() {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0)], Vector::<2>::zeros()));
        let mut state = arm.state();
        let (q, w) = (0.1_f64, 2.0);
        state.update(&[q], &[w]);
        let disc = Obstacle { position: [0.6, 0.5], ..Obstacle::of(Shape::Circle { radius: 0.1 }) };
        let contact = World::new(vec![disc]).contact(0, &state.body(0), 0);
        let d = |q: f64| 0.5 * q.cos() - 0.6 * q.sin() - 0.1;
        assert!((contact.distance - d(q)).abs() < 1e-15);
        let motion = DistanceRate::new(&state, &contact);
        let curvature = w * w * (-0.5 * q.cos() + 0.6 * q.sin());
        assert!((motion.bias - curvature).abs() < 1e-14, "{motion:?} {curvature}");
        let rho = contact.distance + 0.1;
        let sliding = w * perp(state.link(0).direction).dot(&Vector::<2>::new(0.6, 0.5)); // ṡ
        let naive = motion.bias + sliding * sliding / rho;
        assert!(naive - curvature > 0.1, "{naive}");
    }
}
