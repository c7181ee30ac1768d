//! What is sent to a robot in a loop that is watched over, by plants that misbehave.

use proptest::prelude::*;
use toml::Table;
use vff_core::control::output::{BeginError, Phase};
use vff_core::runtime::{AnyArm, AnyController, AnyState, CycleError, Reading, Target};

const ARM: &str =
    "lengths = [0.5, 0.4, 0.4]\nmasses = [3, 2, 1.5]\ngravity = 9.81\ntorque_limits = [90, 60, 30]";
const H: f64 = 1e-3;
const READY: [f64; 3] = [0.6, -0.9, 0.7];
const LIMITS: [f64; 3] = [90.0, 60.0, 30.0];

/// A robot of which one knows everything, and a controller of it.
struct Bench {
    controller: AnyController,
    state: AnyState,
    q: Vec<f64>,
    dq: Vec<f64>,
    t: f64,
    carries_itself: bool,
    sent: Vec<f64>,
}

impl Bench {
    fn new(arm: &str, command: &str) -> Self {
        let table = |text: &str| text.parse::<Table>().unwrap();
        let arm = AnyArm::read(&table(arm)).unwrap();
        let settings =
            format!("stiffness = 100\ndamping = 20\nnull_damping = 8\ncommand = {{ {command} }}");
        let controller = AnyController::new(&arm, &table(&settings)).unwrap();
        let carries_itself = command.contains("\"robot\"");
        let (q, dq) = (READY.to_vec(), vec![0.0; 3]);
        Self { controller, state: arm.at(&q, &dq), q, dq, t: 0.0, carries_itself, sent: vec![] }
    }

    fn tip(&self) -> Vec<f64> {
        let mut out = vec![];
        self.state.append_joint_positions(&mut out);
        out.split_off(out.len() - 2)
    }

    fn moved(&mut self) {
        match &mut self.state {
            AnyState::Plane(state) => {
                vff_core::robot::Robot::update(state, &self.q, &self.dq);
            }
            AnyState::Space(_) => unreachable!("planar"),
        }
    }

    /// A cycle with these numbers, or without any.
    fn cycle_with(&mut self, reading: Option<(f64, &[f64], &[f64])>, x: Option<[f64; 2]>) -> Phase {
        let reading = reading.map(|(t, q, dq)| Reading { t, q, dq });
        let zero = [0.0; 2];
        let target = x.as_ref().map(|x| Target { x, dx: &zero, ddx: &zero });
        let phase = self.controller.cycle(reading, target.as_ref()).unwrap();
        self.sent = self.controller.sent().unwrap().to_vec();
        phase
    }

    /// One with the true state.
    fn cycle(&mut self, x: Option<[f64; 2]>) -> Phase {
        let (q, dq) = (self.q.clone(), self.dq.clone());
        self.cycle_with(Some((self.t, &q, &dq)), x)
    }

    /// The robot does what it was sent, for one period.
    fn go_on(&mut self) {
        self.go_on_with(&[0.0; 3]);
    }

    /// The same under a torque that nobody knows of.
    fn go_on_with(&mut self, external: &[f64]) {
        let g = self.gravity();
        let own = if self.carries_itself { g } else { vec![0.0; 3] };
        let torques = self.sent.iter().zip(own).zip(external);
        let tau: Vec<_> = torques.map(|((sent, own), external)| sent + own + external).collect();
        let ddq = self.state.forward_dynamics(&tau);
        for ((q, dq), ddq) in self.q.iter_mut().zip(&mut self.dq).zip(ddq) {
            *dq += H * ddq;
            *q += H * *dq;
        }
        self.t += H;
        self.moved();
    }

    fn gravity(&self) -> Vec<f64> {
        self.state.gravity_torque()
    }

    /// The torques of a weight \[N\] at the tip.
    fn load(&self, weight: f64) -> Vec<f64> {
        let mut joints = vec![];
        self.state.append_joint_positions(&mut joints);
        let tip = joints[joints.len() - 2];
        (0..3).map(|i| -weight * (tip - joints[2 * i])).collect()
    }
}

