//! What a call can come to.

use std::ffi::c_char;
use std::io;
use vff_core::control::output::BeginError;
use vff_core::math::rotation::NotARotation;
use vff_core::perception::PerceptionError;
use vff_core::runtime::{CycleError, MissedStart, PointsError, SuccessionError, VirtualArmError};
use vff_core::scenario::ScenarioError;

/// What a call came to. Whatever is not `VFF_STATUS_OK` has changed nothing, has written nothing, and has left a sentence in
/// `vff_last_message`.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// A pointer is NULL that must not be.
    Null = 1,
    /// An array has the wrong length.
    Length = 2,
    /// A number is infinite or not a number, or a period that is not greater than 0.
    NotFinite = 3,
    /// A text or what it describes is not what it must be. The message says where.
    Document = 4,
    /// A file cannot be read.
    File = 5,
    /// The numbers are no reference, pose or orientation: the quaternion is not of norm 1. Or the robot is not where the reference of the
    /// scenario begins.
    Reference = 6,
    /// There is no reference yet.
    NoReference = 7,
    /// No state was observed since the last torque or change of the obstacles, or there is no torque yet.
    NotObserved = 8,
    /// There is no such obstacle.
    NoObstacle = 9,
    /// The obstacle is no cloud of points, or not any longer.
    NotACloud = 10,
    /// More than there is room for.
    TooMany = 11,
    /// A torque held over that period makes the arm oscillate.
    Period = 12,
    /// The torque is not finite: state and reference are beyond what numbers can hold. The next call begins anew, which allocates.
    Torque = 13,
    /// Another thread is in a call with the same object.
    Busy = 14,
    /// A fault of vffnull itself, please report it. The object can be freed, and nothing else.
    Panic = 15,
    /// No loop has begun.
    NotBegun = 16,
    /// The law before is still being left, or blended in.
    Succeeding = 17,
    /// A time is not later than the last one.
    NotLater = 18,
    /// There is no such camera.
    NoCamera = 19,
}

