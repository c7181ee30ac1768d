//! What the controller knows by its observer, what it does about it, and how another one takes that over.

use super::ReactiveController;
use crate::control::observer::{Answer, MomentumObserver, Source};
use crate::control::{Gravity, Output};
use crate::math::{Pose, Vector};
use crate::robot::Manipulator;

/// Tips that are no farther apart are the same \[m, rad\].
const SAME_TIP: f64 = 1e-9;

impl<R: Manipulator<D, M>, const D: usize, const M: usize> ReactiveController<R, D, M> {
    /// Lets the observer, if there is one, know what `output` has `sent` \[N·m, N\] in the `elapsed` time \[s\] before the observed
    /// state; None if something else was sent meanwhile. Without an output the torque of the law itself.
    pub fn hear(&mut self, output: Option<&mut Output>, sent: &[f64], elapsed: Option<f64>) {
        let Self { robot, observer, .. } = self;
        let Some(observer) = observer else { return };
        match output {
            Some(output) => output.write_acting(robot, sent, &mut observer.acted),
            None => observer.acted.copy_from_slice(sent),
        }
        self.update_observer(elapsed);
    }

    /// [`hear`](Self::hear) where what `output` wanted has acted, or, without one, the torque of a `law`, or of its own.
    pub fn hear_wanted(&mut self, output: Option<&mut Output>, law: Option<&[f64]>, elapsed: f64) {
        let Some(observer) = &mut self.observer else { return };
        match output {
            Some(output) => output.write_wanted(&self.robot, &mut observer.acted),
            None => observer.acted.copy_from_slice(law.unwrap_or(&self.law.torque.total)),
        }
        self.update_observer(Some(elapsed));
    }

    /// [`hear`](Self::hear) where what moves the joints is no torque, which says nothing of what acts from outside: of that, an observer
    /// knows what is measured alone.
    pub fn hear_of_time(&mut self, elapsed: f64) {
        let given = self.gains.observer.as_ref();
        let is_measured = given.is_some_and(|given| given.source == Source::Measured);
        self.update_observer(is_measured.then_some(elapsed));
    }

    /// Takes in the observed state, to which what has acted has led.
    fn update_observer(&mut self, elapsed: Option<f64>) {
        if let Some(observer) = &mut self.observer {
            observer.update(&self.robot, elapsed);
            self.answer();
        }
    }

    /// What is added because of what the observer knows.
    fn answer(&mut self) {
        let Self { robot, space, gains, observer, force, reaction, .. } = self;
        if let Some(observer) = observer {
            if let (Some(reaction), Some(detector)) = (reaction, observer.detector()) {
                let is_pushed = detector.link().is_some();
                reaction.feel::<D, M>(is_pushed, detector.deviation(), space);
                observer.yield_to_contact(reaction.activity());
            }
            let pressed = force.as_ref().map(|force| force.task_direction(robot));
            observer.reject(robot, space, &gains.touch, pressed.as_ref());
        }
    }

    /// Takes over what another controller of this arm knows by its observer.
    pub fn believe(&mut self, of: &Self) {
        self.believe_by(of, |observer, other, _| observer.believe(other, |_| 0.0));
    }

    /// The same, where `take` says how the observer does so, whose arm is there.
    fn believe_by(
        &mut self,
        of: &Self,
        take: impl FnOnce(&mut MomentumObserver, &MomentumObserver, &R),
    ) {
        if let (Some(observer), Some(other)) = (&mut self.observer, &of.observer) {
            take(observer, other, &self.robot);
            if let (Some(reaction), Some(other)) = (&mut self.reaction, &of.reaction) {
                reaction.believe(other);
            }
            self.answer();
        }
        if let (Some(force), Some(other)) = (&mut self.force, &of.force) {
            force.believe(other);
        }
    }