fn near(a: &[f64], b: &[f64], within: f64) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= within)
}

const AWAY: [f64; 2] = [0.7, 0.5];

/// The first torque is the measured one; from there it goes to that of the law without a jump, and is that of the law then.
#[test]
fn a_start_is_smooth() {
    for (command, robot) in [("", false), ("gravity = \"robot\"", true)] {
        let mut bench = Bench::new(ARM, command);
        let g = bench.gravity();
        let measured: Vec<_> = g.iter().map(|g| if robot { 0.3 } else { 1.05 * g }).collect();
        bench.controller.begin(H, Some(&measured)).unwrap();
        let mut before = measured.clone();
        let mut largest = 0.0_f64;
        for k in 0..600 {
            let phase = bench.cycle(Some(AWAY));
            assert_eq!(phase, if k < 500 { Phase::Starting } else { Phase::Running }, "{k}");
            for (sent, before) in bench.sent.iter().zip(&before) {
                largest = largest.max((sent - before).abs());
            }
            if k == 0 {
                assert!(near(&bench.sent, &measured, 0.0));
            }
            before.clone_from(&bench.sent);
            if phase == Phase::Running {
                let target = Target { x: &AWAY, dx: &[0.0; 2], ddx: &[0.0; 2] };
                let mut other = bench.controller.clone();
                let tau = other.torque(&bench.q, &bench.dq, &target, bench.t).unwrap();
                assert!(near(&bench.sent, tau, 0.0));
            }
            bench.go_on();
        }
        // Without a blend the first change would be as large as the whole torque of the task.
        let mut abrupt = Bench::new(ARM, command);
        let target = Target { x: &AWAY, dx: &[0.0; 2], ddx: &[0.0; 2] };
        let tau = abrupt.controller.torque(&READY, &[0.0; 3], &target, 0.0).unwrap();
        let jump = tau.iter().zip(&measured).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(largest < 0.05 * jump, "{largest} against {jump}");
    }
}

/// A torque that cannot have been measured is not believed: the arm is held where it is.
#[test]
fn a_measured_torque_that_cannot_be_is_not_believed() {
    let g = Bench::new(ARM, "").gravity();
    for wrong in [f64::NAN, f64::INFINITY, 50.0, -200.0] {
        let mut bench = Bench::new(ARM, "");
        bench.controller.begin(H, Some(&[g[0], wrong, g[2]])).unwrap();
        assert_eq!(bench.cycle(Some(AWAY)), Phase::Starting);
        assert!(near(&bench.sent, &g, 1e-12), "{wrong}: {:?} against {g:?}", bench.sent);
    }
}

