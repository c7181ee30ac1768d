//! What is sent in loops that are watched over, whatever happens to them: every way of giving way, with and without a limit of the
//! torque's rate, on arms of space and of the plane.

use toml::Table;
use vff_core::control::output::Phase;
use vff_core::math::ScalarOrVec;
use vff_core::runtime::{
    AnyArm, AnyController, AnyState, Course, Reading, SetPointLimits, Target, VirtualArm,
};

const H: f64 = 1e-3;
const RATE: f64 = 1000.0;
const WAYS: [&str; 4] = ["null_space", "relaxed", "priority", "cbf"];

/// An arm, where it stands, and a body that comes near to it.
struct Place {
    arm: &'static str,
    q: &'static [f64],
    obstacle: &'static str,
    gravity: &'static str,
    settings: &'static str,
}

const PLACES: [Place; 3] = [
    Place {
        arm: "model = 'panda'",
        q: &[0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
        obstacle: "shape = { kind = 'sphere', radius = 0.1 }\nposition = [0.1, -0.35, 0.62]\n\
                   motion = { kind = 'linear', velocity = [0.0, 0.5, 0.0] }",
        gravity: "robot",
        settings: "stiffness = 900\ndamping = 60\nnull_damping = 12\n\
                   field = { kind = 'bounded', gain = 80, influence = 0.25 }",
    },
    Place {
        arm: "model = 'iiwa14'",
        q: &[0.3, 0.6, 0.0, -1.4, 0.0, 0.9, 0.0],
        obstacle: "shape = { kind = 'sphere', radius = 0.1 }\nposition = [0.2, -0.4, 0.6]\n\
                   motion = { kind = 'linear', velocity = [0.0, 0.6, 0.0] }",
        gravity: "controller",
        settings: "stiffness = 900\ndamping = 60\nnull_damping = 12\n\
                   field = { kind = 'bounded', gain = 80, influence = 0.25 }",
    },
    Place {
        arm: "lengths = [0.5, 0.4, 0.4]\nmasses = [3, 2, 1.5]\nradius = 0.04\ngravity = 9.81\n\
              torque_limits = [90, 60, 30]\nvelocity_limits = 1.5",
        q: &[0.6, -0.9, 0.7],
        obstacle: "shape = { kind = 'circle', radius = 0.1 }\nposition = [0.6, 0.6]\n\
                   motion = { kind = 'linear', velocity = [0.0, -0.8] }",
        gravity: "controller",
        settings: "stiffness = 100\ndamping = 20\nnull_damping = 8\n\
                   field = { kind = 'bounded', gain = 80, influence = 0.25 }",
    },
];

fn table(text: &str) -> Table {
    text.parse().unwrap()
}

/// A robot of which one knows everything, and its controller.
struct Bench {
    controller: AnyController,
    arm: AnyArm,
    state: AnyState,
    q: Vec<f64>,
    dq: Vec<f64>,
    t: f64,
    carries_itself: bool,
    rate: Option<f64>,
    /// What was sent last, where anything was.
    sent: Option<Vec<f64>>,
}

impl Bench {
    fn new(place: &Place, way: &str, command: &str) -> Self {
        let arm = AnyArm::read(&table(place.arm)).unwrap();
        let settings = format!(
            "{}\navoidance = '{way}'\ncommand = {{ gravity = '{}', {command} }}",
            place.settings, place.gravity
        );
        let mut controller = AnyController::new(&arm, &table(&settings)).unwrap();
        controller.add(&table(place.obstacle)).unwrap();
        let (q, dq) = (place.q.to_vec(), vec![0.0; place.q.len()]);
        let rate = command.contains("torque_rate").then_some(RATE);
        Self {
            controller,
            state: arm.at(&q, &dq),
            arm,
            q,
            dq,
            t: 0.0,
            carries_itself: place.gravity == "robot",
            rate,
            sent: None,
        }
    }

    /// What holds the arm still where it is, as it would be sent.
    fn at_rest(&self) -> Vec<f64> {
        match self.carries_itself {
            true => vec![0.0; self.q.len()],
            false => self.state.gravity_torque(),
        }
    }

    /// The speed of the fastest joint, relative to its limit.
    fn ratio(&self) -> f64 {
        let joints = self.dq.iter().zip(&self.arm.limits().velocity);
        joints.fold(0.0, |most: f64, (dq, limit)| most.max(dq.abs() / limit))
    }

    /// A cycle, and what has to be true of it whatever it gets; whether the reading is news is said by `news`.
    fn cycle(&mut self, reading: Option<(f64, &[f64], &[f64])>) -> Phase {
        let reading = reading.map(|(t, q, dq)| Reading { t, q, dq });
        let phase = self.controller.cycle(reading, None).unwrap();
        let sent = self.controller.sent().unwrap().to_vec();
        for (i, (sent, limit)) in sent.iter().zip(&self.arm.limits().torque).enumerate() {
            assert!(sent.is_finite(), "{phase:?} {i}: {sent}");
            assert!(sent.abs() <= limit * (1.0 + 1e-12), "{phase:?} {i}: {sent} of {limit}");
        }
        if let (Some(rate), Some(before)) = (self.rate, &self.sent) {
            for (sent, before) in sent.iter().zip(before) {
                let change = (sent - before).abs();
                assert!(change <= rate * H * (1.0 + 1e-9), "{phase:?}: {before} to {sent}");
            }
        }
        if phase == Phase::Holding
            && let Some(before) = &self.sent
        {
            assert_eq!(&sent, before);
        }
        self.sent = Some(sent);
        phase
    }

    /// One with the true state.
    fn known(&mut self) -> Phase {
        let (q, dq) = (self.q.clone(), self.dq.clone());
        self.cycle(Some((self.t, &q, &dq)))
    }

    /// The robot does what it was sent, for one period.
    fn go_on(&mut self) {
        let mut tau = self.sent.clone().unwrap();
        if self.carries_itself {
            let g = self.state.gravity_torque();
            tau.iter_mut().zip(g).for_each(|(tau, g)| *tau += g);
        }
        // Fast arms need shorter steps.
        let steps = if self.ratio() > 1.0 { 20 } else { 1 };
        let h = H / f64::from(steps);
        for _ in 0..steps {
            let ddq = self.state.forward_dynamics(&tau);
            for ((q, dq), ddq) in self.q.iter_mut().zip(&mut self.dq).zip(ddq) {
                *dq += h * ddq;
                *q += h * *dq;
            }
            self.state.update(&self.q, &self.dq);
        }
        self.t += H;
    }

    /// Somebody throws the arm: five times the speed limit of a joint, in one cycle.
    fn throw(&mut self) {
        let limits = self.arm.limits().velocity.iter().enumerate();
        self.dq = limits.map(|(i, v)| [5.0, 1.5, -1.5][i.min(1 + i % 2)] * v).collect();
        self.state.update(&self.q, &self.dq);
    }

    fn begin(&mut self, measured: Option<&[f64]>) {
        self.controller.begin(H, measured).unwrap();
        self.sent = measured.map(<[f64]>::to_vec);
    }

    /// Other calls with the controller, as somebody may make them between two cycles.
    fn ask(&mut self, k: usize) {
        let n = self.q.len();
        let wild = [3.0, -700.0, 1e200][k % 3];
        let (q, dq) = (vec![wild; n], vec![-wild; n]);
        self.controller.observe(&q, &dq, self.t + 0.3);
        match k % 4 {
            0 | 1 => {
                self.controller.follow();
            }
            2 if wild < 10.0 => {
                self.controller.stable_period(&q, self.t);
            }
            _ => {
                let [x, dx, ddx] = self.controller.widths();
                let (x, dx, ddx) = (vec![0.3; x], vec![0.1; dx], vec![0.0; ddx]);
                let target = Target { x: &x, dx: &dx, ddx: &ddx };
                self.controller.torque(&q, &dq, &target, self.t - 1.0).unwrap();
            }
        }
        drop(self.controller.terms());
    }
}

/// Numbers that look random, in [0, 1).
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// What happens to a loop.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Event {
    Losses(f64),
    FirstMissing,
    ClockSteps,
    WhatIfs,
    Duplicates,
    FastArm,
}

