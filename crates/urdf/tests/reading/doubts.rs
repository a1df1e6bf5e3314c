//! What is assumed, and that it is said.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use spec::{JointFriction, Range};
use urdf::{Arm, Options, Part, read};

use crate::refused::{ARM, arm_with};

#[track_caller]
fn arm(text: &str) -> Arm {
    read(text, &Options::default()).unwrap()
}

/// The arm has this one doubt.
#[track_caller]
fn check(arm: &Arm, part: &Part, words: &[&str]) {
    let [doubt] = &arm.doubts[..] else { panic!("{:#?}", arm.doubts) };
    assert_eq!(doubt.part, *part);
    for word in words {
        assert!(doubt.text.contains(word), "{doubt}\nlacks {word:?}");
    }
}

fn joint(name: &str) -> Part {
    Part::Joint(name.to_owned())
}

fn link(name: &str) -> Part {
    Part::Link(name.to_owned())
}

#[test]
fn a_whole_urdf_raises_none() {
    let arm = arm(ARM);
    assert_eq!(arm.doubts, []);
    let [shoulder, elbow] = &arm.description.joints[..] else { panic!("two joints") };
    assert_eq!(shoulder.position_rad, Range::new(-2.0, 2.0));
    assert_eq!((shoulder.torque_nm, shoulder.velocity_rad_s), (40.0, 2.0));
    assert_eq!((elbow.torque_nm, elbow.friction), (20.0, None));
    assert_eq!((arm.base.as_str(), arm.tip.as_str()), ("base", "hand"));
    assert_eq!(arm.bodies[1].links, ["lower", "hand"]);
    let sources: Vec<&String> = arm.description.sources.values().collect();
    assert!(sources.iter().any(|text| text.contains("SHA-256") && text.contains("`hand`")));
}

#[test]
fn limits_that_are_missing_or_none() {
    let shoulder = joint("shoulder");
    let arm_of = |old: &str, new: &str| arm(&arm_with(old, new));
    let changed = arm_of("effort=\"40\"", "effort=\"0\"");
    check(&changed, &shoulder, &["a zero effort limit", "100"]);
    assert_eq!(changed.description.joints[0].torque_nm, 100.0);
    let changed = arm_of("velocity=\"2\"", "");
    check(&changed, &shoulder, &["no velocity limit", "3.1416 rad/s"]);
    assert_eq!(changed.description.joints[0].velocity_rad_s, PI);
    let changed = arm_of("velocity=\"2\"", "velocity=\"1e16\"");
    check(&changed, &shoulder, &["is no limit", "1000"]);
    let changed = arm_of("lower=\"-2\" upper=\"2\"", "");
    check(&changed, &shoulder, &["no limits of its position"]);
    assert_eq!(changed.description.joints[0].position_rad, Range::new(-TAU, TAU));
    let endless =
        arm_of("name=\"shoulder\" type=\"revolute\"", "name=\"shoulder\" type=\"continuous\"");
    check(&endless, &shoulder, &["without end", "±2π"]);
    let infinite = arm_of("lower=\"-2\" upper=\"2\"", "lower=\"-inf\" upper=\"inf\"");
    check(&infinite, &shoulder, &["infinite limits"]);
    let none = arm(&ARM.replacen("<limit ", "<none ", 1));
    assert_eq!(none.doubts.len(), 3, "{:?}", none.doubts);
}

#[test]
fn friction_and_damping() {
    let rough = "<axis xyz=\"0 0 1\"/><dynamics damping=\"0.3\" friction=\"0.7\"/>";
    let arm = arm(&arm_with("<axis xyz=\"0 0 1\"/>", rough));
    check(&arm, &Part::Robot, &["friction f of the joints `shoulder`", "tanh(20 q̇)"]);
    let [shoulder, elbow] = &arm.description.joints[..] else { panic!("two joints") };
    assert_eq!(shoulder.damping_nm_s_rad, 0.3);
    let JointFriction { phi1_nm, phi2_s_rad, phi3_rad_s } = shoulder.friction.unwrap();
    for speed in [-3.0, -0.01, 0.0, 0.02, 1.0_f64] {
        let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
        let torque = phi1_nm
            * (sigmoid(phi2_s_rad * (speed + phi3_rad_s)) - sigmoid(phi2_s_rad * phi3_rad_s));
        assert!((torque - 0.7 * (20.0 * speed).tanh()).abs() < 1e-15, "{speed}");
    }
    assert_eq!(elbow.friction.unwrap().phi1_nm, 0.0);
}