/// A fault, with its sentence.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Fault {
    #[error("{0} is NULL")]
    Null(&'static str),
    #[error("{name}: expected {expected} numbers, got {given}")]
    Length { name: &'static str, expected: usize, given: usize },
    #[error("{name}[{index}] must be finite, got {value}")]
    NotFinite { name: &'static str, index: usize, value: f64 },
    #[error("{name} is not UTF-8")]
    NotText { name: &'static str },
    #[error(transparent)]
    Document(#[from] ScenarioError),
    #[error("{path}: {error}")]
    File { path: String, error: io::Error },
    #[error("x_ref: {0}")]
    Reference(#[from] NotARotation),
    #[error("{0}: {1}")]
    Turn(&'static str, NotARotation),
    #[error("there is no reference: call vff_controller_set_reference first")]
    NoReference,
    #[error("there is no reference of a scenario to follow")]
    NoScenario,
    #[error("no state was observed since the last torque: call vff_controller_observe first")]
    NotObserved,
    #[error("there is no torque yet: call vff_controller_torque first")]
    NoTorque,
    #[error("there is no obstacle {0}")]
    NoObstacle(u32),
    #[error(transparent)]
    Points(#[from] PointsError),
    #[error("the cloud has room for {most} points, got {given}")]
    Room { most: usize, given: usize },
    #[error("the cloud's obstacle or controller is not there any longer")]
    Gone,
    #[error("period must be finite and greater than 0, got {0}")]
    NoPeriod(f64),
    #[error("{0}")]
    Period(String),
    #[error(
        "the torque at this state and reference is not finite: they are beyond what numbers can hold"
    )]
    Torque,
    #[error(transparent)]
    TooLong(BeginError),
    #[error(transparent)]
    Elsewhere(MissedStart),
    #[error("no loop has begun: call vff_controller_begin first")]
    NotBegun,
    #[error("there is no set point: call vff_controller_begin_set_points first")]
    NoSetPoints,
    #[error(transparent)]
    Limits(VirtualArmError),
    #[error(transparent)]
    Succession(SuccessionError),
    #[error(transparent)]
    Perception(#[from] PerceptionError),
    #[error("depth: expected {} rows and {} columns, got {} and {}", expected[0], expected[1], given[0], given[1])]
    Picture { expected: [usize; 2], given: [usize; 2] },
    #[error("row_bytes: a row has {expected} bytes, got {given}")]
    RowBytes { expected: usize, given: usize },
    #[error("another thread is in a call with the same {0}")]
    Busy(&'static str),
    #[error("a fault of vffnull itself, please report it: {0}")]
    Panic(String),
    #[error("an earlier call ended in a fault of vffnull itself; free the {0} and make another")]
    Broken(&'static str),
}

impl From<BeginError> for Fault {
    fn from(error: BeginError) -> Self {
        match error {
            BeginError::Period(given) => Self::NoPeriod(given),
            error => Self::TooLong(error),
        }
    }
}

impl From<VirtualArmError> for Fault {
    fn from(error: VirtualArmError) -> Self {
        match error {
            VirtualArmError::Length { name, expected, given } => {
                Self::Length { name, expected, given }
            }
            VirtualArmError::NotFinite { index, given } => {
                Self::NotFinite { name: "q", index, value: given }
            }
            VirtualArmError::NotPositive { name: "period", given } => Self::NoPeriod(given),
            VirtualArmError::Elsewhere(missed) => Self::Elsewhere(missed),
            VirtualArmError::Gain(error) => error.into(),
            error => Self::Limits(error),
        }
    }
}

impl From<SuccessionError> for Fault {
    fn from(error: SuccessionError) -> Self {
        match error {
            SuccessionError::Room(error) => Self::Document(error),
            SuccessionError::Period(error) => error.into(),
            error => Self::Succession(error),
        }
    }
}

impl From<CycleError> for Fault {
    fn from(error: CycleError) -> Self {
        match error {
            CycleError::NotBegun => Self::NotBegun,
            CycleError::Target(fault) => Self::Reference(fault),
            CycleError::Elsewhere(missed) => Self::Elsewhere(missed),
        }
    }
}

impl Fault {
    pub(crate) fn status(&self) -> Status {
        match self {
            Self::Null(_) => Status::Null,
            Self::Length { .. } | Self::Picture { .. } | Self::RowBytes { .. } => Status::Length,
            Self::NotFinite { .. } | Self::NoPeriod(_) => Status::NotFinite,
            Self::NotText { .. } | Self::Document(_) => Status::Document,
            Self::File { .. } => Status::File,
            Self::Reference(_) | Self::Turn(..) | Self::Elsewhere(_) => Status::Reference,
            Self::NoReference | Self::NoScenario => Status::NoReference,
            Self::NotObserved | Self::NoTorque => Status::NotObserved,
            Self::NoObstacle(_) => Status::NoObstacle,
            Self::Points(PointsError::TooMany(_) | PointsError::NoRoom(_)) | Self::Room { .. } => {
                Status::TooMany
            }
            Self::Points(_) | Self::Gone => Status::NotACloud,
            Self::Period(_) | Self::TooLong(_) => Status::Period,
            Self::NotBegun | Self::NoSetPoints => Status::NotBegun,
            Self::Succession(SuccessionError::Succeeding) => Status::Succeeding,
            Self::Limits(_) | Self::Succession(_) => Status::Document,
            Self::Torque => Status::Torque,
            Self::Perception(error) => match error {
                PerceptionError::NotThere { .. } => Status::NoCamera,
                PerceptionError::NotLater { .. } => Status::NotLater,
                PerceptionError::NoState { .. } => Status::NotObserved,
                PerceptionError::Size { .. }
                | PerceptionError::State { .. }
                | PerceptionError::Joints { .. } => Status::Length,
                PerceptionError::NoCamera
                | PerceptionError::Camera { .. }
                | PerceptionError::Known { .. }
                | PerceptionError::Setting { .. } => Status::Document,
            },
            Self::Busy(_) => Status::Busy,
            Self::Panic(_) | Self::Broken(_) => Status::Panic,
        }
    }
}

/// The name of a status, such as "VFF_STATUS_OK"; "?" for a number that is none.
#[unsafe(no_mangle)]
pub extern "C" fn vff_status_name(status: i32) -> *const c_char {
    const NAMES: [&str; 20] = [
        "VFF_STATUS_OK\0",
        "VFF_STATUS_NULL\0",
        "VFF_STATUS_LENGTH\0",
        "VFF_STATUS_NOT_FINITE\0",
        "VFF_STATUS_DOCUMENT\0",
        "VFF_STATUS_FILE\0",
        "VFF_STATUS_REFERENCE\0",
        "VFF_STATUS_NO_REFERENCE\0",
        "VFF_STATUS_NOT_OBSERVED\0",
        "VFF_STATUS_NO_OBSTACLE\0",
        "VFF_STATUS_NOT_A_CLOUD\0",
        "VFF_STATUS_TOO_MANY\0",
        "VFF_STATUS_PERIOD\0",
        "VFF_STATUS_TORQUE\0",
        "VFF_STATUS_BUSY\0",
        "VFF_STATUS_PANIC\0",
        "VFF_STATUS_NOT_BEGUN\0",
        "VFF_STATUS_SUCCEEDING\0",
        "VFF_STATUS_NOT_LATER\0",
        "VFF_STATUS_NO_CAMERA\0",
    ];
    let name = usize::try_from(status).ok().and_then(|status| NAMES.get(status));
    name.unwrap_or(&"?\0").as_ptr().cast()
}