const EVENTS: [Event; 7] = [
    Event::Losses(0.01),
    Event::Losses(0.2),
    Event::FirstMissing,
    Event::ClockSteps,
    Event::WhatIfs,
    Event::Duplicates,
    Event::FastArm,
];

fn run(place: &Place, way: &str, command: &str, event: Event) {
    let mut bench = Bench::new(place, way, command);
    let (rest, mut dice) = (bench.at_rest(), Dice(7));
    bench.begin(Some(&rest));
    let (mut late, mut fast, mut doubted) = (0.0, false, 0);
    for k in 0..400 {
        let mut heard = true;
        match event {
            Event::Losses(share) => heard = dice.roll() >= share,
            Event::FirstMissing => heard = k >= 3,
            Event::ClockSteps if k == 150 => late = 2.0,
            Event::WhatIfs => bench.ask(k),
            Event::FastArm if k == 200 => {
                bench.throw();
            }
            _ => {}
        }
        let given = bench.t - late;
        let (q, dq) = (bench.q.clone(), bench.dq.clone());
        let phase = bench.cycle(heard.then_some((given, &q, &dq)));
        let news = heard && !(event == Event::ClockSteps && k == 150);
        // A law that the rate keeps from braking in time may make an arm fast, too.
        fast = bench.ratio() > 2.0 || fast && bench.ratio() > 1.0;
        let said = format!("{way}, {command}, {event:?}, {k}: {phase:?}");
        if !news {
            assert!(!matches!(phase, Phase::Starting | Phase::Running), "{said}");
        } else if fast {
            // One that is thrown is a wild reading for two cycles.
            let thrown = event == Event::FastArm && k < 202;
            doubted = if phase == Phase::Holding { doubted + 1 } else { 0 };
            assert!(matches!(phase, Phase::Damping | Phase::Holding) && doubted < 3, "{said}");
            assert!(phase == Phase::Holding || !thrown, "{said}");
        } else {
            assert!(matches!(phase, Phase::Starting | Phase::Running), "{said}");
        }
        if event == Event::Duplicates && k % 5 == 4 {
            assert_eq!(bench.cycle(Some((given, &q, &dq))), Phase::Holding);
        }
        bench.go_on();
    }
}

