//! Arms of every kind behind one type, for whoever has no type of his own.

use super::obstacles::AnyObstacles;
use crate::control::distance::DistanceRate;
use crate::control::extended_jacobian::ExtendedJacobian;
use crate::interrupt::{self, Aside};
use crate::math::Pose;
use crate::robot::inertia::tensor;
use crate::robot::{
    Limits, Manipulator, Model, PlanarArm, PlanarState, Robot, SpatialArm, SpatialState, planar,
};
use crate::scenario::{self, AnyScene, Scenario, ScenarioError};
use crate::simulation::Physics;
use crate::world::{Contact, ObstacleGeometry, World, plane, space};
use nalgebra::DMatrix;
use std::sync::Arc;
use toml::{Table, Value};

/// An arm of any kind: the list of all that there are.
///
/// # Example
/// ```
/// use vff_core::runtime::AnyArm;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let panda = AnyArm::read(&toml::toml! { model = "panda" })?;
/// assert_eq!((panda.dof(), panda.dimension()), (7, 3));
/// let planar = AnyArm::read(&toml::toml! { lengths = [0.5, 0.5, 0.5] masses = 2.0 })?;
/// assert_eq!((planar.dof(), planar.dimension()), (3, 2));
/// let fault = AnyArm::read(&toml::toml! { lengths = [0.5] masses = -1.0 }).unwrap_err();
/// assert!(fault.to_string().starts_with("masses"));
/// # Ok(())
/// # }
/// ```
///
/// # See also
/// [`PlanarArm`] and [`SpatialArm`] where the type is known.
#[derive(Debug, Clone)]
pub enum AnyArm {
    /// In the plane.
    Plane(Arc<PlanarArm>),
    /// In space.
    Space(Arc<SpatialArm>),
}

/// Such an arm at one instant.
///
/// # Example
/// ```
/// use vff_core::runtime::{AnyArm, AnyObstacles, AnyState, DistanceTable};
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let arm = AnyArm::read(&toml::toml! { model = "panda" })?;
/// let (q, dq) = ([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0; 7]);
/// let state: AnyState = arm.at(&q, &dq);
/// assert_eq!(state.mass_matrix().nrows(), 7);
/// let mut obstacles: AnyObstacles = arm.no_obstacles();
/// obstacles.read(&toml::toml! { shape = { kind = "sphere", radius = 0.1 } position = [0.5, 0.5, 0.5] })?;
/// let DistanceTable { pairs, distance, .. } = arm.distances(obstacles, &q, &dq, &[0.0]);
/// assert_eq!(pairs.len(), distance.len());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub enum AnyState {
    /// In the plane.
    Plane(PlanarState),
    /// In space.
    Space(SpatialState),
}

/// Does the same with whatever arm it is.
macro_rules! either {
    ($arm:expr, $inner:ident => $body:expr) => {
        match $arm {
            AnyArm::Plane($inner) => $body,
            AnyArm::Space($inner) => $body,
        }
    };
}

/// Does the same with whatever state it is.
macro_rules! either_state {
    ($state:expr, $inner:ident => $body:expr) => {
        match $state {
            AnyState::Plane($inner) => $body,
            AnyState::Space($inner) => $body,
        }
    };
}

/// What `given` says of a planar arm, with the masses, moments of inertia and gravity of `arm`.
pub(super) fn planar_document(arm: &PlanarArm, mut given: Table) -> Table {
    let list = |values: &[f64]| Value::Array(values.iter().copied().map(Value::Float).collect());
    let each = |of: fn(&planar::Link) -> f64| list(&arm.links().iter().map(of).collect::<Vec<_>>());
    let com = arm.links().iter().map(|link| list(link.com.as_slice())).collect();
    given.insert("masses".into(), each(|link| link.mass));
    given.insert("com".into(), Value::Array(com));
    given.insert("inertias".into(), each(|link| link.inertia));
    given.insert("gravity".into(), list(arm.gravity().as_slice()));
    given
}

