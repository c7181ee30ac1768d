//! A [`Tree`] to the serial chain from a base to a tip.

use super::super::description::{ArmDescription, Frame, Joint};
use super::super::inertia::{self, Body};
use super::super::inertia::{six, tensor};
use super::super::names::list;
use super::UrdfError;
use super::index::Index;
use super::parse::unit;
use super::role::Role;
use super::srdf::disabled_pairs;
use super::tree::{Geometry, Kind, Link, Tree, TreeJoint};
use super::units::doubts;
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// What the reader is asked for.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Where the chain begins; the root by default.
    pub base: Option<String>,
    /// The link where it ends; the only link without children by default.
    pub tip: Option<String>,
    /// Joints that do not move, and where they stand \[rad or m\]. Those off the chain are locked
    /// anyway, at 0 unless they are named here.
    pub locked: BTreeMap<String, f64>,
    /// The tip in the frame of the link `tip`.
    pub tool: Frame,
    /// The base in the world.
    pub mount: Frame,
    /// In the world \[m/s²\]; −9.81 along z by default.
    pub gravity: Option<[f64; 3]>,
    /// Inertias of the rotors, instead of those in the file: one for all, or one per moving joint.
    pub armature: Vec<f64>,
    /// Whether impossible inertia tensors are replaced by the nearest possible ones.
    pub fix_inertia: bool,
    /// Text of an SRDF.
    pub srdf: Option<String>,
}

/// What was read.
///
/// # Example
/// ```
/// use vff_core::robot::urdf::{self, LinkGeometry, Form, Options, UrdfError, Xml};
///
/// let text = r#"<robot name="pendulum">
///     <link name="base"/>
///     <link name="rod">
///         <inertial><origin xyz="0 0 0.5"/><mass value="1"/>
///             <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
///         <collision><geometry><sphere radius="0.1"/></geometry></collision>
///     </link>
///     <joint name="hinge" type="continuous">
///         <parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
///     </joint>
/// </robot>"#;
/// let reading = urdf::read(text, &Options::default()).unwrap();
/// assert_eq!(reading.arm.joints[0].name, "hinge");
/// let LinkGeometry { on, geometry } = &reading.geometry[0];
/// assert!(on == "rod" && matches!(geometry.form, Form::Sphere { .. }));
/// let error = urdf::read("<robot", &Options::default()).unwrap_err();
/// assert!(matches!(error, UrdfError::Malformed { format: Xml::Urdf, .. }));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reading {
    /// The arm; its `collision` is empty, for that is made of `geometry`.
    pub arm: ArmDescription,
    /// What collides, with the link of the arm that carries it.
    pub geometry: Vec<LinkGeometry>,
    /// Joints that were locked, and where.
    pub locked: BTreeMap<String, f64>,
    /// For each link of the arm those of the file that became part of it.
    pub merged: BTreeMap<String, Vec<String>>,
    /// What is odd.
    pub warnings: Vec<String>,
}

/// What a joint is taken to do where others have limits and it has none: more than any robot \[rad/s, m/s\], \[N·m, N\].
const UNLIMITED: [f64; 2] = [100.0, 1e5];
/// A stop beyond this is none \[rad or m\].
const FAR: f64 = 1e9;

/// A form of the file on a link of the arm.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LinkGeometry {
    /// The link of the arm.
    pub on: String,
    /// The form, in the frame of that link.
    #[serde(flatten)]
    pub geometry: Geometry,
}

impl TreeJoint {
    /// What moving to `q` does to the child, in the frame of the joint.
    fn motion(&self, q: f64) -> Isometry3<f64> {
        let axis = Vector3::from(self.axis);
        match self.kind {
            Kind::Revolute | Kind::Continuous => Isometry3::from_parts(
                Translation3::identity(),
                UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), q),
            ),
            Kind::Prismatic => Translation3::from(axis * q).into(),
            _ => Isometry3::identity(),
        }
    }

    fn supported(&self) -> Result<(), UrdfError> {
        match self.kind {
            Kind::Ball | Kind::Floating | Kind::Planar => {
                Err(UrdfError::Unsupported { joint: self.name.clone(), kind: self.kind })
            }
            _ => Ok(()),
        }
    }
}

