//! URDF text to a [`Tree`].

use super::super::description::Frame;
use super::super::description_error::{self, DescriptionProblem};
use super::super::inertia::Body;
use super::super::inertia::{self, tensor};
use super::super::names::list;
use super::tree::{Form, Geometry, Kind, Link, Mimic, Tree, TreeJoint};
use super::{MAX_BYTES, UrdfError, Xml};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

/// The most nodes of an XML document that are read.
pub const MAX_NODES: u32 = 500_000;

/// The most attributes of an element: the parser compares them with each other.
pub const MAX_ATTRIBUTES: usize = 1000;

/// The most prefixes that are declared for a document which does not do so itself.
const MAX_PREFIXES: usize = 16;

/// Reads XML without a document type. Prefixes that it uses and does not declare are, as other readers of URDF take no offence at them.
pub(super) fn with_document<T>(
    format: Xml,
    text: &str,
    read: impl Fn(&Document<'_>) -> Result<T, UrdfError>,
) -> Result<T, UrdfError> {
    if text.len() > MAX_BYTES {
        return Err(UrdfError::TooLong { format, given: text.len() });
    }
    if is_crowded(text) {
        return Err(UrdfError::TooManyAttributes(format));
    }
    attempt(format, text.trim_start_matches('\u{feff}').trim_start(), MAX_PREFIXES, &read)
}

/// The same, with so many prefixes declared at most.
fn attempt<T>(
    format: Xml,
    text: &str,
    prefixes: usize,
    read: &impl Fn(&Document<'_>) -> Result<T, UrdfError>,
) -> Result<T, UrdfError> {
    let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    match Document::parse_with_options(text, options) {
        Ok(document) => read(&document),
        Err(roxmltree::Error::DtdDetected | roxmltree::Error::UnknownEntityReference(..)) => {
            Err(UrdfError::Entities(format))
        }
        Err(roxmltree::Error::NodesLimitReached) => Err(UrdfError::TooManyElements(format)),
        Err(error) => match (&error, root_name_end(text)) {
            (roxmltree::Error::UnknownNamespace(prefix, _), Some(end)) if prefixes > 0 => {
                let (root, rest) = text.split_at(end);
                let declared = format!("{root} xmlns:{prefix}=\"undeclared:{prefix}\"{rest}");
                attempt(format, &declared, prefixes - 1, read)
            }
            _ => Err(UrdfError::Malformed { format, message: error.to_string() }),
        },
    }
}

/// Where the name of the root element ends.
fn root_name_end(text: &str) -> Option<usize> {
    let mut at = text.find('<')?;
    loop {
        let rest = &text[at..];
        let skipped =
            [("<!--", "-->"), ("<?", "?>")].iter().find(|(open, _)| rest.starts_with(open));
        let Some((_, close)) = skipped else {
            return Some(at + rest.find(|c: char| c.is_whitespace() || c == '/' || c == '>')?);
        };
        let after = at + rest.find(close)?;
        at = after + text[after..].find('<')?;
    }
}

/// Whether an element has more attributes than are read.
fn is_crowded(text: &str) -> bool {
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let unread = [("<!--", "-->"), ("<![CDATA[", "]]>")];
        if let Some((_, close)) = unread.iter().find(|(open, _)| rest.starts_with(open)) {
            rest = rest.split_once(close).map_or("", |(_, after)| after);
            continue;
        }
        let (mut quote, mut count, mut end) = (None, 0, rest.len());
        for (i, byte) in rest.bytes().enumerate() {
            match (quote, byte) {
                (Some(open), _) if open != byte => {}
                (Some(_), _) => quote = None,
                (None, b'"' | b'\'') => quote = Some(byte),
                (None, b'=') => count += 1,
                (None, b'>') => {
                    end = i + 1;
                    break;
                }
                _ => {}
            }
        }
        if count > MAX_ATTRIBUTES {
            return true;
        }
        rest = &rest[end..];
    }
    false
}

/// The `<robot>` of a document.
pub(super) fn robot<'a, 'i>(document: &'a Document<'i>) -> Result<Node<'a, 'i>, UrdfError> {
    let root = document.root_element();
    match root.tag_name().name() {
        "robot" => Ok(root),
        found => Err(UrdfError::NotARobot { found: found.into() }),
    }
}

/// Reads URDF into links and joints.
///
/// # Errors
/// [`UrdfError`] for text that is no URDF, and for values that make no sense by themselves.
pub fn parse(text: &str) -> Result<Tree, UrdfError> {
    with_document(Xml::Urdf, text, tree_of)
}

fn tree_of(document: &Document<'_>) -> Result<Tree, UrdfError> {
    let robot = robot(document)?;
    let mut tree =
        Tree { name: robot.attribute("name").unwrap_or_default().into(), ..Tree::default() };
    for node in robot.children().filter(Node::is_element) {
        match node.tag_name().name() {
            "link" => tree.links.push(link(node)?),
            "joint" => tree.joints.push(joint(node)?),
            // Macros would leave out links without a word.
            tag if node.tag_name().namespace().is_some_and(|uri| uri.contains("xacro")) => {
                let (place, text) = ("robot".into(), format!("<xacro:{tag}>"));
                return Err(UrdfError::Xacro { place, text });
            }
            _ => {}
        }
    }
    tree.warnings = odd(robot);
    let empty: Vec<_> = robot
        .children()
        .filter(|node| node.has_tag_name("link") && collisions(*node).any(is_empty))
        .filter_map(|node| node.attribute("name"))
        .collect();
    if !empty.is_empty() {
        tree.warnings
            .push(format!("a collision shape of {} has no size and is left out", list(&empty)));
    }
    Ok(tree)
}

/// What is read otherwise than it may be meant: roll, pitch and yaw in degrees, and stops that are not taken over.
fn odd(robot: Node<'_, '_>) -> Vec<String> {
    fn given<const N: usize>(node: Node<'_, '_>, attribute: &str) -> Option<[f64; N]> {
        numbers(node, attribute, "").ok().flatten()
    }
    let links = robot.children().filter(|node| node.has_tag_name("link"));
    let joints = robot.children().filter(|node| node.has_tag_name("joint"));
    let parts = links.flat_map(|link| link.children()).filter(|part| !part.has_tag_name("visual"));
    let placed = joints.clone().chain(parts);
    let is_turned = |node: &Node<'_, '_>| {
        let angles = child(*node, "origin").and_then(|origin| given::<3>(origin, "rpy"));
        // 2π, rounded up.
        angles.is_some_and(|angles| angles.iter().any(|angle| angle.abs() > 6.3))
    };
    let turned = placed.filter(is_turned).count();
    let is_softer = |node: &Node<'_, '_>| {
        let ends = |tag, [low, high]: [&str; 2]| {
            let node = child(*node, tag)?;
            Some((given::<1>(node, low)?[0], given::<1>(node, high)?[0]))
        };
        let soft = ends("safety_controller", ["soft_lower_limit", "soft_upper_limit"]);
        let has_stops = node.attribute("type") != Some("continuous");
        soft.zip(ends("limit", ["lower", "upper"])).is_some_and(|(soft, hard)| {
            has_stops && soft.0 < soft.1 && (soft.0 > hard.0 || soft.1 < hard.1)
        })
    };
    let softer: Vec<_> =
        joints.filter(is_softer).filter_map(|joint| joint.attribute("name")).collect();
    let mut warnings = vec![];
    if turned > 0 {
        warnings.push(format!(
            "rpy of {turned} <origin> is beyond a turn: it is read as radians; is it degrees?"
        ));
    }
    if !softer.is_empty() {
        warnings.push(format!(
            "soft limits (<safety_controller>) of {} are left out: the stops are those of <limit>",
            list(&softer)
        ));
    }
    warnings
}

fn child<'a, 'i>(node: Node<'a, 'i>, tag: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(tag))
}

