//! From pictures of depth cameras to a cloud of points that move: what is there that nobody has said.
//!
//! One call for each picture, beside the control cycle: the arm is where it was when the picture was taken (`history`), what the
//! picture shows of it is cut away (`self_filter`), what is left is remembered in cells until it is seen through (`voxels`), and
//! cells that hang together are followed (`tracks`). Work and memory are bounded by the settings before anything begins.

mod camera;
mod estimate;
mod hidden;
mod history;
mod long;
mod look;
mod round;
mod self_filter;
mod settings;
mod surface;
mod tracks;
mod voxels;

pub use camera::{Depth, DepthCamera};
pub use settings::PerceiverSettings;
pub use surface::surface_distances;
pub use tracks::Track;

use crate::geometry::Body;
use crate::interrupt;
use crate::math::{Capsule, Vector};
use crate::robot::{Model, Robot, SpatialArm, SpatialState};
use crate::settings::readable;
use crate::world::space::{MAX_POINTS, Obstacle, World};
use camera::Camera;
use history::{History, LEAP};
use look::Look;
use round::Round;
use self_filter::SelfFilter;
use std::sync::Arc;
use tracks::Tracks;
use voxels::{Arm, Touched, VoxelMap};

/// The most cells of a room, whatever its size.
pub const MAX_CELLS: usize = 1 << 24;

/// What is wrong with a perceiver, or with a picture.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::perception::{Perceiver, PerceiverSettings, PerceptionError};
/// use vff_core::robot::models;
///
/// let panda = Arc::new(models::named("panda").unwrap().build().unwrap());
/// let blind = Perceiver::new(&panda, vec![], PerceiverSettings::default(), vec![]).unwrap_err();
/// assert_eq!(blind, PerceptionError::NoCamera);
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PerceptionError {
    /// There is no camera.
    #[error("cameras: expected one at least")]
    NoCamera,
    /// A camera is none.
    #[error("cameras[{number}]: {}", readable(problem))]
    Camera {
        /// Which one.
        number: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// A setting is out of its range.
    #[error("settings.{key}: {}", readable(problem))]
    Setting {
        /// Its key.
        key: &'static str,
        /// What is wrong with it.
        problem: String,
    },
    /// Something that is known is of no use.
    #[error("known[{number}]: {}", readable(problem))]
    Known {
        /// Which one.
        number: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// Another arm has another number of joints.
    #[error("arm: expected one with {expected} joints, got {given}")]
    Joints {
        /// How many the first one has.
        expected: usize,
        /// How many this one has.
        given: usize,
    },
    /// There is no such camera.
    #[error("camera: there is no camera {given}, there are {count}")]
    NotThere {
        /// What was asked for.
        given: usize,
        /// How many there are.
        count: usize,
    },
    /// A picture has another size.
    #[error("depth: expected {expected} pixels, as the camera has, got {given}")]
    Size {
        /// How many pixels the camera has.
        expected: usize,
        /// How many were given.
        given: usize,
    },
    /// A state or a picture is no later than the last.
    #[error("t: expected a finite time after the last one ({}), got {given}", last.map_or("none yet".into(), |t| format!("{t} s")))]
    NotLater {
        /// What was given \[s\].
        given: f64,
        /// The time of the last one \[s\].
        last: Option<f64>,
    },
    /// Nobody knows where the arm was.
    #[error(
        "t: no state of the arm is known within {within} s of {given} s; call `observe` more often, and before the picture"
    )]
    NoState {
        /// The time of the picture, on the clock of the states \[s\].
        given: f64,
        /// How far off a state may be \[s\].
        within: f64,
    },
    /// An array of the state has another length, or is not finite.
    #[error("{name}: expected {expected} finite numbers")]
    State {
        /// Which one.
        name: &'static str,
        /// How many joints there are.
        expected: usize,
    },
}

/// What became of the points of a picture.
///
/// # Example
/// ```
/// use vff_core::perception::Counts;
///
/// let Counts { measured, own, left_out, .. } = Counts::default();
/// assert_eq!(measured + own + left_out, 0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Pixels that were looked at and had a depth.
    pub measured: usize,
    /// Of these those that were cut away as the arm.
    pub own: usize,
    /// Of these those that there was no room for.
    pub left_out: usize,
    /// Cells that are remembered, and not seen in this picture.
    pub remembered: usize,
}

