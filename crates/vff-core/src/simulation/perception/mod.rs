//! What the controller gets to know of the obstacles where it is not told: readings of sensors.
//!
//! `settings` is the table of a scenario, `scans` what becomes of the readings until they arrive. Which rays there are, and
//! what the control law makes of the points, is a matter of the [`plane`] and of [`space`]. `depth` is the whole way from a `picture` with
//! the arm in it to points that move.

mod depth;
mod picture;
mod plane;
mod scans;
mod settings;
mod space;

pub use picture::DepthPicture;
pub use plane::Perception;
pub use scans::{MAX_READINGS, MAX_STEPS};
pub use settings::{Camera, Kind, PerceptionSettings};
pub use space::SpatialPerception;

use crate::world::{self, CollisionQuery, ObstacleGeometry, Positions};

/// What a controller sees of the world by sensors: the obstacles that it believes in. Its [`Positions`] are the readings,
/// NaN where nothing was met.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, Robot, planar::Link};
/// use vff_core::simulation::{Perceive, Perception, PerceptionSettings, SpatialPerception};
/// use vff_core::world::plane::{PlanarGeometry, World};
/// use vff_core::world::{Positions, space::SpatialGeometry};
///
/// let settings: PerceptionSettings = toml::from_str(r#"kind = "range""#).unwrap();
/// let mut robot = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::zeros())).state();
/// robot.update(&[0.0; 2], &[0.0; 2]);
/// let mut seen = Perception::new(&settings, 7, &robot, 0.001);
/// Perceive::<_, PlanarGeometry, 2>::start(&mut seen, &robot, &World::new(vec![]));
/// assert!(Positions::count(&seen) > 0); // a reading per ray
/// fn sees<P: Perceive<R, S, D>, R, S: vff_core::world::ObstacleGeometry<D>, const D: usize>() {}
/// sees::<SpatialPerception, vff_core::robot::SpatialState, SpatialGeometry, 3>();
/// ```
pub trait Perceive<R, S: ObstacleGeometry<D>, const D: usize>:
    CollisionQuery<D> + Positions
{
    /// Begins with robot and world as they are, and as they have been all the time before.
    fn start(&mut self, robot: &R, world: &world::World<S, D>);
    /// Senses one plant step later.
    fn advance(&mut self, robot: &R, world: &world::World<S, D>);
    /// Takes the last step back.
    fn undo(&mut self);

    /// The pictures that arrived last, one of each depth camera. Allocates.
    fn pictures(&self) -> Vec<DepthPicture> {
        vec![]
    }

    /// What the law takes for the world, if that is one; these readings themselves otherwise.
    ///
    /// # Errors
    /// With the readings, which are asked like a world.
    fn believed(&mut self) -> Result<&mut world::World<S, D>, &mut Self> {
        Err(self)
    }
}
