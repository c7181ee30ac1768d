//! What the interfaces of bundled arms take, as their makers say.
//!
//! *Panda, FR3*: libfranka's `rate_limiting.h` (`kMaxTorqueRate`) and `control_types.h` (`Torques`: without gravity and friction), FCI
//! documentation, *Controller requirements* and *Cartesian space limits*; how fast a joint of an FR3 may come to its stops,
//! √(2 b (c − q)) − o: *Limits for Franka Research 3*, where c is 4 to 8 mrad beyond the stop.
//!
//! *UR*: `direct_torque` in the documentation of `ur_robot_driver`: gravity is compensated, by default most of the friction
//! (`FrictionModelParameters` of `ur_msgs`); nothing is said of a rate; 1.5 m/s is the speed of the tool in the safety settings that
//! it comes with.
//!
//! *iiwa*: the wiki of `kuka_drivers`, by KUKA Hungaria: a torque of FRI is laid over gravity compensation, and 0 leaves the arm where
//! it is. *Gen3*: Kinova in issues 26 and 92 of `Kinova-kortex2_Gen3_G3L`: gravity is not compensated in low-level servoing, and
//! nothing is limited there but by the hardware. Neither says anything of a rate, or of how fast a tip may be that is
//! driven by torques.
//!
//! *xArm*: its maker says that there is no torque control (xArm-CPLUS-SDK, issues 12 and 18).

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
    /// How fast the hand may move \[m/s\]; None if nothing is said of it.
    pub tip_speed: Option<f64>,
    /// How fast it may turn \[rad/s\]; None if nothing is said of it.
    pub tip_angular_speed: Option<f64>,
    /// How joints come to their stops: deceleration \[rad/s²\] and offset \[rad/s\] of each; None if nothing is said of it.
    pub stops: Option<[&'static [f64]; 2]>,
}

const PANDA: Interface = Interface {
    adds_gravity: true,
    torque_rate: Some(1000.0),
    tip_speed: Some(1.7),
    tip_angular_speed: Some(2.5),
    stops: None,
};
const FR3: Interface = Interface {
    tip_speed: Some(3.0),
    stops: Some([
        &[6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0],
        &[0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35],
    ]),
    ..PANDA
};
const UR: Interface = Interface {
    adds_gravity: true,
    torque_rate: None,
    tip_speed: Some(1.5),
    tip_angular_speed: None,
    stops: None,
};

const IIWA: Interface = Interface {
    adds_gravity: true,
    torque_rate: None,
    tip_speed: None,
    tip_angular_speed: None,
    stops: None,
};
const GEN3: Interface = Interface { adds_gravity: false, ..IIWA };

const INTERFACES: [(&str, Interface); 6] =
    [("panda", PANDA), ("fr3", FR3), ("ur5e", UR), ("ur10e", UR), ("iiwa14", IIWA), ("gen3", GEN3)];

/// The arms whose interface is known.
pub fn with_interface() -> impl Iterator<Item = &'static str> {
    INTERFACES.iter().map(|(name, _)| *name)
}

/// The interface of a bundled arm, if it is known.
pub fn interface(name: &str) -> Option<Interface> {
    INTERFACES.iter().find(|(known, _)| *known == name).map(|(_, interface)| *interface)
}
