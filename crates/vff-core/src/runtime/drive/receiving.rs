//! What the loop takes over in a period of what other threads have sent.

use super::driver::Driver;
use super::ending::Fault;
use super::exchange::{Inbox, Sighting};
use super::{Inner, SuccessionError};
use std::mem::swap;

impl Inner {
    /// Takes over what others have sent; a robot whose measurements are wanted from now on is asked for them.
    pub(super) fn receive<D: Driver>(&mut self, time: f64, driver: &mut D) {
        let has_sensed = self.senses;
        let Self { exchange, controller, given, has_target, doubts, seen, senses, .. } = self;
        exchange.receive(|inbox: &mut Inbox| {
            let Inbox { target, surroundings, points, sightings, law, of_other_tip, old } = inbox;
            let waits = of_other_tip.target && law.is_some() && controller.is_succeeding();
            if let Some(new) = target.take_if(|_| !waits) {
                *has_target = true;
                old.target = given.replace((new, time)).map(|(before, _)| before);
            }
            if let Some((mut new, epoch)) = surroundings.take() {
                controller.exchange(&mut new, epoch.unwrap_or(time));
                seen.forget();
                old.surroundings = Some(new);
            }
            if !controller.is_succeeding()
                && let Some((mut next, blend)) = law.take()
            {
                let rests = !*has_target;
                let has_sensed = controller.senses();
                match controller.succeed(&mut next, blend) {
                    // Where nobody has said where the end effector is to be, its other tip stays where it is, too.
                    Ok(false) if rests => {
                        if let Some((reference, since)) = given {
                            reference.rest_at(|pose| controller.write_pose(pose));
                            *since = time;
                        }
                    }
                    done => debug_assert!(done.is_ok(), "{done:?}"), // it was tried on the mirror
                }
                *senses = controller.senses() || has_sensed; // also for the law that is being left
                old.law = Some(next);
            }
            for (j, points) in &mut *points {
                // They were tried on the mirror, which is among the same obstacles.
                seen.add(*j, points.since().map_or(time, |since| since.min(time)));
                let swapped = controller.swap_points(*j, points);
                debug_assert!(swapped.is_ok(), "{swapped:?}");
            }
            if !points.is_empty() {
                swap(points, &mut old.points); // sending has emptied it: what is there once more would be news again
            }
            let dimension = controller.dimension();
            for Sighting { obstacle, position, velocity } in sightings.drain(..) {
                let [position, velocity] = [&position, &velocity].map(|x| &x[..dimension]);
                seen.add(obstacle, time);
                doubts.add(obstacle, time, controller.place(obstacle, time, position, velocity));
            }
        });
        if self.senses && !has_sensed {
            match self.sense(driver) {
                Ok(true) => {}
                // Somebody asked for it before that was known.
                Ok(false) => self.fail(Fault::Begin(SuccessionError::Unmeasured.to_string())),
                Err(fault) => self.fail(fault),
            }
        }
    }
}
