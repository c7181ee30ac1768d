//! A simulated arm is driven, by itself and by drivers that misbehave.

use super::*;
use crate::math::ScalarOrVec;
use crate::runtime::SetPointLimits;
use crate::runtime::arm::AnyArm;
use crate::runtime::controller::Target;
use crate::runtime::obstacles::AnyObstacles;
use crate::scenario::Scenario;
use std::collections::VecDeque;
use std::sync::Mutex;

/// A six-link arm under gravity that holds its tip still.
const SCENE: &str = "duration = 1.0\n q0 = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4]\n\
    arm = { lengths = [1, 1, 1, 1, 1, 1], masses = 1, gravity = 9.81, radius = 0.05 }\n\
    controller = { stiffness = 100, damping = 20, null_damping = 6, \
        command = { blend_time = 0.1 }, field = { kind = 'bounded', gain = 40, influence = 0.6 } }\n\
    reference = { kind = 'setpoint', point = [5, 1] }\n\
    simulation = { dt = 1e-3, control = 'hold', integrator = 'semi_implicit_euler' }";

fn scenario() -> Scenario {
    Scenario::from_toml(SCENE).unwrap()
}

fn robot() -> SimulatedRobot {
    SimulatedRobot::new(&scenario(), 1000.0, None).unwrap()
}

/// Without the reference of the scenario.
fn controller() -> AnyController {
    let table: toml::Table = SCENE.parse().unwrap();
    let part = |name: &str| table[name].as_table().unwrap();
    AnyController::new(&AnyArm::read(part("arm")).unwrap(), part("controller")).unwrap()
}

/// What happens to a driver, by number of the period.
#[derive(Clone, Copy, PartialEq)]
enum Mishap {
    None,
    BeginFails,
    ReadFails,
    ReadFailsForEver,
    NotFinite,
    TimeStands,
    ClockSetBack,
    FirstReadFails,
    Jumps,
    WriteFails,
    WriteFailsForEver,
    EndFails,
    ReadPanics,
}

/// The simulated robot with a mishap from period 300 on, and a memory of what it was told.
struct Clumsy {
    robot: SimulatedRobot,
    mishap: Mishap,
    periods: usize,
    told: Arc<Mutex<Vec<Vec<f64>>>>,
    ended: Arc<Mutex<u32>>,
    paces: bool,
}

impl Driver for Clumsy {
    fn paces(&self) -> bool {
        self.paces
    }
    fn begin(&mut self) -> Result<(), String> {
        if self.mishap == Mishap::BeginFails { Err("no cable".into()) } else { Ok(()) }
    }
    fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
        let t = self.robot.read(q, dq)?;
        self.periods += 1;
        let late = self.periods - 300.min(self.periods);
        match self.mishap {
            Mishap::ReadFails if late == 1 => Err("hiccup".into()),
            Mishap::ReadFailsForEver if late > 0 => Err("unplugged".into()),
            Mishap::ReadPanics if late > 0 => panic!("a fault of the driver"),
            Mishap::NotFinite if late > 0 => {
                dq[2] = f64::NAN;
                Ok(t)
            }
            Mishap::TimeStands if late > 0 => Ok(0.25),
            Mishap::ClockSetBack if late > 0 => Ok(t - 2.0),
            // The one before the first period has come.
            Mishap::FirstReadFails if self.periods == 2 => Err("hiccup".into()),
            Mishap::Jumps if late > 0 => {
                q[1] += 2.0;
                Ok(t)
            }
            _ => Ok(t),
        }
    }
    fn write(&mut self, command: &[f64]) -> Result<(), String> {
        self.told.lock().unwrap().push(command.to_vec());
        let late = self.periods - 300.min(self.periods);
        match self.mishap {
            Mishap::WriteFails if late == 1 => Err("refused".into()),
            Mishap::WriteFailsForEver if late > 0 => Err("refused".into()),
            _ => self.robot.write(command),
        }
    }
    fn end(&mut self) -> Result<(), String> {
        *self.ended.lock().unwrap() += 1;
        if self.mishap == Mishap::EndFails { Err("no goodbye".into()) } else { Ok(()) }
    }
}

struct Driven {
    report: Report,
    told: Vec<Vec<f64>>,
    ended: u32,
    last: Vec<(&'static str, Vec<f64>)>,
}

fn drive(mishap: Mishap, options: Options, paces: bool) -> Driven {
    let (told, ended) = (Arc::default(), Arc::default());
    let driver = Clumsy {
        robot: robot(),
        mishap,
        periods: 0,
        told: Arc::clone(&told),
        ended: Arc::clone(&ended),
        paces,
    };
    let (drive, exchange) = Loop::new(driver, controller(), options).unwrap();
    let report = drive.run();
    let mut row = vec![0.0; exchange.layout().width()];
    exchange.copy_latest(&mut row);
    let last = exchange.layout().columns(&row).map(|(name, x)| (name, x.to_vec())).collect();
    let (told, ended) = (told.lock().unwrap().clone(), *ended.lock().unwrap());
    Driven { report, told, ended, last }
}

fn half_a_second() -> Options {
    Options { seconds: Some(0.5), ..Options::default() }
}

fn column<'a>(driven: &'a Driven, name: &str) -> &'a [f64] {
    &driven.last.iter().find(|(each, _)| *each == name).unwrap().1
}

