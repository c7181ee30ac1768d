//! A force and a torque on a link over time: one of what pushes the plant from outside (T143).

use crate::math::{Point, Vector};
use crate::robot::{Model, Robot};
use nalgebra::SMatrix;
use serde::{Deserialize, Deserializer};

/// The most wrenches that act on one arm.
pub const MAX_WRENCHES: usize = 1000;

/// What the end effector is called among the links.
pub const TIP: &str = "tip";

/// One of `[[wrenches]]`: a force and a torque on a link, at a point that the link carries.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, PlanarState, Robot, planar::Link};
/// use vff_core::simulation::{Acting, Axes, Profile, TIP, Torque, Wrench, Wrenches};
///
/// let push = Wrench {
///     link: TIP.into(),
///     point: [0.0; 2],
///     force: [0.0, -10.0],
///     torque: Torque::default(),
///     frame: Axes::World,
///     start: 0.5,
///     duration: Some(1.0),
///     profile: Profile::Constant {},
/// };
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::zeros()));
/// let mut wrenches = Wrenches::<PlanarState, 2>::new(&[push], &*arm).unwrap();
/// let mut robot = arm.state();
/// robot.update(&[0.0; 2], &[0.0; 2]);
/// wrenches.go_to(1.0);
/// let Acting { link, force, .. } = wrenches.acting(&robot).next().unwrap();
/// assert_eq!((link, force), (1, Vector::<2>::new(0.0, -10.0)));
/// assert!((wrenches.torque(&robot)[0] + 20.0).abs() < 1e-12); // 2 m from the base
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wrench<const D: usize> {
    /// The name of the link, or [`TIP`].
    pub link: String,
    /// Where the force acts, in the frame of the link \[m\].
    #[serde(default = "zeros", deserialize_with = "Point::read")]
    pub point: [f64; D],
    /// The force \[N\].
    #[serde(default = "zeros", deserialize_with = "Point::read")]
    pub force: [f64; D],
    /// The torque beside that of the force \[N·m\].
    #[serde(default)]
    pub torque: Torque<D>,
    /// Along whose axes force and torque are given.
    #[serde(default)]
    pub frame: Axes,
    /// When it begins \[s\].
    #[serde(default)]
    pub start: f64,
    /// How long it lasts \[s\]; to the end by default.
    #[serde(default)]
    pub duration: Option<f64>,
    /// What share of it acts when.
    #[serde(default)]
    pub profile: Profile,
}

fn zeros<const D: usize>() -> [f64; D] {
    [0.0; D]
}

/// A torque \[N·m\]: in space three numbers, in the plane one, about the axis out of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Torque<const D: usize>(pub Vector<3>);

impl<'de, const D: usize> Deserialize<'de> for Torque<D> {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> Result<Self, T::Error> {
        match D {
            2 => f64::deserialize(deserializer).map(|torque| Self(Vector::<3>::z() * torque)),
            _ => Point::<3>::read(deserializer).map(|torque| Self(torque.into())),
        }
    }
}

/// Along whose axes a wrench is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axes {
    /// Those of the world.
    #[default]
    World,
    /// Those of the link, with which it turns.
    Link,
}

/// The share of a wrench that acts, over the time since it began.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Profile {
    /// All of it.
    Constant {},
    /// Grows in proportion to time, stays, and goes likewise.
    Ramp {
        /// How long it grows \[s\].
        rise: f64,
        /// How long before its end it begins to go \[s\].
        #[serde(default)]
        fall: f64,
    },
    /// sin(`angular_frequency` · s + `phase`) after s seconds.
    Sinusoid {
        /// Angular frequency \[rad/s\].
        angular_frequency: f64,
        /// Phase at the start \[rad\].
        #[serde(default)]
        phase: f64,
    },
    /// Linear from one to the next, and constant before the first and after the last.
    Table {
        /// Seconds since the start, strictly increasing.
        times: Vec<f64>,
        /// The share at each of them.
        factors: Vec<f64>,
    },
}