fn needed<'a, 'i>(
    node: Node<'a, 'i>,
    tag: &'static str,
    place: &str,
) -> Result<Node<'a, 'i>, UrdfError> {
    child(node, tag).ok_or_else(|| UrdfError::Missing { place: place.into(), what: tag })
}

fn name(node: Node<'_, '_>, what: &'static str) -> Result<String, UrdfError> {
    match node.attribute("name") {
        Some(name) if !name.is_empty() => text(name, what).map(str::to_string),
        _ => {
            let line = node.document().text_pos_at(node.range().start).row;
            let place = format!("{what} in line {line}");
            Err(UrdfError::Missing { place, what: "its name" })
        }
    }
}

/// Text that no macro processor has left undone.
fn text<'a>(text: &'a str, place: &str) -> Result<&'a str, UrdfError> {
    if text.contains("${") || text.contains("$(") {
        return Err(UrdfError::Xacro { place: place.into(), text: text.into() });
    }
    Ok(text)
}

/// `N` finite numbers of an attribute.
fn numbers<const N: usize>(
    node: Node<'_, '_>,
    attribute: &str,
    place: &str,
) -> Result<Option<[f64; N]>, UrdfError> {
    let Some(given) = node.attribute(attribute) else { return Ok(None) };
    let place = || format!("{place}, <{} {attribute}>", node.tag_name().name());
    let parsed: Result<Vec<f64>, _> =
        text(given, &place())?.split_whitespace().map(str::parse).collect();
    let values: [f64; N] =
        parsed.ok().and_then(|values| values.try_into().ok()).ok_or_else(|| {
            UrdfError::NotNumbers {
                place: place(),
                expected: if N == 1 { "a number".into() } else { format!("{N} numbers") },
                given: given.chars().take(80).collect(),
            }
        })?;
    match values.iter().find(|x| !x.is_finite()) {
        Some(&given) => Err(UrdfError::OutOfRange { place: place(), requirement: "finite", given }),
        None => Ok(Some(values)),
    }
}

