//! What of a scenario has the dimension of its arm.

use super::ScenarioError;
use super::validate::no_such_link;
use crate::simulation::{
    Options, PerceptionSettings, Physics, SpaceTypes, System, Wrench, Wrenches,
};
use crate::trajectory::{Guided, Knots, Trajectory};
use crate::world::ObstacleGeometry;
use serde::de::DeserializeOwned;
use std::fmt::Debug;
use std::sync::Arc;

/// What obstacles are described by.
pub type ObstacleOf<S, const D: usize> =
    <<S as SpaceTypes<D>>::Geometry as ObstacleGeometry<D>>::Obstacle;

/// How people describe what meets in `D` dimensions: the tables of a scenario that depend on it, and what is made of them.
pub trait FromDocument<const D: usize>:
    SpaceTypes<D, Geometry: ObstacleGeometry<D, Obstacle: DeserializeOwned + PartialEq>> + PartialEq
{
    /// `[arm]`.
    type ArmTable: DeserializeOwned + Clone + Debug + PartialEq;
    /// `[plant]`.
    type PlantTable: DeserializeOwned + Clone + Debug + PartialEq + Default;
    /// `[reference]`.
    type Reference: DeserializeOwned + Clone + Debug + PartialEq;

    /// The arm that the controller believes in.
    ///
    /// # Errors
    /// With the name of the first parameter that is wrong.
    fn arm(table: &Self::ArmTable) -> Result<Self::Arm, ScenarioError>;

    /// The physical arm, where the controller believes in `model`, made of `arm`.
    ///
    /// # Errors
    /// With the name of the first parameter that is wrong.
    fn plant(
        table: &Self::PlantTable,
        arm: &Self::ArmTable,
        model: &Arc<Self::Arm>,
    ) -> Result<Physics<Self::Arm>, ScenarioError>;

    /// The plan that a reference is, if it is one; it brings a posture with it.
    fn plan(reference: &Self::Reference) -> Option<Knots<'_>>;

    /// Whether a reference comes to rest.
    fn comes_to_rest(reference: &Self::Reference) -> bool;

    /// Validates an obstacle.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    fn validate_obstacle(obstacle: &ObstacleOf<Self, D>) -> Result<(), ScenarioError>;

    /// How an obstacle is turned, as it was given; None in the plane.
    fn orientation_of(_: &ObstacleOf<Self, D>) -> Option<[f64; 4]> {
        None
    }

    /// Quaternions as they were given, with their dotted paths; none in the plane.
    fn orientations(_: &Scene<Self, D>) -> Vec<(String, [f64; 4])> {
        vec![]
    }

    /// Sensors on the bodies of `robot`, which is sampled as `options` say; the same seed gives the same noise.
    ///
    /// # Errors
    /// If there are none of that kind, or with the name of the first setting that is wrong.
    fn perception(
        settings: &PerceptionSettings,
        robot: &Self::State,
        seed: u64,
        options: &Options,
    ) -> Result<Self::Perception, ScenarioError>;
}

/// What is asked of a task of dimension `M` before it is run.
pub trait CheckReach<const D: usize, const M: usize>:
    FromDocument<D> + System<D, M, Pose: Guided<M, Reference = <Self as FromDocument<D>>::Reference>>
{
    /// Whether the end effector can be wherever `trajectory` wants it to be within `options.steps(duration)`, from `q0` on; a search
    /// counts an angle as its arc at `length` \[m\].
    ///
    /// # Errors
    /// [`Problem::Unreachable`](super::Problem::Unreachable), or the like, with the time.
    fn reachable(
        arm: &Arc<Self::Arm>,
        trajectory: &Trajectory<Self::Pose, M>,
        q0: &[f64],
        options: &Options,
        duration: f64,
        length: f64,
    ) -> Result<(), ScenarioError>;
}

/// The tables of a scenario that have the dimension of its arm.
///
/// # Example
/// Whatever the space:
/// ```
/// use vff_core::scenario::{CheckReach, FromDocument, ObstacleOf, Scene, ScenarioError};
/// use vff_core::scenario::FeltObstacle;
///
/// fn dof<S: FromDocument<D>, const D: usize>(scene: &Scene<S, D>) -> Result<S::Arm, ScenarioError> {
///     S::arm(&scene.arm)
/// }
///
/// fn bodies<S: FromDocument<D>, const D: usize>(felt: Vec<FeltObstacle<S, D>>) -> Vec<ObstacleOf<S, D>> {
///     felt.into_iter().map(|(obstacle, _)| obstacle).collect()
/// }
///
/// fn has_task<S: CheckReach<D, M>, const D: usize, const M: usize>() {}
/// has_task::<vff_core::simulation::Space, 3, 5>();
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Scene<S: FromDocument<D>, const D: usize> {
    /// The arm.
    pub arm: S::ArmTable,
    /// What the end effector has to do.
    pub reference: S::Reference,
    /// What is in the way.
    pub obstacles: Vec<ObstacleOf<S, D>>,
    /// The physical arm, where it is not the controller's model.
    pub plant: S::PlantTable,
    /// What pushes it.
    pub wrenches: Vec<Wrench<D>>,
}

impl<S: FromDocument<D>, const D: usize> Scene<S, D> {
    /// What pushes this arm, its physical one or the controller's.
    ///
    /// # Errors
    /// If it has no link of a name, with those that it has.
    pub fn wrenches_on(&self, arm: &S::Arm) -> Result<Wrenches<S::State, D>, ScenarioError> {
        Wrenches::new(&self.wrenches, arm).map_err(|(i, known)| {
            no_such_link(&self.wrenches[i].link, known).inside(&format!("wrenches[{i}]"))
        })
    }
}
