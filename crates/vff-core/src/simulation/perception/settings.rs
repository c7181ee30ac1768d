//! The `[perception]` table of a scenario.

use crate::perception::PerceiverSettings;
use serde::{Deserialize, Serialize};

/// The `[perception]` table of a scenario.
///
/// # Example
/// ```
/// use vff_core::simulation::{Camera, PerceptionKind, PerceptionSettings};
///
/// let seen: PerceptionSettings = toml::from_str(r#"kind = "range""#).unwrap();
/// assert_eq!(seen, PerceptionSettings { kind: PerceptionKind::Range, ..PerceptionSettings::default() });
/// let cameras: &[Camera] = &seen.cameras;
/// assert!(cameras.is_empty());
/// ```
///
/// # See also
/// [`Perception`](super::super::Perception) in the plane, [`SpatialPerception`](super::super::SpatialPerception) in space.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct PerceptionSettings {
    /// How the controller perceives; with `ideal` the rest does not matter.
    pub kind: Kind,
    /// Sensors along each side of every link, ≥ 1.
    pub sensors: usize,
    /// In space: how many sides a link has, ≥ 1. Default: 4.
    pub around: Option<usize>,
    /// Rays of every sensor, ≥ 1.
    pub rays: usize,
    /// Angle from the first to the last ray of a sensor, in space that of the cone which they fill \[rad\], in [0, π).
    pub field_of_view: f64,
    /// The farthest reading \[m\], > 0.
    pub range: f64,
    /// Scans per second \[1/s\], > 0; the time between two is rounded up to whole plant steps. Default:
    /// one every step.
    pub rate: Option<f64>,
    /// Standard deviation of the noise of a reading \[m\], ≥ 0; of a depth that at 1 m, and it grows with the square of the depth.
    pub noise: f64,
    /// Step of the readings \[m\], ≥ 0; of a depth that at 1 m, and it grows with the square of the depth.
    pub resolution: f64,
    /// Age of a scan when the controller gets it \[s\], ≥ 0; rounded up to whole plant steps.
    pub latency: f64,
    /// Share of the readings that are lost, in \[0, 1\].
    pub drop_outs: f64,
    /// In space: the cameras; at least one if that is the kind.
    pub cameras: Vec<Camera>,
    /// Of depths: a surface that is seen at a flatter angle is not measured, nor what is next to an edge \[rad\], in [0, π/2); 0 measures all.
    pub grazing: f64,
    /// Of depths: how far each camera stands from where it is said to stand \[m\], ≥ 0, in a direction at random.
    pub position_error: f64,
    /// Of depths: by which angle each camera is turned from how it is said to look \[rad\], in [0, π], about an axis at random.
    pub orientation_error: f64,
    /// Of depths: by how much the clock of each camera is ahead or behind, at random \[s\], ≥ 0.
    pub clock_error: f64,
    /// Of depths: what makes points of the pictures.
    pub perceiver: PerceiverSettings,
}

/// How the controller perceives the obstacles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// It knows them.
    #[default]
    Ideal,
    /// By range sensors on the links.
    Range,
    /// In space: by depth cameras that stand in the world, from whose points the arm is taken out exactly and which all rest.
    Camera,
    /// In space: by pictures of depth cameras with the arm in them, of which a [`Perceiver`](crate::perception::Perceiver) makes points that move.
    Depth,
}

impl Kind {
    /// Whether it is by cameras, which stand in the world.
    pub fn has_cameras(self) -> bool {
        matches!(self, Self::Camera | Self::Depth)
    }
}

impl Default for PerceptionSettings {
    fn default() -> Self {
        Self {
            kind: Kind::Ideal,
            sensors: 4,
            around: None,
            rays: 3,
            field_of_view: 1.0,
            range: 2.0,
            rate: None,
            noise: 0.0,
            resolution: 0.0,
            latency: 0.0,
            drop_outs: 0.0,
            cameras: Vec::new(),
            grazing: 0.0,
            position_error: 0.0,
            orientation_error: 0.0,
            clock_error: 0.0,
            perceiver: PerceiverSettings::default(),
        }
    }
}

impl PerceptionSettings {
    /// The sides of a link that sensors are on.
    pub fn sides(&self, dimension: usize) -> usize {
        if dimension == 2 { 2 } else { self.around.unwrap_or(4) }
    }

    /// The number of rays with an arm of so many bodies.
    pub fn rays_of(&self, bodies: usize, dimension: usize) -> usize {
        let on_links = [bodies, self.sides(dimension), self.sensors, self.rays];
        match self.kind {
            Kind::Ideal => 0,
            Kind::Range => on_links.into_iter().fold(1, usize::saturating_mul),
            Kind::Camera | Kind::Depth => self
                .cameras
                .iter()
                .map(|camera| camera.columns.saturating_mul(camera.rows))
                .fold(0, usize::saturating_add),
        }
    }

    /// The cells that the perceiver may remember, of so many pixels.
    pub(super) fn cells_of(&self, pixels: usize) -> usize {
        pixels.min(self.perceiver.most_voxels).max(1)
    }

    /// The most points that the controller may know, each a reading in the record.
    pub fn points_of(&self, bodies: usize, dimension: usize) -> usize {
        let rays = self.rays_of(bodies, dimension);
        let of_a_cell = self.perceiver.points_of_a_cell();
        if self.kind == Kind::Depth { self.cells_of(rays) * of_a_cell } else { rays }
    }

    /// How many readings are on their way to the controller at once, with plant steps of `dt` \[s\].
    pub fn readings_under_way(&self, bodies: usize, dimension: usize, dt: f64) -> f64 {
        let scans = self.steps_late(dt) / self.steps_per_scan(dt) + 3.0;
        self.rays_of(bodies, dimension) as f64 * scans
    }

    /// How many cells the room has that pictures are entered into; none where nothing is.
    pub fn cells_of_the_room(&self) -> f64 {
        let sides = self.perceiver.sides();
        if self.kind == Kind::Depth { sides.iter().product() } else { 0.0 }
    }

    /// Plant steps of `dt` \[s\] from scan to scan.
    pub fn steps_per_scan(&self, dt: f64) -> f64 {
        self.rate.map_or(1.0, |rate| (1.0 / (rate * dt) - 1e-9).ceil().max(1.0))
    }

    /// The age of a scan in plant steps of `dt` \[s\].
    pub fn steps_late(&self, dt: f64) -> f64 {
        (self.latency / dt - 1e-9).ceil().max(0.0)
    }
}

/// A depth camera that stands in the world: a picture of distances, row by row.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Where it stands \[m\].
    pub position: [f64; 3],
    /// The quaternion \[w, x, y, z\] of its frame: z looks forward, x to the right of the picture, y down it.
    pub orientation: [f64; 4],
    /// Pixels side by side, ≥ 1.
    #[serde(default = "columns")]
    pub columns: usize,
    /// Pixels one below the other, ≥ 1. They are square.
    #[serde(default = "rows")]
    pub rows: usize,
    /// Angle from the left edge of the picture to the right one \[rad\], in (0, π).
    #[serde(default = "field_of_view")]
    pub field_of_view: f64,
}

fn columns() -> usize {
    64
}

fn rows() -> usize {
    48
}

fn field_of_view() -> f64 {
    1.2
}