/// Nothing that is sent is beyond a limit or changes too fast, and no phase says what is not.
#[test]
fn whatever_happens() {
    for place in &PLACES {
        for way in WAYS {
            for command in ["blend_time = 0.1", "blend_time = 0.1, torque_rate = 1000.0"] {
                for event in EVENTS {
                    run(place, way, command, event);
                }
            }
        }
    }
}

/// A Panda at rest whose states stop coming is sent what it was sent, whatever else was asked of its controller.
#[test]
fn questions_do_not_move_an_arm() {
    for place in &PLACES {
        let mut bench = Bench::new(place, "null_space", "blend_time = 0.0");
        bench.controller.remove(0);
        bench.begin(None);
        for _ in 0..50 {
            bench.known();
            bench.go_on();
        }
        let rest = bench.at_rest();
        for k in 0..700 {
            bench.ask(k);
            bench.cycle(None);
            let sent = bench.sent.as_ref().unwrap();
            let far = sent.iter().zip(&rest).any(|(sent, rest)| (sent - rest).abs() > 0.02);
            assert!(!far, "{k}: {sent:?} instead of {rest:?}");
        }
    }
}

/// Until the first state what was measured is sent, and the rate counts from there; where nothing is known, nothing is sent.
#[test]
fn the_first_state_is_missing() {
    for place in &PLACES {
        for command in ["blend_time = 0.1", "blend_time = 0.1, torque_rate = 1000.0"] {
            for known in [true, false] {
                let mut bench = Bench::new(place, "cbf", command);
                let measured = known.then(|| bench.at_rest());
                bench.begin(measured.as_deref());
                for _ in 0..3 {
                    assert_eq!(bench.cycle(None), Phase::Holding);
                    // Where nothing is known, nothing is sent.
                    let zero = vec![0.0; bench.q.len()];
                    let expected = measured.as_ref().unwrap_or(&zero);
                    assert_eq!(bench.sent.as_ref().unwrap(), expected);
                    bench.t += H;
                }
                assert_eq!(bench.known(), Phase::Starting);
                if !known && bench.rate.is_none() {
                    let sent = bench.sent.as_ref().unwrap();
                    let rest = bench.at_rest();
                    assert!(sent.iter().zip(&rest).all(|(a, b)| (a - b).abs() < 1e-9));
                }
            }
        }
    }
}