fn number(node: Node<'_, '_>, attribute: &str, place: &str) -> Result<Option<f64>, UrdfError> {
    Ok(numbers::<1>(node, attribute, place)?.map(|[x]| x))
}

fn needed_number(
    node: Node<'_, '_>,
    attribute: &'static str,
    place: &str,
) -> Result<f64, UrdfError> {
    let place_of = |tag: &str| format!("{place}, <{tag}>");
    number(node, attribute, place)?.ok_or_else(|| UrdfError::Missing {
        place: place_of(node.tag_name().name()),
        what: attribute,
    })
}

/// Normalises what is nearly of length 1.
pub(super) fn unit<const N: usize>(values: &mut [f64; N], place: String) -> Result<(), UrdfError> {
    description_error::unit(values).map_err(|problem| match problem {
        DescriptionProblem::NotUnit(norm) => UrdfError::NotUnit { place, norm },
        _ => UrdfError::OutOfRange { place, requirement: "finite", given: f64::NAN },
    })
}

fn positive(value: f64, place: String) -> Result<f64, UrdfError> {
    if value > 0.0 {
        return Ok(value);
    }
    Err(UrdfError::OutOfRange { place, requirement: "> 0", given: value })
}

/// `<origin xyz rpy>`, or the quaternion of newer files.
fn origin(node: Node<'_, '_>, place: &str) -> Result<Isometry3<f64>, UrdfError> {
    let Some(origin) = child(node, "origin") else { return Ok(Isometry3::identity()) };
    let position = numbers::<3>(origin, "xyz", place)?.unwrap_or_default();
    let rotation = match numbers::<4>(origin, "quat_xyzw", place)? {
        Some(mut quaternion) => {
            unit(&mut quaternion, format!("{place}, <origin quat_xyzw>"))?;
            let [x, y, z, w] = quaternion;
            UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z))
        }
        None => {
            let [roll, pitch, yaw] = numbers::<3>(origin, "rpy", place)?.unwrap_or_default();
            UnitQuaternion::from_euler_angles(roll, pitch, yaw)
        }
    };
    Ok(Isometry3::from_parts(Translation3::from(Vector3::from(position)), rotation))
}