/// Held, damped from the last velocity, released, lost, each for its time; the arm comes to rest meanwhile, and only a new
/// beginning leads out of it.
#[test]
fn states_that_stop_coming() {
    for command in ["gravity = \"robot\"", "missed_cycles = 3\nstop_damping = 20", "blend_time = 0"]
    {
        let mut bench = Bench::new(ARM, &command.replace('\n', ", "));
        let allowed = if command.contains("missed_cycles") { 3 } else { 5 };
        let d = if command.contains("stop_damping") { 20.0 } else { 10.0 };
        bench.controller.begin(H, None).unwrap();
        for _ in 0..if command == "blend_time = 0" { 150 } else { 350 } {
            bench.cycle(Some(AWAY));
            bench.go_on();
        }
        bench.cycle(Some(AWAY));
        let (dq, last) = (bench.dq.clone(), bench.sent.clone());
        let g = if bench.carries_itself { vec![0.0; 3] } else { bench.gravity() };
        let momentum: Vec<f64> = {
            let m = bench.state.mass_matrix();
            (0..3).map(|i| (0..3).map(|j| m[(i, j)] * dq[j]).sum()).collect()
        };
        let speed = |dq: &[f64]| dq.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        assert!(speed(&dq) > 0.1, "{dq:?}");
        let steps = (5.0 / (d * H)).round() as usize;
        for missed in 1..=allowed + 2 * steps + 50 {
            bench.go_on();
            let phase = bench.cycle_with(None, Some(AWAY));
            let damped = missed as f64 - allowed as f64;
            if missed < allowed {
                assert_eq!(phase, Phase::Holding);
                assert!(near(&bench.sent, &last, 0.0));
            } else if missed < allowed + steps {
                assert_eq!(phase, Phase::Damping, "{missed}");
                let left = d * (-d * H * damped).exp();
                let expected: Vec<_> = g.iter().zip(&momentum).map(|(g, p)| g - left * p).collect();
                assert!(near(&bench.sent, &expected, 1e-9), "{:?} {expected:?}", bench.sent);
            } else if missed > allowed + steps + 1 {
                let over = missed > allowed + 2 * steps + 1;
                if missed < allowed + 2 * steps - 1 || over {
                    assert_eq!(phase, if over { Phase::Lost } else { Phase::Released }, "{missed}");
                }
                assert!(near(&bench.sent, &g, 1e-12));
            }
        }
        // Where gravity's torque is that of the robot, the arm has stopped, although nobody has looked.
        if bench.carries_itself {
            assert!(speed(&bench.dq) < 0.1 * speed(&dq), "{:?} after {dq:?}", bench.dq);
        }
        assert_eq!(bench.cycle(Some(AWAY)), Phase::Lost);
        bench.controller.begin(H, None).unwrap();
        assert_ne!(bench.cycle(Some(AWAY)), Phase::Lost);
    }
}

/// States come again before all is lost: the torque is blended in anew, from what was sent.
#[test]
fn states_that_come_again() {
    let mut bench = Bench::new(ARM, "");
    bench.controller.begin(H, None).unwrap();
    for _ in 0..700 {
        bench.cycle(Some(AWAY));
        bench.go_on();
    }
    for (pause, after) in [(4, Phase::Running), (5, Phase::Starting), (200, Phase::Starting)] {
        for _ in 0..pause {
            bench.cycle_with(None, Some(AWAY));
            bench.go_on();
        }
        let before = bench.sent.clone();
        assert_eq!(bench.cycle(Some(AWAY)), after, "{pause}");
        if after == Phase::Starting {
            // Damping is back at once, nothing else.
            let most =
                1.5 * 10.0 * 1.2 * bench.dq.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            assert!(near(&bench.sent, &before, most + 1e-9), "{:?} {before:?}", bench.sent);
        }
        for _ in 0..600 {
            bench.go_on();
            bench.cycle(Some(AWAY));
        }
        assert_eq!(bench.controller.phase(), Some(Phase::Running));
    }
}

/// What is no news, or cannot be, is like nothing; what comes after it is believed again.
#[test]
fn states_that_cannot_be() {
    let mut bench = Bench::new(&format!("{ARM}\nvelocity_limits = 2"), "");
    bench.controller.begin(H, None).unwrap();
    for _ in 0..700 {
        bench.cycle(Some(AWAY));
        bench.go_on();
    }
    let (t, q, dq) = (bench.t, bench.q.clone(), bench.dq.clone());
    let with = |values: &[f64], i: usize, x: f64| {
        let mut values = values.to_vec();
        values[i] = x;
        values
    };
    let wrong = [
        (t, with(&q, 1, f64::NAN), dq.clone()),
        (t, q.clone(), with(&dq, 2, f64::NEG_INFINITY)),
        (f64::NAN, q.clone(), dq.clone()),
        (t - H, q.clone(), dq.clone()),
        (t - 1.0, q.clone(), dq.clone()),
        (t, with(&q, 0, q[0] + 0.1), dq.clone()),
        (t, with(&q, 0, q[0] + 3.0), dq.clone()),
        (t, q.clone(), with(&dq, 0, 100.0)),
    ];
    // Whole turns are nothing to joints without stops.
    let mut other = Bench { controller: bench.controller.clone(), ..Bench::new(ARM, "") };
    let turned = with(&q, 1, q[1] - 2.0 * std::f64::consts::TAU);
    assert_eq!(other.cycle_with(Some((t, &turned, &dq)), Some(AWAY)), Phase::Running);
    for (t, q, dq) in &wrong {
        let mut other = Bench { controller: bench.controller.clone(), ..Bench::new(ARM, "") };
        for k in 1..20 {
            let phase = other.cycle_with(Some((*t, q, dq)), Some(AWAY));
            assert_eq!(
                phase,
                if k < 5 { Phase::Holding } else { Phase::Damping },
                "{t} {q:?} {dq:?}"
            );
        }
        let (t, q, dq) = (bench.t, bench.q.clone(), bench.dq.clone());
        assert_eq!(other.cycle_with(Some((t, &q, &dq)), Some(AWAY)), Phase::Starting);
    }
}

