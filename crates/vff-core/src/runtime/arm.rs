//! Arms of every kind behind one type, for whoever has no type of his own.

use super::obstacles::AnyObstacles;
use crate::control::distance::DistanceRate;
use crate::control::extended_jacobian::ExtendedJacobian;
use crate::interrupt;
use crate::robot::{Limits, Matrices, Model, PlanarArm, PlanarState, Robot};
use crate::scenario::{self, Scenario, ScenarioError};
use crate::world::{CollisionQuery, Contact, Solid, World, plane};
use nalgebra::DMatrix;
use std::sync::Arc;
use toml::{Table, Value};

/// An arm of any kind: the list of all that there are.
#[derive(Debug, Clone)]
pub enum AnyArm {
    /// In the plane.
    Planar(Arc<PlanarArm>),
}

/// Such an arm at one instant.
#[derive(Debug, Clone)]
pub enum AnyState {
    /// In the plane.
    Planar(PlanarState),
}

/// Does the same with whatever arm it is.
macro_rules! either {
    ($arm:expr, $inner:ident => $body:expr) => {
        match $arm {
            AnyArm::Planar($inner) => $body,
        }
    };
}

/// Does the same with whatever state it is.
macro_rules! either_state {
    ($state:expr, $inner:ident => $body:expr) => {
        match $state {
            AnyState::Planar($inner) => $body,
        }
    };
}

impl AnyArm {
    /// Reads and validates the `[arm]` table of a scenario.
    ///
    /// # Errors
    /// With the name of the first parameter that is wrong.
    pub fn read(document: &Table) -> Result<Self, ScenarioError> {
        scenario::read_arm(document).map(|arm| Self::Planar(Arc::new(arm)))
    }

    /// The physical arm of a scenario that was read from `document`, payload included, and its document.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn plant(scenario: &Scenario, document: &Table) -> Result<(Self, Table), ScenarioError> {
        let arm = scenario.planar_plant()?;
        let list =
            |values: &[f64]| Value::Array(values.iter().copied().map(Value::Float).collect());
        let each = |of: fn(&crate::robot::planar::Link) -> f64| {
            list(&arm.links().iter().map(of).collect::<Vec<_>>())
        };
        let com = arm.links().iter().map(|link| list(link.com.as_slice())).collect();
        let mut given = document.get("arm").and_then(Value::as_table).cloned().unwrap_or_default();
        given.insert("masses".into(), each(|link| link.mass));
        given.insert("com".into(), Value::Array(com));
        given.insert("inertias".into(), each(|link| link.inertia));
        given.insert("gravity".into(), list(arm.gravity().as_slice()));
        Ok((Self::Planar(arm), given))
    }

    /// The dimension of the space that it moves in.
    pub fn dimension(&self) -> usize {
        fn of<A: Model<D>, const D: usize>(_: &Arc<A>) -> usize {
            D
        }
        either!(self, arm => of(arm))
    }

    /// The number of joints n.
    pub fn dof(&self) -> usize {
        either!(self, arm => arm.dof())
    }

    /// The number of bodies that are measured against obstacles and each other.
    pub fn body_count(&self) -> usize {
        either!(self, arm => arm.state().body_count())
    }

    /// What the joints can do.
    pub fn limits(&self) -> &Limits {
        either!(self, arm => arm.limits())
    }

    /// A distance from the base that the end effector cannot exceed \[m\].
    pub fn reach(&self) -> f64 {
        either!(self, arm => arm.reach())
    }

    /// Masses of the links \[kg\], (n).
    pub fn masses(&self) -> Vec<f64> {
        match self {
            Self::Planar(arm) => arm.links().iter().map(|link| link.mass).collect(),
        }
    }

    /// Centres of mass in the links' frames \[m\], (n, dimension), row by row.
    pub fn centres_of_mass(&self) -> Vec<f64> {
        match self {
            Self::Planar(arm) => {
                arm.links().iter().flat_map(|link| [link.com.x, link.com.y]).collect()
            }
        }
    }

    /// Moments of inertia about the centres of mass \[kg·m²\].
    pub fn inertias(&self) -> Vec<f64> {
        match self {
            Self::Planar(arm) => arm.links().iter().map(|link| link.inertia).collect(),
        }
    }

    /// Lengths of the links \[m\], (n).
    pub fn lengths(&self) -> Vec<f64> {
        match self {
            Self::Planar(arm) => arm.links().iter().map(|link| link.length).collect(),
        }
    }

    /// Radii of the links \[m\], (n).
    pub fn radii(&self) -> Vec<f64> {
        match self {
            Self::Planar(arm) => arm.links().iter().map(|link| link.radius).collect(),
        }
    }

    /// Acceleration of free fall \[m/s²\].
    pub fn gravity(&self) -> Vec<f64> {
        match self {
            Self::Planar(arm) => arm.gravity().as_slice().to_vec(),
        }
    }

    /// The arm at q = 0, at rest.
    pub fn state(&self) -> AnyState {
        match self {
            Self::Planar(arm) => AnyState::Planar(arm.state()),
        }
    }

    /// The arm at (q, q̇), of length n each.
    pub fn at(&self, q: &[f64], dq: &[f64]) -> AnyState {
        let mut state = self.state();
        either_state!(&mut state, state => state.update(q, dq));
        state
    }

    /// No obstacle, where this arm is.
    pub fn no_obstacles(&self) -> AnyObstacles {
        match self {
            Self::Planar(_) => AnyObstacles::Plane(vec![]),
        }
    }

    /// The distances of every body from every obstacle at the states (q, q̇), one after the other in `q` and
    /// `dq`, and at the time `t` \[s\] of each, or of all.
    ///
    /// # Panics
    /// If the obstacles are not those of the arm's space.
    pub fn distances(
        &self,
        obstacles: AnyObstacles,
        q: &[f64],
        dq: &[f64],
        t: &[f64],
    ) -> DistanceTable {
        match (self, obstacles) {
            (Self::Planar(arm), AnyObstacles::Plane(obstacles)) => {
                DistanceTable::new(arm, &mut plane::World::new(obstacles), [q, dq, t])
            }
        }
    }
}

