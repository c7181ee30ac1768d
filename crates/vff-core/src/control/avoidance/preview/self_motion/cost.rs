//! What a path along the self-motion costs by its distances (T173).

/// What a second costs in which a distance is below the margin; a second at the margin costs 1. No path leads where less than
/// this share of the margin is left, and each second that a path does not reach costs this.
const BREACH: f64 = 10.0;
const PASSED: f64 = 0.25;
pub const ENDING: f64 = 100.0;

/// The margin, and the distance above which none is better \[m\].
#[derive(Debug, Clone, Copy)]
pub struct Cost {
    pub margin: f64,
    pub clearance: f64,
}

impl Cost {
    /// The least distance at which a path leads past what is there \[m\].
    pub fn passed(self) -> f64 {
        PASSED * self.margin
    }

    /// What a second costs at this distance from what is there.
    pub fn of_what_is_there(self, distance: f64) -> f64 {
        if distance < self.passed() { f64::INFINITY } else { self.near(distance) }
    }

    /// The same from what may come: that closes no way, but a second in which it would costs as much more as one that is not reached.
    pub fn of_what_may_come(self, distance: f64) -> f64 {
        self.near(distance) + if distance < self.passed() { ENDING } else { 0.0 }
    }

    fn near(self, distance: f64) -> f64 {
        let near = ((self.clearance - distance) / (self.clearance - self.margin)).max(0.0);
        near * near + if distance < self.margin { BREACH } else { 0.0 }
    }
}
