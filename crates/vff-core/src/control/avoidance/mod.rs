//! What to do where the null space is not enough: a way each in a file, for the end effector to give way.
//!
//! `relaxed` releases the task while an obstacle is near, [`priority`] overrules it along the shortest way out,
//! `cbf` finds the nearest acceleration that keeps every distance, and [`preview`] looks ahead on top of that.
//! All start from the torque of the null-space law. [`barrier`] is the program of `cbf`, which keeps the limits of the
//! drives for all others.

pub mod barrier;
mod cbf;
mod joint_bounds;
mod margins;
mod order;
pub mod preview;
pub mod priority;
mod relaxed;

use super::deadline::LeftOut;
use super::{Avoidance, Gains, OperationalSpace, Torque, TorqueRange, VirtualForces, limits};
use crate::math::Vector;
use crate::robot::{Limits, Robot};
use crate::trajectory::{JointSpline, Pace};
use crate::world::{CollisionQuery, Contact};
use barrier::{Barrier, Kept, TaskWeight};
use cbf::Cbf;
use priority::Priority;
use relaxed::Relaxed;

/// What a way of giving way acts on: the arm at the observed state, and what is known of it.
#[derive(Debug)]
pub(crate) struct Situation<'a, R: Robot<D>, const D: usize, const M: usize> {
    /// The arm.
    pub robot: &'a R,
    /// Λ, J# and N.
    pub space: &'a OperationalSpace<M>,
    /// What the field does.
    pub forces: &'a VirtualForces<R::Wrench, D>,
    /// C q̇ + g, less the external torque that is known \[N·m, N\].
    pub bias: &'a [f64],
    /// What the drives accept next, behind a limit of the torque rate.
    pub range: Option<&'a TorqueRange>,
    /// Between which the torque of the law may be where there is none \[N·m, N\]; empty without torque limits.
    pub ends: &'a [[f64; 2]],
}

/// A way for the end effector to give way.
trait Way<const D: usize, const M: usize> {
    /// Forgets the pairs and makes room for so many: all may come near later, and nothing must allocate then.
    fn reserve(&mut self, _pairs: usize) {}

    /// Takes in the pairs near `robot`, but not what its tip presses on in the direction `pressed`.
    fn observe<R: Robot<D>>(
        &mut self,
        _robot: &R,
        _surroundings: &mut impl CollisionQuery<D>,
        _pressed: Option<&Vector<D>>,
    ) {
    }

    /// Keeps what the plan that is followed keeps where it is; None without one.
    fn keep(&mut self, _plan: Option<(&JointSpline, &Pace)>) {}

    /// The error that the stiffness of the task is to act on, at these distances of the links \[m\].
    fn pull(&self, _clearance: &[f64], e: Vector<M>) -> Vector<M> {
        e
    }

    /// Changes the torque of the null-space law into one that gives way.
    fn act<R: Robot<D>>(&mut self, situation: &Situation<'_, R, D, M>, torque: &mut Torque);

    /// Changes a torque that is not of the law where that has limits in its program; distances count where it `spares_distances`.
    fn confine<R: Robot<D>>(
        &mut self,
        _situation: &Situation<'_, R, D, M>,
        _spares_distances: bool,
        _torque: &mut Torque,
    ) {
    }

    /// By how much the last command violates what it is to keep at most \[m/s²\]; None if there is no such thing.
    fn slack(&self) -> Option<f64> {
        None
    }

    /// The distances that limits are to spare; None if it has none of its own.
    fn distances(&self) -> Option<&[Contact<D>]> {
        None
    }

    /// The rate at which it keeps those \[1/s\]; None if they are kept as barriers are.
    fn rate(&self) -> Option<f64> {
        None
    }

    /// The program, if it is one.
    fn program(&self) -> Option<&Barrier> {
        None
    }

    /// Forgets what was left out.
    fn forget(&mut self) {}
}

/// The task always wins, as far as the drives let it.
#[derive(Debug, Clone)]
struct TaskWins;

impl<const D: usize, const M: usize> Way<D, M> for TaskWins {
    fn act<R: Robot<D>>(&mut self, _: &Situation<'_, R, D, M>, _: &mut Torque) {}
}

/// The program for ways that are none: it keeps what the drives can do, and spares distances while it does.
#[derive(Debug, Clone)]
struct Limiter<const M: usize> {
    /// W_x (T69).
    weight: TaskWeight<M>,
    barrier: Barrier,
    /// Whether it acts at all times; otherwise where a torque is beyond its limit, or a joint would be too fast or come to a
    /// stop.
    is_judged: bool,
    /// Whether the torque is within its limits before.
    is_fitted: bool,
}

impl<const M: usize> Limiter<M> {
    /// Beside a way that keeps its distances at `rate` \[1/s\], if it has one.
    fn new<R: Robot<D>, const D: usize>(
        gains: &Gains<M>,
        robot: &R,
        rate: Option<f64>,
        is_fitted: bool,
    ) -> Self {
        let is_judged = gains.command.is_judged();
        let mut barrier = Barrier::new(robot, gains);
        if let Some(rate) = rate {
            barrier = barrier.reacting_with(rate);
        }
        Self {
            weight: TaskWeight::new::<D>(&gains.yielding, &gains.metric::<D>()),
            barrier: if is_judged {
                barrier.without_speeds()
            } else {
                barrier.guarding().deferring()
            },
            is_judged,
            is_fitted,
        }
    }