/// Makes a cloud of moving points of what depth cameras see around an arm.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::perception::{Depth, DepthCamera, Perceiver, PerceiverSettings};
/// use vff_core::robot::models;
///
/// let panda = Arc::new(models::named("panda").unwrap().build().unwrap());
/// // At a height of 1.5 m, looking down.
/// let camera = DepthCamera {
///     columns: 80,
///     rows: 60,
///     focal: [75.0, 75.0],
///     centre: [39.5, 29.5],
///     distortion: [0.0; 5],
///     position: [0.6, 0.0, 1.5],
///     orientation: [0.0, 1.0, 0.0, 0.0],
/// };
/// let settings = PerceiverSettings { stride: 1, ..PerceiverSettings::default() };
/// let mut perceiver = Perceiver::new(&panda, vec![camera], settings, vec![]).unwrap();
/// perceiver.observe(0.0, &[0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], &[0.0; 7]).unwrap();
/// let depth = [1.0_f32; 80 * 60]; // a board half a metre above the floor
/// let counts = perceiver.see(0, 0.0, Depth::Metres(&depth)).unwrap();
/// assert!(counts.own > 0 && counts.own < counts.measured);
/// assert!(perceiver.points().all(|(point, velocity)| (point.z - 0.5).abs() < 1e-6 && velocity.norm() == 0.0));
/// ```
#[derive(Debug, Clone)]
pub struct Perceiver {
    robot: SpatialState,
    cameras: Vec<Camera>,
    /// When the last picture of each was taken \[s\].
    last: Vec<Option<f64>>,
    settings: PerceiverSettings,
    history: History,
    map: VoxelMap,
    tracks: Tracks,
    /// Those that stand for their cells.
    round: Vec<Round>,
    q: Vec<f64>,
    dq: Vec<f64>,
}

impl Perceiver {
    /// Around an arm, of these cameras, in a room that the settings say.
    ///
    /// # Arguments
    /// * `known`: what stands around and is known, which the cloud does not repeat.
    ///
    /// # Errors
    /// If there is no camera, one is unusable, a setting is out of its range, the arm does not reach into the room, or something that
    /// is known moves. Nothing large is allocated before.
    #[expect(clippy::needless_pass_by_value, reason = "as all that it is made of")]
    pub fn new(
        arm: &Arc<SpatialArm>,
        cameras: Vec<DepthCamera>,
        settings: PerceiverSettings,
        known: Vec<Obstacle>,
    ) -> Result<Self, PerceptionError> {
        let counts = settings.check()?;
        settings.check_reach(arm)?;
        for (number, obstacle) in known.iter().enumerate() {
            let turns = obstacle.angular_velocity.iter().any(|rate| *rate != 0.0);
            if turns || !obstacle.motion.is_static() {
                let problem = "moves, and what is known is left out of the cloud where it stood at first: leave \
                               it out here, so that it is seen"
                    .into();
                return Err(PerceptionError::Known { number, problem });
            }
        }
        if cameras.is_empty() {
            return Err(PerceptionError::NoCamera);
        }
        let cameras: Vec<Camera> = cameras
            .iter()
            .enumerate()
            .map(|(number, model)| Camera::new(model, number))
            .collect::<Result<_, _>>()?;
        let n = arm.dof();
        let low = Vector::from(settings.room[0]);
        let mut map = VoxelMap::new(low, settings.voxel, counts, settings.most_voxels);
        if !known.is_empty() {
            let world = World::new(known);
            let reach = settings.known_margin + map.half_diagonal();
            map.subtract(|middle| {
                interrupt::checkpoint(64 * world.len());
                let point = Capsule {
                    start: *middle,
                    direction: Vector::<3>::x(),
                    length: 0.0,
                    radius: 0.0,
                };
                let mut least = f64::INFINITY;
                world.for_each_pair([Body::new(0, point)], |found| {
                    least = least.min(found.distance);
                });
                least < reach
            });
        }
        Ok(Self {
            robot: Model::state(arm),
            last: vec![None; cameras.len()],
            cameras,
            settings,
            history: History::of(arm),
            map,
            tracks: Tracks::default(),
            round: vec![],
            q: vec![0.0; n],
            dq: vec![0.0; n],
        })
    }