    /// The same from a controller whose place it takes, where both are at the same state: its observer goes on from there, and so does
    /// a task that is stopped. The arms may carry different things; where they have different tips, what the other task has given
    /// way by is forgotten.
    pub fn take_over(&mut self, of: &Self) {
        let is_ours = self.gains.command.gravity == Gravity::Controller;
        let others = is_ours.then_some(&of.robot);
        self.believe_by(of, |observer, other, robot| observer.go_on(other, robot, others));
        self.law.torque.copy_from(&of.law.torque); // what acts until the next command
        let has_same_tip = self.has_tip_of(of);
        match &mut self.reaction {
            Some(reaction) if !has_same_tip => reaction.forget(),
            _ => self.reference = of.reference, // from where a stopped task counts how far it goes on
        }
        if let (Some(tank), Some(other)) = (&mut self.tank, &of.tank) {
            tank.take_over(other);
        }
    }

    /// Whether it leads the same tip as another controller that is at the same state.
    pub fn has_tip_of(&self, other: &Self) -> bool {
        self.robot.pose().error(&other.robot.pose()).norm() < SAME_TIP
    }

    /// Lets the observer, if there is one that follows this, know what the robot measures of the torque from outside \[N·m, N\],
    /// (n), until the next time.
    pub fn sense(&mut self, measured: &[f64]) {
        if let Some(observer) = &mut self.observer {
            observer.sense(measured);
        }
    }

    /// The wrench at the end effector that this torque is \[N, N·m\], (m): in the rows of J; None without an observer.
    pub fn external_wrench(&self) -> Option<&[f64]> {
        self.observer.as_ref().map(|observer| observer.wrench::<M>())
    }

    /// The link on which a contact is felt, counted from 0, or the number of joints n where none is; None where nothing tells.
    pub fn touched_link(&self) -> Option<usize> {
        let detector = self.observer.as_ref()?.detector()?;
        Some(detector.link().unwrap_or(self.robot.dof()))
    }

    /// What the estimate is beyond what it has been of late \[N·m, N\], (n); None where nothing tells.
    pub fn contact_deviation(&self) -> Option<&[f64]> {
        Some(self.observer.as_ref()?.detector()?.deviation())
    }

    /// What that has to be to be felt \[N·m, N\], (n); None where nothing tells.
    pub fn contact_threshold(&self) -> Option<&[f64]> {
        Some(self.observer.as_ref()?.detector()?.threshold())
    }

    /// By how much the end effector gives way to a push \[m\]; None where it never does.
    pub fn yielded(&self) -> Option<f64> {
        self.reaction.as_ref().map(|reaction| reaction.yielded())
    }

    /// Whether a push has stopped the task; None where none ever does.
    pub fn is_stopped(&self) -> Option<bool> {
        self.reaction.as_ref()?.is_stopped()
    }

    /// The torque that the model does not know, as estimated \[N·m, N\], (n); None without an observer.
    pub fn external_torque(&self) -> Option<&[f64]> {
        self.observer.as_ref().map(|observer| observer.estimate())
    }

    /// Writes what an arm that is being stopped holds beside its own weight \[N·m, N\], (n): the opposite of all of that torque, if
    /// any of it is rejected. What may be friction is part of it: nothing else holds an arm at rest. What the tip presses on is
    /// not: an arm that is stopped presses no more.
    pub fn write_held(&self, out: &mut [f64]) {
        let Self { robot, gains, observer, force, .. } = self;
        let rejects = [gains.touch.task, gains.touch.null_space].contains(&Answer::Reject);
        let Some(observer) = observer.as_ref().filter(|_| rejects) else { return out.fill(0.0) };
        observer.write_resisted(out);
        out.iter_mut().for_each(|out| *out = -*out);
        if let Some(force) = force {
            let u: Vector<M> = force.task_direction(robot);
            let pressed = u.dot(&Vector::<M>::from_fn(|i, _| observer.wrench::<M>()[i]));
            for (i, out) in out.iter_mut().enumerate() {
                *out += robot.jacobian_column::<M>(i).dot(&u) * pressed;
            }
        }
    }
}
