//! What a user can say of the robot that gets the torque: the `[controller.command]` table of a scenario.

use crate::math::ScalarOrVec;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;

/// Who adds the torque that holds the arm against gravity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Gravity {
    /// It is part of what is sent.
    #[default]
    Controller,
    /// The robot, by itself: it is left out of what is sent.
    Robot,
}

/// What is sent to the robot for a torque of the law, and when it is sent no more.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandSettings {
    /// Who adds gravity.
    pub gravity: Gravity,
    /// How fast what is sent may change \[N·m/s, N/s\], each, > 0; no limit by default.
    pub torque_rate: Option<ScalarOrVec>,
    /// Viscous friction that is compensated \[N·m·s/rad, N·s/m\], each, ≥ 0.
    pub viscous_friction: ScalarOrVec,
    /// Dry friction that is compensated \[N·m, N\], each, ≥ 0.
    pub coulomb_friction: ScalarOrVec,
    /// The joint speed at which tanh 1 = 76 % of the dry friction are compensated \[rad/s, m/s\], each, > 0.
    pub friction_speed: ScalarOrVec,
    /// The speed that the tip is kept below \[m/s\], > 0; no limit by default.
    pub tip_speed: Option<f64>,
    /// The speed that no obstacle exceeds \[m/s\], > 0: one that is placed where it cannot have come is brought there no faster.
    pub obstacle_speed: Option<f64>,
    /// How long the torque is blended in at a safe start \[s\], ≥ 0.
    pub start: f64,
    /// The cycle in a row without a new state that is the first to be damped, ≥ 1.
    pub patience: usize,
    /// d \[1/s\] > 0 of the damping −d M q̇ that stops the arm.
    pub stop_damping: f64,
    /// Whether gravity and rate are still to be those of the robot's interface: [`OF_THE_ROBOT`] was given.
    #[serde(skip)]
    pub of_the_robot: bool,
}

/// What may stand in place of the table.
pub const OF_THE_ROBOT: &str = "of the robot";

/// The keys of the table.
const KEYS: [&str; 10] = [
    "gravity",
    "torque_rate",
    "viscous_friction",
    "coulomb_friction",
    "friction_speed",
    "tip_speed",
    "obstacle_speed",
    "start",
    "patience",
    "stop_damping",
];

/// Reads the table, or what may stand in its place.
pub(crate) fn read<'de, T: Deserializer<'de>>(from: T) -> Result<CommandSettings, T::Error> {
    struct Either;
    impl<'de> Visitor<'de> for Either {
        type Value = CommandSettings;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a table, or \"{OF_THE_ROBOT}\"")
        }
        fn visit_str<E: Error>(self, given: &str) -> Result<CommandSettings, E> {
            match given {
                OF_THE_ROBOT => Ok(CommandSettings { of_the_robot: true, ..Default::default() }),
                other => Err(E::invalid_value(Unexpected::Str(other), &self)),
            }
        }
        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<CommandSettings, A::Error> {
            CommandSettings::deserialize(MapAccessDeserializer::new(map))
        }
    }
    from.deserialize_struct("CommandSettings", &KEYS, Either)
}

impl Default for CommandSettings {
    fn default() -> Self {
        Self {
            gravity: Gravity::Controller,
            torque_rate: None,
            viscous_friction: ScalarOrVec::Uniform(0.0),
            coulomb_friction: ScalarOrVec::Uniform(0.0),
            friction_speed: ScalarOrVec::Uniform(0.1),
            tip_speed: None,
            obstacle_speed: None,
            start: 0.5,
            patience: 5,
            stop_damping: 10.0,
            of_the_robot: false,
        }
    }
}

impl CommandSettings {
    /// Whether what is sent differs from the torque of the law.
    pub fn changes_torque(&self) -> bool {
        self.gravity == Gravity::Robot
            || self.torque_rate.is_some()
            || self.tip_speed.is_some()
            || self.compensates_friction()
    }

    /// Whether any friction is compensated.
    pub fn compensates_friction(&self) -> bool {
        let some = |given: &ScalarOrVec| given.values().iter().any(|x| *x > 0.0);
        some(&self.viscous_friction) || some(&self.coulomb_friction)
    }
}