/// States that are some cycles late, as long as they come, are states.
#[test]
fn late_states() {
    let mut bench = Bench::new(ARM, "");
    bench.controller.begin(H, None).unwrap();
    let mut past = std::collections::VecDeque::new();
    for k in 0..1500 {
        past.push_back((bench.t, bench.q.clone(), bench.dq.clone()));
        // Three cycles late, and every fourth does not come at all.
        let late = if past.len() > 3 { past.pop_front() } else { None };
        let late = late.filter(|_| k % 4 != 0);
        let given = late.as_ref().map(|(t, q, dq)| (*t, &q[..], &dq[..]));
        let phase = bench.cycle_with(given, Some(AWAY));
        if k > 700 {
            assert_eq!(phase, if given.is_some() { Phase::Running } else { Phase::Holding }, "{k}");
        }
        bench.go_on();
    }
    assert!(near(&bench.tip(), &AWAY, 0.02), "{:?}", bench.tip());
}

/// The speed decays with e^(−dt), sampled, until the arm stands; the loop is finished then, and stays so.
#[test]
fn a_stop_is_damped() {
    let mut bench = Bench::new(ARM, "gravity = \"robot\", blend_time = 0");
    bench.controller.begin(H, None).unwrap();
    for _ in 0..150 {
        bench.cycle(Some(AWAY));
        bench.go_on();
    }
    bench.controller.stop();
    let first = bench.state.kinetic_energy();
    assert!(first > 0.05, "{first}");
    let mut k = 0;
    while bench.cycle(Some(AWAY)) == Phase::Stopping {
        let expected = first * (1.0 - 10.0 * H).powi(2 * k);
        let energy = bench.state.kinetic_energy();
        assert!((energy - expected).abs() < 0.01 * expected, "{k}: {energy} against {expected}");
        bench.go_on();
        k += 1;
        assert!(k < 1000);
    }
    assert!(k > 100);
    assert_eq!(bench.cycle(Some(AWAY)), Phase::Finished);
    assert!(near(&bench.dq, &[0.0; 3], 0.02));
    bench.t += H;
    assert_eq!(bench.cycle(Some(AWAY)), Phase::Finished);
    assert_eq!(bench.cycle_with(None, None), Phase::Finished);
}

/// An arm with a load that nobody knows of stands where it was stopped, at rest or in motion, and goes on standing there.
#[test]
fn a_stop_holds_a_load_that_nobody_knows_of() {
    for moving in [0, 150] {
        let mut bench = Bench::new(ARM, "blend_time = 0");
        bench.controller.begin(H, None).unwrap();
        for _ in 0..moving {
            bench.cycle(Some(AWAY));
            bench.go_on();
        }
        bench.controller.stop();
        let (mut k, mut low, mut stood) = (0, f64::INFINITY, None);
        let stopped = bench.tip();
        for _ in 0..4000 {
            // 1.5 kg at the tip, half of what the last link weighs.
            let weight = bench.load(1.5 * 9.81);
            if bench.cycle(None) == Phase::Finished && stood.is_none() {
                stood = Some(k);
            }
            bench.go_on_with(&weight);
            low = low.min(bench.tip()[1] - stopped[1]);
            k += 1;
        }
        assert!(stood.is_some_and(|k| k < 3000), "{stood:?}");
        assert!(near(&bench.dq, &[0.0; 3], 1e-3), "{:?}", bench.dq);
        let sunk = stopped[1] - bench.tip()[1];
        assert!(low > -0.15 && sunk < 0.1, "{moving}: {low}, {sunk}");
    }
}