impl Link {
    /// Its mass, checked, and mended where that is wished.
    fn body(&self, fix: bool, warnings: &mut Vec<String>) -> Result<Body, UrdfError> {
        let mut six = self.inertia;
        if let Err(problem) = inertia::check(&six, self.mass) {
            if !fix {
                return Err(UrdfError::Inertia { link: self.name.clone(), problem });
            }
            six = inertia::repair(&six);
            warnings.push(format!(
                "link `{}`: {problem}; replaced by the nearest that is possible",
                self.name
            ));
        }
        if self.mass == 0.0 && six.iter().any(|&x| x != 0.0) {
            warnings.push(format!("link `{}` has a moment of inertia but no mass", self.name));
        }
        Ok(Body { mass: self.mass, com: Vector3::from(self.com), inertia: tensor(&six) })
    }
}

/// A link of the arm in the making: everything that moves as one.
struct Carrier {
    /// Its name in the arm.
    name: String,
    /// The joint that moves it; none for the base.
    joint: Option<(usize, Frame)>,
    body: Body,
    links: Vec<String>,
}

impl Tree {
    /// The arm from a base to a tip.
    ///
    /// # Errors
    /// [`UrdfError`] if the links are no tree, or if what is asked for is no arm.
    pub fn reduce(&self, options: &Options) -> Result<Reading, UrdfError> {
        let index = Index::new(self)?;
        let base =
            options.base.as_deref().map_or(Ok(index.root), |name| index.link("base", name))?;
        let tip = index.tip(base, options.tip.as_deref())?;
        let chain = index.chain(base, tip)?;
        for (name, &value) in &options.locked {
            let joint = &self.joints[index.joint("locked", name)?];
            let place = format!("locked, joint `{name}`");
            if !value.is_finite() {
                let requirement = "finite";
                return Err(UrdfError::OutOfRange { place, requirement, given: value });
            }
            if joint.kind == Kind::Fixed && value != 0.0 {
                let requirement = "0, for the joint is fixed";
                return Err(UrdfError::OutOfRange { place, requirement, given: value });
            }
        }
        for (name, frame) in [("tool", &options.tool), ("mount", &options.mount)] {
            unit(&mut frame.orientation.clone(), format!("{name}.orientation"))?;
        }
        let drives = |&joint: &usize| {
            let joint = &self.joints[joint];
            joint.moves().is_some() && !options.locked.contains_key(&joint.name)
        };
        let moving: BTreeSet<usize> = chain.iter().copied().filter(drives).collect();
        let mut warnings = self.warnings.clone();
        let mut merger =
            Merger { index: &index, moving: &moving, options, locked: BTreeMap::new() };
        let Merged { carriers, geometry, tool } = merger.merge(base, tip, &mut warnings)?;
        let locked = merger.locked;
        if moving.is_empty() {
            let name = |link: usize| self.links[link].name.clone();
            return Err(UrdfError::NoJoints { base: name(base), tip: name(tip) });
        }
        self.tell_locked(&index, &chain, &locked, options, &mut warnings);
        self.tell_gripper(&chain, &moving, &mut warnings);
        if base != index.root {
            warnings.push(format!(
                "what is above `{}` in the file is left out: the arm begins there",
                self.links[base].name
            ));
        }
        let mut arm = self.describe(&carriers, options, &mut warnings)?;
        arm.tip.clone_from(&self.links[tip].name);
        arm.tool = Frame::from(tool * Isometry3::from(options.tool));
        if let Some(srdf) = &options.srdf {
            arm.ignore = ignored(&carriers, &geometry, &disabled_pairs(srdf)?);
        }
        warnings.extend(doubts(&arm));
        let merged = carriers.into_iter().map(|carrier| (carrier.name, carrier.links)).collect();
        Ok(Reading { arm: arm.checked()?, geometry, locked, merged, warnings })
    }

    /// Says where a joint of a gripper has become one of the arm's.
    fn tell_gripper(&self, chain: &[usize], moving: &BTreeSet<usize>, warnings: &mut Vec<String>) {
        let moving: Vec<_> = chain.iter().filter(|joint| moving.contains(joint)).collect();
        let grips = |joint: &&&usize| Role::grips(&self.joints[***joint].name);
        if let Some(at) = moving.iter().position(|joint| grips(&joint)).filter(|at| *at > 0) {
            let joint = &self.joints[*moving[at]];
            warnings.push(format!(
                "`{}`, by its name a gripper's, is joint {} of the arm; tip = \"{}\" leaves it out",
                joint.name,
                at + 1,
                joint.parent
            ));
        }
    }

