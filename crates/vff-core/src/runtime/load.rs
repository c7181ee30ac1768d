//! Arms with what they have at their tips: a load, another tool.

use super::arm::{AnyArm, planar_document};
use crate::robot::description::Frame;
use crate::robot::{Model, PlanarArm};
use crate::scenario::{LoadSpec, Problem, ScenarioError, number};
use crate::settings::NOT_NEGATIVE;
use std::sync::Arc;
use toml::Table;

impl AnyArm {
    /// The same arm, which was read from `given`, with a body at its tip as part of the last link, and its document. In the plane it
    /// is a point at the tip.
    ///
    /// # Errors
    /// With the name of what is wrong.
    pub fn with_load(&self, load: &LoadSpec, given: Table) -> Result<(Self, Table), ScenarioError> {
        match self {
            Self::Plane(arm) => {
                let LoadSpec { mass, com, inertia, shapes } = load;
                number("mass", *mass, &NOT_NEGATIVE)?;
                let is_point = |numbers: &[f64]| numbers.iter().all(|x| *x == 0.0);
                for (key, fits) in [
                    ("com", com.is_none_or(|com| is_point(&com))),
                    ("inertia", inertia.is_none_or(|inertia| is_point(&inertia))),
                    ("shapes", shapes.is_empty()),
                ] {
                    if !fits {
                        let problem = "in the plane a load is a point at the tip".into();
                        return Err(ScenarioError::new(key, Problem::Other(problem)));
                    }
                }
                let mut links = arm.links().to_vec();
                let last = links.len() - 1;
                links[last] = links[last].with_payload(*mass);
                let loaded = PlanarArm::new(links, arm.gravity()).with_limits(arm.limits().clone());
                let document = planar_document(&loaded, given);
                Ok((Self::Plane(Arc::new(loaded)), document))
            }
            Self::Space(arm) => {
                let mut description = arm.description().clone();
                load.fasten(&mut description)?;
                let loaded = Self::Space(Arc::new(description.build()?));
                let document = loaded.document(given);
                Ok((loaded, document))
            }
        }
    }

    /// The same arm in space, which was read from `given`, with its tip elsewhere in the frame of its last link, and its document.
    ///
    /// # Errors
    /// If the frame is none, or the arm moves in the plane.
    pub fn with_tool(&self, tool: Frame, given: Table) -> Result<(Self, Table), ScenarioError> {
        let Self::Space(arm) = self else {
            let problem = "an arm in the plane ends where its last link does".into();
            return Err(ScenarioError::new("tool", Problem::Other(problem)));
        };
        let mut description = arm.description().clone();
        description.tool = tool;
        let made = Self::Space(Arc::new(description.build()?));
        let document = made.document(given);
        Ok((made, document))
    }
}
