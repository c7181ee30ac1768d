//! When obstacles were seen that others follow.

/// So many can be followed at once; more are not watched over.
const MOST: usize = 256;

/// Obstacles that somebody sees from time to time. Nothing allocates after construction.
#[derive(Debug)]
pub(super) struct Seen {
    /// Which, and when it was seen last \[s\].
    last: Vec<(usize, f64)>,
}

impl Seen {
    pub(super) fn new() -> Self {
        Self { last: Vec::with_capacity(MOST) }
    }

    /// Obstacle `j` was seen at time `t` \[s\].
    pub(super) fn add(&mut self, j: usize, t: f64) {
        if let Some((_, last)) = self.last.iter_mut().find(|(obstacle, _)| *obstacle == j) {
            *last = last.max(t);
        } else if self.last.len() < MOST {
            self.last.push((j, t));
        }
    }

    /// There are others in the place of those that were seen.
    pub(super) fn forget(&mut self) {
        self.last.clear();
    }

    /// Which was last seen longer than `patience` \[s\] before `t`, and when.
    pub(super) fn missing(&self, t: f64, patience: f64) -> Option<(usize, f64)> {
        self.last.iter().copied().find(|(_, last)| t - last > patience)
    }
}
