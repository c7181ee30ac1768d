//! What obstacles, references and laws make of clocks: of those that are set, of loops that begin anew, and of what is asked before
//! a loop has its first state.

use toml::Table;
use vff_core::control::output::Phase;
use vff_core::runtime::{AnyArm, AnyController, Reading, SuccessionError, Target};
use vff_core::scenario::Scenario;

const H: f64 = 1e-3;
const Q: [f64; 7] = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785];
const BALL: [f64; 3] = [0.3, 0.25, 0.55];
const FIELD: &str =
    "task = 'position'\nfield = { kind = 'bounded', gain = 80.0, influence = 0.5 }\n";

fn table(text: &str) -> Table {
    text.parse().unwrap()
}

fn arm(name: &str) -> AnyArm {
    AnyArm::read(&table(&format!("model = '{name}'"))).unwrap()
}

fn controller(settings: &str) -> AnyController {
    AnyController::new(&arm("panda"), &table(settings)).unwrap()
}

/// A Panda that stands, a ball beside it, and a loop.
struct Cell {
    controller: AnyController,
    x: Vec<f64>,
}

impl Cell {
    fn new(settings: &str) -> Self {
        let mut controller = controller(settings);
        let ball = format!("shape = {{ kind = 'sphere', radius = 0.08 }}\nposition = {BALL:?}");
        controller.add(&table(&ball)).unwrap();
        controller.observe(&Q, &[0.0; 7], 0.0);
        let mut x = vec![0.0; controller.widths()[0]];
        controller.write_pose(&mut x);
        controller.begin(H, None).unwrap();
        Self { controller, x }
    }

    /// A cycle with a state at `t`.
    fn cycle(&mut self, t: f64) -> Phase {
        let reading = Some(Reading { t, q: &Q, dq: &[0.0; 7] });
        let target = Target { x: &self.x, dx: &[0.0; 3], ddx: &[0.0; 3] };
        self.controller.cycle(reading, Some(&target)).unwrap()
    }

    /// How far the ball is from the fourth link.
    fn distance(&self) -> f64 {
        let mut distance = [0.0; 7];
        self.controller.write_distances(0, &mut distance, None);
        distance[3]
    }

    fn sent(&self) -> Vec<f64> {
        self.controller.sent().unwrap().to_vec()
    }
}

/// A ball that stands is where it is seen, though its stamps come out of order, and from a clock of before.
#[test]
fn a_doubted_obstacle_stays_a_number() {
    let mut cell = Cell::new(&format!("{FIELD}command = {{ obstacle_speed = 2.0 }}"));
    for begun in 0..2 {
        for k in 0..1000 {
            let t = H * f64::from(k);
            if k % 50 == 0 {
                let late = if k == 500 { 0.051 } else { 0.0 };
                let away = cell.controller.place(0, t - late, &BALL, &[0.0; 3]);
                assert!(away < 1e-9, "{begun} {k}: {away}");
            }
            cell.cycle(t);
            assert!((cell.distance() - 0.330).abs() < 1e-3, "{begun} {k}: {}", cell.distance());
        }
        assert!(cell.sent()[0] < -30.0, "{:?}", cell.sent());
        cell.controller.begin(H, None).unwrap();
    }
}

/// One that moves, and is seen twice at one time, goes on as it does.
#[test]
fn what_is_seen_twice_does_not_fly_off() {
    let mut cell = Cell::new(&format!("{FIELD}command = {{ obstacle_speed = 2.0 }}"));
    let mut last = None;
    for k in 0..600 {
        let t = 1e3 + H * f64::from(k);
        if k % 50 == 0 {
            let seen = [BALL[0], BALL[1] + 0.1 * (t - 1e3), BALL[2]];
            for noise in [0.0, 1e-3] {
                let seen = seen.map(|x| x + noise);
                cell.controller.place(0, t, &seen, &[0.0, 0.1, 0.0]);
            }
        }
        cell.cycle(t);
        let distance = cell.distance();
        assert!(last.is_none_or(|last: f64| (distance - last).abs() < 1e-3), "{k}: {distance}");
        last = Some(distance);
    }
}

/// What moves goes on from where it is when another loop begins on another clock.
#[test]
fn another_loop_finds_obstacles_where_they_are() {
    for (ends, jump) in [(60.0, 0.0), (1003.0, 1000.0)] {
        let mut cell = Cell::new(FIELD);
        let velocity = [0.0, 0.02, 0.0];
        cell.cycle(ends - 1.0);
        cell.controller.place(0, ends - 1.0, &BALL, &velocity);
        for k in 1..=1000 {
            // In the middle of the loop its clock is set back, or not.
            let t = ends - 1.0 + H * f64::from(k);
            cell.cycle(if k > 500 { t - jump } else { t });
        }
        let there = cell.distance();
        assert!((there - 0.343).abs() < 6e-3, "{there}");
        cell.controller.begin(H, None).unwrap();
        for k in 0..1000 {
            cell.cycle(H * f64::from(k));
            let moved = cell.distance() - there;
            assert!((-1e-4..0.021).contains(&moved), "{ends} {k}: {moved}");
        }
        assert!(cell.distance() - there > 0.01);
    }
}

