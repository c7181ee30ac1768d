//! A robot as links and joints, as URDF and MJCF have it.

use super::super::description::{Frame, JointKind};
use serde::{Deserialize, Serialize};

/// All links and joints of a robot.
///
/// # Example
/// ```
/// use vff_core::robot::urdf::{Geometry, Kind, Link, Mimic, Tree, TreeJoint, parse};
///
/// let Tree { links, joints, .. } = parse(
///     r#"<robot name="gripper"><link name="palm"/><link name="finger"/>
///         <joint name="grip" type="prismatic">
///             <parent link="palm"/><child link="finger"/>
///             <limit lower="0" upper="0.04" effort="10" velocity="0.1"/>
///         </joint></robot>"#,
/// )
/// .unwrap();
/// let TreeJoint { kind, mimic, .. } = &joints[0];
/// assert_eq!(*kind, Kind::Prismatic);
/// let mimic: &Option<Mimic> = mimic;
/// let carried: &[Geometry] = &links[1].geometry;
/// assert!(mimic.is_none() && carried.is_empty());
/// let Link { name, .. } = &links[0];
/// assert_eq!(name, "palm");
/// ```
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tree {
    /// Of the robot.
    #[serde(default)]
    pub name: String,
    /// In the order of the file.
    pub links: Vec<Link>,
    /// In the order of the file.
    pub joints: Vec<TreeJoint>,
    /// What was odd in the file.
    #[serde(default)]
    pub warnings: Vec<String>,
}

/// A body.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// Of the link.
    pub name: String,
    /// \[kg\].
    #[serde(default)]
    pub mass: f64,
    /// Centre of mass in the link's frame \[m\].
    #[serde(default)]
    pub com: [f64; 3],
    /// `[xx, yy, zz, xy, xz, yz]` about the centre of mass, in the link's axes \[kg·m²\].
    #[serde(default)]
    pub inertia: [f64; 6],
    /// What collides.
    #[serde(default)]
    pub geometry: Vec<Geometry>,
}

/// A form at a place of a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// The link of the file that it belongs to.
    pub link: String,
    /// Where it is.
    #[serde(default)]
    pub frame: Frame,
    /// What it is.
    pub form: Form,
}

/// What collides, in its own frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Form {
    /// About the origin, edges along the axes.
    Box {
        /// Lengths of the edges \[m\].
        size: [f64; 3],
    },
    /// About the origin, along z.
    Cylinder {
        /// \[m\].
        radius: f64,
        /// \[m\].
        length: f64,
    },
    /// About the origin, along z.
    Capsule {
        /// \[m\].
        radius: f64,
        /// Between the centres of the caps \[m\].
        length: f64,
    },
    /// About the origin.
    Sphere {
        /// \[m\].
        radius: f64,
    },
    /// A file of triangles.
    Mesh {
        /// As the model has it.
        file: String,
        /// Along the axes of the file.
        scale: [f64; 3],
    },
}

/// How a joint of a file moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Not at all.
    Fixed,
    /// Turns.
    Revolute,
    /// Turns without end.
    Continuous,
    /// Slides.
    Prismatic,
    /// Turns about a point.
    Ball,
    /// Six degrees of freedom.
    Floating,
    /// Three in a plane.
    Planar,
}

impl Kind {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fixed => "fixed",
            Self::Revolute => "revolute",
            Self::Continuous => "continuous",
            Self::Prismatic => "prismatic",
            Self::Ball => "a ball joint",
            Self::Floating => "floating",
            Self::Planar => "planar",
        }
    }
}

/// A joint of a file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TreeJoint {
    /// Of the joint.
    pub name: String,
    /// How it moves.
    pub kind: Kind,
    /// The link that it hangs on.
    pub parent: String,
    /// The link that it carries.
    pub child: String,
    /// Its place at q = 0 in the frame of the parent.
    #[serde(default)]
    pub frame: Frame,
    /// Unit vector in the joint's frame.
    #[serde(default)]
    pub axis: [f64; 3],
    /// `[lower, upper]` \[rad or m\].
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Largest speed \[rad/s or m/s\]; 0 or less for none.
    #[serde(default)]
    pub velocity: f64,
    /// Largest torque or force \[N·m or N\]; 0 or less for none.
    #[serde(default)]
    pub torque: f64,
    /// Inertia of the rotor \[kg·m² or kg\].
    #[serde(default)]
    pub armature: f64,
    /// Viscous friction \[N·m·s/rad or N·s/m\].
    #[serde(default)]
    pub damping: f64,
    /// Dry friction \[N·m or N\].
    #[serde(default)]
    pub friction: f64,
    /// Another joint that drives it.
    #[serde(default)]
    pub mimic: Option<Mimic>,
}

/// q = multiplier · q(driver) + offset.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mimic {
    /// The driver.
    pub joint: String,
    /// Of the driver's position.
    pub multiplier: f64,
    /// \[rad or m\].
    pub offset: f64,
}

impl Tree {
    pub(super) fn link_names(&self) -> Vec<String> {
        self.links.iter().map(|link| link.name.clone()).collect()
    }

    pub(super) fn joint_names(&self) -> Vec<String> {
        self.joints.iter().map(|joint| joint.name.clone()).collect()
    }
}

impl TreeJoint {
    /// How it moves, if a chain can have it as a joint.
    pub(super) fn moves(&self) -> Option<JointKind> {
        match self.kind {
            Kind::Revolute => Some(JointKind::Revolute),
            Kind::Continuous => Some(JointKind::Continuous),
            Kind::Prismatic => Some(JointKind::Prismatic),
            Kind::Fixed | Kind::Ball | Kind::Floating | Kind::Planar => None,
        }
    }
}