const FINGERS: &str = "\
    <link name='left'><inertial><mass value='0.1'/><inertia ixx='1.1e-4' ixy='0' ixz='0' iyy='1.2e-4' iyz='0' izz='1e-4'/></inertial></link>\
    <link name='right'/>\
    <joint name='left_finger' type='prismatic'><parent link='hand'/><child link='left'/>\
    <axis xyz='0 1 0'/><limit lower='0.01' upper='0.04' effort='1' velocity='1'/></joint>\
    <joint name='right_finger' type='prismatic'><parent link='hand'/><child link='right'/>\
    <axis xyz='0 -1 0'/><mimic joint='left_finger' offset='0.001'/></joint></robot>";

#[test]
fn fingers_share_a_tip_and_stand() {
    let text = arm_with("</robot>", FINGERS);
    let arm = arm(&text);
    assert_eq!(arm.tip, "hand");
    let doubts: Vec<String> = arm.doubts.iter().map(ToString::to_string).collect();
    let expected = [
        ("link `hand`", "`left`, `right` follow it"),
        ("joint `left_finger`", "stands at 0 m"),
        ("joint `right_finger`", "mimics joint `left_finger`, and stands at 0.001 m"),
    ];
    assert_eq!(doubts.len(), expected.len(), "{doubts:#?}");
    for (doubt, (part, text)) in doubts.iter().zip(expected) {
        assert!(doubt.starts_with(part) && doubt.contains(text), "{doubt}");
    }
    assert!(doubts[1].contains("outside of its limits, 0.01 to 0.04"), "{}", doubts[1]);

    let locks = BTreeMap::from([("left_finger".to_owned(), 0.02)]);
    let opened = read(&text, &Options { locks, ..Options::default() }).unwrap();
    assert!(opened.doubts.iter().all(|doubt| doubt.part != joint("left_finger")));
    let mimics = opened.doubts.iter().find(|doubt| doubt.part == joint("right_finger")).unwrap();
    assert!(mimics.text.contains("stands at 0.021 m"), "{mimics}");
    assert_ne!(opened.description.joints[1].link, arm.description.joints[1].link);
}

#[test]
fn inertias_that_are_odd() {
    let placeholder = ARM
        .replace("ixx=\"0.02\"", "ixx=\"1\"")
        .replace("iyy=\"0.02\"", "iyy=\"1\"")
        .replace("izz=\"0.003\"", "izz=\"1\"");
    check(&arm(&placeholder), &link("upper"), &["perhaps a placeholder"]);
    let shape =
        "<link name=\"hand\"><visual><geometry><mesh filename=\"a\"/></geometry></visual></link>";
    check(&arm(&arm_with("<link name=\"hand\"/>", shape)), &link("hand"), &["no <inertial>"]);
    let options = Options { nearest_physical: true, ..Options::default() };
    let repaired = read(&arm_with("izz=\"0.003\"", "izz=\"0.3\""), &options).unwrap();
    check(&repaired, &link("upper"), &["no body has the inertia", "nearest"]);
}

#[test]
fn joints_beside_the_arm_are_left_out() {
    let head = "<link name='head'/><joint name='neck' type='revolute'><parent link='base'/>\
                <child link='head'/></joint></robot>";
    check(&arm(&arm_with("</robot>", head)), &Part::Robot, &["left out", "`neck`"]);
}

#[test]
fn motions_begin_within_the_limits() {
    let arm = arm(&arm_with("lower=\"-1\" upper=\"2\"", "lower=\"-0.2\" upper=\"0.4\""));
    let state = &arm.description.initial_state;
    assert!((state.center_rad[1] - 0.1).abs() < 1e-15);
    assert!((state.spread_rad - 0.15).abs() < 1e-15);
    assert_eq!(state.joint1_scale, Range::new(0.2, 0.8));
    assert_eq!((state.joint1_velocity_rad_s, state.velocity_rad_s), (0.5, 2.0));
    // Joint 1 begins on either side of 0.
    let uneven = read(&arm_with("lower=\"-2\"", "lower=\"-0.5\""), &Options::default()).unwrap();
    assert_eq!(uneven.description.initial_state.joint1_scale, Range::new(0.05, 0.2));
    let beside = read(&arm_with("lower=\"-2\"", "lower=\"0.5\""), &Options::default()).unwrap();
    check(&beside, &joint("shoulder"), &["both sides of 0", "0.5 to 2 rad"]);
}
