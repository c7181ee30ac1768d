//! What the interfaces of bundled arms take, as their makers say.
//!
//! Panda, FR3: libfranka's `rate_limiting.h` (`kMaxTorqueRate`) and `control_types.h` (`Torques`: without gravity and friction), FCI
//! documentation, *Controller requirements* and *Cartesian space limits*; how fast a joint of an FR3 may come to its stops,
//! √(2 b (c − q)) − o: *Limits for Franka Research 3*, where c is 4 to 8 mrad beyond the stop. UR: `direct_torque` in the documentation of `ur_robot_driver`: gravity is compensated, by default most
//! of the friction (`FrictionModelParameters` of `ur_msgs`); nothing is said of a rate; 1.5 m/s is the speed of the tool in the safety settings that it comes with. xArm: its maker says that there is no torque control
//! (xArm-CPLUS-SDK, issue 12). Of the others nothing was found that says who adds gravity.

/// A robot that takes torques.
///
/// # Example
/// ```
/// use vff_core::robot::models::{Interface, interface};
///
/// let Interface { adds_gravity, torque_rate, .. } = interface("panda").unwrap();
/// assert!(adds_gravity && torque_rate.is_some());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interface {
    /// Whether it adds the torque against gravity by itself.
    pub adds_gravity: bool,
    /// How fast what is sent may change \[N·m/s\]; None if nothing is said of it.
    pub torque_rate: Option<f64>,
    /// How fast the hand may move \[m/s\].
    pub tip_speed: f64,
    /// How fast it may turn \[rad/s\]; None if nothing is said of it.
    pub tip_angular_speed: Option<f64>,
    /// How joints come to their stops: deceleration \[rad/s²\] and offset \[rad/s\] of each; None if nothing is said of it.
    pub stops: Option<[&'static [f64]; 2]>,
}

const PANDA: Interface = Interface {
    adds_gravity: true,
    torque_rate: Some(1000.0),
    tip_speed: 1.7,
    tip_angular_speed: Some(2.5),
    stops: None,
};
const FR3: Interface = Interface {
    tip_speed: 3.0,
    stops: Some([
        &[6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0],
        &[0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35],
    ]),
    ..PANDA
};
const UR: Interface = Interface {
    adds_gravity: true,
    torque_rate: None,
    tip_speed: 1.5,
    tip_angular_speed: None,
    stops: None,
};

const INTERFACES: [(&str, Interface); 4] =
    [("panda", PANDA), ("fr3", FR3), ("ur5e", UR), ("ur10e", UR)];

/// The arms whose interface is known.
pub fn with_interface() -> impl Iterator<Item = &'static str> {
    INTERFACES.iter().map(|(name, _)| *name)
}

/// The interface of a bundled arm, if it is known.
pub fn interface(name: &str) -> Option<Interface> {
    INTERFACES.iter().find(|(known, _)| *known == name).map(|(_, interface)| *interface)
}
