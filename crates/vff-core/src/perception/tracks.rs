//! Bodies that are seen, and how they move (T184): cells that hang together, followed from picture to picture by a Kalman filter.
//!
//! What is followed is the mean of the points of a body. The noise of all three coordinates is taken for the same, so that one
//! symmetric matrix of 2 × 2 is the covariance of each.

use super::PerceiverSettings;
use super::voxels::VoxelMap;
use crate::math::Vector;

/// The most bodies that are followed.
const MAX_TRACKS: usize = 64;
/// A body has so many cells at least.
const LEAST: usize = 3;
/// What is farther from where a body is expected than so many standard deviations is another one.
const GATE: f64 = 4.0;
/// A velocity of less than so many standard deviations is none.
const SIGNIFICANT: f64 = 2.0;

/// A body that is followed.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::perception::Track;
///
/// let track = Track {
///     number: 0,
///     camera: 0,
///     position: Vector::<3>::zeros(),
///     velocity: Vector::<3>::new(0.5, 0.0, 0.0),
///     covariance: [1e-6, 1e-5, 1e-4],
///     time: 0.0,
///     seen: 4,
///     points: 120,
/// };
/// assert!(track.is_moving());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Which it is, counted from the first that was ever seen.
    pub number: u64,
    /// By which camera it is followed: each sees another side.
    pub camera: usize,
    /// The mean of what is seen of it \[m\].
    pub position: Vector<3>,
    /// Its velocity \[m/s\].
    pub velocity: Vector<3>,
    /// Of each coordinate: variances of place \[m²\] and velocity \[m²/s²\] first and last, between them their covariance \[m²/s\].
    pub covariance: [f64; 3],
    /// When it was seen last \[s\].
    pub time: f64,
    /// In how many pictures it was seen.
    pub seen: usize,
    /// Of how many points it consisted.
    pub points: usize,
}

impl Track {
    /// Whether it moves for certain: at more than two standard deviations of its velocity.
    pub fn is_moving(&self) -> bool {
        self.seen > 2 && self.velocity.norm() > SIGNIFICANT * self.covariance[2].sqrt()
    }

    /// Goes on to a time \[s\] at constant velocity, while an acceleration that nobody knows acts on it.
    fn predict(&mut self, t: f64, acceleration: f64) {
        let h = (t - self.time).max(0.0);
        let [a, b, c] = self.covariance;
        let noise = acceleration * acceleration * h * h;
        self.position += self.velocity * h;
        self.covariance = [
            a + h * (2.0 * b + h * c) + 0.25 * noise * h * h,
            b + h * c + 0.5 * noise * h,
            c + noise,
        ];
        self.time = self.time.max(t);
    }

    /// Takes in where its mean is seen \[m\], with this variance \[m²\].
    fn correct(&mut self, position: &Vector<3>, variance: f64) {
        let [a, b, c] = self.covariance;
        let [of_place, of_velocity] = [a, b].map(|x| x / (a + variance));
        let off = position - self.position;
        self.position += off * of_place;
        self.velocity += off * of_velocity;
        self.covariance = [a * (1.0 - of_place), b * (1.0 - of_place), c - of_velocity * b];
        self.seen += 1;
    }
}

/// Cells of one body in the present picture.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    sum: Vector<3>,
    points: u32,
    cells: usize,
}

/// The bodies, and room to find them.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracks {
    tracks: Vec<Track>,
    clusters: Vec<Cluster>,
    queue: Vec<usize>,
    count: u64,
}

