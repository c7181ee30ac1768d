use super::super::description::JointKind;
use super::*;

/// Two moving joints with a fixed flange and a gripper of two fingers, the second a mimic.
const ARM: &str = r#"<?xml version="1.0"?>
<robot name="two">
  <link name="world"/>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.01"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.025"/></inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision></link>
  <link name="flange"/>
  <link name="left"><inertial><mass value="0.1"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5"/></inertial>
    <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <link name="right"><inertial><mass value="0.1"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="world"/><child link="upper"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="50" velocity="3"/>
    <dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 0 1"/><limit effort="20" velocity="4"/></joint>
  <joint name="bolt" type="fixed"><parent link="lower"/><child link="flange"/><origin xyz="0 0 0.2"/></joint>
  <joint name="grip" type="prismatic"><parent link="flange"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" effort="5" velocity="1"/></joint>
  <joint name="follow" type="prismatic"><parent link="flange"/><child link="right"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.04" effort="5" velocity="1"/><mimic joint="grip" multiplier="2" offset="0.01"/></joint>
</robot>"#;

fn options(tip: &str) -> Options {
    Options { tip: Some(tip.into()), ..Options::default() }
}

fn fault(text: &str, options: &Options) -> String {
    read(text, options).expect_err("refused").to_string()
}

fn changed(from: &str, to: &str) -> String {
    assert!(ARM.contains(from), "{from}");
    ARM.replacen(from, to, 1)
}

fn near(given: &[f64], expected: &[f64]) {
    assert_eq!(given.len(), expected.len());
    for (a, b) in given.iter().zip(expected) {
        assert!((a - b).abs() < 1e-14, "{given:?} is not {expected:?}");
    }
}

#[test]
fn a_chain_with_what_hangs_on_it() {
    let mut asked = options("flange");
    asked.locked.insert("grip".into(), 0.02);
    let reading = read(ARM, &asked).unwrap();
    let arm = &reading.arm;
    assert_eq!(arm.link_names(), ["world", "upper", "lower"]);
    assert_eq!(arm.joints[1].kind, JointKind::Continuous);
    assert_eq!(arm.joint_limits, [[-1.0, 2.0], [f64::NEG_INFINITY, f64::INFINITY]]);
    assert_eq!(
        (&arm.torque_limits[..], &arm.velocity_limits[..]),
        (&[50.0, 20.0][..], &[3.0, 4.0][..])
    );
    assert_eq!((arm.joints[0].damping, arm.joints[0].friction), (0.5, 0.1));
    near(&arm.tool.position, &[0.0, 0.0, 0.2]);
    // A driver locked at 0.02 leaves its mimic at 2 · 0.02 + 0.01.
    near(&[reading.locked["grip"], reading.locked["follow"]], &[0.02, 0.05]);
    let link = &arm.joints[1];
    near(&[link.mass], &[1.2]);
    near(&link.com, &[0.1 / 1.2, (0.1 * 0.02 - 0.1 * 0.05) / 1.2, 0.04 / 1.2]);
    assert!(reading.warnings[0].contains("`follow` = 0.05"), "{:?}", reading.warnings);
    assert_eq!(reading.merged["lower"], ["lower", "flange", "left", "right"]);
    let ball = reading.geometry.iter().find(|item| item.geometry.link == "left").unwrap();
    assert_eq!(ball.on, "lower");
    near(&ball.geometry.frame.position, &[0.0, 0.02, 0.2]);
}

#[test]
fn the_inertial_frame_turns_the_tensor() {
    let text = changed(
        r#"<mass value="0.1"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5"/></inertial></link>
  <joint"#,
        r#"<mass value="0"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
  <joint"#,
    );
    let text = text.replacen(
        r#"<mass value="0.1"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5"/>"#,
        r#"<mass value="0"/><inertia ixx="0" iyy="0" izz="0"/>"#,
        1,
    );
    let arm = read(&text, &options("flange")).unwrap().arm;
    near(&arm.joints[1].com, &[0.1, 0.0, 0.0]);
    near(&arm.joints[1].inertia, &[0.02, 0.01, 0.025, 0.0, 0.0, 0.0]);
}

#[test]
fn joints_of_the_chain_can_be_locked_too() {
    let mut asked = options("flange");
    asked.locked.insert("elbow".into(), 1.0);
    let reading = read(ARM, &asked).unwrap();
    assert_eq!(reading.arm.dof(), 1);
    near(&reading.arm.tool.orientation, &[0.5f64.cos(), 0.0, 0.0, 0.5f64.sin()]);
    near(&reading.arm.tool.position, &[0.0, 0.0, 0.6]);
    assert!(
        read(ARM, &Options { base: Some("upper".into()), ..options("flange") }).unwrap().arm.dof()
            == 1
    );
}

