use super::*;
use crate::control::TaskKind;
use crate::control::{Avoidance, Projection};
use crate::math::ScalarOrVec;
use crate::math::Vector;
use crate::simulation::{Plane, Run};
use crate::trajectory::GovernorSettings;
use crate::world::plane::World;
use std::sync::atomic::Ordering;
use std::thread;

/// A six-link arm that holds its tip still, a disc above it.
const SCENE: &str = "duration = 1.0\n q0 = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4]\n\
    arm = { lengths = [1, 1, 1, 1, 1, 1], masses = 1 }\n\
    controller = { stiffness = 100, damping = 20, null_damping = 6, \
        field = { kind = 'khatib', gain = 0.5, influence = 0.6, approach_damping = 0.7 } }\n\
    reference = { kind = 'line', end = [5.025, 1.017], duration = 0.5 }\n\
    obstacles = [{ shape = { kind = 'circle', radius = 0.15 }, position = [1.6, 2.9] }]";

fn live() -> Live {
    Live::new(&Scenario::from_toml(SCENE).unwrap()).unwrap()
}

fn world(live: &Live) -> &World {
    let run: &Run<Plane, 2, 2> = live.run.downcast_ref().expect("a position in the plane");
    run.closed_loop().world()
}

fn ticks(live: &mut Live, count: usize) -> f64 {
    (0..count).fold(0.0, |worst: f64, _| {
        live.tick();
        let error = live.snapshot().error.iter().map(|e| e * e).sum::<f64>().sqrt();
        worst.max(error)
    })
}

fn settings(projection: Projection) -> Settings {
    Settings { projection, ..live().scenario.controller }
}

/// Nobody interferes: the same bits as the run of the scenario.
#[test]
fn left_alone_it_is_the_scenario() {
    let mut live = live();
    let mut alone = Scenario::from_toml(SCENE).unwrap().prepare().unwrap().run;
    for _ in 0..500 {
        live.tick();
        assert!(alone.advance(None));
    }
    assert_eq!(live.snapshot().q, alone.snapshot().q);
    assert_eq!(live.snapshot().t.to_bits(), alone.snapshot().t.to_bits());
}

/// A drag through the arm's place, told 20 times a second: the disc moves without a jump in
/// velocity and no faster than half the reach per second, the links keep clear and the tip stays
/// within a micrometre or two; without projection it is pushed off by millimetres.
#[test]
fn a_drag_moves_the_links_and_not_the_tip() {
    for (projection, low, high) in [(Projection::Dynamic, 0.0, 1e-4), (Projection::None, 1e-3, 1.0)]
    {
        let mut live = live();
        live.configure(settings(projection)).unwrap();
        ticks(&mut live, 1000);
        let mut worst: f64 = 0.0;
        let mut last = Vector::<2>::zeros();
        for k in 0..50 {
            live.carry(0, &[1.6, 2.9 - 0.05 * f64::from(k)]).unwrap();
            for _ in 0..50 {
                worst = worst.max(ticks(&mut live, 1));
                let velocity = world(&live).velocity(0);
                assert!(velocity.norm() < 3.0 && (velocity - last).norm() < 0.1);
                last = velocity;
            }
        }
        ticks(&mut live, 1000);
        let place = world(&live).position(0);
        assert!((place - Vector::<2>::new(1.6, 0.45)).norm() < 1e-9);
        assert!(live.min_clearance() > 0.05, "{projection:?}: {}", live.min_clearance());
        assert!(low <= worst && worst < high, "{projection:?}: {worst} m");
    }
}

/// The velocity and acceleration that the world shows are those of the positions that it shows.
#[test]
fn what_is_carried_has_exact_derivatives() {
    let mut live = live();
    live.carry(0, &[0.0, 3.5]).unwrap();
    let h = 1e-3;
    let mut seen = vec![];
    for _ in 0..800 {
        live.tick();
        let world = world(&live);
        seen.push([world.position(0), world.velocity(0), world.acceleration(0)]);
    }
    let scale = |k: i32| 3.0 * CARRY.powi(k + 2) * h * h;
    for three in seen.windows(3) {
        for k in 0..2 {
            let difference = (three[2][k] - three[0][k]) / (2.0 * h);
            let error = (difference - three[1][k + 1]).norm();
            let order = i32::try_from(k).unwrap();
            assert!(error < scale(order), "derivative {}: {error}", k + 1);
        }
    }
}