    fn act<R: Robot<D>, const D: usize>(
        &mut self,
        situation: &Situation<'_, R, D, M>,
        pairs: &[Contact<D>],
        torque: &mut Torque,
    ) {
        let Situation { robot, space, bias, range, ends, .. } = *situation;
        if self.is_judged
            || !(self.is_fitted || limits::within(&torque.total, ends))
            || !self.barrier.is_calm(robot, &torque.total, bias)
        {
            let kept = Kept { pairs, own: &[], range, ends };
            self.barrier.act(robot, space, &self.weight.at(robot), kept, bias, torque);
        }
    }
}

#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "there is one of them, behind a pointer")]
enum Ways<const D: usize, const M: usize> {
    TaskWins(TaskWins),
    Relaxed(Relaxed<M>),
    Priority(Priority<D>),
    Cbf(Cbf<D, M>),
}

/// Does the same with every way.
macro_rules! each {
    ($ways:expr, $way:ident => $body:expr) => {
        match $ways {
            Ways::TaskWins($way) => $body,
            Ways::Relaxed($way) => $body,
            Ways::Priority($way) => $body,
            Ways::Cbf($way) => $body,
        }
    };
}

/// What changes the torque of the null-space law: a way of giving way, and what can be sent. Nothing allocates after
/// [`reserve`](Self::reserve).
#[derive(Debug, Clone)]
pub(crate) struct Avoider<const D: usize, const M: usize> {
    way: Ways<D, M>,
    /// Where the way does not know what the drives can do.
    limiter: Option<Limiter<M>>,
}

impl<const D: usize, const M: usize> Avoider<D, M> {
    /// What `gains` ask for on `robot`; nothing if the task always wins, and no joint has a stop or a largest speed.
    pub fn new<R: Robot<D>>(gains: &Gains<M>, robot: &R) -> Option<Box<Self>> {
        let is_judged = gains.command.is_judged();
        let Limits { joint, torque, velocity } = robot.limits();
        let is_guarded = gains.enforce_limits && !(joint.is_empty() && velocity.is_empty());
        let is_limited = is_guarded || gains.enforce_limits && !torque.is_empty();
        let way = match gains.avoidance {
            Avoidance::NullSpace if !(is_guarded || is_judged) => return None,
            Avoidance::NullSpace => Ways::TaskWins(TaskWins),
            Avoidance::Relaxed => Ways::Relaxed(Relaxed::new::<D>(gains)),
            Avoidance::Priority => Ways::Priority(Priority::new(gains, robot)),
            Avoidance::Cbf => Ways::Cbf(Cbf::new(gains, robot)),
        };
        let keeps_limits = matches!(way, Ways::Cbf(_)) || !(is_limited || is_judged);
        let is_fitted = matches!(way, Ways::TaskWins(_)) && gains.enforce_limits;
        let rate = each!(&way, way => Way::<D, M>::rate(way));
        let limiter = (!keeps_limits).then(|| Limiter::new(gains, robot, rate, is_fitted));
        Some(Box::new(Self { way, limiter }))
    }

    /// By how much the last command violates the barriers at most \[m/s²\]; None if there are none.
    pub fn slack(&self) -> Option<f64> {
        each!(&self.way, way => Way::<D, M>::slack(way))
    }