/// Nothing happens: the tip stays, every period is counted, and the end is a damped stop. Whose clock it is makes no
/// difference to what is sent.
#[test]
fn it_drives() {
    let driven = drive(Mishap::None, half_a_second(), false);
    let Report { ending, timing, periods, notes, replans, .. } = &driven.report;
    assert_eq!((ending, notes.len(), replans.len(), driven.ended), (&Ending::Completed, 0, 0, 1));
    assert!(*periods > 500 && *periods as usize == driven.told.len(), "{periods}");
    assert_eq!((timing.latency.len(), timing.work.len()), (*periods, *periods));
    let [x, x_ref] = ["x", "x_ref"].map(|name| column(&driven, name));
    assert!((x[0] - x_ref[0]).hypot(x[1] - x_ref[1]) < 1e-3, "{x:?} {x_ref:?}");
    assert!(
        column(&driven, "t")[0] >= 0.5 && column(&driven, "dq").iter().all(|dq| dq.abs() < 0.02)
    );

    let paced = drive(Mishap::None, half_a_second(), true);
    assert_eq!((paced.report.timing.latency.len(), &paced.report.ending), (0, &Ending::Completed));
    assert_eq!(paced.told, driven.told);
}

/// What goes wrong ends the drive as a value, the arm is brought to rest as far as the robot takes commands, and
/// it is told goodbye once.
#[test]
fn mishaps_are_values() {
    let text = |mishap: Mishap, paces: bool| {
        let driven = drive(mishap, Options::default(), paces); // nobody else ends it
        assert_eq!(driven.ended, 1);
        assert!(driven.told.iter().flatten().all(|tau| tau.is_finite()));
        let Ending::Faulted(fault) = &driven.report.ending else {
            panic!("{:?}", driven.report.ending)
        };
        (fault.to_string(), driven)
    };
    let cases = [
        (Mishap::BeginFails, "the robot failed to start: no cable"),
        (Mishap::ReadFails, "the robot was not read: hiccup"),
        (Mishap::ReadFailsForEver, "the robot was not read: unplugged"),
        (Mishap::NotFinite, "the robot's dq is not finite"),
        (Mishap::TimeStands, "the robot's time stood at 0.298 s for 5 periods"),
        (Mishap::Jumps, "state discontinuity at t = "),
        (Mishap::WriteFails, "the robot did not take a command: refused"),
        (Mishap::WriteFailsForEver, "the robot did not take a command: refused"),
        (Mishap::ReadPanics, "a fault of vffnull itself, please report it: a fault of the driver"),
    ];
    for paces in [false, true] {
        for (mishap, expected) in cases {
            let (sentence, driven) = text(mishap, paces);
            assert!(sentence.contains(expected), "{sentence}");
            let periods = driven.told.len();
            match mishap {
                Mishap::BeginFails => assert_eq!(periods, 0),
                Mishap::ReadPanics => assert_eq!(periods, 299), // one state was read before the first period
                // The second refusal in a row ends it; on a busy machine the clock is ahead of the periods.
                Mishap::WriteFailsForEver => assert!((301..310).contains(&periods), "{periods}"),
                // A state again: a damped stop, until the arm has stood for 0.2 s.
                Mishap::ReadFails | Mishap::WriteFails => {
                    assert!((498..600).contains(&periods), "{periods}");
                }
                // None any more: damping for 5/d, gravity for 5/d, then it is lost.
                _ => assert!((1290..1310).contains(&periods), "{periods}"),
            }
        }
    }
    let driven = drive(Mishap::EndFails, half_a_second(), false);
    assert_eq!(driven.report.ending, Ending::Completed);
    assert_eq!(driven.report.notes, ["the robot did not take leave: no goodbye"]);
}

/// A robot's clock that is set back is not the end, and the drive lasts as long as it is to.
#[test]
fn a_clock_is_set_back() {
    let driven = drive(Mishap::ClockSetBack, half_a_second(), true);
    assert_eq!(driven.report.ending, Ending::Completed);
    let [x, x_ref] = ["x", "x_ref"].map(|name| column(&driven, name));
    assert!((x[0] - x_ref[0]).hypot(x[1] - x_ref[1]) < 1e-3, "{x:?} {x_ref:?}");
    let periods = driven.report.periods;
    assert!((700..740).contains(&periods), "{periods}"); // with 0.2 s in which the arm stands
}