/// A load that the arm has to hold does not sag when the robot's clock is set back, and motions go on where they were.
#[test]
fn a_clock_that_is_set_back() {
    let place = &PLACES[1];
    let mut runs = [0.0, 2.0, -5.0].map(|step| {
        let mut bench = Bench::new(place, "null_space", "blend_time = 0.0");
        bench.begin(None);
        for k in 0..600 {
            let t = bench.t - if k < 300 { 0.0 } else { step };
            let (q, dq) = (bench.q.clone(), bench.dq.clone());
            let phase = bench.cycle(Some((t, &q, &dq)));
            let missing = k == 300 && step > 0.0;
            assert_eq!(phase, if missing { Phase::Holding } else { Phase::Running }, "{k}");
            bench.go_on();
        }
        bench.q
    });
    let [same, back, ahead] = &mut runs;
    for ((same, back), ahead) in same.iter().zip(back).zip(ahead) {
        assert!(
            (same - *back).abs() < 1e-3 && (same - *ahead).abs() < 1e-3,
            "{same} {back} {ahead}"
        );
    }
}

/// However fast an arm is: as long as its states come it is braked where it is, and never released.
#[test]
fn a_fast_arm_is_braked() {
    for place in &PLACES {
        for command in ["blend_time = 0.0", "blend_time = 0.0, torque_rate = 1000.0"] {
            let mut bench = Bench::new(place, "null_space", command);
            bench.controller.remove(0);
            bench.begin(None);
            for _ in 0..20 {
                bench.known();
                bench.go_on();
            }
            bench.throw();
            let energy = bench.state.kinetic_energy();
            let mut seen = vec![];
            for k in 0..1500 {
                let phase = bench.known();
                if seen.last() != Some(&phase) {
                    seen.push(phase);
                }
                bench.go_on();
                let left = bench.state.kinetic_energy() / energy;
                // A rate keeps the torque from following an arm that turns quickly.
                let most = if bench.rate.is_some() { 1.5 } else { 1.02 };
                assert!(left < most, "{k}: {left}, {command}");
            }
            assert!(!seen.contains(&Phase::Released) && seen.contains(&Phase::Damping), "{seen:?}");
            assert_eq!(seen.last(), Some(&Phase::Running), "{seen:?}");
            assert!(bench.state.kinetic_energy() < 1e-2 * energy);
        }
    }
}

/// A single wild reading is not a fast arm, nor is one that does not move as it says.
#[test]
fn a_wild_reading_is_not_a_fast_arm() {
    let mut bench = Bench::new(&PLACES[0], "null_space", "blend_time = 0.0");
    bench.begin(None);
    for _ in 0..20 {
        bench.known();
        bench.go_on();
    }
    let q = bench.q.clone();
    let fast: Vec<_> = bench.arm.limits().velocity.iter().map(|v| 5.0 * v).collect();
    assert_eq!(bench.cycle(Some((bench.t, &q, &fast))), Phase::Holding);
    bench.go_on();
    assert_eq!(bench.known(), Phase::Running);
    for k in 1..20 {
        bench.go_on();
        let q = bench.q.clone();
        let phase = bench.cycle(Some((bench.t, &q, &fast)));
        assert_eq!(phase, if k < 5 { Phase::Holding } else { Phase::Damping }, "{k}");
    }
}

/// A torque that saturates is within the limits as it is sent, and together with the gravity that the robot adds.
#[test]
fn limits_bind_what_is_sent() {
    for place in &PLACES {
        for way in WAYS {
            let mut bench = Bench::new(place, way, "blend_time = 0.0, coulomb_friction = 0.5");
            let (n, widths) = (bench.q.len(), bench.controller.widths());
            let limits = bench.arm.limits().torque.clone();
            let mut saturated = false;
            for k in 0..20 {
                // From where it is, with an acceleration that no arm has.
                let dq = vec![0.1; n];
                bench.controller.observe(&bench.q, &dq, bench.t);
                let mut x = vec![0.0; widths[0]];
                bench.controller.write_pose(&mut x);
                let (still, mut ddx) = (vec![0.0; widths[1]], vec![0.0; widths[2]]);
                ddx[k % widths[2].min(3)] = if k < 10 { 1e4 } else { -1e4 };
                let target = Target { x: &x, dx: &still, ddx: &ddx };
                let tau = bench.controller.torque(&bench.q, &dq, &target, bench.t).unwrap();
                let g = bench.state.gravity_torque();
                for ((tau, limit), g) in tau.iter().zip(&limits).zip(g) {
                    let most = limit * (1.0 + 1e-12);
                    let carried = if bench.carries_itself { g } else { 0.0 };
                    assert!(tau.abs() <= most && (tau + carried).abs() <= most, "{way}: {tau}");
                    saturated |= tau.abs().max((tau + carried).abs()) > 0.9 * limit;
                }
            }
            assert!(saturated || way == "cbf", "{way}");
        }
    }
}

