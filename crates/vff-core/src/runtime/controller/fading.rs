//! From one law to another while a loop runs. Until the new one has taken over, the torque is a mean of both, which keeps what both
//! keep: limits of torque and rate, and the distances of barriers.

use crate::control::{Controller, Gravity};
use crate::math::smoothstep;
use crate::robot::Robot;
use crate::simulation::System;
use crate::trajectory::Sample;
use crate::world::CollisionQuery;

/// For how long a law whose tip is another one follows its last reference \[s\]; it comes to rest within as long again.
const PATIENCE: f64 = 0.1;

/// A law that is being left; and before, the room for one.
#[derive(Debug, Clone)]
pub(super) struct Fading<S: System<D, M>, const D: usize, const M: usize> {
    pub(super) controller: Controller<S::State, D, M>,
    /// The arm of the law that comes, for the watch over the loop and for that over its plan.
    pub(super) robots: [S::State; 2],
    /// For how long it has been left, and until when \[s\]; None if it is not.
    times: Option<[f64; 2]>,
    /// Its last reference, if its tip is another one than that of the law that comes.
    last: Option<Sample<S::Pose, M>>,
    /// What its torque has to have beside itself to be one of an arm that carries what the other one carries \[N·m, N\].
    weight: [Vec<f64>; 2],
}

impl<S: System<D, M>, const D: usize, const M: usize> Fading<S, D, M> {
    /// Room for the law that one like `controller` takes the place of.
    pub(super) fn room(controller: &Controller<S::State, D, M>) -> Self {
        let robots = [0; 2].map(|_| controller.robot().clone());
        let weight = [0; 2].map(|_| vec![0.0; controller.robot().dof()]);
        Self { controller: controller.clone(), robots, times: None, last: None, weight }
    }

    /// Begins to leave it for `next`, which is at the same state, within `duration` \[s\], or leaves it at once for 0. Whether both
    /// have the same tip.
    pub(super) fn begin(&mut self, next: &Controller<S::State, D, M>, duration: f64) -> bool {
        let is_same = next.has_tip_of(&self.controller);
        self.last = (!is_same).then(|| *self.controller.reference());
        self.times = (duration > 0.0).then_some([0.0, duration]);
        is_same
    }

    /// Whether some of it is left.
    pub(super) fn is_left(&self) -> bool {
        self.times.is_some()
    }

    /// Forgets it.
    pub(super) fn end(&mut self) {
        self.times = None;
    }

    /// Takes in a state, `elapsed` \[s\] after the last one.
    pub(super) fn observe(
        &mut self,
        [q, dq]: [&[f64]; 2],
        elapsed: f64,
        surroundings: &mut impl CollisionQuery<D>,
    ) {
        let Some([passed, duration]) = &mut self.times else { return };
        *passed += elapsed;
        if *passed >= *duration {
            self.times = None;
            return;
        }
        self.controller.elapse(elapsed);
        self.controller.observe(q, dq, surroundings);
    }

    /// Makes the torque of `next` the mean of both for this reference; `later` is that in so many seconds.
    pub(super) fn blend_into(
        &mut self,
        next: &mut Controller<S::State, D, M>,
        surroundings: &mut impl CollisionQuery<D>,
        reference: &Sample<S::Pose, M>,
        later: impl Fn(f64) -> Sample<S::Pose, M>,
    ) {
        let Self {
            controller, times: Some([passed, duration]), last, weight: [own, theirs], ..
        } = self
        else {
            return;
        };
        let reference = match last {
            None => {
                controller.look_ahead(surroundings, later);
                *reference
            }
            Some(last) => {
                let coasting = |ahead: f64| last.coasting(*passed + ahead, PATIENCE);
                controller.look_ahead(surroundings, coasting);
                coasting(0.0)
            }
        };
        controller.command(&reference);
        let share = smoothstep(*passed / *duration);
        if controller.gains().command.gravity == Gravity::Robot {
            // The robot adds what it carries by itself, whatever this law believes.
            controller.robot().gravity_torque(own);
            next.robot().gravity_torque(theirs);
            theirs.iter_mut().zip(own).for_each(|(theirs, own)| *theirs -= *own);
        }
        next.blend(controller.torque(), theirs, share);
    }
}
