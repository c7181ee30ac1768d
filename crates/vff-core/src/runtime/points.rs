//! Clouds of points that are replaced while a loop runs. New points are made ready beside it, and take the place of the old
//! ones between two steps, from where they go on at the velocities that they were given.

use crate::control::Settings;
use crate::scenario::{self, ScenarioError};
use crate::world::CollisionQuery;
use crate::world::space::{MAX_POINTS, Points, Shape, World};
use std::any::Any;

/// Why there are no points to be replaced.
///
/// # Example
/// ```
/// use vff_core::runtime::points::{PointUpdate, make};
/// use vff_core::runtime::PointsError;
///
/// let upright = [1.0, 0.0, 0.0, 0.0];
/// assert_eq!(make(vec![[0.0; 3]; 5].into(), upright).unwrap().len(), 5);
/// let refused = make(vec![[0.0; 3]; 50_001].into(), upright).unwrap_err();
/// assert!(matches!(refused, PointsError::TooMany(50_001)));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PointsError {
    /// There are none in the plane.
    #[error("obstacle: clouds of points are in space, and this arm is in the plane")]
    InThePlane,
    /// There is no such obstacle.
    #[error("obstacle: there is no obstacle {given}, {}", there_are(*.count))]
    NotThere {
        /// What was asked for.
        given: usize,
        /// How many obstacles there are.
        count: usize,
    },
    /// It is no cloud, or another one by now.
    #[error("obstacle: obstacle {0} is not a cloud of points that these were made for")]
    NotACloud(usize),
    /// There are too many points.
    #[error(
        "cloud: expected at most {MAX_POINTS} points, got {0}; leave some out where they are dense"
    )]
    TooMany(usize),
    /// There is not one velocity to each point.
    #[error("velocities: expected one for each of the {points} points, got {velocities}")]
    Velocities {
        /// How many points there are.
        points: usize,
        /// How many velocities.
        velocities: usize,
    },
    /// The controller has no room for them.
    #[error("{0}")]
    NoRoom(#[from] ScenarioError),
}

fn there_are(count: usize) -> String {
    match count {
        0 => "there is none yet".into(),
        1 => "there is one, number 0".into(),
        _ => format!("there are {count}, 0 to {}", count - 1),
    }
}

/// What takes the place of the points of a cloud.
///
/// # Example
/// ```
/// use vff_core::runtime::points::{PointUpdate, make};
///
/// let seen = PointUpdate {
///     points: vec![[0.4, 0.0, 0.3]],
///     velocities: vec![[0.0, -0.5, 0.0]],
///     time: Some(12.3),
/// };
/// let upright = [1.0, 0.0, 0.0, 0.0];
/// assert_eq!(make(seen.clone(), upright).unwrap().since(), Some(12.3));
/// let torn = PointUpdate { points: vec![], ..seen };
/// assert!(make(torn, upright).is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointUpdate {
    /// The points \[m\], relative to the position of the obstacle; finite.
    pub points: Vec<[f64; 3]>,
    /// Their velocities in the same frame \[m/s\], finite; empty where all rest.
    pub velocities: Vec<[f64; 3]>,
    /// When they were there \[s\], on the clock of the loop; none for when they are taken in.
    pub time: Option<f64>,
}

impl From<Vec<[f64; 3]>> for PointUpdate {
    /// Of points that rest.
    fn from(points: Vec<[f64; 3]>) -> Self {
        Self { points, ..Self::default() }
    }
}

/// Points for a cloud of this `orientation`.
///
/// # Errors
/// If they are too many, or their velocities not as many.
pub fn make(update: PointUpdate, orientation: [f64; 4]) -> Result<Points, PointsError> {
    let PointUpdate { points, velocities, time } = update;
    if points.len() > MAX_POINTS {
        return Err(PointsError::TooMany(points.len()));
    }
    if !velocities.is_empty() && velocities.len() != points.len() {
        let (points, velocities) = (points.len(), velocities.len());
        return Err(PointsError::Velocities { points, velocities });
    }
    Ok(Points::moving(points, &velocities, time, orientation))
}

/// What is around an arm, if that is in space.
pub(super) fn in_space(world: &mut dyn Any) -> Result<&mut World, PointsError> {
    world.downcast_mut().ok_or(PointsError::InThePlane)
}

/// The orientation in which the points of cloud `j` stand.
pub(super) fn orientation_of(world: &World, j: usize) -> Result<[f64; 4], PointsError> {
    if j >= world.len() {
        return Err(PointsError::NotThere { given: j, count: world.len() });
    }
    match world.obstacle(j).shape {
        Shape::Points { .. } => Ok(world.obstacle(j).orientation),
        _ => Err(PointsError::NotACloud(j)),
    }
}

/// Whether a controller of n joints can go on with `points` in the place of those of cloud `j`.
pub(super) fn check(
    world: &World,
    j: usize,
    points: &Points,
    settings: &Settings,
    n: usize,
) -> Result<(), PointsError> {
    let [own, meant] =
        [orientation_of(world, j)?, points.orientation()].map(|q| q.map(f64::to_bits));
    if own != meant {
        return Err(PointsError::NotACloud(j));
    }
    let Shape::Points { points: old, .. } = &world.obstacle(j).shape else {
        return Err(PointsError::NotACloud(j));
    };
    let counted = |points: usize| points.max(world.room(j));
    let barriers = world.barrier_count() - counted(old.len()) + counted(points.len());
    Ok(scenario::validate_size(settings, n, barriers)?)
}
