//! Where a frame is in another.

use super::description_error::{Checked, fault, finite, unit};
use crate::math::upright;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Position \[m\] and orientation of one frame in another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Of the origin \[m\].
    #[serde(default)]
    pub position: [f64; 3],
    /// A unit quaternion `[w, x, y, z]`.
    #[serde(default = "upright")]
    pub orientation: [f64; 4],
}

impl Default for Frame {
    fn default() -> Self {
        Self { position: [0.0; 3], orientation: upright() }
    }
}

impl From<Isometry3<f64>> for Frame {
    fn from(pose: Isometry3<f64>) -> Self {
        let [x, y, z, w]: [f64; 4] = pose.rotation.coords.into();
        // Of q and −q, the same rotation, the one with w ≥ 0. + 0.0 turns −0 into 0.
        let sign = if w < 0.0 { -1.0 } else { 1.0 };
        Self {
            position: pose.translation.vector.map(|x| x + 0.0).into(),
            orientation: [w, x, y, z].map(|x| sign * x + 0.0),
        }
    }
}

impl From<Frame> for Isometry3<f64> {
    fn from(frame: Frame) -> Self {
        let [w, x, y, z] = frame.orientation;
        Self::from_parts(
            Translation3::from(Vector3::from(frame.position)),
            UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)),
        )
    }
}

impl Frame {
    pub(super) fn check(&mut self, path: &str) -> Checked {
        finite(&format!("{path}.position"), &self.position)?;
        let orientation = format!("{path}.orientation");
        unit(&mut self.orientation).map_err(|problem| fault(orientation, problem))
    }
}