/// Where the state of the first period is missing, what holds the arm at the one before is sent.
#[test]
fn the_first_state_is_missing() {
    let driven = drive(Mishap::FirstReadFails, half_a_second(), true);
    let known = drive(Mishap::None, half_a_second(), true);
    let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-6;
    assert!(driven.told[0].iter().zip(&known.told[0]).all(near));
    assert!(driven.told[0].iter().any(|tau| tau.abs() > 1.0));
}

/// What others send takes effect in the loop: a target is gone to, an obstacle pushes from the time on that it is said
/// to, one that is seen elsewhere is there; a wish to end is heard.
#[test]
fn others_are_heard() {
    type Sending = Box<dyn Fn(&Exchange) + Send>;
    /// Sends what is due, in the thread of the loop, so that it comes in known periods.
    struct Told {
        robot: SimulatedRobot,
        exchange: Arc<Mutex<Option<Arc<Exchange>>>>,
        plan: VecDeque<(f64, Sending)>,
    }
    impl Driver for Told {
        fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
            let t = self.robot.read(q, dq)?;
            let exchange = self.exchange.lock().unwrap();
            while let Some(exchange) = &*exchange
                && self.plan.front().is_some_and(|(due, _)| *due <= t)
            {
                self.plan.pop_front().unwrap().1(exchange);
            }
            Ok(t)
        }
        fn write(&mut self, command: &[f64]) -> Result<(), String> {
            self.robot.write(command)
        }
    }
    fn latest(exchange: &Exchange, name: &str) -> Vec<f64> {
        let mut row = vec![0.0; exchange.layout().width()];
        exchange.copy_latest(&mut row);
        let found = exchange.layout().columns(&row).find(|(each, _)| *each == name);
        found.unwrap().1.to_vec()
    }
    let nearest = |exchange: &Exchange| {
        latest(exchange, "clearance").into_iter().fold(f64::INFINITY, f64::min)
    };
    let goal = [4.6, 1.4];
    let disc = |motion: &str| {
        let mut read = AnyObstacles::Plane(vec![]);
        let text = format!(
            "shape = {{ kind = 'circle', radius = 0.1 }}\nposition = [1.0, 4.0]\nmotion = {motion}"
        );
        read.read(&text.parse().unwrap()).unwrap();
        read
    };
    let seen = Arc::new(Mutex::new(vec![]));
    let note = {
        let seen = Arc::clone(&seen);
        move |exchange: &Exchange| seen.lock().unwrap().push(nearest(exchange))
    };
    let at = |due: f64, act: Sending| (due, act);
    let plan = VecDeque::from([
        at(
            0.2,
            Box::new(move |exchange| {
                let still = [0.0; 2];
                exchange.set_target(&Target { x: &goal, dx: &still, ddx: &still }).unwrap();
            }),
        ),
        at(1.0, Box::new(note.clone())),
        at(
            1.0,
            Box::new(move |exchange| {
                exchange.surround(disc("{ kind = 'linear', velocity = [0, -1] }"), None).unwrap();
            }),
        ),
        at(1.1, Box::new(note.clone())),
        at(1.6, Box::new(note.clone())),
        at(
            1.6,
            Box::new(|exchange| {
                exchange.place(0, &[1.0, 4.5], &[0.0, 0.0]).unwrap();
                let fault = exchange.place(1, &[1.0, 4.5], &[0.0, 0.0]).unwrap_err().to_string();
                assert_eq!(fault, "obstacles[1]: there is none, only 1 obstacles");
            }),
        ),
        at(1.7, Box::new(note)),
        at(3.0, Box::new(Exchange::stop)),
    ]);
    let shared = Arc::new(Mutex::new(None));
    let driver = Told { robot: robot(), exchange: Arc::clone(&shared), plan };
    let options = Options { record_every: 10, ..Options::default() };
    let (drive, exchange) = Loop::new(driver, controller(), options).unwrap();
    *shared.lock().unwrap() = Some(Arc::clone(&exchange));
    let report = drive.run();
    assert_eq!((report.ending, exchange.phase()), (Ending::Stopped, Phase::Finished));
    let x = latest(&exchange, "x");
    assert!((x[0] - goal[0]).hypot(x[1] - goal[1]) < 0.02, "{x:?}");
    let [before, first, then, away] = seen.lock().unwrap()[..] else { panic!() };
    assert!(before.is_infinite());
    // It comes at 1 m/s from the moment on that it is there, whatever the clock of the robot says.
    assert!((first - then - 0.5).abs() < 0.2 && then > 0.0, "{first} {then}");
    assert!(away > first, "{first} {away}");

    // A row every ten periods, none lost although nobody has taken them, and in their order.
    let Rows { values, lost } = exchange.take_rows();
    let width = exchange.layout().width();
    let times: Vec<f64> = values.chunks(width).map(|row| row[0]).collect();
    assert_eq!((lost, times.len()), (0, report.periods.div_ceil(10) as usize));
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - 0.01).abs() < 1e-9));
    assert!(exchange.take_rows().values.is_empty());
}

