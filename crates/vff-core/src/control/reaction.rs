//! What is done about a push that nobody foresaw (T168–T170): first the null space yields while the task goes on, then the
//! task gives way along the push, then it stops; when the push is over, all of it comes back and goes on.
//!
//! ```text
//! τ_sec ← τ_sec + K_v η,        η̇ = α a (q − q_d − η)
//! ẍ_c ← ẍ_c + K ξ,              ξ̇ = α s u max(uᵀK(e − ξ), 0) / uᵀK u,      f = J#ᵀδ,   u = f / |f|
//! ẋ_r ← (1 − c) ẋ_r,            ξ̇ ← ξ̇ − c ẋ_r
//! ```
//!
//! The springs of posture and task let go of what they hold against the push, so that they only ever lose energy to it. a
//! follows whether there is a contact, s how far |f| is beyond `force`, c whether |f| has been beyond `stop`.

use super::{Gains, OperationalSpace};
use crate::math::{lag_share, smoothstep};
use crate::settings::settings;
use nalgebra::SVector;

settings! {
    /// `[controller.touch.reaction]`.
    #[derive(Copy)]
    pub struct ReactionSettings {
        /// α, how fast springs let go of what they hold against the push.
        rate: f64 = 20.0, "1/s", POSITIVE;
        /// The push on the end effector up to which the task goes on; at twice that it gives way at `rate`.
        force: f64 = 15.0, "N", POSITIVE;
        /// The time constant with which posture and task come back when the push is over.
        recovery: f64 = 1.0, "s", POSITIVE;
        /// The push on the end effector, `force` or more, beyond which the task stops until the push is over. Without it the
        /// task goes on across the push.
        stop: Option<f64> = None, "N", POSITIVE;
    }
}

/// The reaction with its memory. Nothing allocates after construction.
///
/// # Example
/// ```
/// use vff_core::control::reaction::{Reaction, ReactionSettings};
///
/// let reaction = Reaction::new(&ReactionSettings { force: 20.0, ..ReactionSettings::default() }, 7);
/// assert_eq!((reaction.activity(), reaction.yielded()), (0.0, 0.0)); // nobody has pushed
/// ```
#[derive(Debug, Clone)]
pub struct Reaction {
    settings: ReactionSettings,
    /// Whether somebody pushes, and a, the same without a jump.
    is_pushed: bool,
    activity: f64,
    /// The push on the end effector that the estimate tells of \[N\], the rest 0.
    push: SVector<f64, 6>,
    /// η \[rad, m\], (n), and its torque K_v η \[N·m, N\].
    posture: Vec<f64>,
    torque: Vec<f64>,
    /// ξ, of what the task gives way along the push \[m\], the rest 0.
    task: SVector<f64, 6>,
    /// Whether the task is stopped, and c, the same without a jump.
    is_stopped: bool,
    halt: f64,
    /// ξ, of what the reference goes on by meanwhile \[m, rad\].
    missed: SVector<f64, 6>,
}

impl Reaction {
    /// For `n` joints; nobody has pushed.
    pub fn new(settings: &ReactionSettings, n: usize) -> Self {
        Self {
            settings: *settings,
            is_pushed: false,
            activity: 0.0,
            push: SVector::zeros(),
            posture: vec![0.0; n],
            torque: vec![0.0; n],
            task: SVector::zeros(),
            is_stopped: false,
            halt: 0.0,
            missed: SVector::zeros(),
        }
    }

    /// a, in \[0, 1\]: the share of the push that is not resisted by what rejects torques from outside.
    pub fn activity(&self) -> f64 {
        self.activity
    }

    /// By how much the end effector gives way \[m\].
    pub fn yielded(&self) -> f64 {
        self.task.norm()
    }

    /// ξ, by which the task lets go of its reference \[m, rad\], (m).
    pub fn offset<const M: usize>(&self) -> SVector<f64, M> {
        SVector::from_fn(|i, _| self.task[i] + self.missed[i])
    }

    /// Whether the push has stopped the task; None where none ever does.
    pub fn is_stopped(&self) -> Option<bool> {
        self.settings.stop.map(|_| self.is_stopped)
    }

    /// 1 − c, the share of the speed of its reference at which the task goes on.
    pub fn pace(&self) -> f64 {
        1.0 - self.halt
    }

    /// Lets the reference go on, which changes the task error by `change` where the end effector is: a task that is stopped
    /// does not follow.
    pub fn let_go_on<const M: usize>(&mut self, change: &SVector<f64, M>) {
        for (missed, change) in self.missed.iter_mut().zip(change.iter()) {
            *missed += self.halt * change;
        }
    }

