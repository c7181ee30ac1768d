//! What a cycle does in which step, and what it leaves out.

use super::super::fixtures::{Asked, closing, disc, holding, robot};
use super::*;
use crate::control::deadline::Measure;
use crate::control::{Avoidance, Settings, Yielding};
use crate::interrupt;
use crate::robot::PlanarState;
use crate::robot::Robot;
use crate::world::plane::World;
use std::cell::Cell;

fn preview(robot: &PlanarState, settings: &PreviewSettings) -> Preview<PlanarState, 2, 2> {
    let law = Settings { avoidance: Avoidance::Cbf, ..Settings::default() };
    Preview::new(robot, &Gains::new(&law).with_seed(7), settings)
}

fn at(robot: &PlanarState) -> Present<'_, PlanarState> {
    Present { robot, sent: None, unknown: &[] }
}

fn unlimited() -> Budget {
    Budget::of_simulation(None)
}

/// No distance is large enough: candidates are tried as long as there is time.
fn never_satisfied() -> PreviewSettings {
    PreviewSettings { horizon: 2.0, trigger: 2.0, clearance: 9.0, ..PreviewSettings::default() }
}

/// Discs that close in on the second link trigger the search; one that passes does not, nor does one that the law
/// avoids, though a roll-out touches it, nor an empty world. The chosen candidate is free of contact and keeps
/// the speed limits.
#[test]
fn only_contacts_ahead_trigger() {
    let robot = robot();
    let settings = PreviewSettings { horizon: 2.0, trigger: 2.0, ..PreviewSettings::default() };
    let reference = holding(&robot);
    for (obstacles, touched, expected) in [
        (vec![], false, false),
        (vec![disc([1.4, 2.4], [0.0, 0.8])], false, false),
        (vec![disc([1.4, 2.6], [0.0, -0.8])], true, false),
        (vec![disc([1.4, 2.4], [0.0, -0.8]), disc([1.4, -0.6], [0.0, 0.8])], true, true),
    ] {
        let mut world = World::new(obstacles);
        let mut preview = preview(&robot, &settings);
        // The first step does the whole closed-loop rollout, but the next cycle begins after a period, not before.
        for half in 0..6 {
            preview.advance(&at(&robot), &mut world, &|_| reference, &unlimited());
            assert_eq!(preview.is_active(), expected && half >= 2, "{half}: {world:?}");
            preview.elapse(0.5 * settings.period);
        }
        let Preview { best, rollout, .. } = &mut preview;
        let idle = rollout.forecast(&Candidate::idle(4), &world, 0.0, &|_, _| false);
        assert_eq!(idle.distance < 0.0, touched, "{idle:?}");
        if expected {
            let chosen = rollout.forecast(best, &world, 0.0, &|_, _| false);
            assert!(chosen.distance > 0.0, "{chosen:?}");
            let fastest = best.first.iter().chain(&best.then).map(|u| u.abs());
            assert!(fastest.fold(0.0, f64::max) <= Yielding::default().speed);
        }
    }
}

/// However long the control period is: every cycle tries all candidates, and no step does more than its share of
/// the roll-outs. Only the first step, which does not know the period, does the whole closed-loop rollout.
#[test]
fn a_cycle_is_spread_over_its_period() {
    let robot = robot();
    let reference = holding(&robot);
    let settings = never_satisfied();
    let most = (settings.steps + 1) * robot.dof() * 2; // questions of a roll-out
    // 66 roll-outs, two of them at once.
    for (dt, steps, share) in [
        (2.5e-4, 80, 2),
        (1e-3, 20, 4),
        (3e-3, 7, 10),
        (0.015, 2, 50),
        (0.02, 1, 66),
        (0.05, 1, 66),
    ] {
        let mut world = Asked { world: closing(), times: Cell::new(0) };
        let mut preview = preview(&robot, &settings);
        preview.advance(&at(&robot), &mut world, &|_| reference, &unlimited());
        assert_eq!(preview.foreseen, Foreseen::Contact);
        for step in 1..4 * steps {
            let begins = step % steps == 0;
            let before = if begins { 0 } else { preview.tried };
            world.times.set(0);
            preview.elapse(dt);
            preview.advance(&at(&robot), &mut world, &|_| reference, &unlimited());
            assert_eq!(preview.elapsed == 0.0, begins, "{dt}: {step}");
            assert_eq!(preview.is_active(), step >= steps, "{dt}: {step}");
            if step < steps {
                continue;
            }
            let (tried, asked) = (preview.tried - before, world.times.get());
            assert!(tried <= share && asked <= share * most, "{dt}: {tried}, {asked}");
            if (step + 1) % steps == 0 {
                assert_eq!(preview.tried, settings.candidates, "{dt}");
            }
        }
        // Where no time passes, there is nothing to do.
        world.times.set(0);
        preview.advance(&at(&robot), &mut world, &|_| reference, &unlimited());
        assert_eq!(world.times.get(), 0);
    }
}

/// What is asked of each step.
type Check<'a> = dyn FnMut(u32, &Preview<PlanarState, 2, 2>, &World, usize) + 'a;

