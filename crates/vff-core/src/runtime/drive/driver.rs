//! What a robot is to the loop that drives it.

/// What a robot takes in every period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CommandKind {
    /// Joint torques \[N·m, N\].
    #[default]
    Torque,
    /// Joint positions \[rad, m\].
    Position,
    /// Joint velocities \[rad/s, m/s\].
    Velocity,
}

impl CommandKind {
    /// Every kind, with its name.
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Torque, "torque"), (Self::Position, "position"), (Self::Velocity, "velocity")];

    /// The kind of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, each)| *each == name).map(|(kind, _)| *kind)
    }
}

/// A robot: a state comes from it, and a command goes to it, once per period.
///
/// All methods are called from the thread of the loop. None may wait longer than a period, with one exception: a robot that
/// [`paces`](Self::paces) the loop waits in [`read`](Self::read) for its next state. An error ends the drive; it is to say in a few words what
/// went wrong. The errors are texts, because nothing is done about them but to tell people.
///
/// # Example
/// A robot that stands still and takes any torque:
/// ```
/// use vff_core::runtime::drive::{CommandKind, Driver};
///
/// struct Still(f64);
///
/// impl Driver for Still {
///     fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
///         (q.fill(0.5), dq.fill(0.0));
///         self.0 += 0.001;
///         Ok(self.0) // the time of this state
///     }
///
///     fn write(&mut self, command: &[f64]) -> Result<(), String> {
///         command.iter().all(|tau| tau.is_finite()).then_some(()).ok_or("no torque".into())
///     }
/// }
///
/// assert_eq!(CommandKind::named("torque"), Some(CommandKind::Torque));
/// assert_eq!(Still(0.0).read(&mut [0.0], &mut [0.0]), Ok(0.001));
/// ```
pub trait Driver {
    /// What it takes.
    fn kind(&self) -> CommandKind {
        CommandKind::Torque
    }

    /// Whether `read` waits for the next state, so that the robot's clock is that of the loop.
    fn paces(&self) -> bool {
        false
    }

    /// Called once, before the first state is read.
    ///
    /// # Errors
    /// If the robot cannot be driven.
    fn begin(&mut self) -> Result<(), String> {
        Ok(())
    }

    /// Writes the joint positions \[rad, m\] and velocities \[rad/s, m/s\], and returns the robot's time \[s\], which goes on
    /// from state to state.
    ///
    /// # Errors
    /// If there is no state.
    fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String>;

    /// The torque that acts at the moment \[N·m, N\], as far as the robot knows it: what a start blends in from. It is asked for once,
    /// after the first state was read.
    ///
    /// # Errors
    /// If it could not be asked for.
    fn torque(&mut self, tau: &mut [f64]) -> Result<bool, String> {
        let _ = tau;
        Ok(false)
    }

    /// The torque from outside at the state that was read last \[N·m, N\], if the robot measures it. It is asked for at the beginning
    /// where there is an observer, and in every period where that follows it.
    ///
    /// # Errors
    /// If it could not be asked for.
    fn external_torque(&mut self, tau: &mut [f64]) -> Result<bool, String> {
        let _ = tau;
        Ok(false)
    }

    /// Takes a command of its [`kind`](Self::kind), to hold until the next.
    ///
    /// # Errors
    /// If it could not be sent.
    fn write(&mut self, command: &[f64]) -> Result<(), String>;

    /// Called once, after the last command, whatever has happened.
    ///
    /// # Errors
    /// If the robot did not take leave.
    fn end(&mut self) -> Result<(), String> {
        Ok(())
    }

    /// Does one period of work. Whoever needs something for all of it, such as a lock, has it taken meanwhile.
    fn cycle<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T
    where
        Self: Sized,
    {
        work(self)
    }
}