    /// η, by how much the posture lets go \[rad, m\], (n).
    pub fn posture(&self) -> &[f64] {
        &self.posture
    }

    /// K_v η, what the posture lets go of \[N·m, N\], (n).
    pub fn torque(&self) -> &[f64] {
        &self.torque
    }

    /// Takes in what the estimate is beyond what it has been \[N·m, N\], (n), while somebody pushes.
    pub fn feel<const D: usize, const M: usize>(
        &mut self,
        is_pushed: bool,
        deviation: &[f64],
        space: &OperationalSpace<M>,
    ) {
        self.is_pushed = is_pushed;
        let push = space.pinv_tr_mul(deviation);
        self.push = SVector::from_fn(|i, _| if i < D { push[i] } else { 0.0 });
    }

    /// Lets `dt` \[s\] pass at the joints `q` and the task error `e`.
    pub fn elapse<const M: usize>(
        &mut self,
        dt: f64,
        gains: &Gains<M>,
        q: &[f64],
        e: &SVector<f64, M>,
    ) {
        let Self { settings, is_pushed, activity, push, posture, torque, task, .. } = self;
        let ReactionSettings { rate, force, recovery, stop } = *settings;
        let share = |rate: f64| lag_share(rate, dt);
        *activity += share(rate) * (f64::from(u8::from(*is_pushed)) - *activity);
        let lets_go = share(rate * *activity);
        let stays = if *is_pushed { 1.0 } else { 1.0 - share((1.0 - *activity) / recovery) };
        for (i, (rest, stiffness)) in gains.posture.iter().enumerate() {
            let eta = &mut posture[i];
            *eta += lets_go * (gains.way(i, *rest, q[i]) - *eta);
            *eta *= stays;
            torque[i] = stiffness * *eta;
        }
        *task *= stays;
        self.missed *= stays;
        let size = push.norm();
        self.is_stopped = *is_pushed && (self.is_stopped || stop.is_some_and(|stop| size > stop));
        let (goal, halts) = if self.is_stopped { (1.0, rate) } else { (0.0, recovery.recip()) };
        self.halt += share(halts) * (goal - self.halt);
        let beyond = smoothstep(size / force - 1.0);
        if *is_pushed && beyond > 0.0 {
            let u = SVector::<f64, M>::from_fn(|i, _| push[i] / size);
            let along = gains.stiffness.component_mul(&u);
            let offset = SVector::<f64, M>::from_fn(|i, _| task[i] + self.missed[i]);
            let pull = along.dot(&(e - offset)).max(0.0);
            let stiffness = along.dot(&u);
            if stiffness > 0.0 {
                let step = share(rate * beyond) * pull / stiffness;
                for i in 0..M {
                    task[i] += step * u[i];
                }
            }
        }
    }

    /// Nobody has pushed.
    pub fn forget(&mut self) {
        (self.is_pushed, self.activity) = (false, 0.0);
        self.push.fill(0.0);
        self.posture.fill(0.0);
        self.torque.fill(0.0);
        self.task.fill(0.0);
        (self.is_stopped, self.halt) = (false, 0.0);
        self.missed.fill(0.0);
    }