    /// Says which joints were locked, and where that is odd.
    fn tell_locked(
        &self,
        index: &Index<'_>,
        chain: &[usize],
        locked: &BTreeMap<String, f64>,
        options: &Options,
        warnings: &mut Vec<String>,
    ) {
        let untold: Vec<_> = locked
            .iter()
            .filter(|(name, _)| {
                !options.locked.contains_key(*name) && !chain.contains(&index.joints[name.as_str()])
            })
            .map(|(name, value)| format!("`{name}` = {value}"))
            .collect();
        if !untold.is_empty() {
            let (what, are) = if untold.len() == 1 { ("joint", "is") } else { ("joints", "are") };
            warnings.push(format!(
                "{} {what} off the chain {are} locked: {}",
                untold.len(),
                untold.join(", ")
            ));
        }
        for (name, &value) in locked {
            match self.joints[index.joints[name.as_str()]].limits {
                Some([lower, upper]) if lower < upper && !(lower..=upper).contains(&value) => {
                    warnings.push(format!(
                        "joint `{name}` is locked at {value}, outside its limits [{lower}, {upper}]"
                    ));
                }
                _ => {}
            }
        }
    }

    fn describe(
        &self,
        carriers: &[Carrier],
        options: &Options,
        warnings: &mut Vec<String>,
    ) -> Result<ArmDescription, UrdfError> {
        let n = carriers.len() - 1;
        if ![0, 1, n].contains(&options.armature.len()) {
            let given = options.armature.len();
            return Err(UrdfError::WrongLength { what: "armature", expected: n, given });
        }
        let mut joints = Vec::with_capacity(n);
        let (mut ranges, mut velocity, mut torque) = (vec![], vec![], vec![]);
        let (mut no_velocity, mut no_torque) = (vec![], vec![]);
        for (i, carrier) in carriers[1..].iter().enumerate() {
            let Some((joint, frame)) = carrier.joint else { continue };
            let joint = &self.joints[joint];
            let Some(kind) = joint.moves() else { continue };
            if let Some(mimic) = &joint.mimic {
                let (joint, driver) = (joint.name.clone(), mimic.joint.clone());
                return Err(UrdfError::MimicOnChain { joint, driver });
            }
            let [lower, upper] = joint.limits.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            // So far away stands for nowhere.
            let lower = if lower <= -FAR { f64::NEG_INFINITY } else { lower };
            let upper = if upper >= FAR { f64::INFINITY } else { upper };
            if lower >= upper {
                return Err(UrdfError::NoRoom { joint: joint.name.clone(), lower, upper });
            }
            if carrier.body.mass <= 0.0 {
                let (link, joint) = (carrier.name.clone(), joint.name.clone());
                return Err(UrdfError::Massless { link, joint });
            }
            ranges.push([lower, upper]);
            for (limit, all, without, most) in [
                (joint.velocity, &mut velocity, &mut no_velocity, UNLIMITED[0]),
                (joint.torque, &mut torque, &mut no_torque, UNLIMITED[1]),
            ] {
                let given = limit > 0.0;
                all.push(if given { limit } else { most });
                if !given {
                    without.push(joint.name.clone());
                }
            }
            let armature = match options.armature[..] {
                [] => joint.armature,
                [one] => one,
                _ => options.armature[i],
            };
            joints.push(Joint {
                name: joint.name.clone(),
                link: carrier.name.clone(),
                kind,
                position: frame.position,
                orientation: frame.orientation,
                axis: joint.axis,
                mass: carrier.body.mass,
                com: carrier.body.com.into(),
                inertia: six(&carrier.body.inertia),
                armature,
                damping: joint.damping,
                friction: joint.friction,
            });
        }
        for (what, without, all, most) in [
            ("speed", no_velocity, &mut velocity, UNLIMITED[0]),
            ("torque", no_torque, &mut torque, UNLIMITED[1]),
        ] {
            let names = list(&without);
            if without.len() == n {
                all.clear();
                warnings.push(format!("no limit of {what} for {names}"));
            } else if !without.is_empty() {
                warnings.push(format!("no limit of {what} for {names}: taken for {most}"));
            }
        }
        if ranges.iter().flatten().all(|x| x.is_infinite()) {
            ranges.clear();
        }
        Ok(ArmDescription {
            name: Some(self.name.clone()).filter(|name| !name.is_empty()),
            payload: None,
            reach: None,
            base: carriers[0].name.clone(),
            tip: String::new(),
            gravity: options.gravity.unwrap_or([0.0, 0.0, -9.81]),
            joint_limits: ranges,
            velocity_limits: velocity,
            torque_limits: torque,
            ignore: vec![],
            mount: options.mount,
            tool: Frame::default(),
            joints,
            collision: vec![],
        })
    }
}

