//! How a drive ends, and what of it is to be told.

use super::Inner;
use crate::math::short_way;

/// What is farther off at the end is to be told: a joint off its plan \[rad, m\], the end effector off its reference \[m\].
const OFF_PLAN: f64 = 0.1;
const OFF: f64 = 0.02;

/// Why a drive ended before its time.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// It could not begin.
    #[error("the robot failed to start: {0}")]
    Begin(String),
    /// No state came.
    #[error("the robot was not read: {0}")]
    Read(String),
    /// A state is no state.
    #[error("the robot's {0} is not finite")]
    NotFinite(&'static str),
    /// Who sees an obstacle has fallen silent.
    #[error(
        "obstacles[{obstacle}] was last seen at t = {since:.3} s, longer ago than sight_patience"
    )]
    Unseen {
        /// Which.
        obstacle: usize,
        /// When \[s\].
        since: f64,
    },
    /// The robot's time stood still.
    #[error("the robot's time stood at {t:.3} s for {periods} periods")]
    Stale {
        /// Where it stood \[s\].
        t: f64,
        /// For how many periods.
        periods: u32,
    },
    /// The robot's time is none in seconds.
    #[error(
        "the robot's clock goes on by {step} from period to period, where {period} s pass: it has to count in seconds"
    )]
    Clock {
        /// By how much it goes on.
        step: f64,
        /// The period of the loop \[s\].
        period: f64,
    },
    /// A velocity is none of its position.
    #[error(
        "joint {joint} went by {gone:.3} in {within:.3} s, and its velocity says {told:.3}: its sign or unit is another one, or it is not filled in"
    )]
    Velocity {
        /// Which, counted from 0.
        joint: usize,
        /// How far it went \[rad, m\].
        gone: f64,
        /// How far by its velocity.
        told: f64,
        /// In which time \[s\].
        within: f64,
    },
    /// The state jumps.
    #[error(
        "state discontinuity at t = {t:.3} s: a joint cannot have moved so far since the state before"
    )]
    Impossible {
        /// When \[s\].
        t: f64,
    },
    /// The arm is thrown.
    #[error("a joint was faster than twice its speed limit at t = {t:.3} s; the arm was braked")]
    TooFast {
        /// When \[s\].
        t: f64,
    },
    /// A command was not taken.
    #[error("the robot did not take a command: {0}")]
    Write(String),
    /// The arm did not come to rest.
    #[error("the arm still moved {0} s after it was to stop")]
    Moves(f64),
    /// The law came to no torque.
    #[error("the torque at this state and reference is not finite")]
    Torque,
    /// A fault of the program, in its words.
    #[error("{0}")]
    Program(String),
}

impl Fault {
    /// What is wrong with values of this name of which one is no number.
    pub(super) fn unless_finite(name: &'static str, values: &[f64]) -> Result<(), Self> {
        match values.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(Self::NotFinite(name)),
        }
    }
}

/// How a drive ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Ending {
    /// Its time was over.
    Completed,
    /// Somebody asked it to.
    Stopped,
    /// Something went wrong.
    Faulted(Fault),
}

impl Ending {
    /// What people call it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Stopped => "stopped",
            Self::Faulted(_) => "fault",
        }
    }
}

/// How far off an arm was at the end of its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Off {
    /// The joint that was farthest off the plan, and how far \[rad, m\].
    joint: (usize, f64),
    /// The end effector, off its reference \[m\].
    end_effector: f64,
}

impl Off {
    /// If that is to be told.
    pub(super) fn note(self) -> Option<String> {
        let Self { joint: (joint, most), end_effector: off } = self;
        if most > OFF_PLAN {
            Some(format!(
                "at the end joint {joint} was {most:.3} off the plan, the end effector {off:.3} m off"
            ))
        } else if off > OFF {
            Some(format!("at the end the end effector was {off:.3} m off its reference"))
        } else {
            None
        }
    }
}

impl Inner {
    /// How far the arm is off where its reference or plan has it; None where others say where it is to be.
    pub(super) fn off(&self) -> Option<Off> {
        let Self { controller, now, given: None, .. } = self else { return None };
        let [mut is, mut wanted] = [[0.0; 7]; 2];
        let width = now.pose().len();
        controller.write_pose(&mut is[..width]);
        controller.write_reference(&mut wanted[..width]);
        let place = controller.dimension();
        let squares = is[..place].iter().zip(&wanted[..place]).map(|(a, b)| (a - b).powi(2));
        let end_effector = squares.sum::<f64>().sqrt();
        let joints = controller.planned().into_iter().flat_map(|plan| plan.iter().zip(&self.q));
        let ways = joints.zip(controller.endless());
        let ways = ways.map(|((plan, q), endless)| short_way(plan - q, endless).abs()).enumerate();
        let joint = ways.fold((0, 0.0), |most, way| if way.1 > most.1 { way } else { most });
        Some(Off { joint, end_effector })
    }
}