impl AnyArm {
    /// Reads and validates the `[arm]` table of a scenario: with `model` or `joints` it is an arm in space, else one
    /// in the plane.
    ///
    /// # Errors
    /// With the name of the first parameter that is wrong.
    pub fn read(document: &Table) -> Result<Self, ScenarioError> {
        if scenario::is_spatial(document) {
            return Ok(Self::Space(Arc::new(scenario::read_spatial_arm(document)?)));
        }
        scenario::read_arm(document).map(|arm| Self::Plane(Arc::new(arm)))
    }

    /// The complete document of an arm that was read from `given`: of one in space every key, else what was given.
    pub fn document(&self, given: Table) -> Table {
        match self {
            Self::Plane(_) => given,
            Self::Space(arm) => {
                // Its fields are numbers, text, and lists and tables of them, which TOML can hold.
                Table::try_from(arm.description()).unwrap_or(given)
            }
        }
    }

    /// The physical arm of a scenario that was read from `document`, payload included, and its document.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn plant(scenario: &Scenario, document: &Table) -> Result<(Self, Table), ScenarioError> {
        let given = document.get("arm").and_then(Value::as_table).cloned().unwrap_or_default();
        match &scenario.scene {
            AnyScene::Plane(scene) => {
                let arm = scenario.physics(scene)?.arm;
                let document = planar_document(&arm, given);
                Ok((Self::Plane(arm), document))
            }
            AnyScene::Space(scene) => {
                let Physics { arm, viscous, coulomb, .. } = scenario.physics(scene)?;
                let mut description = arm.description().clone();
                for (i, joint) in description.joints.iter_mut().enumerate() {
                    joint.damping = viscous.get(i).copied().unwrap_or(0.0);
                    joint.friction = coulomb.get(i).copied().unwrap_or(0.0);
                }
                let arm = Self::Space(Arc::new(description.build()?));
                let document = arm.document(given);
                Ok((arm, document))
            }
        }
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
        either!(self, arm => Model::state(arm).body_count())
    }

    /// What the joints can do.
    pub fn limits(&self) -> &Limits {
        either!(self, arm => arm.limits())
    }

    /// A distance from the base that the end effector cannot exceed \[m\].
    pub fn reach(&self) -> f64 {
        either!(self, arm => Model::reach(&**arm))
    }

    /// Masses of the links \[kg\], (n).
    pub fn masses(&self) -> Vec<f64> {
        match self {
            Self::Plane(arm) => arm.links().iter().map(|link| link.mass).collect(),
            Self::Space(arm) => arm.description().joints.iter().map(|joint| joint.mass).collect(),
        }
    }

    /// Centres of mass in the links' frames \[m\], (n, dimension), row by row.
    pub fn centres_of_mass(&self) -> Vec<f64> {
        match self {
            Self::Plane(arm) => {
                arm.links().iter().flat_map(|link| [link.com.x, link.com.y]).collect()
            }
            Self::Space(arm) => {
                arm.description().joints.iter().flat_map(|joint| joint.com).collect()
            }
        }
    }

    /// Moments of inertia about the centres of mass \[kg·m²\]: a number for each link in the plane, and in space a
    /// matrix (3, 3) in the link's axes, row by row.
    pub fn inertias(&self) -> Vec<f64> {
        match self {
            Self::Plane(arm) => arm.links().iter().map(|link| link.inertia).collect(),
            Self::Space(arm) => {
                let joints = arm.description().joints.iter();
                // Symmetric: its columns are its rows.
                joints.flat_map(|joint| tensor(&joint.inertia).as_slice().to_vec()).collect()
            }
        }
    }

    /// Lengths of the links \[m\], (n); None in space, where a link is not a length.
    pub fn lengths(&self) -> Option<Vec<f64>> {
        match self {
            Self::Plane(arm) => Some(arm.links().iter().map(|link| link.length).collect()),
            Self::Space(_) => None,
        }
    }

    /// Radii of the links \[m\], (n); None in space, where links carry shapes.
    pub fn radii(&self) -> Option<Vec<f64>> {
        match self {
            Self::Plane(arm) => Some(arm.links().iter().map(|link| link.radius).collect()),
            Self::Space(_) => None,
        }
    }

    /// What people call it.
    pub fn name(&self) -> Option<&str> {
        match self {
            Self::Plane(_) => None,
            Self::Space(arm) => arm.description().name.as_deref(),
        }
    }

    /// Names of the joints, from the base.
    pub fn joint_names(&self) -> Vec<String> {
        match self {
            Self::Plane(arm) => (1..=arm.dof()).map(|i| format!("joint_{i}")).collect(),
            Self::Space(arm) => arm.joint_names().map(String::from).collect(),
        }
    }

    /// Names of the links that they move.
    pub fn link_names(&self) -> Vec<String> {
        match self {
            Self::Plane(arm) => (1..=arm.dof()).map(|i| format!("link_{i}")).collect(),
            Self::Space(arm) => arm.link_names().map(String::from).collect(),
        }
    }

    /// What is measured against obstacles and other links, as tables with `link` and `shape`; points are in the
    /// frame of the link.
    pub fn collision(&self) -> Vec<Table> {
        fn table<T: serde::Serialize>(value: &T) -> Table {
            Table::try_from(value).unwrap_or_default()
        }
        match self {
            Self::Plane(arm) => {
                let capsule = |(link, name): (&planar::Link, String)| {
                    let numbers = |x: f64| Value::Array(vec![Value::Float(x), Value::Float(0.0)]);
                    let shape = Table::from_iter([
                        ("kind".into(), Value::String("capsule".into())),
                        ("a".into(), numbers(0.0)),
                        ("b".into(), numbers(link.length)),
                        ("radius".into(), Value::Float(link.radius)),
                    ]);
                    Table::from_iter([
                        ("link".into(), Value::String(name)),
                        ("shape".into(), Value::Table(shape)),
                    ])
                };
                arm.links().iter().zip(self.link_names()).map(capsule).collect()
            }
            Self::Space(arm) => arm.description().collision.iter().map(table).collect(),
        }
    }

    /// Acceleration of free fall \[m/s²\].
    pub fn gravity(&self) -> Vec<f64> {
        match self {
            Self::Plane(arm) => arm.gravity().as_slice().to_vec(),
            Self::Space(arm) => arm.gravity().as_slice().to_vec(),
        }
    }

    /// The arm at q = 0, at rest.
    pub fn state(&self) -> AnyState {
        match self {
            Self::Plane(arm) => AnyState::Plane(arm.state()),
            Self::Space(arm) => AnyState::Space(arm.state()),
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
            Self::Plane(_) => AnyObstacles::Plane(vec![]),
            Self::Space(_) => AnyObstacles::Space(vec![]),
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
            (Self::Plane(arm), AnyObstacles::Plane(obstacles)) => {
                DistanceTable::new(arm, &mut plane::World::new(obstacles), [q, dq, t])
            }
            (Self::Space(arm), AnyObstacles::Space(obstacles)) => {
                DistanceTable::new(arm, &mut space::World::new(obstacles), [q, dq, t])
            }
            _ => panic!("obstacles of another space"),
        }
    }
}