/// Where a link of the file goes.
enum Place {
    /// Onto a link of the arm, at this pose.
    On(usize, Isometry3<f64>),
    /// It is one itself, with the joint that moves it; none for the base.
    Own(Option<(usize, Frame)>),
}

/// What moves as one, what collides on it, and where the tip is in the last of them.
struct Merged {
    carriers: Vec<Carrier>,
    geometry: Vec<LinkGeometry>,
    tool: Isometry3<f64>,
}

struct Merger<'a> {
    index: &'a Index<'a>,
    moving: &'a BTreeSet<usize>,
    options: &'a Options,
    locked: BTreeMap<String, f64>,
}

impl Merger<'_> {
    /// Walks down from the base.
    fn merge(
        &mut self,
        base: usize,
        tip: usize,
        warnings: &mut Vec<String>,
    ) -> Result<Merged, UrdfError> {
        let tree = self.index.tree;
        let mut carriers: Vec<Carrier> = vec![];
        let mut geometry = vec![];
        let mut tool = Isometry3::identity();
        let mut open = vec![(base, Place::Own(None))];
        while let Some((at, place)) = open.pop() {
            let link = &tree.links[at];
            let (on, pose) = match place {
                Place::On(carrier, pose) => (carrier, pose),
                Place::Own(joint) => {
                    let (name, body) = (link.name.clone(), Body::default());
                    carriers.push(Carrier { name, joint, body, links: vec![] });
                    (carriers.len() - 1, Isometry3::identity())
                }
            };
            if on > 0 {
                // What is fixed to the base needs no mass.
                let body = link.body(self.options.fix_inertia, warnings)?;
                carriers[on].body = carriers[on].body.joined(&body.moved(&pose));
            }
            carriers[on].links.push(link.name.clone());
            geometry.extend(link.geometry.iter().map(|item| {
                let frame = Frame::from(pose * Isometry3::from(item.frame));
                (on, Geometry { frame, ..item.clone() })
            }));
            if at == tip {
                tool = pose;
            }
            for &j in self.index.below[at].iter().rev() {
                let joint = &tree.joints[j];
                joint.supported()?;
                let origin = pose * Isometry3::from(joint.frame);
                let child = self.index.child(j);
                if self.moving.contains(&j) {
                    open.push((child, Place::Own(Some((j, Frame::from(origin))))));
                    continue;
                }
                let mut q = 0.0;
                if joint.moves().is_some() {
                    q = self.index.standing(j, self.moving, &self.options.locked)?;
                    self.locked.insert(joint.name.clone(), q);
                }
                open.push((child, Place::On(on, origin * joint.motion(q))));
            }
        }
        geometry.sort_by_key(|(on, _)| *on);
        let carried = geometry
            .into_iter()
            .map(|(on, geometry)| LinkGeometry { on: carriers[on].name.clone(), geometry })
            .collect();
        Ok(Merged { carriers, geometry: carried, tool })
    }
}

/// The pairs of links of the arm that an SRDF switches off: those of whose parts it names every pair.
/// A part without form needs no naming.
fn ignored(
    carriers: &[Carrier],
    geometry: &[LinkGeometry],
    pairs: &[[String; 2]],
) -> Vec<[String; 2]> {
    let off: BTreeSet<_> = pairs.iter().flat_map(|[a, b]| [(a, b), (b, a)]).collect();
    let parts: Vec<BTreeSet<_>> = carriers
        .iter()
        .map(|carrier| {
            let on = geometry.iter().filter(|item| item.on == carrier.name);
            on.map(|item| &item.geometry.link).collect()
        })
        .collect();
    let mut ignored = vec![];
    for (i, first) in parts.iter().enumerate() {
        for (j, second) in parts.iter().enumerate().skip(i + 2) {
            let mut between = first.iter().flat_map(|a| second.iter().map(move |b| (*a, *b)));
            let named = !first.is_empty() && !second.is_empty();
            if named && between.all(|pair| off.contains(&pair)) {
                ignored.push([carriers[i].name.clone(), carriers[j].name.clone()]);
            }
        }
    }
    ignored
}
