//! Which obstacles a loop doubts.

/// Obstacles that were seen where they cannot have come.
#[derive(Debug, Default)]
pub(super) struct Doubts {
    count: u64,
    /// The farthest one \[m\], and when \[s\].
    farthest: (f64, usize, f64),
}

impl Doubts {
    /// Obstacle `j` was seen at time `t` \[s\], so far from where it can be \[m\].
    pub(super) fn add(&mut self, j: usize, t: f64, distance: f64) {
        self.count += u64::from(distance > 0.0);
        if distance > self.farthest.0 {
            self.farthest = (distance, j, t);
        }
    }

    pub(super) fn note(&self) -> Option<String> {
        let Self { count, farthest: (distance, j, t) } = self;
        (*count > 0).then(|| {
            format!(
                "obstacles were seen {count} times where they cannot have come at command.obstacle_speed, \
                 farthest away obstacles[{j}] at t = {t:.3} s, by {distance:.3} m; they were brought there no faster"
            )
        })
    }
}
