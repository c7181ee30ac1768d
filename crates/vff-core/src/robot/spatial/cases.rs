//! Random spatial arms and states for the unit tests.

use super::{SpatialArm, SpatialState};
use crate::math::Vector;
use crate::math::rotation::UnitQuaternion;
use crate::robot::description::{ArmDescription, Frame, Joint, JointKind};
use crate::robot::inertia::six;
use crate::robot::{PlanarArm, Robot};
use proptest::prelude::*;
use std::sync::Arc;

/// A random arm at a random state, and two more random joint vectors.
#[derive(Debug, Clone)]
pub struct Case {
    pub arm: Arc<SpatialArm>,
    pub q: Vec<f64>,
    pub dq: Vec<f64>,
    pub u: Vec<f64>,
    pub v: Vec<f64>,
}

impl Case {
    pub fn state(&self) -> SpatialState {
        self.at(&self.q, &self.dq)
    }

    pub fn at(&self, q: &[f64], dq: &[f64]) -> SpatialState {
        let mut state = self.arm.state();
        state.update(q, dq);
        state
    }

    /// The state a short time later, moving with constant q̇.
    pub fn later(&self, dt: f64) -> SpatialState {
        let q: Vec<_> = self.q.iter().zip(&self.dq).map(|(q, dq)| q + dt * dq).collect();
        self.at(&q, &self.dq)
    }
}

/// A rod of `length` along x, not quite thin, that turns about z at its end.
pub fn link(name: &str, length: f64) -> Joint {
    let across = length * length / 12.0;
    Joint {
        name: format!("{name}_joint"),
        link: name.into(),
        kind: JointKind::Revolute,
        position: [0.0; 3],
        orientation: Frame::default().orientation,
        axis: [0.0, 0.0, 1.0],
        mass: 1.0,
        com: [0.5 * length, 0.0, 0.0],
        inertia: [1e-3, across, across, 0.0, 0.0, 0.0],
        armature: 0.0,
        damping: 0.0,
        friction: 0.0,
    }
}

fn vector(size: f64) -> impl Strategy<Value = Vector<3>> {
    prop::array::uniform3(-size..size).prop_map(Vector::from)
}

fn placement(size: f64) -> impl Strategy<Value = Frame> {
    (vector(size), vector(3.0)).prop_map(|(position, phi)| Frame {
        position: position.into(),
        orientation: UnitQuaternion::exp(&phi).to_array(),
    })
}

/// A link of any placement, axis and full inertia tensor: that of three rods across each other, turned.
fn joint() -> impl Strategy<Value = Joint> {
    let kind = prop_oneof![
        3 => Just(JointKind::Revolute),
        1 => Just(JointKind::Continuous),
        2 => Just(JointKind::Prismatic),
    ];
    let axis = prop_oneof![
        Just(Vector::<3>::z()),
        Just(-Vector::<3>::y()),
        vector(1.0).prop_filter_map("no axis", |x| x.try_normalize(0.1)),
    ];
    let second_moments = prop::array::uniform3(0.002..0.05);
    let armature = prop_oneof![Just(0.0), 0.0..0.5];
    (kind, placement(0.6), axis, 0.3..4.0, vector(0.3), second_moments, vector(3.0), armature)
        .prop_map(|(kind, placement, axis, mass, com, [a, b, c], turn, armature)| {
            let diagonal = Vector::<3>::new(b + c, a + c, a + b) * mass;
            let r = UnitQuaternion::exp(&turn).matrix();
            let j = r * nalgebra::Matrix3::from_diagonal(&diagonal) * r.transpose();
            let Frame { position, orientation } = placement;
            Joint {
                kind,
                position,
                orientation,
                axis: axis.into(),
                mass,
                com: com.into(),
                inertia: six(&j),
                armature,
                ..link("", 1.0)
            }
        })
}