impl Tracks {
    pub(super) fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Finds the bodies in the picture of a camera at time `t` \[s\], follows them, and tells the cells that it has hit at which
    /// velocity they go on.
    pub(super) fn update(
        &mut self,
        map: &mut VoxelMap,
        camera: usize,
        t: f64,
        settings: &PerceiverSettings,
    ) {
        self.find(map, t, settings.settling);
        let PerceiverSettings { acceleration, memory, track_error, .. } = settings;
        let variance = track_error * track_error;
        self.tracks.retain(|track| (t - track.time).abs() <= *memory);
        let own = |track: &&mut Track| track.camera == camera;
        self.tracks.iter_mut().filter(own).for_each(|track| track.predict(t, *acceleration));
        // The largest first.
        let mut order: Vec<usize> = (0..self.clusters.len()).collect();
        order.sort_unstable_by_key(|k| std::cmp::Reverse(self.clusters[*k].points));
        let mut velocities = vec![Vector::<3>::zeros(); self.clusters.len()];
        let mut is_taken = vec![false; self.tracks.len()];
        for k in order {
            let Cluster { sum, points, cells } = self.clusters[k];
            if cells < LEAST {
                continue;
            }
            let mean = sum / f64::from(points);
            let off = |track: &Track| {
                let square = (mean - track.position).norm_squared();
                square / (track.covariance[0] + variance)
            };
            let free = (0..self.tracks.len())
                .filter(|i| !is_taken[*i] && self.tracks[*i].camera == camera);
            let nearest =
                free.min_by(|i, j| off(&self.tracks[*i]).total_cmp(&off(&self.tracks[*j])));
            let place = match nearest.filter(|i| off(&self.tracks[*i]) < GATE * GATE) {
                Some(i) => {
                    self.tracks[i].correct(&mean, variance);
                    i
                }
                None if self.tracks.len() == MAX_TRACKS => continue,
                None => {
                    self.tracks.push(Track {
                        number: self.count,
                        camera,
                        position: mean,
                        velocity: Vector::zeros(),
                        covariance: [variance, 0.0, settings.speed * settings.speed],
                        time: t,
                        seen: 1,
                        points: 0,
                    });
                    is_taken.push(false);
                    self.count += 1;
                    self.tracks.len() - 1
                }
            };
            is_taken[place] = true;
            let track = &mut self.tracks[place];
            track.points = points as usize;
            if track.is_moving() {
                velocities[k] = track.velocity;
            }
        }
        for voxel in map.voxels_mut().iter_mut().filter(|voxel| voxel.hits > 0) {
            let of = velocities.get(voxel.cluster as usize);
            voxel.velocity = of.copied().unwrap_or_default();
        }
    }

    /// Numbers the cells that hang together, of those that were hit and are not taken for long: what stands is not beside them.
    #[expect(clippy::cast_possible_truncation, reason = "few")]
    fn find(&mut self, map: &mut VoxelMap, t: f64, settling: f64) {
        self.clusters.clear();
        let stands = |map: &VoxelMap, place: usize| {
            let voxel = &map.voxels()[place];
            t - voxel.since > settling
        };
        for start in 0..map.voxels().len() {
            let number = self.clusters.len() as u32;
            let mut cluster = Cluster { sum: Vector::zeros(), points: 0, cells: 0 };
            self.queue.clear();
            self.queue.push(start);
            while let Some(place) = self.queue.pop() {
                let voxel = &map.voxels()[place];
                if voxel.hits == 0 || voxel.cluster < u32::MAX || stands(map, place) {
                    continue;
                }
                let mut beside = false;
                map.for_each_neighbour(place, |other| beside |= stands(map, other));
                if beside {
                    continue;
                }
                cluster.sum += voxel.point * f64::from(voxel.hits);
                cluster.points += voxel.hits;
                cluster.cells += 1;
                map.voxels_mut()[place].cluster = number;
                let queue = &mut self.queue;
                map.for_each_neighbour(place, |other| queue.push(other));
            }
            if cluster.cells > 0 {
                self.clusters.push(cluster);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From four places that are known to a millimetre its velocity is known, and the covariance is that of the matrix form.
    #[test]
    fn velocities_come_of_places() {
        let velocity = Vector::<3>::new(0.3, -0.4, 0.0);
        let mut track = Track {
            number: 0,
            camera: 0,
            position: Vector::zeros(),
            velocity: Vector::zeros(),
            covariance: [1e-6, 0.0, 1.0],
            time: 0.0,
            seen: 1,
            points: 0,
        };
        let mut p = nalgebra::Matrix2::new(1e-6, 0.0, 0.0, 1.0);
        let (h, a) = (1.0 / 30.0, 3.0);
        for k in 1..4 {
            let t = h * f64::from(k);
            track.predict(t, a);
            track.correct(&(velocity * t), 1e-6);
            let f = nalgebra::Matrix2::new(1.0, h, 0.0, 1.0);
            let g = nalgebra::Vector2::new(0.5 * h * h, h) * a;
            p = f * p * f.transpose() + g * g.transpose();
            let gain = p.column(0) / (p[(0, 0)] + 1e-6);
            p -= gain * p.row(0);
            let [place, both, speed] = track.covariance;
            let found = nalgebra::Matrix2::new(place, both, both, speed);
            assert!((found - p).norm() < 1e-12, "{found} {p}");
        }
        assert!((track.velocity - velocity).norm() < 0.01 && track.is_moving());
    }
}
