//! The `[arm]` table: what is given, validated, and turned into a [`PlanarArm`].

use super::super::error::{Problem, ScenarioError};
use super::super::numbers::{each, length};
use crate::math::{ScalarOrVec, Vector};
use crate::robot::planar::Link;
use crate::robot::{Limits, PlanarArm};
use crate::settings::{NOT_NEGATIVE, POSITIVE};
use serde::Deserialize;
use serde::de::{Deserializer, Error, SeqAccess, Visitor};
use std::fmt;

/// An arm as the user describes it; scalars hold for every link.
///
/// # Example
/// ```
/// use vff_core::scenario::{ArmSpec, PlanarScene, PlantSpec, Scenario};
///
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5]
///     arm = { lengths = [0.5, 0.4], masses = 2.0, gravity = 9.81 }
///     plant = { payload = 0.5 }
///     reference = { kind = "setpoint", point = [0.7, 0.3] }
///     "#,
/// )
/// .unwrap();
/// let scene: &PlanarScene = scenario.scene.plane().unwrap();
/// let arm: &ArmSpec = &scene.arm;
/// assert_eq!((arm.dof(), arm.build().unwrap().links()[1].length), (2, 0.4));
/// assert_eq!(scene.plant, PlantSpec { payload: 0.5, ..PlantSpec::default() });
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmSpec {
    /// Link lengths \[m\], > 0; their number is the number of joints.
    pub lengths: ScalarOrVec,
    /// Link masses \[kg\], > 0.
    pub masses: ScalarOrVec,
    /// Centres of mass \[m\]: distance along the link from its joint, or `[along, across]`.
    /// Default: the middle.
    #[serde(default)]
    pub com: Option<Nested>,
    /// Moments of inertia about the centres of mass \[kg·m²\], ≥ 0. Default: uniform rods, m l²/12.
    #[serde(default)]
    pub inertias: Option<ScalarOrVec>,
    /// Half the thickness of the links \[m\], ≥ 0.
    #[serde(default = "zero")]
    pub radius: ScalarOrVec,
    /// Gravity \[m/s²\]: g acting along −y, or the vector `[x, y]`.
    #[serde(default)]
    pub gravity: Option<Nested>,
    /// `[lower, upper]` \[rad\] for all joints, or one pair each.
    #[serde(default)]
    pub joint_limits: Option<Nested>,
    /// Largest joint speeds \[rad/s\], > 0.
    #[serde(default)]
    pub velocity_limits: Option<ScalarOrVec>,
    /// Largest torques \[N·m\], > 0.
    #[serde(default)]
    pub torque_limits: Option<ScalarOrVec>,
}

fn zero() -> ScalarOrVec {
    ScalarOrVec::Uniform(0.0)
}

/// A number or a list of such, to any depth.
///
/// # Example
/// ```
/// use vff_core::scenario::plane::Nested;
///
/// let com: Nested = toml::Value::from(vec![0.2, 0.3]).try_into().unwrap();
/// assert!(matches!(com, Nested::List(values) if values.len() == 2));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Nested {
    /// A number.
    Number(f64),
    /// A list.
    List(Vec<Nested>),
}

impl<'de> Deserialize<'de> for Nested {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> Result<Self, T::Error> {
        struct Numbers;
        impl<'de> Visitor<'de> for Numbers {
            type Value = Nested;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or a list of numbers")
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<Nested, E> {
                Ok(Nested::Number(value))
            }
            #[expect(clippy::cast_precision_loss, reason = "as TOML writes 5 for 5.0")]
            fn visit_i64<E: Error>(self, value: i64) -> Result<Nested, E> {
                Ok(Nested::Number(value as f64))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Nested, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = seq.next_element()? {
                    values.push(value);
                }
                Ok(Nested::List(values))
            }
        }
        deserializer.deserialize_any(Numbers)
    }
}

impl Nested {
    /// `[a, b]`, if that is what it is.
    fn pair(&self) -> Option<[f64; 2]> {
        match self {
            Self::List(values) => match values.as_slice() {
                [Self::Number(a), Self::Number(b)] => Some([*a, *b]),
                _ => None,
            },
            Self::Number(_) => None,
        }
    }
}

impl ArmSpec {
    /// The number of joints.
    pub fn dof(&self) -> usize {
        self.lengths.values().len()
    }

