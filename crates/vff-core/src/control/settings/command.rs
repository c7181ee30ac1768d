//! What a user can say of the robot that gets the torque: the `[controller.command]` table of a scenario.

use crate::math::ScalarOrVec;
use crate::settings::{Table, settings};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// Who adds the torque that holds the arm against gravity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Gravity {
    /// It is part of what is sent.
    #[default]
    Controller,
    /// The robot, by itself: it is left out of what is sent.
    Robot,
}

settings! {
    /// What is sent to the robot for a torque of the law, and when it is sent no more.
    pub struct CommandSettings {
        /// `controller`, or `robot`: it adds the torque against gravity by itself, so it is left out of what is sent.
        gravity: Gravity = Gravity::Controller, "";
        /// What is sent changes no faster (Franka: 1000), and distances, speeds and the way back are begun in time for it.
        torque_rate: Option<ScalarOrVec> = None, "N·m/s", POSITIVE;
        /// What is compensated of it.
        viscous_friction: ScalarOrVec = ScalarOrVec::Uniform(0.0), "N·m·s/rad", NOT_NEGATIVE;
        /// What is compensated of it, with tanh for the sign of the joint velocity.
        coulomb_friction: ScalarOrVec = ScalarOrVec::Uniform(0.0), "N·m", NOT_NEGATIVE;
        /// The joint speed at which 76 % of `coulomb_friction` are compensated, tanh 1.
        friction_speed: ScalarOrVec = ScalarOrVec::Uniform(0.1), "rad/s", POSITIVE;
        /// The tip is braked so that it does not exceed it; torque limits come first.
        tip_speed: Option<f64> = None, "m/s", POSITIVE;
        /// The same for how fast it turns.
        tip_angular_speed: Option<f64> = None, "rad/s", POSITIVE;
        /// Deceleration with which every joint comes to its stops, so that it is slower the nearer it is (of an FR3: half the factor in
        /// its maker's square root); None leaves it to `yielding.rate`.
        stop_deceleration: Option<ScalarOrVec> = None, "rad/s²", POSITIVE;
        /// By how much it is slower than that.
        stop_offset: ScalarOrVec = ScalarOrVec::Uniform(0.0), "rad/s", NOT_NEGATIVE;
        /// An obstacle that is placed by `move_obstacle` where it cannot have come at this speed is doubted, and brought there
        /// no faster.
        obstacle_speed: Option<f64> = None, "m/s", POSITIVE;
        /// How long the torque is blended in.
        blend_time: f64 = 0.5, "s", NOT_NEGATIVE;
        /// So many cycles in a row without a new state, and the arm is damped; before, the torque is held.
        missed_cycles: usize = 5, "", AT_LEAST_ONE;
        /// Damping relative to inertia of a stop.
        stop_damping: f64 = 10.0, "1/s", POSITIVE;
        /// Whether gravity and rate are still to be those of the robot's interface: [`OF_THE_ROBOT`] was given.
        #[serde(skip)]
        of_the_robot: bool = false;
    }
}

/// What may stand in place of the table.
pub const OF_THE_ROBOT: &str = "of the robot";

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
    from.deserialize_struct("CommandSettings", CommandSettings::NAMES, Either)
}

impl CommandSettings {
    /// Whether what is sent differs from the torque of the law.
    pub fn changes_torque(&self) -> bool {
        self.gravity == Gravity::Robot || self.torque_rate.is_some() || self.compensates_friction()
    }

    /// Whether more than the torque is limited.
    pub fn is_judged(&self) -> bool {
        self.torque_rate.is_some()
            || self.tip_speed.is_some()
            || self.tip_angular_speed.is_some()
            || self.stop_deceleration.is_some()
    }

    /// Whether any friction is compensated.
    pub fn compensates_friction(&self) -> bool {
        let some = |given: &ScalarOrVec| given.values().iter().any(|x| *x > 0.0);
        some(&self.viscous_friction) || some(&self.coulomb_friction)
    }
}