/// The target goes where it is wanted, and where that is out of reach as near as can be; the tip
/// follows all the way.
#[test]
fn the_target_stays_within_reach() {
    let mut live = live();
    ticks(&mut live, 600);
    live.aim(&[3.0, 2.0]);
    // The law is held for a millisecond: it lags behind by that much, some tenths of a millimetre.
    assert!(ticks(&mut live, 4000) < 2e-3);
    let tip = Vector::<2>::new(live.snapshot().x[0], live.snapshot().x[1]);
    assert!((tip - Vector::<2>::new(3.0, 2.0)).norm() < 1e-6);
    live.aim(&[30.0, 40.0]);
    ticks(&mut live, 6000);
    let x_ref = Vector::from_column_slice(live.snapshot().x_ref);
    assert!((x_ref - Vector::<2>::new(0.6, 0.8) * (6.0 * 0.98)).norm() < 1e-9);
    live.aim(&[0.0, 0.0]);
    ticks(&mut live, 6000);
    assert_eq!(live.state(), &State::Running);
}

/// A reference that waits does not jump when it gets another target, or is told to wait no more.
#[test]
fn a_reference_that_waits_does_not_jump() {
    let mut live = live();
    let waiting = Settings {
        avoidance: Avoidance::Cbf,
        governor: Some(GovernorSettings { floor: 0.0, ..GovernorSettings::default() }),
        ..settings(Projection::Dynamic)
    };
    live.configure(waiting.clone()).unwrap();
    ticks(&mut live, 200);
    live.aim(&[3.0, 2.0]);
    live.carry(0, &[4.0, 1.5]).unwrap();
    ticks(&mut live, 3000);
    let late = |live: &Live| live.snapshot().t - live.snapshot().path_time.unwrap();
    let place = |live: &Live| Vector::<2>::from_column_slice(live.snapshot().x_ref);
    let (delay, before) = (late(&live), place(&live));
    assert!(delay > 0.1, "it had nothing to wait for: {delay}");
    live.aim(&[4.0, 3.0]);
    assert!((place(&live) - before).norm() < 1e-12);
    live.configure(Settings { governor: None, ..waiting }).unwrap();
    assert!((place(&live) - before).norm() < 1e-12);
    ticks(&mut live, 6000);
    assert!(late(&live) >= delay);
    assert!((place(&live) - Vector::<2>::new(4.0, 3.0)).norm() < 1e-3);
}

/// Obstacles come and go, each with its own drag.
#[test]
fn obstacles_come_and_go() {
    let mut live = live();
    let disc = "shape = { kind = 'circle', radius = 0.15 }\nposition = [3.0, 3.0]";
    live.add(&disc.parse().unwrap()).unwrap();
    live.carry(1, &[4.0, 3.0]).unwrap();
    ticks(&mut live, 3000);
    live.remove(0).unwrap();
    assert_eq!(world(&live).len(), 1);
    assert!((world(&live).position(0) - Vector::<2>::new(4.0, 3.0)).norm() < 1e-9);
    live.carry(0, &[4.0, 3.5]).unwrap();
    ticks(&mut live, 3000);
    assert!((world(&live).position(0) - Vector::<2>::new(4.0, 3.5)).norm() < 1e-9);
    let fault = live.carry(1, &[0.0, 0.0]).unwrap_err().to_string();
    assert_eq!(fault, "obstacles[1]: there is none, only 1 obstacles");
    live.remove(0).unwrap();
    ticks(&mut live, 10);
    assert!(live.remove(0).is_err());
    for stands in [false, true] {
        live.pause(stands);
        live.reset().unwrap();
        assert_eq!((world(&live).len(), live.snapshot().t.to_bits()), (1, 0));
        assert_eq!(*live.state() == State::Paused, stands);
        ticks(&mut live, 10);
    }
}

