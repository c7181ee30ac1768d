//! How near a drive came to what its law knew.

use std::fmt::Write;

/// The least distance of a link from an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closest {
    /// \[m\], negative in contact; infinite without an obstacle.
    pub distance: f64,
    /// Which link, counted from 0.
    pub link: usize,
    /// When, by the time of the drive \[s\].
    pub t: f64,
}

impl Default for Closest {
    fn default() -> Self {
        Self { distance: f64::INFINITY, link: 0, t: 0.0 }
    }
}

impl Closest {
    /// Takes in how far each link was from everything at time `t` \[s\].
    pub(super) fn look(&mut self, t: f64, clearance: &[f64]) {
        for (link, distance) in clearance.iter().enumerate() {
            if *distance < self.distance {
                *self = Self { distance: *distance, link, t };
            }
        }
    }

    /// What is to be told of a contact.
    pub(super) fn note(&self) -> Option<String> {
        let Self { distance, link, t } = self;
        (*distance < 0.0).then(|| {
            let mut note = String::with_capacity(96); // at once: tests count what a drive allocates
            let depth = -1e3 * distance;
            let written =
                write!(note, "link {link} was {depth:.1} mm inside an obstacle at t = {t:.3} s");
            written.expect("a string takes everything");
            note
        })
    }
}
