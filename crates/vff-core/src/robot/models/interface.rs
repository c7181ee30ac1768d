//! What the interfaces of bundled arms take, as their makers say.
//!
//! Panda, FR3: libfranka's `rate_limiting.h` (`kMaxTorqueRate`) and `control_types.h` (`Torques`: without gravity and friction), FCI
//! documentation, *Controller requirements*. UR: `direct_torque` in the documentation of `ur_robot_driver`: gravity is compensated, by default most
//! of the friction (`FrictionModelParameters` of `ur_msgs`); nothing is said of a rate. xArm: its maker says that there is no torque control
//! (xArm-CPLUS-SDK, issue 12). Of the others nothing was found that says who adds gravity.

/// A robot that takes torques.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interface {
    /// Whether it adds the torque against gravity by itself.
    pub adds_gravity: bool,
    /// How fast what is sent may change \[N·m/s\]; None if nothing is said of it.
    pub torque_rate: Option<f64>,
}

const FRANKA: Interface = Interface { adds_gravity: true, torque_rate: Some(1000.0) };
const UR: Interface = Interface { adds_gravity: true, torque_rate: None };

const INTERFACES: [(&str, Interface); 4] =
    [("panda", FRANKA), ("fr3", FRANKA), ("ur5e", UR), ("ur10e", UR)];

/// The arms whose interface is known.
pub fn with_interface() -> impl Iterator<Item = &'static str> {
    INTERFACES.iter().map(|(name, _)| *name)
}

/// The interface of a bundled arm, if it is known.
pub fn interface(name: &str) -> Option<Interface> {
    INTERFACES.iter().find(|(known, _)| *known == name).map(|(_, interface)| *interface)
}
