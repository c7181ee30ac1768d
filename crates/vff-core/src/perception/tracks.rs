//! Bodies that are seen, and how they move (T184): cells that hang together, followed from picture to picture by a Kalman filter.
//!
//! What is followed is the mean of the points of a body, and where it is cut off at the end of the picture the box around it. The
//! noise of all three coordinates is taken for the same, so that one symmetric matrix of 2 × 2 is the covariance of each.

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

/// The standard deviation of a corner, by that of a mean: it is a matter of few points.
const CORNER: f64 = 3.0;

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
///     is_cut: false,
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
    /// Whether it goes on where the picture or the room ends: its velocity is then that of its sides, not of its mean.
    pub is_cut: bool,
}

impl Track {
    /// Whether it moves for certain: at more than two standard deviations of its velocity.
    pub fn is_moving(&self) -> bool {
        self.seen > 2 && self.velocity.norm() > SIGNIFICANT * self.covariance[2].sqrt()
    }
}

/// Place and velocity of something, as far as they are known.
#[derive(Debug, Clone)]
struct Estimate {
    position: Vector<3>,
    velocity: Vector<3>,
    /// As of a [`Track`].
    covariance: [f64; 3],
}

impl Estimate {
    /// Of something seen for the first time.
    fn new(position: Vector<3>, variance: f64, speed: f64) -> Self {
        Self { position, velocity: Vector::zeros(), covariance: [variance, 0.0, speed * speed] }
    }

    /// Goes on for a time \[s\] at constant velocity, while an acceleration that nobody knows acts on it.
    fn predict(&mut self, h: f64, acceleration: f64) {
        let [a, b, c] = self.covariance;
        let noise = acceleration * acceleration * h * h;
        self.position += self.velocity * h;
        self.covariance = [
            a + h * (2.0 * b + h * c) + 0.25 * noise * h * h,
            b + h * c + 0.5 * noise * h,
            c + noise,
        ];
    }

    /// Takes in where it is seen \[m\], with this variance \[m²\].
    fn correct(&mut self, position: &Vector<3>, variance: f64) {
        let [a, b, c] = self.covariance;
        let [of_place, of_velocity] = [a, b].map(|x| x / (a + variance));
        let off = position - self.position;
        self.position += off * of_place;
        self.velocity += off * of_velocity;
        self.covariance = [a * (1.0 - of_place), b * (1.0 - of_place), c - of_velocity * b];
    }
}

/// A body, with the mean and the corners of a box around it.
#[derive(Debug, Clone)]
struct Body {
    number: u64,
    camera: usize,
    /// For when it is estimated, and when it was seen last \[s\].
    time: f64,
    last: f64,
    seen: usize,
    points: usize,
    is_cut: bool,
    mean: Estimate,
    corners: [Estimate; 2],
}

impl Body {
    /// Goes on to a time \[s\].
    fn predict(&mut self, t: f64, acceleration: f64) {
        let h = (t - self.time).max(0.0);
        self.mean.predict(h, acceleration);
        self.corners.iter_mut().for_each(|corner| corner.predict(h, acceleration));
        self.time = self.time.max(t);
    }

    fn track(&self) -> Track {
        let Self { number, camera, last, seen, points, is_cut, mean, corners, .. } = self;
        let [low, high] = corners.each_ref().map(|corner| corner.velocity);
        // The faster one up the axis and the faster one down: a side that is cut off stands still where it is, and sides that go
        // apart or together are those of a body of which more or less is seen.
        let of_sides = low.zip_map(&high, |a, b| a.max(b).max(0.0) + a.min(b).min(0.0));
        Track {
            number: *number,
            camera: *camera,
            position: mean.position,
            velocity: if *is_cut { of_sides } else { mean.velocity },
            covariance: if *is_cut { corners[0].covariance } else { mean.covariance },
            time: *last,
            seen: *seen,
            points: *points,
            is_cut: *is_cut,
        }
    }
}

/// Cells of one body in the present picture.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    sum: Vector<3>,
    corners: [Vector<3>; 2],
    is_cut: bool,
    points: u32,
    cells: usize,
}