/// One control step after another of a look-ahead that has so long a cycle \[µs\] by its work: what `check` makes of each, with
/// the work that was done in it, and the look-ahead after all of them.
fn timed(micros: Option<f64>, steps: u32, check: &mut Check<'_>) -> Preview<PlanarState, 2, 2> {
    let robot = robot();
    let reference = holding(&robot);
    let settings = never_satisfied();
    let mut world = closing();
    let mut preview = preview(&robot, &settings);
    let mut budget = Budget::new(Measure::Work, micros);
    for step in 0..steps {
        world.update(1e-3 * f64::from(step));
        budget.begin();
        let before = interrupt::spent();
        preview.advance(&at(&robot), &mut world, &|_| reference, &budget);
        check(step, &preview, &world, interrupt::spent() - before);
        budget.reserve();
        budget.end();
        preview.elapse(1e-3);
    }
    preview
}

/// The work of a control step stays within the deadline and one instant of a roll-out, whatever is due. With less time less
/// is tried, all that was not is counted, and what is followed is never worse than the law as it is.
#[test]
fn a_deadline_is_kept_and_what_it_leaves_out_is_counted() {
    const STEPS: u32 = 400;
    let generous = timed(Some(1e6), STEPS, &mut |_, _, _, _| {});
    let whole = timed(None, STEPS, &mut |_, _, _, _| {});
    assert_eq!((generous.tried, &generous.best.first), (whole.tried, &whole.best.first));
    assert_eq!(generous.left_out(), LeftOut::default());
    assert!(whole.is_active());
    let mut tried = vec![];
    for micros in [0.5, 1.0, 2.0, 4.0] {
        let (mut found, mut before) = (0, 0);
        let mut follows = 0;
        let end = timed(Some(micros), STEPS, &mut |step, preview, world, work| {
            // One step of the closed-loop rollout is the most that is done at once.
            assert!(work < (1000.0 * micros) as usize + 2500, "{micros}: {step}: {work}");
            found += preview.tried.saturating_sub(before);
            before = preview.tried;
            if preview.active && preview.tried > 0 && preview.elapsed < 0.5 {
                follows += 1;
                let Preview { rollout, settings, elapsed, margin, best, .. } = &mut preview.clone();
                let mut price = |candidate: &Candidate| {
                    let found = rollout.forecast(candidate, world, *elapsed, &|_, _| false);
                    cost(settings, *margin, found, share_of(candidate, 1))
                };
                assert!(price(best) <= price(&Candidate::idle(4)) + 1e-6, "{micros}: {step}");
            }
        });
        assert!(end.left_out().cut > 0 && end.left_out().rollouts > 0, "{micros}");
        assert!(follows > 20, "{micros}: {follows}");
        tried.push(found);
    }
    assert!(tried.is_sorted(), "{tried:?}");
    // Without any time nothing is done at all: the law remains as it is.
    let none = timed(Some(0.0), STEPS, &mut |_, preview, _, work| {
        assert!(!preview.is_active() && work == 0);
    });
    assert_eq!(none.left_out().cut, u64::from(STEPS));
}

/// A candidate that nobody has looked at for longer than its horizon is not followed any more.
#[test]
fn what_is_old_is_given_up() {
    let mut left = None;
    let mut preview = timed(None, 100, &mut |_, _, _, _| {});
    assert!(preview.is_active());
    let (robot, mut world) = (robot(), closing());
    let reference = holding(&robot);
    let none = Budget::new(Measure::Work, Some(0.0));
    for step in 0..2100 {
        preview.advance(&at(&robot), &mut world, &|_| reference, &none);
        preview.elapse(1e-3);
        if !preview.is_active() {
            left.get_or_insert(step);
        }
    }
    assert!(left.is_some_and(|step| (1980..=2001).contains(&step)), "{left:?}");
    assert_eq!(preview.best.first, [0.0; 4]);
}

/// A closed-loop rollout takes two cycles, and no step does more than its share; a new one begins at once, as long
/// as a roll-out is hit.
#[test]
fn a_closed_loop_rollout_is_spread_over_two_cycles() {
    let robot = robot();
    let settings = PreviewSettings { horizon: 2.0, trigger: 2.0, ..PreviewSettings::default() };
    let reference = holding(&robot);
    for (dt, steps, share) in [(1e-3, 20, 5), (0.015, 2, 75), (0.05, 1, 200)] {
        // A roll-out touches this disc, the law does not.
        let mut world = World::new(vec![disc([1.4, 2.6], [0.0, -0.8])]);
        let mut preview = preview(&robot, &settings);
        preview.advance(&at(&robot), &mut world, &|_| reference, &unlimited());
        assert_eq!(preview.foreseen, Foreseen::Nothing);
        assert!(!preview.closed_loop.is_running());
        for step in 1..=6 * steps {
            let before = preview.closed_loop.done();
            preview.elapse(dt);
            preview.advance(&at(&robot), &mut world, &|_| reference, &unlimited());
            let done = preview.closed_loop.done();
            let done = if done < before { done } else { done - before };
            assert!(done <= share, "{dt}: {done}");
            if steps == 20 {
                let over = (step + 1) % (2 * steps) == steps;
                assert_eq!(preview.closed_loop.is_running(), step >= steps && !over, "{step}");
            }
        }
        assert_eq!(preview.foreseen, Foreseen::Nothing);
        assert!(preview.closed_loop.done() > 0);
    }
}