impl AnyState {
    /// Moves to (q, q̇).
    pub fn update(&mut self, q: &[f64], dq: &[f64]) {
        either_state!(self, state => state.update(q, dq));
    }

    /// Moves to q as far as positions need it; see [`Robot::update_positions`].
    pub fn update_positions(&mut self, q: &[f64]) {
        either_state!(self, state => state.update_positions(q));
    }

    /// Appends the positions of the joints \[m\], (n + 1, dimension); the last one is that of the tip.
    pub fn append_joint_positions(&self, out: &mut Vec<f64>) {
        either_state!(self, state => for i in 0..=state.dof() {
            out.extend_from_slice(state.joint_position(i).as_slice());
        });
    }

    /// Position \[m\] and orientation of the tip: an angle \[rad\] in the plane, a quaternion \[w, x, y, z\] with
    /// w ≥ 0 in space.
    pub fn pose(&self) -> (Vec<f64>, Vec<f64>) {
        fn split<const M: usize>(pose: impl Pose<M>, dimension: usize) -> (Vec<f64>, Vec<f64>) {
            let (position, orientation) = pose.as_slice().split_at(dimension);
            (position.to_vec(), orientation.to_vec())
        }
        match self {
            Self::Plane(state) => split::<3>(Manipulator::<2, 3>::pose(state), 2),
            Self::Space(state) => split::<6>(Manipulator::<3, 6>::pose(state), 3),
        }
    }

