//! Bodies that are seen, and how they move (T184): cells that hang together, followed from picture to picture by a Kalman filter.
//!
//! What is followed is the mean of the points of a body, the direction of one that is long (T197), and where it is cut off at the
//! end of the picture the box around it. The noise of all coordinates is taken for the same, so that one symmetric matrix of
//! 2 × 2 is the covariance of each.

use super::PerceiverSettings;
use super::voxels::{COASTS, VoxelMap};
use crate::math::Vector;
use nalgebra::Matrix3;

/// The most bodies that are followed by each camera.
const MAX_TRACKS: usize = 64;
/// A body has so many cells at least.
const LEAST: usize = 3;
/// What is farther from where a body is expected than so many standard deviations is another one.
const GATE: f64 = 4.0;
/// A velocity of less than so many standard deviations is none.
const SIGNIFICANT: f64 = 2.0;
/// From so many pictures on, one after the other as expected, a velocity is believed.
const BELIEVED: usize = 3;

/// The standard deviation of a corner, by that of a mean: it is a matter of few points.
const CORNER: f64 = 3.0;
/// A body is long if the variance of its points along it is so many times the next one: more than that of two balls that touch.
const LONG: f64 = 9.0;

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
///     angular_velocity: Vector::<3>::zeros(),
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
    /// How fast it turns across its length \[rad/s\] (T197): zero where that is not certain, as of what is not long.
    pub angular_velocity: Vector<3>,
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
    /// Whether it moves for certain: at more than two standard deviations of its velocity, or of that at which it turns.
    pub fn is_moving(&self) -> bool {
        self.goes_on() || self.angular_velocity != Vector::<3>::zeros()
    }

    /// Whether its velocity is certain.
    fn goes_on(&self) -> bool {
        self.seen >= BELIEVED && self.velocity.norm() > SIGNIFICANT * self.covariance[2].sqrt()
    }
}

/// Place and velocity of something, as far as they are known.
#[derive(Debug, Clone)]
struct Estimate {
    position: Vector<3>,
    velocity: Vector<3>,
    /// As of a [`Track`].
    covariance: [f64; 3],
    /// In how many pictures it was where it was expected.
    seen: usize,
}

impl Estimate {
    /// Of something seen for the first time.
    fn new(position: Vector<3>, variance: f64, speed: f64) -> Self {
        Self {
            position,
            velocity: Vector::zeros(),
            covariance: [variance, 0.0, speed * speed],
            seen: 1,
        }
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
        self.seen += 1;
    }

    /// Takes in where it is seen; what is too far off for it has not gone there, but is another place, and begins anew.
    fn follow(&mut self, position: &Vector<3>, variance: f64, speed: f64) {
        let expected = self.covariance[0] + variance;
        if (position - self.position).norm_squared() > GATE * GATE * expected {
            *self = Self::new(*position, variance, speed);
        } else {
            self.correct(position, variance);
        }
    }
}

/// Along what a long body lies, and how fast that turns: a unit vector and its rate (T197).
#[derive(Debug, Clone)]
struct Axis {
    direction: Estimate,
    /// Half of how long it is \[m\].
    half: f64,
}

impl Axis {
    /// Of what is seen of a body for the first time.
    fn new((along, half): (Vector<3>, f64), settings: &PerceiverSettings) -> Self {
        let variance = Self::variance(half, settings);
        Self { direction: Estimate::new(along, variance, settings.speed / half), half }
    }

    /// Of its direction \[rad²\], as an end is known as well as a corner.
    fn variance(half: f64, settings: &PerceiverSettings) -> f64 {
        (CORNER * settings.track_error / half).powi(2)
    }

    /// Turns on for a time \[s\].
    fn predict(&mut self, h: f64, acceleration: f64) {
        let Estimate { position: along, velocity: rate, .. } = self.direction;
        self.direction.predict(h, acceleration / self.half);
        let speed = rate.norm();
        if speed > 0.0 {
            let (sin, cos) = (speed * h).sin_cos();
            self.direction.position = along * cos + rate * (sin / speed);
            self.direction.velocity = rate * cos - along * (speed * sin);
        }
    }

    /// Takes in along what the body is seen to lie; that has no sign.
    fn follow(&mut self, (along, half): (Vector<3>, f64), settings: &PerceiverSettings) {
        let Self { direction, half: known } = self;
        *known = half;
        let along = if along.dot(&direction.position) < 0.0 { -along } else { along };
        direction.follow(&along, Self::variance(half, settings), settings.speed / half);
        direction.position = direction.position.normalize();
        direction.velocity -= direction.position * direction.position.dot(&direction.velocity);
    }

    /// The angular velocity \[rad/s\], zero where it is not certain.
    fn turning(&self) -> Vector<3> {
        let Estimate { position, velocity, covariance, seen } = &self.direction;
        let is_certain = *seen >= BELIEVED && velocity.norm() > SIGNIFICANT * covariance[2].sqrt();
        if is_certain { position.cross(velocity) } else { Vector::zeros() }
    }
}

