//! What crosses between the loop and other threads. The loop never waits for them, and they wait no longer than the loop takes to
//! copy a row.

use super::reference::Reference;
use crate::control::LeftOut;
use crate::control::output::Phase;
use crate::runtime::controller::{AnyController, SuccessionError, Surroundings, Target};
use crate::runtime::obstacles::AnyObstacles;
use crate::runtime::points::{PointUpdate, PointsError, make};
use crate::scenario::{Problem, ScenarioError};
use crate::world::space::Points;
use std::fmt;
use std::mem::{replace, swap, take};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What a reference is made of is within this of 0 \[m, rad, …\]: carried on, it stays a number.
const FARTHEST: f64 = 1e9;

/// Rows that the loop keeps while nobody takes them.
pub(super) const ROWS: usize = 4096;

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A row of numbers: the names of its columns, and how many numbers each has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout(pub Vec<(&'static str, usize)>);

impl Layout {
    /// Numbers of a row.
    pub fn width(&self) -> usize {
        self.0.iter().map(|(_, width)| width).sum()
    }

    /// The numbers of each column of one row.
    pub fn columns<'a>(
        &'a self,
        row: &'a [f64],
    ) -> impl Iterator<Item = (&'static str, &'a [f64])> {
        self.0.iter().scan(row, |rest, (name, width)| {
            let (column, others) = rest.split_at(*width);
            *rest = others;
            Some((*name, column))
        })
    }
}

/// Where an obstacle has been seen, and how it moves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    pub obstacle: usize,
    pub position: [f64; 3],
    pub velocity: [f64; 3],
}

/// What the loop is to take over. It exchanges what it has for what is here, so that others free it.
#[derive(Default)]
pub(super) struct Inbox {
    pub target: Option<Reference>,
    /// With the time of the drive at which their motions begin \[s\], now if it is not said.
    pub surroundings: Option<(Surroundings, Option<f64>)>,
    /// Points for clouds.
    pub points: Vec<(usize, Points)>,
    pub sightings: Vec<Sighting>,
    /// A law that is to take the place of the one in use, within so long \[s\]. It stays here until the last has done so.
    pub law: Option<(AnyController, f64)>,
    /// What is of another tip than that of the law in use.
    pub of_other_tip: OfOtherTip,
    /// What they took the place of, for others to free.
    pub old: Old,
}

/// Whether it is of another tip than the one that is led: the law that waits, and the target that was given after it, which waits with
/// it.
#[derive(Debug, Default)]
pub(super) struct OfOtherTip {
    pub law: bool,
    pub target: bool,
}

/// What the loop had before.
#[derive(Default)]
pub(super) struct Old {
    pub target: Option<Reference>,
    pub surroundings: Option<Surroundings>,
    pub points: Vec<(usize, Points)>,
    pub law: Option<AnyController>,
}

/// The last row, for whoever wants it.
struct View {
    places: [Mutex<Vec<f64>>; 2],
    latest: AtomicUsize,
}

/// Rows on their way to a file.
#[derive(Debug, Default)]
pub struct Rows {
    /// One after the other.
    pub values: Vec<f64>,
    /// Rows that were lost because nobody took them in time.
    pub lost: u64,
}

/// What crosses between the loop and other threads.
///
/// # Example
/// ```
/// use vff_core::runtime::drive::{Exchange, Fault, Layout, Loop, Options, Rows, SimulatedRobot};
/// use vff_core::runtime::{AnyController, Target};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let robot = SimulatedRobot::new(&scenario, 1000.0, None)?;
/// let controller = AnyController::from_scenario(&scenario)?;
/// let options = Options { seconds: Some(0.02), record_every: 1, ..Options::default() };
/// let (drive, exchange) = Loop::new(robot, controller, options)?;
/// let loop_ = std::thread::spawn(move || drive.run());
/// exchange.set_target(&Target { x: &[1.1, 0.5], dx: &[0.0; 2], ddx: &[0.0; 2] })?;
/// loop_.join().unwrap();
/// let layout: &Layout = exchange.layout();
/// let Rows { values, lost } = exchange.take_rows();
/// assert_eq!((values.len() % layout.width(), lost), (0, 0));
/// assert!(Fault::Torque.to_string().len() > 0);
/// # Ok(())
/// # }
/// ```
pub struct Exchange {
    pub(super) layout: Layout,
    /// The same controller as the loop's, to try on what is sent to that.
    mirror: Mutex<AnyController>,
    inbox: Mutex<Inbox>,
    news: AtomicBool,
    view: View,
    rows: Mutex<Rows>,
    /// Whether the robot measures the torque from outside.
    pub(super) measures: AtomicBool,
    /// Whether somebody wants the drive to end.
    pub(super) end: AtomicBool,
    phase: Mutex<Phase>,
    pub(super) periods: AtomicU64,
    left_out: [AtomicU64; 5],
}

impl fmt::Debug for Exchange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Exchange").finish_non_exhaustive()
    }
}

