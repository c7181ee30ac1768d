//! Obstacles of the plane or of space behind one type.

use crate::scenario::{self, ScenarioError};
use crate::simulation::{Plane, Space};
use crate::world::{Description, plane, space};
use std::any::Any;
use toml::Table;

/// Obstacles in any space: the list of all that there are.
///
/// # Example
/// ```
/// use vff_core::runtime::AnyObstacles;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let mut obstacles = AnyObstacles::Space(vec![]);
/// obstacles.read(&toml::toml! { shape = { kind = "box", size = [0.4, 0.4, 0.1] } })?;
/// assert_eq!(obstacles.len(), 1);
/// let unseen = toml::toml! {
///     shape = { kind = "sphere", radius = 0.1 }
///     contact = { seen = false }
/// };
/// assert!(obstacles.clone().read(&unseen).is_ok() && obstacles.read_seen(&unseen).is_err());
/// let fault = obstacles.read(&toml::toml! { shape = { kind = "sphere", radius = 0.0 } }).unwrap_err();
/// assert!(fault.to_string().contains("radius"));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub enum AnyObstacles {
    /// In the plane.
    Plane(Vec<plane::Obstacle>),
    /// In space.
    Space(Vec<space::Obstacle>),
}

impl AnyObstacles {
    /// Reads, validates and adds one, to be measured: whether a controller sees it does not matter.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn read(&mut self, document: &Table) -> Result<(), ScenarioError> {
        match self {
            Self::Plane(all) => all.push(scenario::read_felt_obstacle::<Plane, 2>(document)?.0),
            Self::Space(all) => all.push(scenario::read_felt_obstacle::<Space, 3>(document)?.0),
        }
        Ok(())
    }

    /// The same for a controller that is to know of it.
    ///
    /// # Errors
    /// As [`read`](Self::read), and if it says that the controller does not see it.
    pub fn read_seen(&mut self, document: &Table) -> Result<(), ScenarioError> {
        match self {
            Self::Plane(all) => all.push(scenario::read_seen_obstacle::<Plane, 2>(document)?),
            Self::Space(all) => all.push(scenario::read_seen_obstacle::<Space, 3>(document)?),
        }
        Ok(())
    }

    /// How the first one is turned at these instants \[s\], compared with its description: one matrix after the other, row by
    /// row. None if it does not turn.
    pub fn rotations(&self, times: &[f64]) -> Option<Vec<f64>> {
        match self {
            Self::Plane(obstacles) => rotations(obstacles.first()?, times),
            Self::Space(obstacles) => rotations(obstacles.first()?, times),
        }
    }

    /// All of them, if they are of this type.
    pub(super) fn into_vec<T: 'static>(self) -> Option<Vec<T>> {
        let all: Box<dyn Any> = match self {
            Self::Plane(obstacles) => Box::new(obstacles),
            Self::Space(obstacles) => Box::new(obstacles),
        };
        all.downcast().ok().map(|all| *all)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Plane(obstacles) => obstacles.len(),
            Self::Space(obstacles) => obstacles.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

fn rotations<const D: usize>(obstacle: &impl Description<D>, times: &[f64]) -> Option<Vec<f64>> {
    let turning = obstacle.turning()?;
    let rows = |t: &f64| turning.at(*t).rotation.transpose().as_slice().to_vec();
    Some(times.iter().flat_map(rows).collect())
}