fn link(node: Node<'_, '_>) -> Result<Link, UrdfError> {
    let name = name(node, "link")?;
    let place = format!("link `{name}`");
    let mut link = Link { name, ..Link::default() };
    if let Some(inertial) = child(node, "inertial") {
        let mass = needed_number(needed(inertial, "mass", &place)?, "value", &place)?;
        if mass < 0.0 {
            let place = format!("{place}, <mass value>");
            return Err(UrdfError::OutOfRange { place, requirement: "≥ 0", given: mass });
        }
        let inertia = needed(inertial, "inertia", &place)?;
        let mut six = [0.0; 6];
        for (x, key) in six.iter_mut().zip(["ixx", "iyy", "izz", "ixy", "ixz", "iyz"]) {
            let given = number(inertia, key, &place)?;
            // Products of inertia are often left out, moments are not.
            *x = match given {
                None if key.as_bytes()[1] == key.as_bytes()[2] => {
                    needed_number(inertia, key, &place)?
                }
                given => given.unwrap_or(0.0),
            };
        }
        // The tensor stands about the centre of mass in the axes of the inertial frame.
        let body = Body { mass, inertia: tensor(&six), ..Body::default() };
        let body = body.moved(&origin(inertial, &place)?);
        link.mass = body.mass;
        link.com = body.com.into();
        link.inertia = inertia::six(&body.inertia);
    }
    for (i, collision) in collisions(node).enumerate().filter(|(_, it)| !is_empty(*it)) {
        let place = format!("{place}, <collision> {}", i + 1);
        let geometry = needed(collision, "geometry", &place)?;
        let form = form(geometry, &place)?;
        let frame = Frame::from(origin(collision, &place)?);
        link.geometry.push(Geometry { link: link.name.clone(), frame, form });
    }
    Ok(link)
}

/// The collision shapes of a link.
fn collisions<'a, 'i>(link: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
    link.children().filter(|node| node.has_tag_name("collision"))
}

/// Whether a shape is a point, as stands for none.
fn is_empty(collision: Node<'_, '_>) -> bool {
    let form = child(collision, "geometry").and_then(|it| it.children().find(Node::is_element));
    let is_nothing = |form: Node<'_, '_>| {
        let zero = |key: &str| number(form, key, "").is_ok_and(|x| x == Some(0.0));
        match form.tag_name().name() {
            "box" => numbers::<3>(form, "size", "").is_ok_and(|size| size == Some([0.0; 3])),
            "sphere" => zero("radius"),
            "cylinder" | "capsule" => zero("radius") && zero("length"),
            _ => false,
        }
    };
    form.is_some_and(is_nothing)
}

fn form(geometry: Node<'_, '_>, place: &str) -> Result<Form, UrdfError> {
    let shape = geometry.children().find(Node::is_element);
    let shape = shape.ok_or_else(|| UrdfError::Missing {
        place: place.into(),
        what: "the form in <geometry>",
    })?;
    let tag = shape.tag_name().name();
    let length = |key: &'static str| {
        positive(needed_number(shape, key, place)?, format!("{place}, <{tag} {key}>"))
    };
    Ok(match tag {
        "box" => {
            let size = numbers::<3>(shape, "size", place)?
                .ok_or_else(|| UrdfError::Missing { place: place.into(), what: "<box size>" })?;
            for x in size {
                positive(x, format!("{place}, <box size>"))?;
            }
            Form::Box { size }
        }
        "cylinder" => Form::Cylinder { radius: length("radius")?, length: length("length")? },
        "capsule" => Form::Capsule { radius: length("radius")?, length: length("length")? },
        "sphere" => Form::Sphere { radius: length("radius")? },
        "mesh" => {
            let file = shape.attribute("filename").unwrap_or_default();
            if file.is_empty() {
                let what = "<mesh filename>";
                return Err(UrdfError::Missing { place: place.into(), what });
            }
            let scale = numbers::<3>(shape, "scale", place)?.unwrap_or([1.0; 3]);
            if let Some(&given) = scale.iter().find(|&&x| x == 0.0) {
                let place = format!("{place}, <mesh scale>");
                return Err(UrdfError::OutOfRange { place, requirement: "other than 0", given });
            }
            Form::Mesh { file: text(file, place)?.into(), scale }
        }
        _ => {
            return Err(UrdfError::NotNumbers {
                place: place.into(),
                expected: "a box, cylinder, capsule, sphere or mesh".into(),
                given: format!("<{tag}>"),
            });
        }
    })
}

