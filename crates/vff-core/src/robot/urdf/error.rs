//! What can be wrong with a model of a robot, and how it is said.

use super::super::description::{DescriptionError, UNIT_TOLERANCE};
use super::super::inertia::Impossible;
use super::super::names::{hint, list};
use super::{Kind, MAX_BYTES};

/// Which of the XML texts is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Xml {
    /// The robot.
    Urdf,
    /// Its pairs of links that are not measured.
    Srdf,
}

impl std::fmt::Display for Xml {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Urdf => "URDF",
            Self::Srdf => "SRDF",
        })
    }
}

/// Why a model was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UrdfError {
    /// More text than any robot needs.
    #[error("the {format} has {given} bytes; at most {MAX_BYTES} are read")]
    TooLong {
        /// URDF or SRDF.
        format: Xml,
        /// Bytes of the text.
        given: usize,
    },
    /// More elements than any robot needs.
    #[error("the {0} has more than {limit} elements and texts", limit = super::parse::MAX_NODES)]
    TooManyElements(Xml),
    /// More attributes than any element needs.
    #[error("an element of the {0} has more than {limit} attributes", limit = super::parse::MAX_ATTRIBUTES)]
    TooManyAttributes(Xml),
    /// Not XML; the message shows line and column.
    #[error("the {format} is not well-formed XML: {message}")]
    Malformed {
        /// URDF or SRDF.
        format: Xml,
        /// What the parser says.
        message: String,
    },
    /// A document type or entities, which could fetch or blow up to anything.
    #[error(
        "the {0} has a document type declaration (DTD) with entities, which are not read; expand them first"
    )]
    Entities(Xml),
    /// Something else in XML.
    #[error("the root element is <{found}>, expected <robot>{}", match found.as_str() {
        "mujoco" => ": this is MJCF, use from_mjcf",
        "sdf" => ": this is SDF; convert it to URDF first",
        _ => "",
    })]
    NotARobot {
        /// Name of the root element.
        found: String,
    },
    /// A robot where its pairs of links are expected.
    #[error("the SRDF is a URDF: it has links of its own")]
    NotAnSrdf,
    /// Unexpanded macros.
    #[error(
        "{place}: `{text}` is a xacro expression; expand the file first: xacro FILE > robot.urdf"
    )]
    Xacro {
        /// Where.
        place: String,
        /// What stands there.
        text: String,
    },
    /// An element or attribute that has to be there.
    #[error("{place}: {what} is missing")]
    Missing {
        /// Where.
        place: String,
        /// What.
        what: &'static str,
    },
    /// Text in place of numbers.
    #[error("{place}: expected {expected}, got `{given}`")]
    NotNumbers {
        /// Where.
        place: String,
        /// How many.
        expected: String,
        /// What stands there.
        given: String,
    },
    /// Infinite, not a number, or not in its range.
    #[error("{place}: must be {requirement}, got {given}")]
    OutOfRange {
        /// Where.
        place: String,
        /// What would be right.
        requirement: &'static str,
        /// What was given.
        given: f64,
    },
    /// An axis or quaternion of another length than 1.
    #[error("{place}: must have length 1 (within {UNIT_TOLERANCE}), has {norm}")]
    NotUnit {
        /// Where.
        place: String,
        /// Its length.
        norm: f64,
    },
    /// A joint type that URDF does not have.
    #[error(
        "joint `{joint}`: unknown type `{given}`; there are revolute, continuous, prismatic, fixed, floating, planar"
    )]
    UnknownKind {
        /// The joint.
        joint: String,
        /// The type.
        given: String,
    },
    /// Two links or joints of the same name.
    #[error("there are two {what}s named `{name}`")]
    Twice {
        /// Link or joint.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A name that nothing has.
    #[error("{place}: there is no {what} `{given}`{}", hint(given, known))]
    Unknown {
        /// Where the name stands.
        place: String,
        /// Link or joint.
        what: &'static str,
        /// The name.
        given: String,
        /// The names that exist.
        known: Vec<String>,
    },
    /// A link that hangs on two joints.
    #[error(
        "link `{link}` is the child of two joints, `{first}` and `{second}`: closed loops are not read"
    )]
    TwoParents {
        /// The link.
        link: String,
        /// A joint.
        first: String,
        /// Another.
        second: String,
    },
    /// Links that carry each other in a circle.
    #[error("the joints form a circle through the links {}", list(links))]
    Cycle {
        /// Their names.
        links: Vec<String>,
    },
    /// Several trees.
    #[error("{} links are the child of no joint: {}; a robot has one root", roots.len(), list(roots))]
    SeveralRoots {
        /// Their names.
        roots: Vec<String>,
    },
    /// No links at all.
    #[error("the robot has no links")]
    Empty,
    /// No single end to choose.
    #[error("which tip? `{base}` leads to {} ends, likely ones first: {}; name one, or any link on the way", leaves.len(), list(leaves))]
    WhichTip {
        /// Where the chain begins.
        base: String,
        /// The links without children.
        leaves: Vec<String>,
    },
    /// A base that is no ancestor of the tip.
    #[error("the tip `{tip}` does not hang on the base `{base}`; it hangs on {}", list(above))]
    NotBelow {
        /// The tip.
        tip: String,
        /// The base.
        base: String,
        /// All links between the root and the tip.
        above: Vec<String>,
    },
    /// Nothing moves.
    #[error("no joint moves between `{base}` and `{tip}`")]
    NoJoints {
        /// The base.
        base: String,
        /// The tip.
        tip: String,
    },
    /// A joint with more than one degree of freedom.
    #[error("joint `{joint}` is {}: only revolute, continuous and prismatic joints can be driven or locked; replace it by such, or choose a base beyond it", kind.name())]
    Unsupported {
        /// The joint.
        joint: String,
        /// Floating, planar or ball.
        kind: Kind,
    },
    /// A joint on the chain that another drives.
    #[error(
        "joint `{joint}` lies on the chain and mimics `{driver}`: one motor for two joints is not modelled; lock one of them"
    )]
    MimicOnChain {
        /// The joint.
        joint: String,
        /// What it mimics.
        driver: String,
    },
    /// A joint off the chain that a moving joint drives.
    #[error(
        "joint `{joint}` is off the chain and mimics `{driver}`, which moves: what it carries has no fixed place; lock one of them"
    )]
    MimicOfMoving {
        /// The joint.
        joint: String,
        /// What it mimics.
        driver: String,
    },
    /// Joints that mimic each other in a circle.
    #[error("joint `{0}` mimics itself, directly or through others")]
    MimicCycle(String),
    /// A joint that cannot move.
    #[error(
        "joint `{joint}`: the limits [{lower}, {upper}] leave it no room; lock it, or give it limits"
    )]
    NoRoom {
        /// The joint.
        joint: String,
        /// Its lower limit.
        lower: f64,
        /// Its upper limit.
        upper: f64,
    },
    /// A link that moves but weighs nothing.
    #[error(
        "link `{link}` moves with joint `{joint}` but has no mass, and neither has anything fixed to it; give it a mass, or lock the joint"
    )]
    Massless {
        /// The link.
        link: String,
        /// The joint that moves it.
        joint: String,
    },
    /// An inertia tensor that no mass distribution has.
    #[error("link `{link}`: {problem}; fix_inertia=True takes the nearest that is possible")]
    Inertia {
        /// The link.
        link: String,
        /// Which inequality fails, and by how much.
        problem: Impossible,
    },
    /// A list of another length than the number of joints.
    #[error("{what}: expected one value or {expected}, one per moving joint, got {given}")]
    WrongLength {
        /// Which list.
        what: &'static str,
        /// The number of moving joints.
        expected: usize,
        /// How many there are.
        given: usize,
    },
    /// A value of the finished description.
    #[error(transparent)]
    Description(#[from] DescriptionError),
}