/// A hand that gets no farther than a wall goes around it when somebody wants a plan: from beside, without a jump, and to where the
/// target has been dragged. A reference that never rests leads nowhere.
#[test]
fn a_plan_is_made_when_it_is_wanted() {
    let text = "duration = 1.0\n q0 = [0.9, 0.5, 0.4, 0.3]\n\
        arm = { lengths = [1, 1, 1, 1], masses = 1, radius = 0.05 }\n\
        controller = { stiffness = 100, damping = 20, null_damping = 10, posture = [0.5, 0.5, 0.5, 0.5], \
            posture_stiffness = 20, avoidance = 'cbf' }\n\
        reference = { kind = 'setpoint', point = [0.06, 3.6] }\n\
        obstacles = [{ shape = { kind = 'circle', radius = 0.3 }, position = [1.2, 1.1] }, \
            { shape = { kind = 'circle', radius = 0.3 }, position = [1.5, 0.6] }]";
    let mut live = Live::new(&Scenario::from_toml(text).unwrap()).unwrap();
    live.record(true).unwrap();
    live.aim(&[2.2, -0.4]);
    ticks(&mut live, 6000);
    let off = |live: &Live| {
        let s = live.snapshot();
        (s.x[0] - 2.2).hypot(s.x[1] + 0.4)
    };
    assert!(off(&live) > 0.3, "{}", off(&live));
    assert_eq!((live.last_search(), live.is_recording()), (None, true));
    live.plan().unwrap();
    assert!(!live.is_recording(), "its rows have no plan");
    let begin = Instant::now();
    let mut torque = live.snapshot().torque.total.clone();
    let mut step: f64 = 0.0;
    let mut tick = |live: &mut Live| {
        live.tick();
        for (before, now) in torque.iter_mut().zip(&live.snapshot().torque.total) {
            step = step.max((*before - now).abs());
            *before = *now;
        }
    };
    while live.snapshot().replans.unwrap().taken == 0 && begin.elapsed().as_secs() < 60 {
        tick(&mut live);
        thread::sleep(Duration::from_millis(1));
    }
    (0..20).for_each(|_| tick(&mut live));
    assert!(step < 2.0, "the torque jumps by {step} N·m");
    ticks(&mut live, 20_000);
    assert_eq!(live.last_search(), Some("found"));
    assert!(off(&live) < 5e-3, "{}", off(&live));
    assert!(live.min_clearance() > 5e-3, "{}", live.min_clearance());

    let round = text.replace(
        "kind = 'setpoint', point = [0.06, 3.6]",
        "kind = 'circle', center = [1.5, 2.0], radius = 0.1, angular_velocity = 2.0",
    );
    let fault = Live::new(&Scenario::from_toml(&round).unwrap()).unwrap().plan().unwrap_err();
    assert!(fault.to_string().contains("never comes to rest"), "{fault}");
}

/// A loop that diverges stands still where it was, says so, and runs again after a reset.
#[test]
fn divergence_is_a_state() {
    let mut live = live();
    let wild = Settings {
        stiffness: ScalarOrVec::Uniform(1e9),
        damping: ScalarOrVec::Uniform(1e5),
        ..settings(Projection::Dynamic)
    };
    live.configure(wild).unwrap();
    live.aim(&[3.0, 2.0]);
    ticks(&mut live, 2000);
    assert_eq!(live.state(), &State::Diverged);
    assert!(live.snapshot().q.iter().all(|q| q.is_finite()));
    live.pause(false);
    assert_eq!(live.state(), &State::Diverged);
    live.configure(settings(Projection::Dynamic)).unwrap();
    live.reset().unwrap();
    ticks(&mut live, 100);
    assert_eq!(live.state(), &State::Running);
}