    /// The frames of the links in the world, homogeneous, (n, dimension + 1, dimension + 1), row by row.
    pub fn link_poses(&self) -> Vec<f64> {
        match self {
            Self::Plane(state) => {
                let one = |i: usize| {
                    let (origin, along) = (state.joint_position(i), state.link(i).direction);
                    [along.x, -along.y, origin.x, along.y, along.x, origin.y, 0.0, 0.0, 1.0]
                };
                (0..state.dof()).flat_map(one).collect()
            }
            Self::Space(state) => {
                let poses = (0..state.dof()).map(|i| state.link_pose(i));
                poses.flat_map(|pose| pose.transpose().as_slice().to_vec()).collect()
            }
        }
    }

    /// The frame of the tip in the world, homogeneous, (dimension + 1, dimension + 1), row by row.
    pub fn tip_pose(&self) -> Vec<f64> {
        match self {
            Self::Plane(state) => {
                let (tip, along) =
                    (state.joint_position(state.dof()), state.link(state.dof() - 1).direction);
                vec![along.x, -along.y, tip.x, along.y, along.x, tip.y, 0.0, 0.0, 1.0]
            }
            Self::Space(state) => {
                let mut pose = state.tool_axes().to_homogeneous();
                pose.fixed_view_mut::<3, 1>(0, 3).copy_from(&state.joint_position(state.dof()));
                pose.transpose().as_slice().to_vec()
            }
        }
    }

    /// The Jacobian of the tip: a row per coordinate of its position, and in space three more of its angular
    /// velocity; world axes.
    pub fn jacobian(&self) -> DMatrix<f64> {
        match self {
            Self::Plane(state) => jacobian::<_, 2, 2>(state),
            Self::Space(state) => jacobian::<_, 3, 6>(state),
        }
    }

    /// Its time derivative.
    pub fn jacobian_dot(&self) -> DMatrix<f64> {
        match self {
            Self::Plane(state) => jacobian_dot::<_, 2, 2>(state),
            Self::Space(state) => jacobian_dot::<_, 3, 6>(state),
        }
    }

    /// The mass matrix M, (n, n).
    pub fn mass_matrix(&self) -> DMatrix<f64> {
        either_state!(self, state => state.matrices::<3>().mass)
    }

    /// The Christoffel matrix C, (n, n).
    pub fn coriolis_matrix(&self) -> DMatrix<f64> {
        either_state!(self, state => state.matrices::<3>().coriolis)
    }

    /// The split into the task of [`jacobian`](Self::jacobian) and its null space; None in a singularity.
    pub fn extended_jacobian(&self) -> Option<ExtendedJacobian> {
        match self {
            Self::Plane(state) => ExtendedJacobian::new(&state.matrices::<2>()),
            Self::Space(state) => ExtendedJacobian::new(&state.matrices::<6>()),
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
    /// Nearest point on the axis of the link, of a box or hull on its surface \[m\].
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

    fn new<A: Model<D>, S: ObstacleGeometry<D>, const D: usize>(
        arm: &Arc<A>,
        world: &mut World<S, D>,
        [q, dq, t]: [&[f64]; 3],
    ) -> Self {
        let (n, mut state) = (arm.dof(), arm.state());
        let links = state.bodies().map(|body| body.link);
        let pairs: Vec<_> = links.flat_map(|i| (0..world.len()).map(move |j| [i, j])).collect();
        let rows = q.len() / n * pairs.len();
        let room = |width: usize| Vec::with_capacity(rows * width);
        let mut table = Aside::new(Self {
            pairs,
            distance: room(1),
            gradient: vec![0.0; rows * n],
            rate: room(1),
            bias: room(1),
            normal: room(D),
            point: room(D),
            witness: room(D),
        });
        let Self { distance, gradient, rate, bias, normal, point, witness, .. } = table.as_mut();
        let mut gradients = gradient.chunks_exact_mut(n);
        for (b, (q, dq)) in q.chunks_exact(n).zip(dq.chunks_exact(n)).enumerate() {
            state.update(q, dq);
            world.update(t[b % t.len()]);
            let visit = |contact: &Contact<D>| {
                interrupt::checkpoint(64 + n);
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
            world.for_each_pair(state.bodies(), visit);
        }
        table.done()
    }
}