/// What holds an arm that is stopped is no stronger than a quarter of its limits: who pushes harder moves it.
#[test]
fn a_stop_gives_in() {
    let mut bench = Bench::new(ARM, "blend_time = 0");
    bench.controller.begin(H, None).unwrap();
    bench.controller.stop();
    let first = bench.q.clone();
    for _ in 0..1000 {
        bench.cycle(None);
        bench.go_on_with(&[0.0, 0.0, -0.4 * LIMITS[2]]);
    }
    assert!(bench.q[2] < first[2] - 0.5, "{}", bench.q[2]);
    for _ in 0..2000 {
        bench.cycle(None);
        bench.go_on();
    }
    assert!(near(&bench.dq, &[0.0; 3], 0.01), "{:?}", bench.dq);
}

/// What is sent changes no faster than it may, in whatever phase; without the limit it would.
#[test]
fn the_rate_is_limited() {
    let largest = |command: &str| {
        let mut bench = Bench::new(ARM, command);
        bench.controller.begin(H, None).unwrap();
        let (mut largest, mut before) = (0.0_f64, bench.gravity());
        for k in 0..900 {
            match k {
                100..130 | 600..640 => bench.cycle_with(None, Some(AWAY)),
                400 => bench.cycle(Some([-0.5, 0.9])),
                _ if k < 400 => bench.cycle(Some(AWAY)),
                _ => bench.cycle(Some([-0.5, 0.9])),
            };
            if k == 800 {
                bench.controller.stop();
            }
            for (sent, before) in bench.sent.iter().zip(&before) {
                largest = largest.max((sent - before).abs());
            }
            before.clone_from(&bench.sent);
            bench.go_on();
        }
        largest
    };
    assert!(largest("blend_time = 0") > 5.0);
    let limited = largest("blend_time = 0, torque_rate = 1000");
    assert!((0.99..1.0 + 1e-9).contains(&limited), "{limited}");
}

/// An arm that moves towards the stop of a joint is damped as hard as it takes to stand before.
#[test]
fn a_stop_ends_before_the_stops_of_the_joints() {
    let limits = "joint_limits = [[-1, 1], [-2, 2], [-2, 2]]";
    let left_at = |speed: f64| {
        let mut bench = Bench::new(&format!("{ARM}\n{limits}"), "blend_time = 0");
        bench.q = vec![0.9, -0.9, 0.7];
        bench.moved();
        bench.controller.begin(H, None).unwrap();
        bench.cycle(None);
        bench.dq = vec![speed, 0.0, 0.0];
        bench.moved();
        bench.controller.stop();
        let mut most = f64::NEG_INFINITY;
        for _ in 0..2000 {
            bench.cycle(None);
            bench.go_on();
            most = most.max(bench.q[0]);
        }
        assert!(bench.dq[0].abs() < 0.01, "{}", bench.dq[0]);
        0.99 - most
    };
    // 0.05 rad of way at 10 1/s are fewer than there are; 0.15 would be more.
    assert!((left_at(0.5) - 0.04).abs() < 0.005, "{}", left_at(0.5));
    assert!((-1e-3..0.02).contains(&left_at(1.5)), "{}", left_at(1.5));
}