    /// Goes on around another arm, such as the same one with what it has taken up: that is cut away from the next picture on, and
    /// forgotten where it was seen before, which no picture will show to be free. What else is remembered of states and of the cloud
    /// stays.
    ///
    /// # Errors
    /// If it has another number of joints.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use vff_core::perception::{DepthCamera, Perceiver, PerceiverSettings};
    /// use vff_core::robot::models;
    ///
    /// let [panda, other] = ["panda", "ur5e"].map(|it| Arc::new(models::named(it).unwrap().build().unwrap()));
    /// let camera: DepthCamera =
    ///     toml::from_str("columns = 3\nrows = 1\nfocal = [2.0, 2.0]\ncentre = [1.0, 0.0]").unwrap();
    /// let mut perceiver =
    ///     Perceiver::new(&panda, vec![camera], PerceiverSettings::default(), vec![]).unwrap();
    /// assert!(perceiver.set_arm(&panda).is_ok() && perceiver.set_arm(&other).is_err());
    /// ```
    pub fn set_arm(&mut self, arm: &Arc<SpatialArm>) -> Result<(), PerceptionError> {
        let (expected, given) = (self.q.len(), arm.dof());
        if given != expected {
            return Err(PerceptionError::Joints { expected, given });
        }
        self.robot = Model::state(arm);
        self.history.set_arm(arm);
        if let Some(t) = self.history.newest()
            && self.history.at(t, 0.0, &mut self.q, &mut self.dq).is_some()
        {
            self.robot.update(&self.q, &self.dq);
            let taken_up = SelfFilter::of_load(&self.robot, self.settings.margin);
            let clearance = |place: &Vector<3>| taken_up.clearance(place, f64::INFINITY);
            self.map.drop_where(|voxel| clearance(&voxel.at(t)) < 0.0);
            self.tracks.take_up(t, clearance);
        }
        self.cover();
        Ok(())
    }

    /// Begins anew, without a state, a picture or a point: times may begin anew, too.
    pub fn forget(&mut self) {
        self.last.fill(None);
        self.history.forget();
        self.map.forget();
        self.tracks = Tracks::default();
        self.round.clear();
    }

    /// Takes in a state of the arm: angles \[rad, m\] and velocities \[rad/s, m/s\] at time `t` \[s\], (n) each. The last 512 are kept.
    /// One more than a second later than the one before has leapt: up to sixteen of them are dropped by one that goes on where they
    /// leapt from, within a second of it, with what was seen by them; by what has leapt by ten seconds or more no picture is taken in
    /// before there are more.
    ///
    /// # Errors
    /// If it is not later than the last one, has another length, or is not finite.
    pub fn observe(&mut self, t: f64, q: &[f64], dq: &[f64]) -> Result<(), PerceptionError> {
        let expected = self.q.len();
        for (name, given) in [("q", q), ("dq", dq)] {
            if given.len() != expected || !given.iter().all(|x| x.is_finite()) {
                return Err(PerceptionError::State { name, expected });
            }
        }
        if self.history.add(t, q, dq)? {
            self.go_back(t);
        }
        Ok(())
    }

    /// The states have been taken back to time `t` \[s\]: what was seen later was seen then.
    fn go_back(&mut self, t: f64) {
        if self.last().is_some_and(|last| last > t + LEAP) {
            let before = t.next_down(); // a picture at the time of this state is later
            self.last.iter_mut().for_each(|last| *last = last.map(|last| last.min(before)));
            self.map.go_back(t);
            self.tracks.forget();
            self.cover();
        }
    }

    /// Takes in a picture that a camera took at time `t` \[s\], on its own clock.
    ///
    /// # Errors
    /// If there is no such camera, the picture has another size or is not later than the last one of this camera, or where
    /// the arm was then is not known. Then nothing has changed.
    pub fn see(
        &mut self,
        camera: usize,
        t: f64,
        depth: Depth<'_>,
    ) -> Result<Counts, PerceptionError> {
        self.of_picture(camera, &depth)?;
        self.take(camera, t, depth, Some(self.settings.stride))
    }

    /// The points of a picture \[m\] in the frame of its camera, of the pixels that [`see`](Self::see) looks at. Changes nothing.
    ///
    /// # Errors
    /// If there is no such camera, or the picture has another size.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use vff_core::perception::{Depth, DepthCamera, Perceiver, PerceiverSettings};
    /// use vff_core::robot::models;
    ///
    /// let panda = Arc::new(models::named("panda").unwrap().build().unwrap());
    /// let camera: DepthCamera =
    ///     toml::from_str("columns = 3\nrows = 1\nfocal = [2.0, 2.0]\ncentre = [1.0, 0.0]").unwrap();
    /// let settings = PerceiverSettings { stride: 1, ..PerceiverSettings::default() };
    /// let perceiver = Perceiver::new(&panda, vec![camera], settings, vec![]).unwrap();
    /// let points = perceiver.deproject(0, Depth::Millimetres(&[1000, 0, 2000])).unwrap();
    /// assert_eq!(points, [[-0.5, 0.0, 1.0], [1.0, 0.0, 2.0]]);
    /// ```
    pub fn deproject(
        &self,
        camera: usize,
        depth: Depth<'_>,
    ) -> Result<Vec<[f64; 3]>, PerceptionError> {
        let eye = self.of_picture(camera, &depth)?;
        let PerceiverSettings { stride, range, .. } = self.settings;
        let mut points = vec![];
        for row in (0..eye.rows()).step_by(stride) {
            interrupt::checkpoint(eye.columns());
            let pixels =
                (0..eye.columns()).step_by(stride).map(|column| row * eye.columns() + column);
            let measured = pixels.filter_map(|pixel| Some((pixel, depth.metres(pixel)?)));
            let near = measured.filter(|(_, depth)| *depth <= range);
            points.extend(near.map(|(pixel, depth)| <[f64; 3]>::from(eye.deproject(pixel, depth))));
        }
        Ok(points)
    }

