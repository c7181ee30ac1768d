//! An energy tank: what avoidance may inject into the null space (T40).
//!
//! Dissipated energy fills the tank, repulsion that accelerates the arm drains it. A tank that runs
//! empty weakens the repulsion, but never below its floor, and only while it injects: what slows an
//! approach keeps its full strength.

use crate::math::smoothstep;
use serde::{Deserialize, Serialize};

/// `[controller.tank]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TankSettings {
    /// The most that it holds \[J\], > 0.
    pub capacity: f64,
    /// What it holds at the start \[J\], in \[0, capacity\]; full by default.
    #[serde(default)]
    pub initial: Option<f64>,
    /// The share of the repulsion that is left when it is empty, in (0, 1].
    #[serde(default = "floor")]
    pub floor: f64,
}

fn floor() -> f64 {
    0.2
}

/// The tank at one instant.
///
/// ```
/// use vff_core::control::tank::{Tank, TankSettings};
///
/// let mut tank = Tank::new(TankSettings { capacity: 2.0, initial: None, floor: 0.2 });
/// assert_eq!(tank.share(100.0), 1.0); // it is full
/// tank.elapse(0.1, -20.0); // repulsion has injected 2 J
/// assert_eq!(tank.level(), 0.0);
/// assert!((tank.share(100.0) - 0.2).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tank {
    settings: TankSettings,
    level: f64,
}

impl Tank {
    /// As filled at the start.
    pub fn new(settings: TankSettings) -> Self {
        Self { settings, level: settings.initial.unwrap_or(settings.capacity) }
    }

    /// What it holds \[J\].
    pub fn level(&self) -> f64 {
        self.level
    }

    /// Holds what `other` holds, as far as there is room for it: nothing is gained by another law.
    pub fn take_over(&mut self, other: &Self) {
        self.level = other.level.min(self.settings.capacity);
    }

    /// The share of the repulsion that is let through while it would inject `power` \[W\]. Continuous
    /// in both the power and the level.
    pub fn share(&self, power: f64) -> f64 {
        let TankSettings { capacity, floor, .. } = self.settings;
        let supply = floor + (1.0 - floor) * smoothstep(2.0 * self.level / capacity);
        // From full strength at no injection to the supply at a power of a tenth of the tank a second.
        1.0 - (1.0 - supply) * smoothstep(10.0 * power / capacity)
    }

    /// Lets `dt` \[s\] pass with `inflow` \[W\]: what is dissipated less what repulsion injects.
    pub fn elapse(&mut self, dt: f64, inflow: f64) {
        self.level = (self.level + dt * inflow).clamp(0.0, self.settings.capacity);
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "exact by construction")]
mod tests {
    use super::*;

    fn tank(initial: f64) -> Tank {
        Tank::new(TankSettings { capacity: 2.0, initial: Some(initial), floor: 0.2 })
    }

    /// Full strength when full or when nothing is injected; never below the floor.
    #[test]
    fn share_is_between_floor_and_all() {
        assert_eq!(tank(2.0).share(1e9), 1.0);
        assert_eq!(tank(0.0).share(-5.0), 1.0);
        assert!((tank(0.0).share(1e9) - 0.2).abs() < 1e-15);
        for k in 0..100 {
            let (level, power) = (0.02 * f64::from(k), 0.01 * f64::from(k));
            assert!((0.2..=1.0).contains(&tank(level).share(power)));
        }
    }

    /// The level is what flowed in, within 0 and the capacity.
    #[test]
    fn level_follows_the_flow() {
        let mut tank = tank(1.0);
        tank.elapse(0.4, 0.5 - 2.0);
        assert!((tank.level() - 0.4).abs() < 1e-15);
        tank.elapse(10.0, -1.5);
        assert_eq!(tank.level(), 0.0);
        tank.elapse(10.0, 3.0);
        assert_eq!(tank.level(), 2.0);
    }
}