/// A robot that takes positions or velocities gets those of the model, within its limits.
#[test]
fn set_points() {
    /// It is where it is told to be, one period later.
    struct Servo {
        kind: CommandKind,
        q: Vec<f64>,
        dq: Vec<f64>,
        t: f64,
    }
    impl Driver for Servo {
        fn kind(&self) -> CommandKind {
            self.kind
        }
        fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
            q.copy_from_slice(&self.q);
            dq.copy_from_slice(&self.dq);
            Ok(self.t)
        }
        fn write(&mut self, command: &[f64]) -> Result<(), String> {
            self.t += 1e-3;
            for ((q, dq), u) in self.q.iter_mut().zip(&mut self.dq).zip(command) {
                let before = *q;
                *q = if self.kind == CommandKind::Position { *u } else { before + 1e-3 * u };
                *dq = (*q - before) / 1e-3;
                if dq.abs() > 1.0 + 1e-3 {
                    // Between two set points it may be a little faster.
                    return Err(format!("too fast: {dq}"));
                }
            }
            Ok(())
        }
    }
    for kind in [CommandKind::Position, CommandKind::Velocity] {
        let q = vec![1.2, -0.6, -0.6, -0.5, 0.3, 0.4];
        let driver = || Servo { kind, dq: vec![0.0; 6], q: q.clone(), t: 7.0 };
        let none = Loop::new(driver(), controller(), Options::default()).err();
        assert_eq!(none, Some(DriveError::NoLimits));
        let limits = SetPointLimits {
            speed: Some(ScalarOrVec::Uniform(1.0)),
            acceleration: ScalarOrVec::Uniform(10.0),
            jerk: ScalarOrVec::Uniform(500.0),
            threshold: 0.1,
        };
        let options = Options { limits: Some(limits), seconds: Some(2.0), ..Options::default() };
        let (drive, exchange) = Loop::new(driver(), controller(), options).unwrap();
        let (goal, still) = ([4.6, 1.4], [0.0; 2]);
        exchange.set_target(&Target { x: &goal, dx: &still, ddx: &still }).unwrap();
        let report = drive.run();
        assert_eq!((report.ending, report.notes.len()), (Ending::Completed, 0));
        let mut row = vec![0.0; exchange.layout().width()];
        exchange.copy_latest(&mut row);
        let x = exchange.layout().columns(&row).find(|(name, _)| *name == "x").unwrap().1;
        assert!((x[0] - goal[0]).hypot(x[1] - goal[1]) < 0.02, "{kind:?} {x:?}");
    }
}

/// An arm whose joints are in degrees is refused before anything is written.
#[test]
fn another_language_is_not_begun_with() {
    struct Degrees(Arc<Mutex<u32>>);
    impl Driver for Degrees {
        fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
            q.copy_from_slice(&[0.0, -45.0, 0.0, -135.0, 0.0, 90.0, 45.0]);
            dq.fill(0.0);
            Ok(7.0)
        }
        fn write(&mut self, _: &[f64]) -> Result<(), String> {
            *self.0.lock().unwrap() += 1;
            Ok(())
        }
    }
    let arm = AnyArm::read(&toml::toml! { model = "panda" }).unwrap();
    let controller = AnyController::new(&arm, &toml::Table::new()).unwrap();
    let written = Arc::default();
    let (drive, _) = Loop::new(Degrees(Arc::clone(&written)), controller, half_a_second()).unwrap();
    let Ending::Faulted(fault) = drive.run().ending else { panic!() };
    assert_eq!(
        fault.to_string(),
        "the robot failed to start: joint 3 is at -135.000, far beyond its stop at -3.072: all joints would fit in degrees, give radians"
    );
    assert_eq!(*written.lock().unwrap(), 0);
}

/// A rate at which the damping would be unstable is refused before anything moves.
#[test]
fn what_cannot_be() {
    let options = Options { rate: 4.0, ..Options::default() };
    let error = Loop::new(robot(), controller(), options).unwrap_err();
    assert!(error.to_string().starts_with("command.stop_damping"), "{error}");
    assert_eq!(CommandKind::named("velocity"), Some(CommandKind::Velocity));
    assert_eq!(CommandKind::named("force"), None);
}