/// How the points of a body go on.
#[derive(Debug, Clone, Copy, Default)]
struct Twist {
    velocity: Vector<3>,
    turning: Vector<3>,
    about: Vector<3>,
}

impl Twist {
    /// The velocity of a point \[m/s\].
    fn at(&self, point: &Vector<3>) -> Vector<3> {
        self.velocity + self.turning.cross(&(point - self.about))
    }
}

/// A body, with the mean, the direction and the corners of a box around it.
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
    axis: Option<Axis>,
    corners: [Estimate; 2],
}

impl Body {
    /// Of what is seen by a camera at time `t` \[s\] for the first time.
    fn new(
        number: u64,
        camera: usize,
        cluster: &Cluster,
        t: f64,
        settings: &PerceiverSettings,
    ) -> Self {
        let (variance, speed) = (settings.track_error.powi(2), settings.speed);
        let of_corner = CORNER * CORNER * variance;
        Self {
            number,
            camera,
            time: t,
            last: t,
            seen: 1,
            points: cluster.points as usize,
            is_cut: cluster.is_cut,
            mean: Estimate::new(cluster.mean(), variance, speed),
            axis: cluster.length().map(|length| Axis::new(length, settings)),
            corners: cluster.corners.map(|at| Estimate::new(at, of_corner, speed)),
        }
    }

    /// Goes on to a time \[s\].
    fn predict(&mut self, t: f64, acceleration: f64) {
        let h = (t - self.time).max(0.0);
        self.mean.predict(h, acceleration);
        self.corners.iter_mut().for_each(|corner| corner.predict(h, acceleration));
        self.axis.iter_mut().for_each(|axis| axis.predict(h, acceleration));
        self.time = self.time.max(t);
    }

    /// Takes in what is seen of it at time `t` \[s\].
    fn follow(&mut self, cluster: &Cluster, t: f64, settings: &PerceiverSettings) {
        let (variance, speed) = (settings.track_error.powi(2), settings.speed);
        self.mean.correct(&cluster.mean(), variance);
        for (corner, at) in self.corners.iter_mut().zip(&cluster.corners) {
            corner.follow(at, CORNER * CORNER * variance, speed);
        }
        self.axis = cluster.length().map(|length| match self.axis.take() {
            Some(mut axis) => {
                axis.follow(length, settings);
                axis
            }
            None => Axis::new(length, settings),
        });
        self.seen += 1;
        self.last = t;
        (self.points, self.is_cut) = (cluster.points as usize, cluster.is_cut);
    }

    /// Velocity and covariance as its sides have them, which are those of the less certain one.
    fn of_sides(&self) -> (Vector<3>, [f64; 3]) {
        let [low, high] = &self.corners;
        let less_certain = if low.covariance[2] > high.covariance[2] { low } else { high };
        if low.seen.min(high.seen) < BELIEVED {
            return (Vector::zeros(), less_certain.covariance);
        }
        // The faster one up the axis and the faster one down: a side that is cut off stands still where it is, and sides that go
        // apart or together are those of a body of which more or less is seen.
        let faster = |a: f64, b: f64| a.max(b).max(0.0) + a.min(b).min(0.0);
        (low.velocity.zip_map(&high.velocity, faster), less_certain.covariance)
    }

    fn track(&self) -> Track {
        let Self { number, camera, last, seen, points, is_cut, mean, axis, .. } = self;
        let of_mean = (mean.velocity, mean.covariance);
        let (velocity, covariance) = if *is_cut { self.of_sides() } else { of_mean };
        Track {
            number: *number,
            camera: *camera,
            position: mean.position,
            velocity,
            angular_velocity: axis.as_ref().map(Axis::turning).unwrap_or_default(),
            covariance,
            time: *last,
            seen: *seen,
            points: *points,
            is_cut: *is_cut,
        }
    }

    /// How its points go on, as far as that is certain; the mean of them is here \[m\].
    fn twist(&self, about: Vector<3>) -> Twist {
        let track = self.track();
        let velocity = if track.goes_on() { track.velocity } else { Vector::zeros() };
        Twist { velocity, turning: track.angular_velocity, about }
    }
}

/// Cells of one body in the present picture.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    sum: Vector<3>,
    /// The sum of p pᵀ \[m²\].
    outer: Matrix3<f64>,
    corners: [Vector<3>; 2],
    is_cut: bool,
    points: u32,
    cells: usize,
}

impl Cluster {
    fn mean(&self) -> Vector<3> {
        self.sum / f64::from(self.points)
    }

