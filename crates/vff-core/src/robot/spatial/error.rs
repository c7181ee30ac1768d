//! What can be wrong with the description of a spatial arm, and how it is said.

use crate::math::rotation::UNIT_TOLERANCE;

/// Why a description is no arm.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArmError {
    /// No joint at all.
    #[error("an arm needs at least one joint")]
    Empty,
    /// A number that is not finite.
    #[error("{what} must be a finite number")]
    NotFinite {
        /// Which number: "the mass of link `forearm`".
        what: String,
    },
    /// Two joints or two links of the same name.
    #[error("two {what}s are called `{name}`")]
    DuplicateName {
        /// "joint" or "link".
        what: &'static str,
        /// The name.
        name: String,
    },
    /// An axis that is no direction.
    #[error(
        "the axis of joint `{joint}` has length {norm}, which must be 1 within {UNIT_TOLERANCE}"
    )]
    Axis {
        /// The joint.
        joint: String,
        /// The length of the axis as given.
        norm: f64,
    },
    /// A quaternion that is no rotation.
    #[error("the orientation of {what} has norm {norm}, which must be 1 within {UNIT_TOLERANCE}")]
    Orientation {
        /// Whose orientation: "joint `elbow`", "the mount" or "the tool".
        what: String,
        /// The norm of the quaternion as given.
        norm: f64,
    },
    /// A link that moves without mass.
    #[error("link `{link}` has a mass of {mass} kg; a link that moves needs a mass above 0")]
    Mass {
        /// The link.
        link: String,
        /// Its mass as given \[kg\].
        mass: f64,
    },
    /// A principal moment below zero.
    #[error(
        "the inertia of link `{link}` has the principal moment {moment} kg·m², which must not be negative"
    )]
    NegativeInertia {
        /// The link.
        link: String,
        /// The smallest principal moment \[kg·m²\].
        moment: f64,
    },
    /// Principal moments that no distribution of mass has.
    #[error(
        "the inertia of link `{link}` belongs to no distribution of mass: its largest principal moment {} kg·m² exceeds the sum of the other two, {} + {}, by {}",
        .moments[2], .moments[0], .moments[1], .moments[2] - .moments[0] - .moments[1]
    )]
    TriangleInequality {
        /// The link.
        link: String,
        /// The principal moments about the centre of mass, ascending \[kg·m²\].
        moments: [f64; 3],
    },
    /// A joint that moves nothing that resists it.
    #[error(
        "joint `{joint}` turns its link without inertia: give `{link}` an inertia about the axis, or the joint an armature"
    )]
    NoInertia {
        /// The joint.
        joint: String,
        /// Its link.
        link: String,
    },
    /// An armature below zero.
    #[error("the armature of joint `{joint}` is {armature}, which must not be negative")]
    Armature {
        /// The joint.
        joint: String,
        /// Its armature as given \[kg·m², kg\].
        armature: f64,
    },
    /// A list of limits of another length.
    #[error("there are {given} {what} limits for {joints} joints")]
    LimitCount {
        /// "position", "velocity" or "torque".
        what: &'static str,
        /// How many there are.
        given: usize,
        /// The number of joints.
        joints: usize,
    },
    /// A range without extent, or not a number.
    #[error(
        "joint `{joint}` is limited to [{lower}, {upper}]: the lower limit must be below the upper"
    )]
    LimitOrder {
        /// The joint.
        joint: String,
        /// Its limits as given.
        lower: f64,
        /// Its limits as given.
        upper: f64,
    },
    /// A continuous joint with an end.
    #[error(
        "joint `{joint}` is continuous and has limits of position: a joint with limits is revolute"
    )]
    ContinuousLimit {
        /// The joint.
        joint: String,
    },
    /// A limit that allows nothing.
    #[error("the {what} limit of joint `{joint}` is {limit}, which must be above 0")]
    LimitSign {
        /// "velocity" or "torque".
        what: &'static str,
        /// The joint.
        joint: String,
        /// The limit as given.
        limit: f64,
    },
    /// A collision body on a link that does not exist.
    #[error("collision body {body} is on link {link}, but the arm has {links} links")]
    BodyLink {
        /// The index of the body.
        body: usize,
        /// The index of the link as given.
        link: usize,
        /// The number of links.
        links: usize,
    },
    /// A collision body with a negative radius.
    #[error("the radius of collision body {body} is {radius} m, which must not be negative")]
    BodyRadius {
        /// The index of the body.
        body: usize,
        /// Its radius as given \[m\].
        radius: f64,
    },
}