impl AnyState {
    /// Moves to q as far as positions need it; see [`Robot::update_positions`].
    pub fn update_positions(&mut self, q: &[f64]) {
        either_state!(self, state => state.update_positions(q));
    }

    /// Appends the positions of the joints \[m\], (n + 1, dimension); the last one is that of the tip.
    pub fn append_joint_positions(&self, out: &mut Vec<f64>) {
        match self {
            Self::Planar(state) => {
                for i in 0..=state.dof() {
                    out.extend_from_slice(state.joint_position(i).as_slice());
                }
            }
        }
    }

    /// The Jacobian of the tip, one row per coordinate of its position.
    pub fn jacobian(&self) -> DMatrix<f64> {
        match self {
            Self::Planar(state) => jacobian::<_, 2, 2>(state),
        }
    }

    /// Its time derivative.
    pub fn jacobian_dot(&self) -> DMatrix<f64> {
        match self {
            Self::Planar(state) => jacobian_dot::<_, 2, 2>(state),
        }
    }

    /// The mass matrix M, (n, n).
    pub fn mass_matrix(&self) -> DMatrix<f64> {
        match self {
            Self::Planar(state) => state.matrices::<2>().mass,
        }
    }

    /// The Christoffel matrix C, (n, n).
    pub fn coriolis_matrix(&self) -> DMatrix<f64> {
        match self {
            Self::Planar(state) => state.matrices::<2>().coriolis,
        }
    }

    /// The split into the task of [`jacobian`](Self::jacobian) and its null space; None in a singularity.
    pub fn extended_jacobian(&self) -> Option<ExtendedJacobian> {
        match self {
            Self::Planar(state) => {
                let matrices: Matrices<2> = state.matrices();
                ExtendedJacobian::new(&matrices)
            }
        }
    }

    /// g(q), the torque that holds the arm against gravity \[N·m, N\].
    pub fn gravity_torque(&self) -> Vec<f64> {
        either_state!(self, state => filled(state.dof(), |out| state.gravity_torque(out)))
    }

    /// M q̈ + C q̇ + g \[N·m, N\].
    pub fn inverse_dynamics(&self, ddq: &[f64]) -> Vec<f64> {
        let mut scratch = vec![0.0; ddq.len()];
        either_state!(self, state => {
            filled(ddq.len(), |out| state.inverse_dynamics(ddq, &mut scratch, out))
        })
    }

    /// M⁻¹(τ − C q̇ − g) \[rad/s², m/s²\].
    pub fn forward_dynamics(&self, tau: &[f64]) -> Vec<f64> {
        let mut scratch = vec![0.0; tau.len()];
        either_state!(self, state => {
            filled(tau.len(), |out| state.forward_dynamics(tau, &mut scratch, out))
        })
    }

