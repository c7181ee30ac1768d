//! Somebody takes hold of a link: a spring between a point of it and a place in the world (T146).

use super::wrench::{Acting, find};
use crate::math::{Point, Vector};
use crate::robot::{Model, Robot};
use serde::Deserialize;

/// The natural frequency of a spring whose stiffness nobody has said \[rad/s\]: a hand's, well below what a plant step of
/// some milliseconds resolves.
const RATE: f64 = 10.0;

/// How a point of a link is pulled.
///
/// # Example
/// ```
/// use vff_core::simulation::Pull;
///
/// let pull: Pull<3> = toml::from_str(r#"link = "panda_link4" anchor = [0.3, 0.0, 0.6]"#.replace(" anchor", "\nanchor").as_str()).unwrap();
/// assert_eq!((pull.point, pull.stiffness), ([0.0; 3], None));
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pull<const D: usize> {
    /// The name of the link, or [`TIP`](super::TIP).
    pub link: String,
    /// The point, in the frame of the link \[m\].
    #[serde(default = "zeros", deserialize_with = "Point::read")]
    pub point: [f64; D],
    /// The place that it is pulled towards \[m\]; where the point is by default.
    #[serde(default, deserialize_with = "place")]
    pub anchor: Option<[f64; D]>,
    /// The spring's stiffness \[N/m\]; by default that which swings the link at 10 rad/s.
    #[serde(default)]
    pub stiffness: Option<f64>,
    /// Its damping \[N·s/m\]; critical by default.
    #[serde(default)]
    pub damping: Option<f64>,
}

fn zeros<const D: usize>() -> [f64; D] {
    [0.0; D]
}

fn place<'de, D, const N: usize>(deserializer: D) -> Result<Option<[f64; N]>, D::Error>
where
    D: serde::Deserializer<'de>,
{
    Point::read(deserializer).map(Some)
}

/// A spring and a damper between a point of a link and a place in the world.
#[derive(Debug, Clone)]
pub struct Spring<const D: usize> {
    link: usize,
    frame: usize,
    point: Vector<D>,
    /// Where it pulls to \[m\].
    pub anchor: Vector<D>,
    stiffness: f64,
    damping: f64,
}

impl<const D: usize> Spring<D> {
    /// One on `robot`, a state of `arm`, where that is.
    ///
    /// # Errors
    /// If the arm has no such link: with the names of those that it has.
    pub fn new<R: Robot<D>>(
        pull: &Pull<D>,
        arm: &impl Model<D>,
        robot: &R,
    ) -> Result<Self, Vec<String>> {
        let [link, frame] = find(&pull.link, arm)?;
        let point = Vector::from(pull.point);
        let mut this =
            Self { link, frame, point, anchor: Vector::zeros(), stiffness: 0.0, damping: 0.0 };
        let place = this.place(robot);
        this.anchor = pull.anchor.map_or(place, Vector::from);
        #[expect(clippy::cast_precision_loss, reason = "two or three")]
        let mean = this.mobility(robot) / D as f64;
        let mass = (1.0 / mean).min(robot.total_mass());
        this.stiffness = pull.stiffness.unwrap_or(RATE * RATE * mass);
        this.damping = pull.damping.unwrap_or(2.0 * (this.stiffness * mass).sqrt());
        Ok(this)
    }

    /// Where the point is on `robot` \[m\].
    fn place(&self, robot: &impl Robot<D>) -> Vector<D> {
        let (origin, axes) = robot.link_frame(self.frame);
        origin + axes * self.point
    }

    /// The trace of the point's mobility \[1/kg\].
    fn mobility(&self, robot: &impl Robot<D>) -> f64 {
        let place = self.place(robot);
        let unit = |k| Vector::from_fn(|row, _| f64::from(u8::from(row == k)));
        let along = |k| robot.point_mobility(self.link, &place, &unit(k));
        (0..D).map(along).sum()
    }

    /// What it does on `robot` where that is.
    pub fn acting(&self, robot: &impl Robot<D>) -> Acting<D> {
        let point = self.place(robot);
        let velocity = robot.point_velocity(self.link, &point);
        let force = (self.anchor - point) * self.stiffness - velocity * self.damping;
        Acting { link: self.link, point, force, torque: Vector::zeros() }
    }

    /// No eigenvalue of the motion that it makes of `robot` is larger \[1/s\].
    pub fn rate(&self, robot: &impl Robot<D>) -> f64 {
        let mobility = self.mobility(robot);
        self.damping * mobility + (self.stiffness * mobility).sqrt()
    }
}
