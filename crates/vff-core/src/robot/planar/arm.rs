//! The immutable parameters of a planar arm.

use super::{Annulus, Joint};
use crate::math::{Capsule, Vector};
use crate::robot::Limits;

/// The physical parameters of one link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Distance from this joint to the next \[m\], > 0.
    pub length: f64,
    /// Mass \[kg\], > 0.
    pub mass: f64,
    /// Centre of mass in the link's frame (x along the link) \[m\].
    pub com: Vector<2>,
    /// Moment of inertia about the centre of mass \[kg·m²\], ≥ 0.
    pub inertia: f64,
    /// Half the thickness of the link \[m\], ≥ 0.
    pub radius: f64,
}

impl Link {
    /// A uniform rod: centre of mass in the middle, inertia m l²/12.
    pub fn rod(length: f64, mass: f64) -> Self {
        Self {
            length,
            mass,
            com: Vector::<2>::new(0.5 * length, 0.0),
            inertia: mass * length * length / 12.0,
            radius: 0.0,
        }
    }

    /// The same link with a point mass \[kg\] at its far end.
    #[must_use]
    pub fn with_payload(self, payload: f64) -> Self {
        let tip = Vector::<2>::new(self.length, 0.0);
        let mass = self.mass + payload;
        let com = self.com + (tip - self.com) * (payload / mass);
        let about = |point: Vector<2>, mass: f64| mass * (point - com).norm_squared();
        let inertia = self.inertia + about(self.com, self.mass) + about(tip, payload);
        Self { mass, com, inertia, ..self }
    }
}

/// The immutable parameters of a planar arm, shared by every state.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::robot::planar::{Annulus, Link};
/// use vff_core::robot::{Limits, Model, PlanarArm};
///
/// let arm = PlanarArm::new(vec![Link::rod(0.5, 2.0); 3], Vector::<2>::new(0.0, -9.81));
/// let Annulus { inner, outer } = arm.annulus(3);
/// assert_eq!((inner, outer), (0.0, 1.5));
/// let limits = Limits { torque: vec![40.0; 3], ..Limits::default() };
/// assert_eq!(arm.with_limits(limits).limits().torque, [40.0; 3]);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PlanarArm {
    pub(super) links: Vec<Link>,
    pub(super) gravity: Vector<2>,
    pub(super) composite: Vec<Composite>,
    pub(super) total_mass: f64,
    pub(super) limits: Limits,
}

/// What the recursions need of a link and of the mass it carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Composite {
    /// `m_i c_i + l_i Σ_{k>i} m_k` in the link's frame \[kg·m\].
    pub(super) moment: Vector<2>,
    /// `I_i + m_i|c_i|² + l_i² Σ_{k>i} m_k` \[kg·m²\].
    pub(super) diagonal: f64,
    /// `I_i + m_i|c_i|²` \[kg·m²\].
    pub(super) about_joint: f64,
    /// Length \[m\] and mass \[kg\] of the link, and the mass that it carries at its far end \[kg\].
    pub(super) length: f64,
    pub(super) mass: f64,
    pub(super) carried: f64,
}

impl PlanarArm {
    /// An arm of at least one link. `gravity` is the acceleration of free fall \[m/s²\].
    ///
    /// The values are taken as they are; `scenario` validates user input.
    pub fn new(links: Vec<Link>, gravity: Vector<2>) -> Self {
        let mut distal = 0.0;
        let mut composite: Vec<_> = links
            .iter()
            .rev()
            .map(|link| {
                let about_joint = link.inertia + link.mass * link.com.norm_squared();
                let carried = distal;
                distal += link.mass;
                Composite {
                    moment: link.com * link.mass + Vector::<2>::new(link.length * carried, 0.0),
                    diagonal: about_joint + link.length * link.length * carried,
                    about_joint,
                    length: link.length,
                    mass: link.mass,
                    carried,
                }
            })
            .collect();
        composite.reverse();
        Self { links, gravity, composite, total_mass: distal, limits: Limits::default() }
    }

    /// The same arm with limits of its joints.
    #[must_use]
    pub fn with_limits(self, limits: Limits) -> Self {
        Self { limits, ..self }
    }

    /// The links from base to tip.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// The acceleration of free fall \[m/s²\].
    pub fn gravity(&self) -> Vector<2> {
        self.gravity
    }

    /// Where `links` links from the base can put their far end.
    pub fn annulus(&self, links: usize) -> Annulus {
        let lengths = || self.links[..links].iter().map(|l| l.length);
        let outer: f64 = lengths().sum();
        let longest = lengths().fold(0.0, f64::max);
        Annulus { inner: (2.0 * longest - outer).max(0.0), outer }
    }
}

/// What a link takes up.
#[inline(always)]
pub(super) fn capsule(joint: &Joint, link: &Link) -> Capsule<2> {
    let Link { length, radius, .. } = *link;
    Capsule { start: joint.position, direction: joint.x, length, radius }
}