    /// ½ q̇ᵀM q̇ \[J\].
    pub fn kinetic_energy(&self) -> f64 {
        either_state!(self, state => {
            let momentum = filled(state.dof(), |out| state.mass_mul(state.velocity(), out));
            0.5 * state.velocity().iter().zip(&momentum).map(|(v, p)| v * p).sum::<f64>()
        })
    }

    /// The potential energy of gravity \[J\].
    pub fn potential_energy(&self) -> f64 {
        either_state!(self, state => state.potential_energy())
    }
}

fn filled(n: usize, fill: impl FnOnce(&mut [f64])) -> Vec<f64> {
    let mut out = vec![0.0; n];
    fill(&mut out);
    out
}

fn jacobian<R: Robot<D>, const D: usize, const M: usize>(state: &R) -> DMatrix<f64> {
    DMatrix::from_fn(M, state.dof(), |i, k| state.jacobian_column::<M>(k)[i])
}

fn jacobian_dot<R: Robot<D>, const D: usize, const M: usize>(state: &R) -> DMatrix<f64> {
    DMatrix::from_fn(M, state.dof(), |i, k| state.jacobian_dot_column::<M>(k)[i])
}

/// Distances with their derivatives; one row per state, body and obstacle, in this order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DistanceTable {
    /// Link and obstacle of the pairs of one state.
    pub pairs: Vec<[usize; 2]>,
    /// Signed distance d of the two surfaces \[m\].
    pub distance: Vec<f64>,
    /// n̂ᵀJ_c, n numbers each \[m/rad, m/m\].
    pub gradient: Vec<f64>,
    /// ḋ, the motion of the obstacle included \[m/s\].
    pub rate: Vec<f64>,
    /// d̈ while q̈ = 0 \[m/s²\].
    pub bias: Vec<f64>,
    /// Unit vector n̂ from the obstacle towards the link.
    pub normal: Vec<f64>,
    /// Nearest point on the axis of the link \[m\].
    pub point: Vec<f64>,
    /// Nearest point on the surface of the obstacle \[m\].
    pub witness: Vec<f64>,
}

impl DistanceTable {
    /// How many numbers such a table has for so many states, bodies and obstacles.
    pub fn numbers(arm: &AnyArm, states: usize, obstacles: usize) -> usize {
        let pairs = arm.body_count().saturating_mul(obstacles);
        let one = 3 + 3 * arm.dimension() + arm.dof();
        states.saturating_mul(pairs).saturating_mul(one).saturating_add(2 * pairs)
    }

    fn new<A: Model<D>, S: Solid<D>, const D: usize>(
        arm: &Arc<A>,
        world: &mut World<S, D>,
        [q, dq, t]: [&[f64]; 3],
    ) -> Self {
        let (n, mut state) = (arm.dof(), arm.state());
        let links = state.bodies().map(|body| body.link);
        let pairs: Vec<_> = links.flat_map(|i| (0..world.len()).map(move |j| [i, j])).collect();
        let rows = q.len() / n * pairs.len();
        let room = |width: usize| Vec::with_capacity(rows * width);
        let [mut distance, mut rate, mut bias] = [room(1), room(1), room(1)];
        let [mut normal, mut point, mut witness] = [room(D), room(D), room(D)];
        let mut gradient = vec![0.0; rows * n];
        let mut gradients = gradient.chunks_exact_mut(n);
        for (b, (q, dq)) in q.chunks_exact(n).zip(dq.chunks_exact(n)).enumerate() {
            state.update(q, dq);
            world.update(t[b % t.len()]);
            let visit = |contact: &Contact<D>| {
                interrupt::spend(64 + n);
                let motion = DistanceRate::new(&state, contact);
                distance.push(contact.distance);
                rate.push(motion.rate);
                bias.push(motion.bias);
                normal.extend_from_slice(contact.normal.as_slice());
                point.extend_from_slice(contact.point.as_slice());
                witness.extend_from_slice(contact.witness.as_slice());
                if let Some(row) = gradients.next() {
                    let (point, normal) = (&contact.point, &contact.normal);
                    state.point_jacobian_tr_mul(contact.link, point, normal, row);
                }
            };
            world.for_each_contact(state.bodies(), f64::INFINITY, |_, _| (), visit);
        }
        Self { pairs, distance, gradient, rate, bias, normal, point, witness }
    }
}