/// The bodies, and room to find them.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracks {
    bodies: Vec<Body>,
    clusters: Vec<Cluster>,
    queue: Vec<usize>,
    count: u64,
}

impl Tracks {
    pub(super) fn tracks(&self) -> impl Iterator<Item = Track> + '_ {
        self.bodies.iter().map(Body::track)
    }

    /// How many bodies were found in the last picture.
    pub(super) fn found(&self) -> usize {
        self.clusters.len()
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
        let of_corner = CORNER * CORNER * variance;
        self.bodies.retain(|body| (t - body.last).abs() <= *memory);
        let own = |body: &&mut Body| body.camera == camera;
        self.bodies.iter_mut().filter(own).for_each(|body| body.predict(t, *acceleration));
        let mut velocities = vec![Vector::<3>::zeros(); self.clusters.len()];
        let mut is_taken = vec![false; self.bodies.len()];
        let mut left: Vec<usize> =
            (0..self.clusters.len()).filter(|k| self.clusters[*k].cells >= LEAST).collect();
        // The largest first, as many as there can be.
        for _ in 0..MAX_TRACKS {
            let largest = (0..left.len()).max_by_key(|i| self.clusters[left[*i]].points);
            let Some(k) = largest.map(|i| left.swap_remove(i)) else { break };
            let Cluster { sum, corners, is_cut, points, .. } = self.clusters[k];
            let seen = sum / f64::from(points);
            let off = |i: &usize| {
                let Estimate { position, covariance, .. } = &self.bodies[*i].mean;
                let expected = covariance[0] + variance;
                [(seen - position).norm_squared() / expected, expected]
            };
            // By how likely it is: what was not seen for long may be anywhere, but is hardly just here.
            let unlikely = |i: &usize| {
                let [square, expected] = off(i);
                square + 3.0 * expected.ln()
            };
            let is_free = |i: &usize| !is_taken[*i] && self.bodies[*i].camera == camera;
            let nearest = (0..self.bodies.len())
                .filter(is_free)
                .filter(|i| off(i)[0] < GATE * GATE)
                .min_by(|i, j| unlikely(i).total_cmp(&unlikely(j)));
            let place = match nearest {
                Some(place) => place,
                None if self.bodies.len() == MAX_TRACKS => continue,
                None => {
                    self.bodies.push(Body {
                        number: self.count,
                        camera,
                        time: t,
                        last: t,
                        seen: 0,
                        points: 0,
                        is_cut,
                        mean: Estimate::new(seen, variance, settings.speed),
                        corners: corners.map(|at| Estimate::new(at, of_corner, settings.speed)),
                    });
                    is_taken.push(false);
                    self.count += 1;
                    self.bodies.len() - 1
                }
            };
            is_taken[place] = true;
            let body = &mut self.bodies[place];
            if body.seen > 0 {
                body.mean.correct(&seen, variance);
                for (corner, at) in body.corners.iter_mut().zip(&corners) {
                    corner.correct(at, of_corner);
                }
            }
            body.seen += 1;
            body.last = t;
            (body.points, body.is_cut) = (points as usize, is_cut);
            let track = body.track();
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
            let mut cluster = Cluster {
                sum: Vector::zeros(),
                corners: [Vector::repeat(f64::INFINITY), Vector::repeat(f64::NEG_INFINITY)],
                is_cut: false,
                points: 0,
                cells: 0,
            };
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
                let ([low, high], [bottom, top]) = (cluster.corners, &voxel.corners);
                cluster.corners = [low.inf(bottom), high.sup(top)];
                cluster.is_cut |= voxel.is_cut;
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
        let mut track = Estimate::new(Vector::zeros(), 1e-6, 1.0);
        let mut p = nalgebra::Matrix2::new(1e-6, 0.0, 0.0, 1.0);
        let (h, a) = (1.0 / 30.0, 3.0);
        for k in 1..4 {
            let t = h * f64::from(k);
            track.predict(h, a);
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
        assert!((track.velocity - velocity).norm() < 0.01);
    }
}