    /// Takes over what another one has let go of.
    pub fn believe(&mut self, other: &Self) {
        (self.is_pushed, self.activity) = (other.is_pushed, other.activity);
        (self.push, self.task) = (other.push, other.task);
        (self.is_stopped, self.halt, self.missed) = (other.is_stopped, other.halt, other.missed);
        self.posture.copy_from_slice(&other.posture);
        self.torque.copy_from_slice(&other.torque);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Settings;
    use crate::math::ScalarOrVec;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn gains() -> Gains<3> {
        Gains::new(&Settings {
            stiffness: ScalarOrVec::Each(vec![400.0, 100.0, 25.0]),
            posture: Some(vec![0.1, -0.2, 0.3, 0.0]),
            posture_stiffness: ScalarOrVec::Uniform(3.0),
            ..Settings::default()
        })
    }

    properties! {
        /// While somebody pushes, whatever arm and hand do, what the springs hold is never more than it was: of the posture,
        /// and of the task per mass (T168–T170).
        #[test]
        fn springs_only_lose(
            moves in prop::collection::vec((prop::array::uniform4(-1.0..1.0), prop::array::uniform3(-0.2..0.2)), 1..40),
            pushes in prop::collection::vec(prop::array::uniform3(-60.0..60.0), 40),
            dt in 1e-4..1e-2,
        ) {
            let gains = gains();
            let settings = ReactionSettings { stop: Some(30.0), ..ReactionSettings::default() };
            let mut reaction = Reaction::new(&settings, 4);
            for ((q, e), push) in moves.iter().zip(&pushes) {
                let e = Vector3::from(*e);
                reaction.is_pushed = true;
                reaction.push = SVector::from_fn(|i, _| push.get(i).copied().unwrap_or(0.0));
                let energy = |reaction: &Reaction| {
                    let posture = gains.posture.iter().zip(&reaction.posture).zip(q);
                    let off = e - reaction.offset::<3>();
                    [
                        posture.map(|(((rest, k), eta), q)| k * f64::powi(q - rest - eta, 2)).sum::<f64>(),
                        off.dot(&gains.stiffness.component_mul(&off)),
                    ]
                };
                let before = energy(&reaction);
                reaction.elapse(dt, &gains, q, &e);
                let after = energy(&reaction);
                for k in 0..2 {
                    prop_assert!(after[k] <= before[k] * (1.0 + 1e-12), "{before:?} {after:?}");
                }
            }
        }
    }

    /// A light push is left to the null space; a hard one takes the hand along; when it is over, all is as before.
    #[test]
    fn in_order() {
        let (gains, q) = (gains(), [0.5, 0.0, 0.0, 0.0]);
        let mut reaction = Reaction::new(&ReactionSettings::default(), 4);
        let e = Vector3::new(0.1, 0.0, 0.02);
        let mut pushed = |push: f64, seconds: f64| {
            (reaction.is_pushed, reaction.push[0]) = (push > 0.0, push);
            for _ in 0..(seconds / 1e-3).round() as usize {
                reaction.elapse(1e-3, &gains, &q, &e);
            }
            (reaction.yielded(), reaction.torque()[0])
        };
        assert_eq!(pushed(0.0, 1.0), (0.0, 0.0));
        let (task, posture) = pushed(14.0, 1.0);
        assert!(task == 0.0 && (posture - 3.0 * 0.4).abs() < 1e-6, "{posture}");
        let (task, _) = pushed(40.0, 1.0);
        assert!((task - 0.1).abs() < 1e-6, "along the push alone: {task}");
        let (task, posture) = pushed(0.0, 8.0);
        assert!(task < 1e-3 && posture < 1e-2, "{task} {posture}");
    }

    /// A push beyond `stop` holds the anchor of the spring where it is, however far the reference goes and however weak the push
    /// becomes, until it is over; then the task catches up.
    #[test]
    fn then_it_stops() {
        let (gains, q) = (gains(), [0.1, -0.2, 0.3, 0.0]);
        let settings = ReactionSettings { stop: Some(20.0), ..ReactionSettings::default() };
        let mut reaction = Reaction::new(&settings, 4);
        let mut e = Vector3::zeros();
        let mut pushed = |push: f64, seconds: f64| {
            (reaction.is_pushed, reaction.push[1]) = (push > 0.0, push);
            for _ in 0..(seconds / 1e-3).round() as usize {
                let change = Vector3::new(1e-4, 0.0, 0.0); // the reference goes back by 0.1 m/s
                e += change;
                reaction.let_go_on(&change);
                reaction.elapse(1e-3, &gains, &q, &e);
            }
            (reaction.is_stopped(), reaction.pace(), (e - reaction.offset::<3>()).x)
        };
        let (stops, pace, before) = pushed(0.0, 0.5);
        assert!(stops == Some(false) && pace >= 1.0 && (before - 0.05).abs() < 1e-12, "{before}");
        let (stops, _, before) = pushed(18.0, 0.5);
        assert!(stops == Some(false) && (before - 0.1).abs() < 1e-12, "{before}");
        let (stops, pace, held) = pushed(25.0, 0.5);
        assert!(
            stops == Some(true) && pace < 1e-4 && (held - 0.1 - 0.1 / 20.0).abs() < 1e-4,
            "{held}"
        );
        let (stops, _, later) = pushed(1.0, 1.0);
        assert!(stops == Some(true) && (later - held).abs() < 1e-6, "{later}");
        let (stops, pace, _) = pushed(0.0, 10.0);
        assert!(stops == Some(false) && pace > 0.999, "{pace}");
        assert!(reaction.offset::<3>().norm() < 1e-3);
        assert_eq!(Reaction::new(&ReactionSettings::default(), 4).is_stopped(), None);
    }
}