impl Exchange {
    /// With room for so many numbers in rows for a file.
    pub(super) fn new(controller: AnyController, layout: Layout, room: usize) -> Self {
        let place = || Mutex::new(vec![f64::NAN; layout.width()]);
        Self {
            mirror: Mutex::new(controller),
            inbox: Mutex::default(),
            news: AtomicBool::new(false),
            view: View { places: [place(), place()], latest: AtomicUsize::new(0) },
            rows: Mutex::new(Rows { values: Vec::with_capacity(room), lost: 0 }),
            measures: AtomicBool::new(true), // as long as nobody has asked it
            end: AtomicBool::new(false),
            phase: Mutex::new(Phase::Starting),
            periods: AtomicU64::new(0),
            left_out: [const { AtomicU64::new(0) }; 5],
            layout,
        }
    }

    /// Sends something to the loop, and frees what it had before.
    fn send(&self, put: impl FnOnce(&mut Inbox)) {
        let mut inbox = lock(&self.inbox);
        put(&mut inbox);
        let old = take(&mut inbox.old);
        self.news.store(true, Ordering::Release);
        drop(inbox);
        drop(old);
    }

    /// The reference from now on: pose, velocity and acceleration, of as many numbers as [`widths`](crate::runtime::ErasedController::widths) says.
    ///
    /// # Errors
    /// If they are no reference.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn set_target(&self, target: &Target<'_>) -> Result<(), ScenarioError> {
        let fault = |text: String| ScenarioError::new("x_ref", Problem::Other(text));
        lock(&self.mirror).check(target).map_err(|error| fault(error.to_string()))?;
        let Target { x, dx, ddx } = target;
        if let Some(far) = [*x, *dx, *ddx].concat().into_iter().find(|x| x.abs() > FARTHEST) {
            return Err(fault(format!("must be within {FARTHEST:e}, with its rates, got {far:e}")));
        }
        let mut new = Some(Reference::new(target));
        self.send(|inbox| {
            inbox.of_other_tip.target = inbox.law.is_some() && inbox.of_other_tip.law;
            swap(&mut inbox.target, &mut new);
        });
        Ok(())
    }

    /// Puts other obstacles in place of those that there are. Their motions begin at time `t` of the drive \[s\], or when the loop
    /// takes them over.
    ///
    /// # Errors
    /// If the controller has no room for so many; then nothing has changed.
    ///
    /// # Panics
    /// If the obstacles are not those of the arm's space.
    pub fn surround(&self, obstacles: AnyObstacles, t: Option<f64>) -> Result<(), ScenarioError> {
        let mut mirror = lock(&self.mirror);
        mirror.surround(obstacles)?;
        let mut new = Some((mirror.surroundings(), t));
        let (mut points, mut sightings) = (vec![], vec![]);
        // The mirror stays locked, so that what is meant for the old ones does not come after them.
        self.send(|inbox| {
            swap(&mut inbox.surroundings, &mut new);
            swap(&mut inbox.points, &mut points);
            swap(&mut inbox.sightings, &mut sightings);
        });
        Ok(())
    }

    /// Obstacle `j` is at `position` \[m\] now, and goes on at `velocity` \[m/s\].
    ///
    /// # Errors
    /// If there is none of that number.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn place(&self, j: usize, position: &[f64], velocity: &[f64]) -> Result<(), ScenarioError> {
        let mirror = lock(&self.mirror); // also while it is sent, so that the obstacles stay those
        let (count, dimension) = (mirror.obstacle_count(), mirror.dimension());
        if j >= count {
            let problem = Problem::Other(format!("there is none, only {count} obstacles"));
            return Err(ScenarioError::new(format!("obstacles[{j}]"), problem));
        }
        let wide = |given: &[f64]| {
            let mut wide = [0.0; 3];
            wide[..dimension].copy_from_slice(given);
            wide
        };
        let new = Sighting { obstacle: j, position: wide(position), velocity: wide(velocity) };
        self.send(|inbox| {
            match inbox.sightings.iter_mut().find(|sighting| sighting.obstacle == j) {
                Some(old) => *old = new,
                None => inbox.sightings.push(new),
            }
        });
        Ok(())
    }

    /// Puts other points in place of those of obstacle `j`.
    ///
    /// # Errors
    /// If it is no cloud, there is not one velocity to each point, or the controller has no room for them; then nothing has
    /// changed.
    pub fn update_points(&self, j: usize, update: PointUpdate) -> Result<(), PointsError> {
        let orientation = lock(&self.mirror).orientation_of_points(j)?;
        let made = make(update, orientation)?;
        let mut mirror = lock(&self.mirror);
        mirror.swap_points(j, &mut made.clone())?;
        let mut made = Some(made);
        self.send(|inbox| {
            let new = made.take().into_iter().map(|made| (j, made));
            match inbox.points.iter_mut().find(|(cloud, _)| *cloud == j) {
                Some(old) => new.for_each(|new| made = Some(replace(old, new).1)),
                None => inbox.points.extend(new),
            }
        });
        Ok(())
    }

    /// Lets a law like `like` take the place of the one in use, within `blend` \[s\]: see
    /// [`succeed`](crate::runtime::ErasedController::succeed). If the last one has not taken over yet, it waits for that.
    ///
    /// # Errors
    /// If it is for another kind of arm or task, for other drives, wants to know what the robot does not measure, has no room for the
    /// obstacles or does not see one, or its joints have other limits than set points keep; then nothing has changed.
    pub fn succeed(&self, like: &AnyController, blend: f64) -> Result<(), SuccessionError> {
        let mut mirror = lock(&self.mirror);
        let next = mirror.successor(like)?;
        let [then, now] = [&next, &*mirror].map(|law| law.limits());
        if mirror.sets_points() && (&then.joint, &then.velocity) != (&now.joint, &now.velocity) {
            return Err(SuccessionError::Limits);
        }
        if next.senses() && !self.measures.load(Ordering::Acquire) {
            return Err(SuccessionError::Unmeasured);
        }
        mirror.forget(); // whatever is being left there
        let has_same_tip = mirror.succeed(&mut next.clone(), 0.0)?;
        let mut new = Some((next, blend.max(0.0)));
        self.send(|inbox| {
            // The mirror leads what waits already, which the loop never does where this takes its place.
            let is_waiting = inbox.law.is_some() && inbox.of_other_tip.law;
            inbox.of_other_tip.law = is_waiting || !has_same_tip;
            swap(&mut inbox.law, &mut new);
        });
        Ok(())
    }

    /// Asks the drive to end: by a damped stop.
    pub fn stop(&self) {
        self.end.store(true, Ordering::Release);
    }

    /// What the loop is doing.
    pub fn phase(&self) -> Phase {
        *lock(&self.phase)
    }

    /// Periods so far.
    pub fn periods(&self) -> u64 {
        self.periods.load(Ordering::Relaxed)
    }

    /// What was left out so far, for lack of time or because of a bound: name and count of each.
    pub fn left_out(&self) -> [(&'static str, u64); 5] {
        let mut named = LeftOut::default().named();
        for ((_, count), now) in named.iter_mut().zip(&self.left_out) {
            *count = now.load(Ordering::Relaxed);
        }
        named
    }

    /// Columns of a row.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Copies the last row, NaN before the first.
    ///
    /// # Panics
    /// If the slice has the wrong length.
    pub fn copy_latest(&self, row: &mut [f64]) {
        let View { places, latest } = &self.view;
        loop {
            let first = latest.load(Ordering::Acquire);
            // The loop writes to the other one, but may have come to this one meanwhile.
            for place in [first, 1 - first] {
                if let Ok(place) = places[place].try_lock() {
                    return row.copy_from_slice(&place);
                }
            }
            std::thread::yield_now();
        }
    }

    /// Takes the rows that have come together since the last call.
    pub fn take_rows(&self) -> Rows {
        let mut rows = lock(&self.rows);
        let taken = Rows { values: rows.values.clone(), lost: take(&mut rows.lost) };
        rows.values.clear(); // and keeps its room, for the loop does not allocate
        taken
    }

    // For the loop.

    /// If something was sent, and nobody is just sending, takes it over. Does not wait.
    pub(super) fn receive(&self, take_over: impl FnOnce(&mut Inbox)) {
        if self.news.load(Ordering::Acquire)
            && let Ok(mut inbox) = self.inbox.try_lock()
        {
            self.news.store(false, Ordering::Relaxed);
            take_over(&mut inbox);
            if inbox.law.is_some() {
                self.news.store(true, Ordering::Relaxed);
            }
        }
    }

    /// Shows what it is doing. Does not wait: whoever looks just now sees it later.
    pub(super) fn enter(&self, phase: Phase) {
        if let Ok(mut shown) = self.phase.try_lock() {
            *shown = phase;
        }
    }

    /// Shows what was left out so far.
    pub(super) fn count(&self, left_out: LeftOut) {
        for (shown, (_, count)) in self.left_out.iter().zip(left_out.named()) {
            shown.store(count, Ordering::Relaxed);
        }
    }

    /// Shows a row. Does not wait; a row that somebody looks at is not replaced.
    pub(super) fn show(&self, row: &[f64]) {
        let View { places, latest } = &self.view;
        let free = 1 - latest.load(Ordering::Relaxed);
        if let Ok(mut place) = places[free].try_lock() {
            place.copy_from_slice(row);
            latest.store(free, Ordering::Release);
        }
    }

    /// Hands on the last rows, whether or not those before were taken.
    pub(super) fn append(&self, kept: &mut Rows) {
        let mut rows = lock(&self.rows);
        rows.values.append(&mut kept.values);
        rows.lost += kept.lost;
    }

    /// Hands on the rows that have come together, if the last were taken. Does not wait.
    pub(super) fn hand_on(&self, kept: &mut Rows) {
        if let Ok(mut rows) = self.rows.try_lock()
            && rows.values.is_empty()
        {
            rows.lost += kept.lost;
            kept.lost = 0;
            swap(&mut rows.values, &mut kept.values);
        }
    }
}
