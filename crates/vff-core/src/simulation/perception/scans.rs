//! Readings of many rays: noise, losses, and the time until they arrive.

use super::PerceptionSettings;
use crate::interrupt;
use crate::math::{Noise, Vector};
use crate::simulation::measurement::rounded;
use crate::world::Positions;

/// The most plant steps that a scan may be late, and from scan to scan.
pub const MAX_STEPS: f64 = 1e4;
/// The most readings that may be under way.
pub const MAX_READINGS: f64 = 1e7;

/// Where a ray begins, and the unit vector along it.
pub type Ray<const D: usize> = [Vector<D>; 2];

/// The points that rays have met: everything that has been seen and the controller does not know yet.
#[derive(Debug, Clone)]
pub struct Scans<const D: usize> {
    range: f64,
    deviation: f64,
    resolution: f64,
    drop_outs: f64,
    noise: Noise,
    losses: Noise,
    /// Plant steps from scan to scan, and until a scan arrives.
    every: usize,
    late: usize,
    /// The points of the last scans, NaN where nothing was met, one row a scan, as a ring.
    scans: Vec<Vector<D>>,
    rows: usize,
    /// Plant steps so far.
    step: usize,
    /// What the controller knows: the points of one scan, and those of them that were met.
    seen: Vec<Vector<D>>,
    met: Vec<Vector<D>>,
}

impl<const D: usize> Scans<D> {
    /// Of so many rays, for plant steps of `dt` \[s\]; the same seed gives the same noise.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated before")]
    pub fn new(settings: &PerceptionSettings, seed: u64, rays: usize, dt: f64) -> Self {
        let (every, late) =
            (settings.steps_per_scan(dt) as usize, settings.steps_late(dt) as usize);
        let rows = late / every + 3;
        let nothing = Vector::<D>::repeat(f64::NAN);
        Self {
            range: settings.range,
            deviation: settings.noise,
            resolution: settings.resolution,
            drop_outs: settings.drop_outs,
            noise: Noise::new(seed, 2),
            losses: Noise::new(seed, 3),
            every,
            late,
            scans: vec![nothing; rays * rows],
            rows,
            step: 0,
            seen: vec![nothing; rays],
            met: Vec::with_capacity(rays),
        }
    }

    /// One point per ray \[m\], NaN where nothing was met.
    pub fn seen(&self) -> &[Vector<D>] {
        &self.seen
    }

    /// Those that were met.
    pub fn met(&self) -> &[Vector<D>] {
        &self.met
    }

    /// Begins with a scan, as if all before had been the same. `cast` says where a ray is, and how far it goes until it
    /// meets something within the range that it is given \[m\].
    pub fn start(&mut self, cast: impl Fn(usize, f64) -> (Ray<D>, Option<f64>)) {
        self.step = 0;
        self.scan(0, cast);
        let count = self.seen.len();
        for row in 1..self.rows {
            self.scans.copy_within(..count, row * count);
        }
        self.fetch();
    }

    /// One plant step later.
    pub fn advance(&mut self, cast: impl Fn(usize, f64) -> (Ray<D>, Option<f64>)) {
        self.step += 1;
        if self.step.is_multiple_of(self.every) {
            self.scan(self.step / self.every % self.rows, cast);
        }
        self.fetch();
    }

    /// Takes the last step back.
    pub fn undo(&mut self) {
        self.step -= 1;
        self.fetch();
    }

    /// Reads every sensor (T80).
    fn scan(&mut self, row: usize, cast: impl Fn(usize, f64) -> (Ray<D>, Option<f64>)) {
        let Self { scans, noise, losses, .. } = self;
        let count = self.seen.len();
        for (k, point) in scans[row * count..][..count].iter_mut().enumerate() {
            interrupt::checkpoint(64);
            // Drawn for every ray, so that no reading depends on what the others have met.
            let (error, lost) = (self.deviation * noise.draw(), losses.share() < self.drop_outs);
            let ([origin, direction], met) = cast(k, self.range);
            let reading = met
                .map(|distance| rounded(distance + error, self.resolution).max(0.0))
                .filter(|distance| !lost && *distance <= self.range);
            *point = reading
                .map_or_else(|| Vector::repeat(f64::NAN), |distance| origin + direction * distance);
        }
    }

    /// As if the rays had met these.
    #[cfg(test)]
    pub fn pretend(&mut self, points: &[Vector<D>]) {
        self.met = points.to_vec();
    }

    /// Fetches the scan that has arrived last.
    fn fetch(&mut self) {
        let row = self.step.saturating_sub(self.late) / self.every % self.rows;
        let count = self.seen.len();
        self.seen.copy_from_slice(&self.scans[row * count..][..count]);
        self.met.clear();
        self.met.extend(self.seen.iter().filter(|point| !point[0].is_nan()));
    }
}

impl<const D: usize> Positions for Scans<D> {
    fn count(&self) -> usize {
        self.seen.len()
    }

    fn append_to(&self, out: &mut Vec<f64>) {
        self.seen.iter().for_each(|point| out.extend_from_slice(point.as_slice()));
    }
}