/// Arms of mixed joints, anywhere in the world, under gravity from any side.
pub fn case(joints: impl Strategy<Value = usize>) -> impl Strategy<Value = Case> {
    let joint_vector = || -3.0..3.0;
    joints
        .prop_flat_map(move |n| {
            (
                prop::collection::vec(joint(), n),
                (placement(3.0), placement(0.3), vector(10.0)),
                prop::array::uniform4(prop::collection::vec(joint_vector(), n)),
            )
        })
        .prop_map(|(mut joints, (mount, tool, gravity), [q, dq, u, v])| {
            for (i, joint) in joints.iter_mut().enumerate() {
                joint.name = format!("joint {i}");
                joint.link = format!("link {i}");
            }
            let gravity = gravity.into();
            let description =
                ArmDescription { joints, mount, tool, gravity, ..ArmDescription::default() };
            Case { arm: Arc::new(description.build().unwrap()), q, dq, u, v }
        })
}

/// A planar arm as a spatial one with axes z; if it is to `lift`, on a prismatic joint that moves all
/// of it along z, which nothing in the plane feels.
pub fn planar_twin(arm: &PlanarArm, lift: bool) -> Arc<SpatialArm> {
    let mut joints = vec![];
    if lift {
        joints.push(Joint { kind: JointKind::Prismatic, ..link("lift", 1.0) });
    }
    let mut at = [0.0; 3];
    for (i, planar) in arm.links().iter().enumerate() {
        // Where the mass is along z and what it opposes to a turn across z is the same to a planar arm.
        let across = 1.0 + planar.inertia;
        joints.push(Joint {
            position: at,
            mass: planar.mass,
            com: [planar.com.x, planar.com.y, 0.3],
            inertia: [across, across, planar.inertia, 0.0, 0.0, 0.0],
            ..link(&i.to_string(), 1.0)
        });
        at = [planar.length, 0.0, 0.0];
    }
    let tool = Frame { position: at, ..Frame::default() };
    let gravity = [arm.gravity().x, arm.gravity().y, -3.0];
    let description = ArmDescription { joints, tool, gravity, ..ArmDescription::default() };
    Arc::new(description.build().unwrap())
}

/// An arm with the joints of a Panda, and links of like size and mass.
pub fn panda_like() -> Arc<SpatialArm> {
    use std::f64::consts::FRAC_PI_2;
    // Denavit and Hartenberg's parameters in Craig's form: a, α, d.
    let rows = [
        (0.0, 0.0, 0.333),
        (0.0, -FRAC_PI_2, 0.0),
        (0.0, FRAC_PI_2, 0.316),
        (0.0825, FRAC_PI_2, 0.0),
        (-0.0825, -FRAC_PI_2, 0.384),
        (0.0, FRAC_PI_2, 0.0),
        (0.088, FRAC_PI_2, 0.0),
    ];
    let joint = |(i, (a, alpha, d)): (usize, (f64, f64, f64))| Joint {
        position: [a, -d * alpha.sin(), d * alpha.cos()],
        orientation: UnitQuaternion::exp(&Vector::<3>::new(alpha, 0.0, 0.0)).to_array(),
        mass: 3.0 - 0.3 * i as f64,
        com: [0.02, -0.03, 0.05],
        inertia: [0.02, 0.018, 0.012, 1e-3, -5e-4, 8e-4],
        ..link(&i.to_string(), 1.0)
    };
    let joint_limits = vec![
        [-2.9, 2.9],
        [-1.76, 1.76],
        [-2.9, 2.9],
        [-3.07, -0.07],
        [-2.9, 2.9],
        [-0.02, 3.75],
        [-2.9, 2.9],
    ];
    let tool = Frame { position: [0.0, 0.0, 0.107], ..Frame::default() };
    let joints = rows.into_iter().enumerate().map(joint).collect();
    let description = ArmDescription { joints, tool, joint_limits, ..ArmDescription::default() };
    Arc::new(description.build().unwrap())
}