    /// The arm.
    ///
    /// # Errors
    /// With the name of the first parameter that is wrong.
    pub fn build(&self) -> Result<PlanarArm, ScenarioError> {
        let n = self.dof();
        if n == 0 {
            return Err(ScenarioError::out_of_range("lengths", "at least one length", [0.0; 0]));
        }
        each("lengths", &self.lengths, n, &POSITIVE)?;
        each("masses", &self.masses, n, &POSITIVE)?;
        each("radius", &self.radius, n, &NOT_NEGATIVE)?;
        if let Some(inertias) = &self.inertias {
            each("inertias", inertias, n, &NOT_NEGATIVE)?;
        }
        let com = self.centres_of_mass()?;
        let links = (0..n).map(|i| {
            let rod = Link::rod(self.lengths.get(i), self.masses.get(i));
            Link {
                com: com.as_ref().map_or(rod.com, |com| com[i]),
                inertia: self.inertias.as_ref().map_or(rod.inertia, |inertias| inertias.get(i)),
                radius: self.radius.get(i),
                ..rod
            }
        });
        let arm = PlanarArm::new(links.collect(), self.gravity_vector()?);
        for (i, link) in arm.links().iter().enumerate() {
            // A point mass on the joint axis of the last link would leave M singular.
            if link.inertia + link.mass * link.com.norm_squared() <= 0.0 {
                let problem = Problem::Other(format!(
                    "link {i} has no inertia about its joint: give it a moment of inertia or move \
                     its centre of mass off the joint"
                ));
                return Err(ScenarioError::new("inertias", problem));
            }
        }
        let velocity = self.largest("velocity_limits", self.velocity_limits.as_ref())?;
        let torque = self.largest("torque_limits", self.torque_limits.as_ref())?;
        Ok(arm.with_limits(Limits { joint: self.joint_ranges()?, velocity, torque }))
    }

    /// One limit per joint, none if not given.
    fn largest(&self, path: &str, given: Option<&ScalarOrVec>) -> Result<Vec<f64>, ScenarioError> {
        let Some(limit) = given else { return Ok(vec![]) };
        each(path, limit, self.dof(), &POSITIVE)?;
        Ok((0..self.dof()).map(|i| limit.get(i)).collect())
    }

    fn centres_of_mass(&self) -> Result<Option<Vec<Vector<2>>>, ScenarioError> {
        let n = self.dof();
        let along = |x: f64| Vector::<2>::new(x, 0.0);
        match &self.com {
            None => Ok(None),
            Some(Nested::Number(x)) => Ok(Some(vec![along(*x); n])),
            Some(Nested::List(values)) => {
                length("com", values.len(), n)?;
                let one = |(i, value): (usize, &Nested)| match (value, value.pair()) {
                    (Nested::Number(x), _) => Ok(along(*x)),
                    (_, Some(offset)) => Ok(Vector::from(offset)),
                    _ => Err(wrong(format!("com[{i}]"), "a number or [along, across]")),
                };
                values.iter().enumerate().map(one).collect::<Result<_, _>>().map(Some)
            }
        }
    }

    fn gravity_vector(&self) -> Result<Vector<2>, ScenarioError> {
        match &self.gravity {
            None => Ok(Vector::<2>::zeros()),
            Some(Nested::Number(g)) => Ok(Vector::<2>::new(0.0, -g)),
            Some(list) => list
                .pair()
                .map(Vector::from)
                .ok_or_else(|| wrong("gravity", "a number or a list of 2 numbers")),
        }
    }

    fn joint_ranges(&self) -> Result<Vec<[f64; 2]>, ScenarioError> {
        let n = self.dof();
        let Some(given) = &self.joint_limits else { return Ok(vec![]) };
        let ranges = match (given, given.pair()) {
            (_, Some(range)) => vec![range; n],
            (Nested::List(values), _) => {
                length("joint_limits", values.len(), n)?;
                let one = |(i, value): (usize, &Nested)| {
                    value
                        .pair()
                        .ok_or_else(|| wrong(format!("joint_limits[{i}]"), "[lower, upper]"))
                };
                values.iter().enumerate().map(one).collect::<Result<_, _>>()?
            }
            _ => return Err(wrong("joint_limits", "[lower, upper], or one such pair per joint")),
        };
        for (i, [lower, upper]) in ranges.iter().enumerate() {
            if !(lower.is_finite() && upper.is_finite()) {
                let path = format!("joint_limits[{i}]");
                return Err(ScenarioError::out_of_range(path, "finite", [lower, upper]));
            }
            if lower >= upper {
                let path = format!("joint_limits[{i}]");
                return Err(ScenarioError::out_of_range(path, "lower < upper", [lower, upper]));
            }
        }
        Ok(ranges)
    }
}

fn wrong(path: impl Into<String>, expected: &str) -> ScenarioError {
    let given = "something else".into();
    ScenarioError::new(path, Problem::WrongType { expected: expected.into(), given })
}
