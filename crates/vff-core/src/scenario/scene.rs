//! What of a scenario has the dimension of its arm.

use super::ScenarioError;
use super::plane::PlanarScene;
use super::space::SpatialScene;
use crate::math::Vector;
use crate::robot::{Model, Robot};
use crate::simulation::{Options, PerceptionSettings, Physics, Setting, System};
use crate::trajectory::{Guided, Trajectory};
use crate::world::{Description, Solid};
use serde::de::DeserializeOwned;
use std::fmt::Debug;
use std::sync::Arc;

/// What obstacles are described by.
pub type ObstacleOf<S, const D: usize> = <<S as Setting<D>>::Solid as Solid<D>>::Obstacle;

/// How people describe what meets in `D` dimensions: the tables of a scenario that depend on it, and what is made of them.
pub trait Described<const D: usize>:
    Setting<D, Solid: Solid<D, Obstacle: DeserializeOwned + PartialEq>> + PartialEq
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

    /// Whether a reference brings a posture with it.
    fn is_plan(reference: &Self::Reference) -> bool;

    /// Validates an obstacle.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    fn validate_obstacle(obstacle: &ObstacleOf<Self, D>) -> Result<(), ScenarioError>;

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
pub trait Prepared<const D: usize, const M: usize>:
    Described<D> + System<D, M, Pose: Guided<M, Reference = <Self as Described<D>>::Reference>>
{
    /// Whether the end effector can be wherever `trajectory` wants it to be within `options.steps(duration)`, from `q0` on.
    ///
    /// # Errors
    /// [`Problem::Unreachable`](super::Problem::Unreachable), or the like, with the time.
    fn reachable(
        arm: &Arc<Self::Arm>,
        trajectory: &Trajectory<Self::Pose, M>,
        q0: &[f64],
        options: &Options,
        duration: f64,
    ) -> Result<(), ScenarioError>;
}

/// The tables of a scenario that have the dimension of its arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene<S: Described<D>, const D: usize> {
    /// The arm.
    pub arm: S::ArmTable,
    /// What the end effector has to do.
    pub reference: S::Reference,
    /// What is in the way.
    pub obstacles: Vec<ObstacleOf<S, D>>,
    /// The physical arm, where it is not the controller's model.
    pub plant: S::PlantTable,
}

fn bodies<S: Described<D>, const D: usize>(scene: &Scene<S, D>) -> usize {
    S::arm(&scene.arm).map_or(0, |arm| Arc::new(arm).state().body_count())
}

/// The scene of any arm: the list of all that there are.
#[derive(Debug, Clone, PartialEq)]
pub enum AnyScene {
    /// In the plane.
    Plane(Box<PlanarScene>),
    /// In space.
    Space(Box<SpatialScene>),
}

/// Does the same with whatever scene it is.
macro_rules! on_scene {
    ($scene:expr, $inner:ident => $body:expr) => {
        match $scene {
            $crate::scenario::AnyScene::Plane($inner) => $body,
            $crate::scenario::AnyScene::Space($inner) => $body,
        }
    };
}

pub(crate) use on_scene;

impl AnyScene {
    /// Of the space.
    pub fn dimension(&self) -> usize {
        match self {
            Self::Plane(_) => 2,
            Self::Space(_) => 3,
        }
    }

    /// How many obstacles there are.
    pub fn obstacle_count(&self) -> usize {
        on_scene!(self, scene => scene.obstacles.len())
    }

    /// How many bodies the arm has, none if there is no such arm.
    pub fn body_count(&self) -> usize {
        on_scene!(self, scene => bodies(scene))
    }

    /// The highest speed of any obstacle \[m/s\].
    pub fn top_speed(&self) -> f64 {
        on_scene!(self, scene => {
            let speeds = scene.obstacles.iter().map(|obstacle| obstacle.motion().top_speed());
            speeds.fold(0.0, f64::max)
        })
    }

    /// Displaces every obstacle with its motion by a number of `draw` \[m\] along every axis.
    pub fn shift_obstacles(&mut self, mut draw: impl FnMut() -> f64) {
        on_scene!(self, scene => for obstacle in &mut scene.obstacles {
            let shift = Vector::from_fn(|_, _| draw());
            obstacle.set_position(obstacle.position() + shift);
            obstacle.set_motion(obstacle.motion().shifted(&shift));
        });
    }

    /// The scene, if it is in the plane.
    pub fn plane(&self) -> Option<&PlanarScene> {
        match self {
            Self::Plane(scene) => Some(scene),
            Self::Space(_) => None,
        }
    }

    /// The same, to be changed.
    pub fn plane_mut(&mut self) -> Option<&mut PlanarScene> {
        match self {
            Self::Plane(scene) => Some(scene),
            Self::Space(_) => None,
        }
    }
}