#[test]
fn every_refusal_has_a_sentence() {
    let none = Options::default();
    let says = |text: &str, options: &Options, words: &[&str]| {
        let fault = fault(text, options);
        for word in words {
            assert!(fault.contains(word), "{fault:?} does not say {word:?}");
        }
    };
    says(ARM, &none, &["which tip?", "`left`, `right`"]);
    says(ARM, &options("flangge"), &["no link `flangge`", "did you mean `flange`?", "`upper`"]);
    says(
        ARM,
        &Options { base: Some("left".into()), ..options("right") },
        &["does not hang on the base `left`"],
    );
    says(ARM, &options("world"), &["no joint moves"]);
    let mut asked = options("flange");
    asked.locked.insert("gripp".into(), 0.0);
    says(ARM, &asked, &["no joint `gripp`", "did you mean `grip`?"]);
    asked.locked = [("grip".into(), f64::NAN)].into();
    says(ARM, &asked, &["must be finite"]);
    let flange = options("flange");
    let kind = |kind: &str| changed(r#"type="continuous""#, &format!(r#"type="{kind}""#));
    says(&kind("floating"), &flange, &["`elbow` is floating"]);
    says(&kind("planar"), &flange, &["`elbow` is planar"]);
    says(&kind("ball"), &flange, &["unknown type `ball`"]);
    says(
        &changed(r#"<axis xyz="0 0 1"/>"#, r#"<axis xyz="0 0 1.01"/>"#),
        &flange,
        &["`elbow`", "length 1", "1.01"],
    );
    says(
        &changed(r#"<axis xyz="0 0 1"/>"#, r#"<axis xyz="0 0"/>"#),
        &flange,
        &["3 numbers", "`0 0`"],
    );
    says(&changed(r#"<axis xyz="0 0 1"/>"#, r#"<axis xyz="0 0 nan"/>"#), &flange, &["finite"]);
    says(
        &changed(r#"rpy="0 0 1.5707963267948966""#, r#"quat_xyzw="0 0 0 2""#),
        &flange,
        &["length 1", "has 2"],
    );
    says(&changed(r#"<mass value="2"/>"#, r#"<mass value="-2"/>"#), &flange, &["≥ 0"]);
    says(
        &changed(r#"<mass value="2"/>"#, r#"<mass value="0"/>"#),
        &flange,
        &["`upper` moves with joint `shoulder`"],
    );
    says(
        &changed(r#"ixx="0.03" iyy="0.03" izz="0.01""#, r#"ixx="0.03" iyy="0.03" izz="0.09""#),
        &flange,
        &["`upper`", "triangle inequality", "3.000e-2 + 3.000e-2 ≥ 9.000e-2", "fix_inertia"],
    );
    says(&changed(r#"lower="-1" upper="2""#, ""), &flange, &["no room"]);
    says(
        &changed(r#"<limit lower="-1" upper="2" effort="50" velocity="3"/>"#, ""),
        &flange,
        &["`shoulder`", "<limit"],
    );
    says(
        &changed(r#"<parent link="upper"/>"#, r#"<parent link="uper"/>"#),
        &flange,
        &["no link `uper`"],
    );
    says(
        &changed(r#"<parent link="upper"/>"#, r#"<parent link="flange"/>"#),
        &flange,
        &["circle", "`lower`", "`flange`"],
    );
    says(
        &changed(r#"<link name="upper">"#, r#"<link name="lower">"#),
        &flange,
        &["two links named `lower`"],
    );
    says(
        &changed("<link name=\"world\"/>", "<link name=\"world\"/><link name=\"alone\"/>"),
        &flange,
        &["2 links", "`world`, `alone`"],
    );
    says(
        &changed(r#"<child link="right"/>"#, r#"<child link="left"/>"#),
        &flange,
        &["two joints, `grip` and `follow`"],
    );
    says(ARM, &options("right"), &["`follow` lies on the chain and mimics `grip`"]);
    says(
        &changed(r#"<mimic joint="grip""#, r#"<mimic joint="elbow""#),
        &flange,
        &["`follow` is off the chain and mimics `elbow`"],
    );
    says(
        &changed(r#"<mimic joint="grip""#, r#"<mimic joint="follow""#),
        &flange,
        &["mimics itself"],
    );
    says(&changed(r#"<sphere radius="0.01"/>"#, r#"<sphere radius="-1"/>"#), &flange, &["> 0"]);
    says(&changed(r#"<sphere radius="0.01"/>"#, "<cone/>"), &flange, &["<cone>"]);
    says(&changed("value=\"2\"", "value=\"${m}\""), &flange, &["xacro"]);
    says("<mujoco/>", &none, &["from_mjcf"]);
    says("<robot/>", &none, &["no links"]);
    says("", &none, &["not well-formed"]);
    says("<robot><link>", &none, &["not well-formed"]);
    says(
        "<!DOCTYPE r [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><robot name='&a;'/>",
        &none,
        &["entities"],
    );
    says("<robot name='&a;'/>", &none, &["entities"]);
    says(&" ".repeat(MAX_BYTES + 1), &none, &["at most"]);
    says(ARM, &Options { armature: vec![1.0; 3], ..flange }, &["one value or 2"]);
}

#[test]
fn deep_and_long_documents_end_in_a_sentence() {
    let deep = format!("<robot>{}", "<a>".repeat(400_000));
    assert!(fault(&deep, &Options::default()).contains("not well-formed"));
    let many = format!("<robot>{}</robot>", "<a/>".repeat(600_000));
    assert!(fault(&many, &Options::default()).contains("more than 500000"));
    let attributes: String = (0..100_000).map(|i| format!(" a{i}='='")).collect();
    let wide = format!("<robot><!-- <{attributes}> --><link{attributes}/></robot>");
    assert!(fault(&wide, &Options::default()).contains("more than 1000 attributes"));
    let commented = format!("<robot><!-- <{attributes}> --><a b='{attributes}'/></robot>");
    assert!(fault(&commented.replace("='='", "="), &Options::default()).contains("no links"));
    let mut long = String::from("<robot><link name='0'/>");
    for i in 1..20_000 {
        long += &format!(
            "<link name='{i}'/><joint name='{i}' type='fixed'><parent link='{}'/><child link='{i}'/></joint>",
            i - 1
        );
    }
    assert!(fault(&(long + "</robot>"), &Options::default()).contains("no joint moves"));
}

#[test]
fn impossible_inertia_is_mended_on_demand() {
    let text =
        changed(r#"ixx="0.03" iyy="0.03" izz="0.01""#, r#"ixx="0.03" iyy="0.03" izz="0.09""#);
    let reading = read(&text, &Options { fix_inertia: true, ..options("flange") }).unwrap();
    // Σ = diag(0.045, 0.045, −0.015) loses its last entry, but for what rounding asks for.
    let rest = 1e-9 * 0.09;
    near(&reading.arm.joints[0].inertia, &[0.045 + rest, 0.045 + rest, 0.09, 0.0, 0.0, 0.0]);
    assert!(
        reading.warnings.iter().any(|warning| warning.contains("nearest")),
        "{:?}",
        reading.warnings
    );
}

#[test]
fn an_srdf_must_name_every_pair_of_parts() {
    let text = changed(
        r#"<link name="world"/>"#,
        r#"<link name="world"><collision><geometry>
        <box size="1 1 1"/></geometry></collision></link>"#,
    );
    let srdf = |pairs: &str| format!("<robot name='two'>{pairs}</robot>");
    let one = "<disable_collisions link1='world' link2='lower' reason='Never'/>";
    let both = format!("{one}<disable_collisions link1='left' link2='world'/>");
    let asked = |srdf: String| Options { srdf: Some(srdf), ..options("flange") };
    assert!(read(&text, &asked(srdf(one))).unwrap().arm.ignore.is_empty());
    let arm = read(&text, &asked(srdf(&both))).unwrap().arm;
    assert_eq!(arm.ignore, [["world".to_string(), "lower".to_string()]]);
    let fault = fault(&text, &asked(srdf("<disable_collisions link1='world'/>")));
    assert!(fault.contains("link2 is missing"), "{fault}");
}

/// An arm of one joint that turns, with one value in another unit at a time.
#[test]
fn other_units_are_told_of() {
    let plain = r#"<robot name="r"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0.15" rpy="0 0 0"/>
        <mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.3" rpy="1.5708 0 6.2832"/>
        <axis xyz="0 0 1"/><limit lower="-6.3" upper="6.3" effort="50" velocity="2"/>
        <safety_controller soft_lower_limit="-6.3" soft_upper_limit="6.3" k_velocity="10"/></joint></robot>"#;
    let warnings = |from: &str, to: &str| {
        assert!(plain.contains(from));
        read(&plain.replace(from, to), &Options::default()).unwrap().warnings
    };
    assert_eq!(warnings("0.3", "0.3"), [""; 0]);
    for (from, to, told) in [
        (
            r#" lower="-6.3" upper="6.3""#,
            r#" lower="-170" upper="170""#,
            "limits of `j` are beyond two turns",
        ),
        ("0 0 0.3", "0 0 300", "the arm is 300 m long"),
        ("0.01", "10000", "moments of inertia of `arm`"),
        ("1.5708 0", "90 0", "rpy of 1 <origin>"),
        (
            "soft_upper_limit=\"6.3\"",
            "soft_upper_limit=\"0.5\"",
            "soft limits (<safety_controller>) of `j`",
        ),
    ] {
        let warnings = warnings(from, to);
        assert!(warnings.iter().any(|warning| warning.starts_with(told)), "{to}: {warnings:?}");
    }
}