    /// Along what it lies, and half of how long it is \[m\], of what is long and seen to both ends.
    fn length(&self) -> Option<(Vector<3>, f64)> {
        let mean = self.mean();
        let spread = self.outer / f64::from(self.points) - mean * mean.transpose();
        let found = spread.symmetric_eigen();
        let values = &found.eigenvalues;
        let longest = values.imax();
        let next = (0..3).filter(|k| *k != longest).map(|k| values[k]).fold(0.0, f64::max);
        let is_long = !self.is_cut && values[longest] > LONG * next;
        // As of a rod, of which all is seen alike.
        is_long.then(|| (found.eigenvectors.column(longest).into(), (3.0 * values[longest]).sqrt()))
    }
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
    /// Follows nothing any more; what is found later has other numbers.
    pub(super) fn forget(&mut self) {
        self.bodies.clear();
    }

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
        // However short the memory of places is, from picture to picture it has to be the same body.
        let memory = settings.memory.max(COASTS);
        self.bodies.retain(|body| (t - body.last).abs() <= memory);
        let own = |body: &&mut Body| body.camera == camera;
        self.bodies.iter_mut().filter(own).for_each(|body| body.predict(t, settings.acceleration));
        let mut twists = vec![Twist::default(); self.clusters.len()];
        let mut is_taken = vec![false; self.bodies.len()];
        let mut left: Vec<usize> =
            (0..self.clusters.len()).filter(|k| self.clusters[*k].cells >= LEAST).collect();
        // The largest first, as many as there can be.
        for _ in 0..MAX_TRACKS {
            let largest = (0..left.len()).max_by_key(|i| self.clusters[left[*i]].points);
            let Some(k) = largest.map(|i| left.swap_remove(i)) else { break };
            let cluster = self.clusters[k];
            let place = match self.nearest(&cluster.mean(), camera, &is_taken, settings) {
                Some(place) => {
                    self.bodies[place].follow(&cluster, t, settings);
                    place
                }
                None => {
                    let body = Body::new(self.count, camera, &cluster, t, settings);
                    self.count += 1;
                    self.put(body, &mut is_taken)
                }
            };
            is_taken[place] = true;
            twists[k] = self.bodies[place].twist(cluster.mean());
        }
        for voxel in map.voxels_mut().iter_mut().filter(|voxel| voxel.hits > 0) {
            let twist = twists.get(voxel.cluster as usize);
            voxel.velocity = twist.map(|twist| twist.at(&voxel.point)).unwrap_or_default();
            // What another camera has hit in a later picture is told for that time.
            voxel.point += voxel.velocity * (voxel.last - t).min(COASTS);
        }
    }

    /// Which body of a camera is seen here \[m\], of those that are not taken.
    fn nearest(
        &self,
        seen: &Vector<3>,
        camera: usize,
        is_taken: &[bool],
        settings: &PerceiverSettings,
    ) -> Option<usize> {
        let off = |i: &usize| {
            let Estimate { position, covariance, .. } = &self.bodies[*i].mean;
            let expected = covariance[0] + settings.track_error.powi(2);
            [(seen - position).norm_squared() / expected, expected]
        };
        // By how likely it is: what was not seen for long may be anywhere, but is hardly just here.
        let unlikely = |i: &usize| {
            let [square, expected] = off(i);
            square + 3.0 * expected.ln()
        };
        let is_free = |i: &usize| !is_taken[*i] && self.bodies[*i].camera == camera;
        (0..self.bodies.len())
            .filter(is_free)
            .filter(|i| off(i)[0] < GATE * GATE)
            .min_by(|i, j| unlikely(i).total_cmp(&unlikely(j)))
    }

    /// Puts a new body where there is room: where its camera follows as many as it can, in place of the one that was not seen for
    /// the longest.
    fn put(&mut self, body: Body, is_taken: &mut Vec<bool>) -> usize {
        let own = (0..self.bodies.len()).filter(|i| self.bodies[*i].camera == body.camera);
        let is_full = own.clone().count() >= MAX_TRACKS;
        let oldest = own
            .filter(|i| is_full && !is_taken[*i])
            .min_by(|i, j| self.bodies[*i].last.total_cmp(&self.bodies[*j].last));
        if let Some(place) = oldest {
            self.bodies[place] = body;
            return place;
        }
        self.bodies.push(body);
        is_taken.push(false);
        self.bodies.len() - 1
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
                outer: Matrix3::zeros(),
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
                // Not its point, which may be that of a later picture of another camera.
                cluster.sum += voxel.sum;
                cluster.outer += voxel.sum * voxel.sum.transpose() / f64::from(voxel.hits);
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

    /// A rod that turns steadily about any axis across it: how fast is known after a few pictures, and once it has been turned by
    /// hand, not before a few more.
    #[test]
    fn turning_comes_of_directions() {
        let settings = PerceiverSettings::default();
        let across = Vector::<3>::new(0.3, -0.5, 0.8).normalize();
        let along = across.cross(&Vector::x()).normalize();
        let (rate, h) = (2.5, 1.0 / 30.0);
        let at = |angle: f64| (along * angle.cos() + across.cross(&along) * angle.sin(), 0.2);
        let mut axis = Axis::new(at(0.0), &settings);
        for k in 1..40 {
            axis.predict(h, settings.acceleration);
            let (seen, half) = at(rate * h * f64::from(k));
            axis.follow((if k % 2 == 0 { seen } else { -seen }, half), &settings);
            if k >= 5 {
                let off = (axis.turning() - across * rate).norm();
                assert!(off < 0.1, "{k}: {}", axis.turning());
            }
        }
        axis.predict(h, settings.acceleration);
        axis.follow(at(rate * h * 40.0 + 1.0), &settings);
        assert_eq!(axis.turning(), Vector::<3>::zeros());
    }

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