    /// The program of `cbf`, if that is the way.
    #[cfg(test)]
    pub(crate) fn barrier(&self) -> Option<&Barrier> {
        each!(&self.way, way => Way::<D, M>::program(way))
    }

    /// Whether a program acts, be it that of a way or of limits.
    pub fn has_program(&self) -> bool {
        self.limiter.is_some() || self.slack().is_some()
    }

    /// What bounds have left out since the beginning.
    pub fn left_out(&self) -> LeftOut {
        let of_way = each!(&self.way, way => Way::<D, M>::program(way));
        let of_limiter = self.limiter.as_ref().map(|limiter| &limiter.barrier);
        let programs = of_way.into_iter().chain(of_limiter);
        programs.fold(LeftOut::default(), |sum, program| sum.with(program.left_out))
    }

    /// Forgets that.
    pub fn forget(&mut self) {
        each!(&mut self.way, way => Way::<D, M>::forget(way));
        if let Some(limiter) = &mut self.limiter {
            limiter.barrier.left_out = LeftOut::default();
        }
    }

    /// Whether limits of torque and speed are among the constraints of a program at all times.
    pub fn keeps_limits(&self) -> bool {
        self.limiter.as_ref().map_or(self.slack().is_some(), |limiter| limiter.is_judged)
    }

    /// Whether the end effector may give way.
    pub fn yields(&self) -> bool {
        !matches!(self.way, Ways::TaskWins(_))
    }

    /// Forgets the pairs and makes room for so many: all may come near later, and nothing must allocate then.
    pub fn reserve(&mut self, pairs: usize) {
        each!(&mut self.way, way => Way::<D, M>::reserve(way, pairs));
        self.make_room(pairs);
    }

    /// Takes in the pairs near `robot`, but not what its tip presses on in the direction `pressed`, a unit vector.
    pub fn observe<R: Robot<D>>(
        &mut self,
        robot: &R,
        surroundings: &mut impl CollisionQuery<D>,
        pressed: Option<&Vector<D>>,
    ) {
        each!(&mut self.way, way => Way::<D, M>::observe(way, robot, surroundings, pressed));
        self.make_room(robot.body_count() * surroundings.contact_count());
    }

    /// Keeps what the plan that is followed keeps where it is, from now on; without one, what the settings ask for.
    pub fn keep(&mut self, plan: Option<(&JointSpline, &Pace)>) {
        each!(&mut self.way, way => Way::<D, M>::keep(way, plan));
        if let Some(limiter) = &mut self.limiter {
            limiter.barrier.margins.go_to(plan);
        }
    }

    /// What has been cloned has no room any more.
    fn make_room(&mut self, pairs: usize) {
        let distances = each!(&self.way, way => Way::<D, M>::distances(way));
        if let Some(limiter) = &mut self.limiter {
            limiter.barrier.reserve(if distances.is_some() { pairs } else { 0 });
        }
    }

    /// The error that the stiffness of the task is to act on, at these distances of the links \[m\].
    pub fn pull(&self, clearance: &[f64], e: Vector<M>) -> Vector<M> {
        each!(&self.way, way => Way::<D, M>::pull(way, clearance, e))
    }

    /// Changes the torque of the null-space law into one that gives way, and that can be sent: behind a limit of the torque rate
    /// what the drives accept, within the torque limits otherwise.
    pub fn act<R: Robot<D>>(&mut self, situation: &Situation<'_, R, D, M>, torque: &mut Torque) {
        each!(&mut self.way, way => way.act(situation, torque));
        self.limit(situation, true, torque);
    }

    /// Changes a torque that is not of the law so that limits are kept, and distances as the way keeps them where it
    /// `spares_distances`.
    pub fn confine<R: Robot<D>>(
        &mut self,
        situation: &Situation<'_, R, D, M>,
        spares_distances: bool,
        torque: &mut Torque,
    ) {
        each!(&mut self.way, way => way.confine(situation, spares_distances, torque));
        self.limit(situation, spares_distances, torque);
    }

    /// Keeps what the drives can do where the way does not know it.
    fn limit<R: Robot<D>>(
        &mut self,
        situation: &Situation<'_, R, D, M>,
        spares_distances: bool,
        torque: &mut Torque,
    ) {
        if let Some(limiter) = &mut self.limiter {
            let distances = each!(&self.way, way => Way::<D, M>::distances(way));
            let distances = distances.filter(|_| spares_distances);
            limiter.act(situation, distances.unwrap_or_default(), torque);
        }
    }
}