    fn eye(&self, camera: usize) -> Result<&Camera, PerceptionError> {
        let count = self.cameras.len();
        self.cameras.get(camera).ok_or(PerceptionError::NotThere { given: camera, count })
    }

    /// The camera that took a picture of this size.
    fn of_picture(&self, camera: usize, depth: &Depth<'_>) -> Result<&Camera, PerceptionError> {
        let eye = self.eye(camera)?;
        let expected = eye.columns() * eye.rows();
        if depth.len() != expected {
            return Err(PerceptionError::Size { expected, given: depth.len() });
        }
        Ok(eye)
    }

    /// The same of a cloud of points \[m\] in the frame of the camera, as far as they are in its picture: of those in one pixel
    /// the nearest.
    ///
    /// # Errors
    /// As of [`see`](Self::see).
    pub fn see_points(
        &mut self,
        camera: usize,
        t: f64,
        points: &[[f64; 3]],
    ) -> Result<Counts, PerceptionError> {
        let eye = self.eye(camera)?;
        interrupt::checkpoint(64 * points.len());
        let picture = eye.picture(points);
        self.take(camera, t, Depth::Metres(&picture), None)
    }

    /// Takes in a picture of a camera that is there, of which every so manieth pixel is looked at: all of them without a number, where
    /// nobody knows how many of them there could be.
    fn take(
        &mut self,
        camera: usize,
        t: f64,
        depth: Depth<'_>,
        stride: Option<usize>,
    ) -> Result<Counts, PerceptionError> {
        let eye = &self.cameras[camera];
        let t = t + self.settings.time_offset;
        let last = self.last[camera];
        if !t.is_finite() || last.is_some_and(|last| t <= last) {
            return Err(PerceptionError::NotLater { given: t, last });
        }
        let within = self.settings.latest_state;
        let Some(missing) = self.history.at(t, within, &mut self.q, &mut self.dq) else {
            return Err(PerceptionError::NoState { given: t, within });
        };
        self.last[camera] = Some(t);
        self.robot.update(&self.q, &self.dq);
        let uncertainty = self.settings.time_error + missing;
        let filter = SelfFilter::new(&self.robot, self.settings.margin, uncertainty);
        let (every, range) = (stride.unwrap_or(1), self.settings.range);
        let mut counts = hit(&mut self.map, eye, &filter, &depth, every, range);
        counts.left_out = self.map.left_out;
        let look = Look::new(eye, &depth, &filter, &self.map, &self.settings);
        let PerceiverSettings { least_points, memory, .. } = self.settings;
        interrupt::checkpoint(64 * self.map.voxels().len());
        #[expect(clippy::cast_precision_loss, reason = "checked to be small")]
        let most = least_points as f64;
        let side = self.settings.voxel;
        // A cell far away is less than so many pixels; half of them are enough of what has slopes and edges.
        let least = |place: &Vector<3>| match stride {
            Some(stride) => most.min(0.5 * eye.pixels_of(place, side, stride)),
            None => most,
        };
        let half = self.map.half_diagonal();
        let is_cut_away = |place: &Vector<3>| filter.clearance(place, half) < half;
        let is_through = |place: &Vector<3>| look.is_through(place);
        self.map.finish(camera, t, least, memory, is_through, is_cut_away);
        self.tracks.update(&mut self.map, camera, t, &self.settings);
        self.tracks.look_through((camera, eye.origin()), t, is_through);
        if self.settings.hidden > 0.0 {
            let (found, widest) = (self.tracks.found(), self.settings.hidden);
            hidden::bound(&mut self.map, found, eye.origin(), widest, is_cut_away);
        }
        self.cover();
        counts.remembered = self.map.voxels().iter().filter(|voxel| voxel.hits == 0).count();
        Ok(counts)
    }