/// The tip stays below its speed; where it is far slower, the torque is what it was, to the last bit.
#[test]
fn the_tip_is_kept_slow() {
    let fastest = |command: &str| {
        let mut bench = Bench::new(ARM, command);
        bench.controller.begin(H, None).unwrap();
        let (mut most, mut before) = (0.0_f64, bench.tip());
        for _ in 0..6000 {
            bench.cycle(Some([-0.6, 0.7]));
            bench.go_on();
            let tip = bench.tip();
            most = most.max((tip[0] - before[0]).hypot(tip[1] - before[1]) / H);
            before = tip;
        }
        (most, bench.tip())
    };
    let (free, _) = fastest("blend_time = 0.1");
    assert!(free > 2.0, "{free}");
    let (kept, arrived) = fastest("blend_time = 0.1, tip_speed = 0.5");
    assert!((0.49..0.51).contains(&kept), "{kept}");
    assert!(near(&arrived, &[-0.6, 0.7], 0.01), "{arrived:?}");
    let target = Target { x: &AWAY, dx: &[0.0; 2], ddx: &[0.0; 2] };
    let tau = |command: &str| {
        let mut bench = Bench::new(ARM, command);
        bench.controller.torque(&READY, &[0.01; 3], &target, 0.0).unwrap().to_vec()
    };
    assert_eq!(tau("tip_speed = 50"), tau(""));
}

/// What a loop cannot begin with, and what is no cycle.
#[test]
fn faults() {
    let mut bench = Bench::new(ARM, "stop_damping = 50");
    assert_eq!(bench.controller.cycle(None, None), Err(CycleError::NotBegun));
    assert_eq!((bench.controller.phase(), bench.controller.sent()), (None, None));
    bench.controller.stop();
    for period in [0.0, -1.0, f64::INFINITY] {
        assert_eq!(bench.controller.begin(period, None), Err(BeginError::Period(period)));
    }
    assert!(matches!(bench.controller.begin(f64::NAN, None), Err(BeginError::Period(_))));
    let too_long = BeginError::Damping { damping: 50.0, period: 0.04 };
    assert_eq!(bench.controller.begin(0.04, None), Err(too_long));
    assert_eq!(bench.controller.phase(), None);
    bench.controller.begin(0.039, None).unwrap();
    // Nothing was ever heard of the robot: nothing is sent, and in the end it is lost.
    while bench.cycle_with(None, None) != Phase::Lost {
        assert_eq!(bench.sent, [0.0; 3]);
    }
}

/// A number that a robot may report.
fn reported() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -0.01..0.01,
        1 => -1e3..1e3,
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(1e300), Just(-0.0)],
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is reported: what is sent is finite, within the torque limits and changes no faster than it may.
    #[test]
    fn whatever_is_reported(
        cycles in prop::collection::vec((0..10_u8, reported(), reported(), reported()), 1..200),
        rate in prop::option::of(10.0..2000.0),
    ) {
        let command = rate.map_or(String::new(), |rate| format!("torque_rate = {rate:?}"));
        let mut bench = Bench::new(ARM, &command);
        let measured = [cycles[0].1, cycles[0].2, cycles[0].3];
        bench.controller.begin(H, Some(&measured)).unwrap();
        let mut before: Option<Vec<f64>> = None;
        for (k, (kind, a, b, c)) in cycles.iter().enumerate() {
            let t = k as f64 * H + if *kind == 1 { *c } else { 0.0 };
            let q: Vec<_> = READY.iter().map(|q| q + a).collect();
            let dq = [*b, -b, 2.0 * b];
            let reading = (*kind != 0).then_some((t, &q[..], &dq[..]));
            if *kind == 9 {
                bench.controller.stop();
            }
            bench.cycle_with(reading, Some(AWAY));
            for (i, sent) in bench.sent.iter().enumerate() {
                prop_assert!(sent.abs() <= LIMITS[i] * (1.0 + 1e-12), "{sent}");
                if let (Some(rate), Some(before)) = (rate, &before) {
                    prop_assert!((sent - before[i]).abs() <= rate * H * (1.0 + 1e-9));
                }
            }
            before = Some(bench.sent.clone());
        }
    }
}