/// What is told of the obstacles at the time of a clock that was set, before the first state that says so, is of now.
#[test]
fn a_clock_is_set_before_the_state_that_says_so() {
    for jump in [-1000.0, 1000.0] {
        let mut cell = Cell::new(FIELD);
        for k in 0..2200 {
            let t = 2000.0 + H * f64::from(k) + if k < 2000 { 0.0 } else { jump };
            if k % 50 == 0 {
                cell.controller.place(0, t, &BALL, &[0.0, -0.01, 0.0]);
            }
            cell.cycle(t);
            assert!((cell.distance() - 0.330).abs() < 2e-3, "{jump} {k}: {}", cell.distance());
        }
    }
}

/// A law takes the place of none but that which it was made for, or a copy.
#[test]
fn a_successor_of_another_law_is_refused() {
    let mut cell = Cell::new("task = 'position'\ncommand = { gravity = 'controller' }");
    cell.cycle(0.0);
    let iiwa = AnyController::new(&arm("iiwa14"), &table("task = 'position'")).unwrap();
    let held = controller("task = 'position'\ncommand = { gravity = 'robot' }");
    for other in [iiwa, held] {
        let mut next = other.successor(&other).unwrap();
        assert_eq!(cell.controller.succeed(&mut next, 0.1), Err(SuccessionError::Another));
    }
    let alike = controller("task = 'position'\ncommand = { gravity = 'controller' }");
    let mut next = cell.controller.copy().successor(&alike).unwrap();
    assert_eq!(cell.controller.succeed(&mut next, 0.1), Err(SuccessionError::Succeeding));
    for k in 1..600 {
        cell.cycle(H * f64::from(k)); // until the torque is blended in
    }
    assert_eq!(cell.controller.succeed(&mut next, 0.1), Ok(true));
}

/// A law that is left at once leaves a torque, also where it is asked for before the next state.
#[test]
fn a_law_is_left_at_once() {
    for duration in [0.0, -1.0] {
        let mut law = controller("task = 'position'");
        let mut x = vec![0.0; 3];
        law.observe(&Q, &[0.0; 7], 0.0);
        law.write_pose(&mut x);
        let target = Target { x: &x, dx: &[0.0; 3], ddx: &[0.0; 3] };
        let expected = law.command(&target).unwrap().to_vec();
        let mut next = law.successor(&controller("task = 'position'")).unwrap();
        law.observe(&Q, &[0.0; 7], H);
        law.succeed(&mut next, duration).unwrap();
        let torque = law.command(&target).unwrap();
        for (torque, expected) in torque.iter().zip(&expected) {
            assert!((torque - expected).abs() < 1e-9, "{torque} {expected}");
        }
    }
}

/// Questions before and between the cycles change nothing of what is sent, though the law came from one made before the loop.
#[test]
fn questions_are_no_cycles() {
    let text = "q0 = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]\nduration = 5.0\n[arm]\nmodel = 'panda'\n\
                [controller]\ntask = 'position'\ntank = { capacity = 0.02 }\n\
                field = { kind = 'bounded', gain = 80.0, influence = 0.5 }\ngovernor = {}\n\
                [reference]\nkind = 'line'\nend = [0.4, 0.2, 0.5]\nduration = 3.0\n\
                [[obstacles]]\nshape = { kind = 'sphere', radius = 0.08 }\nposition = [0.3, 0.25, 0.55]";
    let scenario = Scenario::from_toml(text).unwrap();
    let sent = |asks: bool| {
        let mut law = AnyController::from_scenario(&scenario).unwrap();
        let mut next = law.successor(&law).unwrap();
        law.begin(H, None).unwrap();
        if asks {
            for t in [100.0, -2.0] {
                law.observe(&Q, &[0.0; 7], t);
                law.follow();
            }
        }
        let mut sent = vec![];
        for k in 0..1500 {
            let t = H * f64::from(k);
            if k == 700 {
                law.succeed(&mut next, 0.1).unwrap();
            }
            law.cycle(Some(Reading { t, q: &Q, dq: &[0.0; 7] }), None).unwrap();
            sent.push(law.sent().unwrap().to_vec());
            if asks && k % 10 == 3 {
                law.observe(&Q.map(|q| q + 0.1), &[0.5; 7], t);
                law.follow();
            }
        }
        sent
    };
    let (alone, asked) = (sent(false), sent(true));
    for (k, (alone, asked)) in alone.iter().zip(&asked).enumerate() {
        assert_eq!(alone, asked, "{k}");
    }
    assert!(alone[1499][0].abs() > 0.1);
}