    /// Says which round bodies stand for what is remembered of them: those of which something is, as long as there is room.
    fn cover(&mut self) {
        let (t, radius, side) =
            (self.last().unwrap_or_default(), self.map.half_diagonal(), self.settings.voxel);
        self.round = self.tracks.round(t);
        let voxels = self.map.voxels_mut();
        interrupt::checkpoint(4 * voxels.len() * (1 + self.round.len()));
        let taken = voxels.iter().map(|voxel| 1 + usize::from(voxel.is_deep())).sum();
        let most = self.settings.most_voxels * self.settings.points_of_a_cell();
        let mut room = most.saturating_sub(taken);
        self.round.retain(|round| {
            let is_there = voxels.iter().any(|voxel| round.is_known_by(voxel, t, side));
            let left = room.checked_sub(round.count(radius) as usize).filter(|_| is_there);
            room = left.unwrap_or(room);
            left.is_some()
        });
        for voxel in voxels {
            voxel.is_covered = self.round.iter().any(|round| round.covers(&voxel.at(t), side));
        }
    }

    /// The cloud at the time of the [`last`](Self::last) picture: points \[m\], each with the velocity at which it goes on from
    /// there \[m/s\]. What moved when it was hidden goes on for 0.3 s, and stays where it has come to. Where the settings reckon with what
    /// bodies hide, the points behind them are the last, and those all around bodies that are round.
    pub fn points(&self) -> impl Iterator<Item = (Vector<3>, Vector<3>)> + '_ {
        let (t, radius) = (self.last().unwrap_or_default(), self.map.half_diagonal());
        let voxels = self.map.voxels().iter().filter(|voxel| !voxel.is_covered);
        let seen = voxels.clone().map(move |voxel| (voxel.at(t), voxel.velocity_at(t)));
        let deep = voxels.filter(|voxel| voxel.is_deep());
        let behind = deep.map(move |voxel| (voxel.at(t) + voxel.behind, voxel.velocity_at(t)));
        let around = self
            .round
            .iter()
            .flat_map(move |round| round.points(radius).map(move |point| (point, round.velocity)));
        seen.chain(behind).chain(around)
    }

    /// The bodies that are followed.
    pub fn tracks(&self) -> Vec<Track> {
        self.tracks.tracks().collect()
    }

    /// A radius with which balls at the points cover what is seen \[m\], and to a tenth of it what is round: half the diagonal of a cell.
    pub fn radius(&self) -> f64 {
        self.map.half_diagonal()
    }

    /// When the last picture was taken \[s\], on the clock of the states; none before the first.
    pub fn last(&self) -> Option<f64> {
        self.last.iter().copied().flatten().reduce(f64::max)
    }

    /// How many cameras there are.
    pub fn cameras(&self) -> usize {
        self.cameras.len()
    }

    /// How many pixels a camera has, row by row: rows and columns.
    pub fn size(&self, camera: usize) -> Option<[usize; 2]> {
        self.cameras.get(camera).map(|eye| [eye.rows(), eye.columns()])
    }
}

/// Finds the cells that are hit, without the arm.
fn hit(
    map: &mut VoxelMap,
    eye: &Camera,
    filter: &SelfFilter<'_>,
    depth: &Depth<'_>,
    stride: usize,
    range: f64,
) -> Counts {
    map.begin();
    let mut counts = Counts::default();
    let half = map.half_diagonal();
    let of_cell = |middle: &Vector<3>| match filter.clearance(middle, half) {
        clearance if clearance >= half => Arm::Outside,
        clearance if clearance <= -half => Arm::Inside,
        _ => Arm::Across,
    };
    for row in (0..eye.rows()).step_by(stride) {
        interrupt::checkpoint(16 * eye.columns());
        for column in (0..eye.columns()).step_by(stride) {
            let pixel = row * eye.columns() + column;
            let Some(depth) = depth.metres(pixel).filter(|depth| *depth <= range) else {
                continue;
            };
            counts.measured += 1;
            let point = eye.point(pixel, depth);
            let voxel = match map.touch(&point, of_cell) {
                Touched::Cell(voxel) => voxel,
                Touched::NoRoom => {
                    let is_own = filter.clearance(&point, half) < 0.0;
                    *(if is_own { &mut counts.own } else { &mut map.left_out }) += 1;
                    continue;
                }
                Touched::Nothing => continue,
            };
            let is_own = match voxel.arm {
                Arm::Inside => true,
                Arm::Outside => false,
                Arm::Across => filter.clearance(&point, half) < 0.0,
            };
            if is_own {
                counts.own += 1;
            } else {
                let [down, aside] = [eye.rows() - row, eye.columns() - column];
                let at_the_end = row.min(column) < stride || down.min(aside) <= stride;
                voxel.add(&point, at_the_end);
            }
        }
    }
    counts
}
