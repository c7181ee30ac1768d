//! How a drive ends.

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
    /// The robot's time stood still.
    #[error("the robot's time stood at {t} s for {periods} periods")]
    Stale {
        /// Where it stood \[s\].
        t: f64,
        /// For how many periods.
        periods: u32,
    },
    /// The state jumps.
    #[error(
        "state discontinuity at t = {t} s: a joint cannot have moved so far since the state before"
    )]
    Impossible {
        /// When \[s\].
        t: f64,
    },
    /// The arm is thrown.
    #[error("a joint was faster than twice its speed limit at t = {t} s; the arm was braked")]
    TooFast {
        /// When \[s\].
        t: f64,
    },
    /// A command was not taken.
    #[error("the robot did not take a command: {0}")]
    Write(String),
    /// The law came to no torque.
    #[error("the torque at this state and reference is not finite")]
    Torque,
    /// A fault of the program, in its words.
    #[error("{0}")]
    Program(String),
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
