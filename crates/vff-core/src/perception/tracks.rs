//! Bodies that are seen, and how they move (T184): cells that hang together, followed from picture to picture by a Kalman filter.
//!
//! What is followed is the mean of the points of a body, the direction of one that is long (T197), the middle of one that is round
//! (T205), and where it is cut off at the end of the picture the box around it. The noise of all coordinates is taken for the same, so that one symmetric matrix of
//! 2 × 2 is the covariance of each.

use super::PerceiverSettings;
use super::estimate::{BELIEVED, Estimate, GATE, SIGNIFICANT};
use super::long::{Axis, CORNER};
use super::round::{Ball, Round};
use super::voxels::{COASTS, Voxel, VoxelMap};
use crate::math::Vector;
use nalgebra::Matrix3;

/// The most bodies that are followed by each camera.
const MAX_TRACKS: usize = 64;
/// A body has so many cells at least.
const LEAST: usize = 3;

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
    ball: Option<Ball>,
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
            ball: None,
            corners: cluster.corners.map(|at| Estimate::new(at, of_corner, speed)),
        }
    }

    /// Goes on to a time \[s\].
    fn predict(&mut self, t: f64, acceleration: f64) {
        let h = (t - self.time).max(0.0);
        self.mean.predict(h, acceleration);
        self.corners.iter_mut().for_each(|corner| corner.predict(h, acceleration));
        self.axis.iter_mut().for_each(|axis| axis.predict(h, acceleration));
        self.ball.iter_mut().for_each(|ball| ball.centre.predict(h, acceleration));
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

    /// Takes in where its cells are that are seen; what is wider than is reckoned with is no ball.
    fn follow_ball(
        &mut self,
        cluster: &Cluster,
        points: &[Vector<3>],
        settings: &PerceiverSettings,
    ) {
        self.ball = match self.ball.take() {
            _ if cluster.width() > settings.hidden => None,
            Some(mut ball) => ball.follow(points, settings).then_some(ball),
            None => Ball::new(points, settings),
        };
    }

    /// Whether its camera saw it in its last picture.
    fn is_seen(&self) -> bool {
        self.last >= self.time
    }

    /// Whether what is seen of it in that picture lies on its ball.
    fn is_seen_round(&self) -> bool {
        self.is_seen() && self.ball().is_some_and(Ball::fits)
    }

    /// The ball that it is for certain.
    fn ball(&self) -> Option<&Ball> {
        self.ball.as_ref().filter(|ball| ball.is_believed())
    }

    /// The ball that it is where that is expected at a time \[s\] for which it is estimated: where nothing of it is seen, it goes on for a
    /// while.
    fn expected(&self, t: f64) -> Option<Round> {
        let ball = self.ball()?;
        let Estimate { position, velocity, .. } = &ball.centre;
        let hidden = t - self.last;
        Some(ball.round(
            self.number,
            position + velocity * (hidden.min(COASTS) - hidden),
            *velocity,
        ))
    }

    /// The ball that it is, at a time \[s\]: goes on for a while where nothing of it is seen.
    fn round(&self, t: f64) -> Option<Round> {
        let ball = self.ball()?;
        let Twist { velocity, .. } = self.twist(Vector::zeros());
        let hidden = t - self.last;
        let seen = ball.centre.position - ball.centre.velocity * (self.time - self.last);
        let now = if hidden < COASTS { velocity } else { Vector::zeros() };
        Some(ball.round(self.number, seen + velocity * hidden.min(COASTS), now))
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
        let Self { number, camera, time, last, seen, points, is_cut, mean, axis, .. } = self;
        let of_mean = (mean.velocity, mean.covariance);
        let of_centre = self.ball().map(|ball| (ball.centre.velocity, ball.centre.covariance));
        let (velocity, covariance) =
            of_centre.unwrap_or_else(|| if *is_cut { self.of_sides() } else { of_mean });
        let axis = axis.as_ref().filter(|_| of_centre.is_none());
        Track {
            number: *number,
            camera: *camera,
            position: mean.position - mean.velocity * (time - last),
            velocity,
            angular_velocity: axis.map(Axis::turning).unwrap_or_default(),
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
    /// Of nothing yet.
    fn new() -> Self {
        Self {
            sum: Vector::zeros(),
            outer: Matrix3::zeros(),
            corners: [Vector::repeat(f64::INFINITY), Vector::repeat(f64::NEG_INFINITY)],
            is_cut: false,
            points: 0,
            cells: 0,
        }
    }

    /// Takes in a cell that is hit: not its point, which may be that of a later picture of another camera.
    fn add(&mut self, voxel: &Voxel) {
        self.sum += voxel.sum;
        self.outer += voxel.sum * voxel.sum.transpose() / f64::from(voxel.hits);
        let ([low, high], [bottom, top]) = (self.corners, &voxel.corners);
        self.corners = [low.inf(bottom), high.sup(top)];
        self.is_cut |= voxel.is_cut;
        self.points += voxel.hits;
        self.cells += 1;
    }

    /// The longest side of the box around it \[m\].
    fn width(&self) -> f64 {
        let [low, high] = self.corners;
        (high - low).max()
    }

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

    /// The balls that bodies are, at a time \[s\].
    pub(super) fn round(&self, t: f64) -> Vec<Round> {
        self.bodies.iter().filter_map(|body| body.round(t)).collect()
    }

    /// A ball is none any more if a third or more of its side that is turned to a camera at `origin` \[m\] is seen through in its picture
    /// at time `t` \[s\]: what goes on being seen there is what it stood on. Asked are the balls of that camera, and those that
    /// another one sees no more: of what it does see, the errors of both calibrations tell which is where.
    pub(super) fn look_through(
        &mut self,
        (camera, origin): (usize, &Vector<3>),
        t: f64,
        is_through: impl Fn(&Vector<3>) -> bool,
    ) {
        let is_asked =
            |body: &&mut Body| body.camera == camera || !body.is_seen() || t - body.last >= COASTS;
        for body in self.bodies.iter_mut().filter(is_asked) {
            let Some(round) = body.round(t) else { continue };
            let (mut through, mut all) = (0, 0);
            for place in round.facing(origin) {
                all += 1;
                through += usize::from(is_through(&place));
            }
            if 3 * through >= all {
                body.ball = None;
            }
        }
    }

    /// Balls that reach at time `t` \[s\] into what the arm has taken up, which is so far away from a place \[m\], are none any more.
    pub(super) fn take_up(&mut self, t: f64, clearance: impl Fn(&Vector<3>) -> f64) {
        for body in &mut self.bodies {
            if body.round(t).is_some_and(|round| round.meets(&clearance)) {
                body.ball = None;
            }
        }
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
        // However short the memory of places is, from picture to picture it has to be the same body.
        let memory = settings.memory.max(COASTS);
        // Another camera's picture may be of a later time.
        self.bodies.retain(|body| t - body.last <= memory);
        let was_hidden: Vec<bool> = self.bodies.iter().map(|body| !body.is_seen()).collect();
        let own = |body: &&mut Body| body.camera == camera;
        self.bodies.iter_mut().filter(own).for_each(|body| body.predict(t, settings.acceleration));
        let expected = self.expect(map, (camera, &was_hidden), t, settings);
        self.find(map, t, settings.settling);
        let mut points = vec![vec![]; self.clusters.len()];
        for voxel in map.voxels().iter().filter(|voxel| voxel.hits > 0) {
            let k = voxel.cluster as usize;
            if self.clusters.get(k).is_some_and(|cluster| cluster.width() <= settings.hidden) {
                points[k].push(voxel.seen());
            }
        }
        let mut twists = vec![(Twist::default(), None); self.clusters.len()];
        let mut is_taken = vec![false; self.bodies.len()];
        let mut left: Vec<usize> =
            (0..self.clusters.len()).filter(|k| self.clusters[*k].cells >= LEAST).collect();
        // Those that are where they are expected, and then the largest first, as many as there can be.
        let order = |k: &usize| (*k < expected.len(), self.clusters[*k].points);
        left.sort_by_key(|k| std::cmp::Reverse(order(k)));
        for k in left.into_iter().take(MAX_TRACKS) {
            let cluster = self.clusters[k];
            let known = expected.get(k).copied();
            let place = match known
                .or_else(|| self.nearest(&cluster.mean(), camera, &is_taken, settings))
            {
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
            let body = &mut self.bodies[place];
            body.follow_ball(&cluster, &points[k], settings);
            twists[k] = (body.twist(cluster.mean()), body.ball().map(|_| body.number));
        }
        for voxel in map.voxels_mut().iter_mut().filter(|voxel| voxel.hits > 0) {
            let (twist, round) = twists.get(voxel.cluster as usize).copied().unwrap_or_default();
            (voxel.velocity, voxel.round) = (twist.at(&voxel.point), round);
            // What another camera has hit in a later picture is told for that time.
            voxel.point += voxel.velocity * (voxel.last - t).min(COASTS);
        }
        // What was seen of a ball has gone on with it, wherever no camera looks.
        let own = self.bodies.iter().filter(|body| body.camera == camera);
        let seen: Vec<u64> =
            own.filter(|body| body.is_seen_round()).map(|body| body.number).collect();
        map.drop_where(|voxel| voxel.hits == 0 && voxel.round.is_some_and(|it| seen.contains(&it)));
    }

    /// Begins with the cells that are hit where a ball of a camera is expected, and says which bodies these are, as they are numbered.
    /// Where one is expected that was not seen in the picture before, what stands there is something else, if it was not the ball's.
    #[expect(clippy::cast_possible_truncation, reason = "few")]
    fn expect(
        &mut self,
        map: &mut VoxelMap,
        (camera, was_hidden): (usize, &[bool]),
        t: f64,
        settings: &PerceiverSettings,
    ) -> Vec<usize> {
        let own = |(_, body): &(usize, &Body)| body.camera == camera;
        let (places, balls): (Vec<_>, Vec<_>) = (self.bodies.iter().enumerate().filter(own))
            .filter_map(|(place, body)| Some((place, (body.expected(t)?, was_hidden[place]))))
            .unzip();
        self.clusters.clear();
        self.clusters.resize(places.len(), Cluster::new());
        for voxel in map.voxels_mut().iter_mut().filter(|voxel| voxel.hits > 0) {
            let point = voxel.seen();
            let stands = t - voxel.since > settings.settling;
            let on = |(k, (ball, was_hidden)): (usize, &(Round, bool))| {
                let is_else = *was_hidden && stands && voxel.round != Some(ball.number);
                Some((k, ball.distance_on(&point, settings.voxel).filter(|_| !is_else)?))
            };
            let found = balls.iter().enumerate().filter_map(on);
            if let Some((k, _)) = found.min_by(|a, b| a.1.total_cmp(&b.1)) {
                voxel.cluster = k as u32;
                self.clusters[k].add(voxel);
            }
        }
        places
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

    /// Numbers the cells that hang together, of those that were hit and are not taken for long: what stands is not beside them. Not
    /// those that are numbered already.
    #[expect(clippy::cast_possible_truncation, reason = "few")]
    fn find(&mut self, map: &mut VoxelMap, t: f64, settling: f64) {
        let stands = |map: &VoxelMap, place: usize| {
            let voxel = &map.voxels()[place];
            t - voxel.since > settling
        };
        for start in 0..map.voxels().len() {
            let number = self.clusters.len() as u32;
            let mut cluster = Cluster::new();
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
                cluster.add(voxel);
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
mod tests;