/// An obstacle that is seen inside the arm for some frames does not throw it, one that comes there stays doubted no longer than it
/// needs for the way, and both are said.
#[test]
fn a_phantom_is_doubted() {
    let [far, near] = [[0.1, -0.9, 0.62], [0.1, -0.05, 0.62]];
    let most = |command: &str, until: usize| {
        let mut bench = Bench::new(&PLACES[0], "cbf", command);
        bench.begin(None);
        let (mut fastest, mut doubts, mut last_doubt) = (0.0_f64, 0, 0);
        for k in 0..1200 {
            if k % 33 == 0 {
                let at = if (330..until).contains(&k) { near } else { far };
                let away = bench.controller.place(0, bench.t, &at, &[0.0; 3]);
                if away > 0.0 {
                    (doubts, last_doubt) = (doubts + 1, k);
                }
            }
            bench.known();
            bench.go_on();
            fastest = fastest.max(bench.ratio());
        }
        (fastest, doubts, last_doubt)
    };
    let (thrown, none, _) = most("blend_time = 0.0", 363);
    let (kept, some, _) = most("blend_time = 0.0, obstacle_speed = 2.0", 363);
    assert!(none == 0 && thrown > 0.5, "{thrown} {none}");
    assert!(some >= 1 && kept < 0.1, "{kept} {some}");
    // 0.85 m at 2 m/s, and a frame.
    let (_, some, last) = most("blend_time = 0.0, obstacle_speed = 2.0", 2000);
    assert!(some > 5 && last <= 330 + 425 + 33, "{some} {last}");
}

/// Set points keep speed, acceleration, jerk and joint limits at every period, whatever the law wants and wherever they begin.
#[test]
fn set_points_keep_their_limits() {
    for place in &PLACES {
        for (way, period) in WAYS.into_iter().zip([1e-3, 4e-3, 8e-3, 2e-2]) {
            let mut bench = Bench::new(place, way, "");
            let limits = bench.arm.limits().clone();
            let (acceleration, jerk, n) = (10.0, 4000.0, bench.q.len());
            // Near the ends of the joints, where there are any.
            let begin =
                |i: usize| limits.joint.get(i).map_or(place.q[i], |[_, upper]| upper - 0.02);
            let q: Vec<_> = (0..n).map(begin).collect();
            let given = SetPointLimits {
                speed: None,
                acceleration: ScalarOrVec::Uniform(acceleration),
                jerk: ScalarOrVec::Uniform(jerk),
                threshold: 0.1,
            };
            let mut arm = VirtualArm::new(&mut bench.controller, &given, period, &q).unwrap();
            let mut before = vec![0.0; n];
            let widths = bench.controller.widths();
            let still = vec![0.0; widths[1]];
            for k in 0..(2.0 / period) as usize {
                let x: Vec<_> = (0..widths[0])
                    .map(|i| if (k / 50 + i) % 2 == 0 { 0.9 } else { -0.4 })
                    .collect();
                let target = Target { x: &x, dx: &still, ddx: &still };
                let t = period * k as f64;
                arm.step(&mut bench.controller, t, Some(&target), None).unwrap();
                let [q, dq, ddq] = arm.set_point();
                for i in 0..n {
                    let more = 1.0 + 1e-9;
                    assert!(dq[i].abs() <= limits.velocity[i] * more, "{way} {i} {k}: {}", dq[i]);
                    assert!(ddq[i].abs() <= acceleration * more, "{way} {i} {k}: {}", ddq[i]);
                    assert!((ddq[i] - before[i]).abs() <= jerk * period * more, "{way} {i} {k}");
                    if let Some([lower, upper]) = limits.joint.get(i) {
                        assert!(
                            (lower - 1e-9..=upper + 1e-9).contains(&q[i]),
                            "{way} {i} {k}: {}",
                            q[i]
                        );
                    }
                }
                before.copy_from_slice(ddq);
            }
        }
    }
}