/// What does not fit is refused, and the old settings stay.
#[test]
fn wrong_settings_are_refused() {
    let mut live = live();
    let negative =
        Settings { stiffness: ScalarOrVec::Uniform(-1.0), ..settings(Projection::Dynamic) };
    assert!(live.configure(negative).unwrap_err().path.starts_with("controller.stiffness"));
    let pose = Settings { task: TaskKind::Pose, ..settings(Projection::Dynamic) };
    assert_eq!(live.configure(pose).unwrap_err().path, "controller.task");
    live.reset().unwrap();
    assert_eq!(live.scenario.controller, settings(Projection::Dynamic));
}

/// A row every ten periods, none twice, none lost while somebody takes them; then they are counted.
#[test]
fn rows_are_recorded() {
    let mut live = live();
    live.record(true).unwrap();
    let mut times = vec![];
    for _ in 0..4 {
        for _ in 0..500 {
            live.tick();
            live.stats.periods += 1;
        }
        let (record, dropped) = live.take().unwrap();
        assert_eq!(dropped, 0);
        times.extend(record.unwrap().t);
    }
    assert_eq!(times.len(), 200);
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - 0.01).abs() < 1e-12));
    for _ in 0..(10 * ROWS + 50) {
        live.tick();
        live.stats.periods += 1;
    }
    assert_eq!(live.take().unwrap().1, 5);
    live.record(false).unwrap();
    assert!(live.take().unwrap().0.is_none());
}

/// On its thread it ticks, pauses on demand, and ends; a pause counts no period.
#[test]
fn it_serves() {
    let (live, stop) = (Mutex::new(live()), AtomicBool::new(false));
    thread::scope(|scope| {
        scope.spawn(|| serve(&live, &stop));
        let wait = |condition: &dyn Fn(&Live) -> bool| {
            let start = Instant::now();
            while !condition(&lock(&live)) {
                assert!(start.elapsed() < Duration::from_secs(20));
                thread::sleep(Duration::from_millis(5));
            }
        };
        wait(&|live| live.stats().periods > 700 && live.stats().rate > 0.0);
        lock(&live).pause(true);
        let t = lock(&live).snapshot().t;
        let periods = lock(&live).stats().periods;
        thread::sleep(Duration::from_millis(50));
        assert_eq!(lock(&live).snapshot().t.to_bits(), t.to_bits());
        assert_eq!(lock(&live).stats().periods, periods);
        lock(&live).pause(false);
        wait(&|live| live.snapshot().t > t);
        stop.store(true, Ordering::Relaxed);
    });
    assert!(lock(&live).stats().worst > 0.0);
}

/// A link that is held is pulled to where the hand goes, from where it was taken hold of, and let go of by whoever held it or
/// by a reset.
#[test]
fn a_link_is_pulled_and_let_go() {
    let mut live = live();
    ticks(&mut live, 1500);
    let nobody = |live: &Live| {
        live.pulled().is_none() && live.snapshot().tau_ext.unwrap().iter().all(|tau| *tau == 0.0)
    };
    assert!(nobody(&live));
    let hold = toml::from_str("link = 'link_3'\npoint = [0.5, 0.0]").unwrap();
    live.grab(&hold).unwrap();
    let start = live.pulled().unwrap();
    assert!(start.wrench.force.iter().all(|force| force.abs() < 1e-2), "it pulls already");
    live.pull_by(&[0.0, 0.4]);
    ticks(&mut live, 500);
    let pulled = live.pulled().unwrap();
    assert!((pulled.anchor[1] - start.anchor[1] - 0.4).abs() < 1e-12);
    assert!(pulled.wrench.force[1] > 1.0 && pulled.wrench.point[1] > start.wrench.point[1] + 0.01);
    assert!(live.snapshot().tau_ext.unwrap().iter().any(|tau| tau.abs() > 0.1));
    let unknown = toml::from_str("link = 'elbow'").unwrap();
    assert!(live.grab(&unknown).is_err() && live.pulled().is_some());
    live.let_go().unwrap();
    assert!(nobody(&live));
    live.grab(&hold).unwrap();
    live.reset().unwrap();
    assert!(nobody(&live));
}
