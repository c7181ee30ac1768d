//! Obstacles of the plane or of space behind one type.

use crate::scenario::{self, ScenarioError};
use crate::simulation::{Plane, Space};
use crate::world::{plane, space};
use toml::Table;

/// Obstacles in any space: the list of all that there are.
#[derive(Debug, Clone)]
pub enum AnyObstacles {
    /// In the plane.
    Plane(Vec<plane::Obstacle>),
    /// In space.
    Space(Vec<space::Obstacle>),
}

impl AnyObstacles {
    /// Reads, validates and adds one.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn read(&mut self, document: &Table) -> Result<(), ScenarioError> {
        match self {
            Self::Plane(obstacles) => {
                obstacles.push(scenario::read_obstacle::<Plane, 2>(document)?);
            }
            Self::Space(obstacles) => {
                obstacles.push(scenario::read_obstacle::<Space, 3>(document)?);
            }
        }
        Ok(())
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