/// Set points that wait, stop or have finished come to rest, without turning back or shaking.
#[test]
fn set_points_come_to_rest() {
    for period in [1e-3, 8e-3, 2e-2, 0.1] {
        for jerk in [20.0, 500.0, 4000.0] {
            let calm =
                Place { settings: "stiffness = 50\ndamping = 15\nnull_damping = 12", ..PLACES[0] };
            let mut bench = Bench::new(if period < 0.05 { &PLACES[0] } else { &calm }, WAYS[0], "");
            let given = SetPointLimits {
                speed: None,
                acceleration: ScalarOrVec::Uniform(10.0),
                jerk: ScalarOrVec::Uniform(jerk),
                threshold: 0.1,
            };
            let mut arm =
                VirtualArm::new(&mut bench.controller, &given, period, PLACES[0].q).unwrap();
            let widths = bench.controller.widths();
            let (mut x, still) = (vec![0.0; widths[0]], vec![0.0; widths[1]]);
            bench.controller.write_pose(&mut x);
            x[1] += 0.3;
            let target = Target { x: &x, dx: &still, ddx: &still };
            let stops = (0.3 / period) as usize;
            let mut moved: Vec<f64> = vec![];
            for k in 0..stops + (8.0 / period) as usize {
                if k == stops {
                    arm.stop();
                    moved = arm.set_point()[1].to_vec();
                }
                arm.step(&mut bench.controller, period * k as f64, Some(&target), None).unwrap();
                let [_, dq, ddq] = arm.set_point();
                let what = format!("{period} {jerk} {k}");
                if period < 0.05 && k as f64 * period > 1.5 {
                    let back = dq.iter().zip(&moved).all(|(dq, moved)| dq * moved > -0.05);
                    assert!(back, "{what} {dq:?} {moved:?}");
                }
                if k as f64 * period > 6.0 {
                    assert!(ddq.iter().chain(dq).all(|x| x.abs() < 1e-6), "{what} {ddq:?}");
                    assert_eq!(arm.course(), Course::Finished);
                }
            }
        }
    }
}

/// Where what the law wants is more than the joints can do, the set points come to where they are wanted nevertheless, or as near as the
/// arm reaches, no faster than the tip may be but for a little.
#[test]
fn set_points_do_not_swing_beyond_what_joints_can_do() {
    let slow = "stiffness = 50\ndamping = 14.1\nnull_damping = 10\ncommand = { tip_speed = 0.25 }";
    let far = "task = 'pose'\nstiffness = 100\ndamping = 20\nnull_damping = 10\ncommand = { tip_speed = 0.25 }";
    let xarm: &[f64] = &[0.0, 0.3, 0.0, 0.9, 0.0, 0.6, 0.0];
    // By how much the target moves in so many seconds, and how far from it the hand has to be at the end at most.
    for (model, settings, q, [acceleration, jerk, period], way, [seconds, most]) in [
        ("xarm7", slow, xarm, [20.0, 20.0, 4e-3], [0.0, 0.1, 0.0], [1e-3, 2e-3]),
        ("panda", far, PLACES[0].q, [7.5, 3750.0, 1e-3], [0.2, 0.4, 0.2], [3.0, 0.045]),
    ] {
        let arm = AnyArm::read(&table(&format!("model = '{model}'"))).unwrap();
        let mut controller = AnyController::new(&arm, &table(settings)).unwrap();
        let given = SetPointLimits {
            speed: None,
            acceleration: ScalarOrVec::Uniform(acceleration),
            jerk: ScalarOrVec::Uniform(jerk),
            threshold: 0.1,
        };
        let mut virtual_arm = VirtualArm::new(&mut controller, &given, period, q).unwrap();
        let widths = controller.widths();
        let mut start = vec![0.0; widths[0]];
        controller.write_pose(&mut start);
        let (mut x, mut before, still) = (start.clone(), start.clone(), vec![0.0; widths[1]]);
        let (mut fastest, mut off, mut last) = (0.0_f64, 0.0_f64, 0.0_f64);
        for k in 0..(9.0 / period) as usize {
            let t = period * k as f64;
            let s = (t / seconds).min(1.0);
            let s = s.powi(3) * (10.0 + s * (6.0 * s - 15.0));
            (0..3).for_each(|i| x[i] = start[i] + s * way[i]);
            let target = Target { x: &x, dx: &still, ddx: &still };
            virtual_arm.step(&mut controller, t, Some(&target), None).unwrap();
            let mut pose = vec![0.0; widths[0]];
            controller.write_pose(&mut pose);
            let far =
                |a: &[f64], b: &[f64]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
            let speed = far(&pose, &before) / period;
            fastest = fastest.max(speed);
            if t > 8.0 {
                (off, last) = (off.max(far(&pose, &x)), last.max(speed));
            }
            before = pose;
        }
        assert!(fastest < 0.35 && last < 0.02 && off < most, "{model} {fastest} {last} {off}");
    }
}