fn joint(node: Node<'_, '_>) -> Result<TreeJoint, UrdfError> {
    let name = name(node, "joint")?;
    let place = format!("joint `{name}`");
    let attribute = |tag, key, what| {
        let value = needed(node, tag, &place)?.attribute(key);
        value.map(str::to_string).ok_or_else(|| UrdfError::Missing { place: place.clone(), what })
    };
    let kind = match node.attribute("type") {
        Some("fixed") => Kind::Fixed,
        Some("revolute") => Kind::Revolute,
        Some("continuous") => Kind::Continuous,
        Some("prismatic") => Kind::Prismatic,
        Some("floating") => Kind::Floating,
        Some("planar") => Kind::Planar,
        Some(given) => return Err(UrdfError::UnknownKind { joint: name, given: given.into() }),
        None => return Err(UrdfError::Missing { place, what: "its type" }),
    };
    let moves = matches!(kind, Kind::Revolute | Kind::Continuous | Kind::Prismatic);
    let mut axis = [1.0, 0.0, 0.0];
    if let Some(given) = child(node, "axis").filter(|_| moves) {
        axis = numbers::<3>(given, "xyz", &place)?.unwrap_or(axis);
        unit(&mut axis, format!("{place}, <axis xyz>"))?;
    }
    let mut joint = TreeJoint {
        kind,
        parent: attribute("parent", "link", "<parent link>")?,
        child: attribute("child", "link", "<child link>")?,
        frame: Frame::from(origin(node, &place)?),
        axis,
        limits: None,
        velocity: 0.0,
        torque: 0.0,
        armature: 0.0,
        damping: 0.0,
        friction: 0.0,
        mimic: None,
        name,
    };
    let not_negative = |of: Node<'_, '_>, key: &str| {
        let value = number(of, key, &place)?.unwrap_or_default();
        if value < 0.0 {
            let place = format!("{place}, <{} {key}>", of.tag_name().name());
            return Err(UrdfError::OutOfRange { place, requirement: "≥ 0", given: value });
        }
        Ok(value)
    };
    if let Some(limit) = child(node, "limit").filter(|_| moves) {
        let of = |key| number(limit, key, &place).map(Option::unwrap_or_default);
        joint.velocity = not_negative(limit, "velocity")?;
        joint.torque = not_negative(limit, "effort")?;
        if kind != Kind::Continuous {
            joint.limits = Some([of("lower")?, of("upper")?]);
        }
    } else if matches!(kind, Kind::Revolute | Kind::Prismatic) {
        return Err(UrdfError::Missing { place, what: "<limit lower upper effort velocity>" });
    }
    if let Some(dynamics) = child(node, "dynamics").filter(|_| moves) {
        joint.damping = not_negative(dynamics, "damping")?;
        joint.friction = not_negative(dynamics, "friction")?;
    }
    if let Some(mimic) = child(node, "mimic").filter(|_| moves) {
        let driver = mimic.attribute("joint").unwrap_or_default();
        if driver.is_empty() {
            return Err(UrdfError::Missing { place, what: "<mimic joint>" });
        }
        joint.mimic = Some(Mimic {
            joint: driver.into(),
            multiplier: number(mimic, "multiplier", &place)?.unwrap_or(1.0),
            offset: number(mimic, "offset", &place)?.unwrap_or(0.0),
        });
    }
    Ok(joint)
}