impl Default for Profile {
    fn default() -> Self {
        Self::Constant {}
    }
}

impl<const D: usize> Wrench<D> {
    /// How long it lasts \[s\].
    pub fn length(&self) -> f64 {
        self.duration.unwrap_or(f64::INFINITY)
    }

    /// The share of it that acts at time `t` \[s\].
    pub fn share(&self, t: f64) -> f64 {
        let (since, length) = (t - self.start, self.length());
        if !(0.0..length).contains(&since) {
            return 0.0;
        }
        match &self.profile {
            Profile::Constant {} => 1.0,
            Profile::Ramp { rise, fall } => {
                let grown = if since < *rise { since / rise } else { 1.0 };
                let left = length - since;
                if left < *fall { grown.min(left / fall) } else { grown }
            }
            Profile::Sinusoid { angular_frequency, phase } => {
                (angular_frequency * since + phase).sin()
            }
            Profile::Table { times, factors } => {
                let next = times.partition_point(|time| *time <= since);
                let Some(before) = next.checked_sub(1) else { return factors[0] };
                let Some(end) = times.get(next) else { return factors[before] };
                let passed = (since - times[before]) / (end - times[before]);
                factors[before] + passed * (factors[next] - factors[before])
            }
        }
    }
}

/// A wrench on an arm: which link carries it, and in whose frame it is given.
#[derive(Debug, Clone)]
pub(super) struct Placed<const D: usize> {
    pub wrench: Wrench<D>,
    /// The link's index.
    link: usize,
    /// The same, or the number of joints: the frame of the end effector.
    frame: usize,
}

/// A wrench as it is at one instant, in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acting<const D: usize> {
    /// The index of the link that it acts on.
    pub link: usize,
    /// Where the force acts \[m\].
    pub point: Vector<D>,
    /// The force \[N\].
    pub force: Vector<D>,
    /// The torque beside that of the force \[N·m\].
    pub torque: Vector<3>,
}

impl<const D: usize> Placed<D> {
    /// One on `arm`.
    ///
    /// # Errors
    /// If the arm has no such link: with the names of those that it has.
    pub fn new(wrench: Wrench<D>, arm: &impl Model<D>) -> Result<Self, Vec<String>> {
        let [link, frame] = find(&wrench.link, arm)?;
        Ok(Self { wrench, link, frame })
    }

    /// `share` of it on `robot` where that is.
    pub fn acting<R: Robot<D>>(&self, robot: &R, share: f64) -> Acting<D> {
        let Wrench { point, force, torque, frame, .. } = &self.wrench;
        let (origin, axes) = robot.link_frame(self.frame);
        let (force, torque) = (Vector::from(*force) * share, torque.0 * share);
        let (force, torque) = match frame {
            Axes::World => (force, torque),
            Axes::Link => (axes * force, turned(&axes, &torque)),
        };
        Acting { link: self.link, point: origin + axes * Vector::from(*point), force, torque }
    }
}

/// The index of the link of this name, or of the one that carries the [`TIP`], and that of its frame.
///
/// # Errors
/// If the arm has no such link: with the names of those that it has.
pub(super) fn find<const D: usize>(
    given: &str,
    arm: &impl Model<D>,
) -> Result<[usize; 2], Vec<String>> {
    let n = arm.dof();
    if given == TIP {
        return Ok([n - 1, n]);
    }
    let names = arm.link_names();
    let index = names.iter().position(|name| name == given);
    index.map(|i| [i, i]).ok_or_else(|| names.into_iter().chain([TIP.to_string()]).collect())
}

/// A torque of the axes `axes` in the world; in the plane they all have the same one.
fn turned<const D: usize>(axes: &SMatrix<f64, D, D>, torque: &Vector<3>) -> Vector<3> {
    match D {
        2 => *torque,
        _ => Vector::<3>::from_fn(|row, _| (0..3).map(|k| axes[(row, k)] * torque[k]).sum()),
    }
}
