//! Descriptions written back into their URDFs: what is read again, and which bytes change.

use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;
use random::keyed;
use spec::{AttachedBody, BodyDescription, JointFriction, RobotDescription};
use urdf::{Arm, Options, UrdfError, read, write};

use crate::agreement::check;
use crate::damaged::damaged;
use crate::refused::ARM;
use crate::robots::{Draws, Robot};

fn body(draws: &mut Draws) -> BodyDescription {
    let moments = Vector3::from(draws.vector(0.05)).abs() + Vector3::repeat(1e-4);
    let axes = Rotation3::from_scaled_axis(Vector3::from(draws.vector(3.0)));
    let moments = axes.matrix() * Matrix3::from_diagonal(&moments) * axes.matrix().transpose();
    let inertia = Matrix3::identity() * moments.trace() - moments;
    BodyDescription {
        mass_kg: 0.1 + draws.within(4.0).abs(),
        center_m: draws.vector(0.3),
        inertia_kg_m2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| inertia[at]),
        nearest_physical: false,
    }
}

/// The description with other bodies, damping and friction.
fn changed(description: &RobotDescription, draws: &mut Draws) -> RobotDescription {
    let mut changed = description.clone();
    for joint in &mut changed.joints {
        joint.link = body(draws);
        joint.damping_nm_s_rad = draws.within(20.0).abs();
        let phi1_nm = draws.within(10.0).abs();
        joint.friction = Some(JointFriction { phi1_nm, phi2_s_rad: 40.0, phi3_rad_s: 0.0 });
    }
    changed
}

#[track_caller]
fn assert_same(ours: &BodyDescription, theirs: &BodyDescription) {
    let entries = |body: &BodyDescription| {
        let [x, y, z] = body.center_m;
        let [xx, xy, xz, yy, yz, zz] = body.inertia_kg_m2;
        [body.mass_kg, x, y, z, xx, xy, xz, yy, yz, zz]
    };
    for (ours, theirs) in entries(ours).into_iter().zip(entries(theirs)) {
        assert!((ours - theirs).abs() < 1e-12, "{ours}, not {theirs}");
    }
}

/// All but the bodies and the sources, which have the digest of the text.
fn without_bodies(description: &RobotDescription) -> RobotDescription {
    let mut rest = description.clone();
    rest.sources.clear();
    let none = BodyDescription {
        mass_kg: 0.0,
        center_m: [0.0; 3],
        inertia_kg_m2: [0.0; 6],
        nearest_physical: false,
    };
    for joint in &mut rest.joints {
        joint.link = none;
    }
    rest
}

proptest! {
    #[test]
    fn a_changed_description_is_read_again(seed in any::<u64>()) {
        let (robot, options) = Robot::locked(seed);
        let text = robot.urdf(seed);
        let arm = read(&text, &options).unwrap();
        let changed = changed(&arm.description, &mut Draws::new(seed, 5));
        let written = write(&text, &arm, &changed).unwrap();
        let again = read(&written, &options).unwrap();
        prop_assert_eq!(without_bodies(&again.description), without_bodies(&changed));
        for (ours, theirs) in again.description.joints.iter().zip(&changed.joints) {
            assert_same(&ours.link, &theirs.link);
        }
        prop_assert_eq!(&again.bodies, &arm.bodies);
        // The comments, elements and frames are there already.
        prop_assert_eq!(write(&written, &again, &changed).unwrap(), written);
    }

    #[test]
    fn an_unchanged_description_moves_as_before(seed in any::<u64>()) {
        let (robot, options) = Robot::locked(seed);
        let text = robot.urdf(seed);
        let arm = read(&text, &options).unwrap();
        let written = write(&text, &arm, &arm.description).unwrap();
        let again = read(&written, &options).unwrap();
        check(&robot, &again, &options.mount, &mut Draws::new(seed, 6), 1e-12);
        prop_assert_eq!(without_bodies(&again.description), without_bodies(&arm.description));
    }

    #[test]
    fn only_inertials_and_dynamics_change(seed in any::<u64>()) {
        let (robot, options) = Robot::locked(seed);
        let text = robot.urdf(seed).replace('\n', "\r\n");
        let arm = read(&text, &options).unwrap();
        let changed = changed(&arm.description, &mut Draws::new(seed, 5));
        let written = write(&text, &arm, &changed).unwrap();
        prop_assert_eq!(bare(&written), bare(&text));
    }

    #[test]
    fn a_damaged_text_that_gives_an_arm_can_be_written(seed in any::<u64>()) {
        let whole = if seed % 2 == 0 { ARM.to_owned() } else { Robot::random(seed, 9.0).urdf(seed) };
        let mut draws = keyed([seed, 4, 0, 0]);
        for _ in 0..16 {
            let text = damaged(&whole, &mut draws);
            let options = Options { nearest_physical: true, ..Options::default() };
            let Ok(arm) = read(&text, &options) else { continue };
            let written = write(&text, &arm, &arm.description).unwrap();
            let again = read(&written, &options).unwrap();
            prop_assert_eq!(without_bodies(&again.description), without_bodies(&arm.description));
        }
    }
}

/// The text without the elements that may change, and with one spelling of empty elements.
fn bare(text: &str) -> String {
    let mut text = text.to_owned();
    for (start, end) in
        [("<inertial>", "</inertial>"), ("<dynamics", "/>"), ("<!-- torqued:", "-->")]
    {
        while let Some(at) = text.find(start) {
            let length = text[at..].find(end).unwrap() + end.len();
            let from = text[..at].trim_end().len();
            text.replace_range(from..at + length, "");
        }
    }
    text.replace("\r\n</link>", "</link>").replace("></link>", "/>")
}

/// An arm as people write it.
const WRITTEN: &str = r#"<?xml version="1.0" encoding="utf-8"?>
<!-- é: the arm's -->
<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro">
    <gazebo reference="upper"><inertial><mass value="9"/></inertial></gazebo>
    <link name="base">
        <inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
    </link>
    <link name="upper">
        <inertial> <!-- by CAD -->
            <mass unit='kg' value='2.0' />
            <inertia iyy="0.02" ixx="0.02" ixy="0" ixz="0" iyz="0" izz="0.003"></inertia>
        </inertial>
        <visual><geometry><mesh filename="upper.stl"/></geometry></visual>
        <gazebo><inertial><mass value="1"/></inertial></gazebo>
    </link>
    <link name="lower"/>
    <link name="camera">
        <!-- 80 g -->
        <inertial>
            <origin xyz="0.1 0 0"/>
            <mass value="1.5"/>
            <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.015" iyz="0" izz="0.015"/>
        </inertial>
        <visual><![CDATA[<inertial/></link>]]></visual>
    </link>
    <link name="cable">

        <inertial>
            <mass value="0.5"/>
            <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/>
        </inertial>
    </link>
    <joint name="shoulder" type="revolute">
        <parent link="base"/> <child link="upper"/>
        <axis xyz="0 0 1"/>
        <dynamics damping = "1.50" spring_stiffness='3' />
        <limit lower="-2" upper="2" effort="40" velocity="2"/>
    </joint>
    <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/></joint>
    <joint name="mount" type="fixed">
        <origin xyz="0 0 0.25"/>
        <parent link="lower"/>
        <child link="camera"/> <!-- glued -->
    </joint>
    <joint name="drum" type="continuous">
        <parent link="lower"/>
        <child link="cable"/>
        <dynamics damping="7" friction="7"/>
    </joint>
    <transmission name="t"><joint name="shoulder"><dynamics damping="9"/></joint></transmission>
</robot>
<!-- end -->
"#;

fn options() -> Options {
    Options { tip: Some("camera".to_owned()), ..Options::default() }
}

fn written() -> (Arm, RobotDescription) {
    let arm = read(WRITTEN, &options()).unwrap();
    let mut description = arm.description.clone();
    description.joints[0].link = BodyDescription {
        mass_kg: 2.25,
        center_m: [0.0, 0.0, 1.25e-7],
        inertia_kg_m2: [0.5, 0.0, 0.0, 0.5, 0.0, 0.375],
        nearest_physical: false,
    };
    description.joints[1].link = BodyDescription {
        mass_kg: 1.75,
        center_m: [0.0; 3],
        inertia_kg_m2: [0.25, 0.0, 0.0, 0.25, 0.0, 0.25],
        nearest_physical: false,
    };
    description.joints[0].damping_nm_s_rad = 1.5;
    description.joints[0].friction =
        Some(JointFriction { phi1_nm: 0.5, phi2_s_rad: 20.0, phi3_rad_s: -0.125 });
    description.joints[1].damping_nm_s_rad = 0.75;
    description.joints[1].friction = Some(COULOMB);
    description.joints[1].armature_kg_m2 = 0.01;
    (arm, description)
}

/// 0.5 N·m of Coulomb friction, as a URDF is read.
const COULOMB: JointFriction = JointFriction { phi1_nm: 1.0, phi2_s_rad: 40.0, phi3_rad_s: 0.0 };

#[test]
fn a_text_keeps_its_bytes_but_for_the_numbers() {
    let (arm, description) = written();
    let mut expected = WRITTEN.to_owned();
    for (old, new) in [
        ("value='2.0'", "value='2.25'"),
        (
            r#"<inertia iyy="0.02" ixx="0.02" ixy="0" ixz="0" iyz="0" izz="0.003"></inertia>"#,
            "<inertia iyy=\"0.5\" ixx=\"0.5\" ixy=\"0\" ixz=\"0\" iyz=\"0\" izz=\"0.375\"></inertia>\n            \
             <origin xyz=\"0 0 1.25e-7\" rpy=\"0 0 0\"/>",
        ),
        (
            r#"<link name="lower"/>"#,
            r#"<link name="lower">
        <inertial>
            <origin xyz="0 0 0" rpy="0 0 0"/>
            <mass value="1.75"/>
            <inertia ixx="0.25" ixy="0" ixz="0" iyy="0.25" iyz="0" izz="0.25"/>
        </inertial>
    </link>"#,
        ),
        (
            r#"<inertial>
            <origin xyz="0.1 0 0"/>
            <mass value="1.5"/>
            <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.015" iyz="0" izz="0.015"/>
        </inertial>"#,
            "<!-- torqued: the mass of this link and of others without an inertial is in \
             the child link of the joint that moves them -->",
        ),
        (
            r#"

        <inertial>
            <mass value="0.5"/>
            <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/>
        </inertial>"#,
            "",
        ),
        (
            "spring_stiffness='3' />",
            "spring_stiffness='3' friction=\"0.25\" phi2_s_rad=\"20\" /> \
             <!-- torqued: phi1_nm 0.5, phi2_s_rad 20, phi3_rad_s -0.125 -->",
        ),
        (
            r#"<axis xyz="0 1 0"/></joint>"#,
            "<axis xyz=\"0 1 0\"/><dynamics damping=\"0.75\" friction=\"0.5\" \
             armature=\"0.01\"/></joint>",
        ),
    ] {
        assert_eq!(expected.matches(old).count(), 1, "{old}");
        expected = expected.replace(old, new);
    }
    assert_eq!(write(WRITTEN, &arm, &description).unwrap(), expected);

    // Windows' line ends stay as well.
    let text = WRITTEN.replace('\n', "\r\n");
    let written = write(&text, &arm, &description).unwrap();
    assert_eq!(written, expected.replace('\n', "\r\n"));
}

#[test]
fn a_comment_of_an_earlier_writing_is_replaced() {
    let (arm, mut description) = written();
    let once = write(WRITTEN, &arm, &description).unwrap();
    assert_eq!(write(&once, &arm, &description).unwrap(), once);
    description.joints[1].armature_kg_m2 = 0.0;
    description.joints[0].friction = Some(JointFriction { phi1_nm: 0.5, ..COULOMB });
    let twice = write(&once, &arm, &description).unwrap();
    let expected = once
        .replace("armature=\"0.01\"", "armature=\"0\"")
        .replace("phi2_s_rad=\"20\" />", "phi2_s_rad=\"40\" />")
        .replace(" <!-- torqued: phi1_nm 0.5, phi2_s_rad 20, phi3_rad_s -0.125 -->", "");
    assert_eq!(twice, expected);
}

#[test]
fn a_rotor_inertia_is_read_back() {
    let (arm, description) = written();
    let again = write(WRITTEN, &arm, &description).unwrap();
    let again = read(&again, &options()).unwrap();
    assert_eq!(again.description.joints[0].armature_kg_m2, 0.0);
    assert_eq!(again.description.joints[1].armature_kg_m2, 0.01);
    let wrong = WRITTEN.replacen("spring_stiffness='3'", "armature='-0.5'", 1);
    let message = read(&wrong, &options()).unwrap_err().to_string();
    assert!(message.contains("dynamics armature is -0.5"), "{message}");
}

/// An identified arm had another bend in its URDF, tanh(20 q̇), than in its description.
#[test]
fn the_bend_of_friction_is_read_back() {
    let (arm, mut description) = written();
    description.joints[0].friction = Some(JointFriction { phi2_s_rad: 200.0, ..COULOMB });
    description.joints[1].friction = Some(JointFriction { phi2_s_rad: 12.5, ..COULOMB });
    let text = write(WRITTEN, &arm, &description).unwrap();
    assert!(text.contains("friction=\"0.5\" armature=\"0.01\" phi2_s_rad=\"12.5\"/>"), "{text}");
    let again = read(&text, &options()).unwrap();
    for (again, joint) in again.description.joints.iter().zip(&description.joints) {
        assert_eq!(again.friction, joint.friction);
    }
    let assumed = again.doubts.iter().filter(|doubt| doubt.to_string().contains("tanh"));
    assert_eq!(assumed.count(), 0, "the URDF says how the friction bends");
    assert_eq!(write(&text, &arm, &description).unwrap(), text);
    let wrong = text.replacen("phi2_s_rad=\"200\"", "phi2_s_rad='1001'", 1);
    let message = read(&wrong, &options()).unwrap_err().to_string();
    assert!(message.contains("dynamics phi2_s_rad is 1001"), "{message}");
    assert!(message.contains("0 to 1000 s/rad"), "{message}");
}

#[test]
fn friction_that_is_not_known_stays_as_it_is() {
    let (arm, mut description) = written();
    for joint in &mut description.joints {
        joint.friction = None;
    }
    let written = write(WRITTEN, &arm, &description).unwrap();
    assert!(written.contains("<dynamics damping = \"1.50\" spring_stiffness='3' />"));
    assert!(written.contains("<dynamics damping=\"0.75\" armature=\"0.01\"/></joint>"));

    // Without damping and rotor inertia there is nothing to say.
    description.joints[1].damping_nm_s_rad = 0.0;
    description.joints[1].armature_kg_m2 = 0.0;
    let written = write(WRITTEN, &arm, &description).unwrap();
    assert!(written.contains("<axis xyz=\"0 1 0\"/></joint>"));
}

#[test]
fn the_hand_s_bodies_are_part_of_the_last_body() {
    let (arm, mut description) = written();
    let payload = BodyDescription {
        mass_kg: 0.25,
        center_m: [0.0, 0.0, 0.5],
        inertia_kg_m2: [0.25, 0.0, 0.0, 0.25, 0.0, 0.25],
        nearest_physical: false,
    };
    description.hand.bodies =
        vec![AttachedBody { name: "load".to_owned(), position_m: [0.0, 0.0, 0.25], body: payload }];
    let written = write(WRITTEN, &arm, &description).unwrap();
    // The hand's frame is 0.25 m from the last link's, so the payload's centre is at 1 m.
    let reduced = 1.75 * 0.25 / (1.75 + 0.25);
    let end = (0.25_f64 / 2.0, 0.5 + reduced);
    let options = Options { tip: Some("camera".to_owned()), ..Options::default() };
    let again = read(&written, &options).unwrap();
    let last = &again.description.joints[1].link;
    let frame = &again.bodies[1];
    let center: Vec<f64> = (0..3)
        .map(|row| (0..3).map(|axis| frame.rotation[row][axis] * last.center_m[axis]).sum())
        .collect();
    assert_eq!(last.mass_kg, 2.0);
    assert!((center[2] - end.0).abs() < 1e-15 && center[0].abs() < 1e-15, "{center:?}");
    let trace = |body: &BodyDescription| {
        let [xx, _, _, yy, _, zz] = body.inertia_kg_m2;
        xx + yy + zz
    };
    assert!((trace(last) - 2.0 * end.1 - 0.5).abs() < 1e-14, "{last:?}");
}

#[test]
fn other_descriptions_and_other_texts_are_refused() {
    let (arm, description) = written();
    let error = |description: &RobotDescription| {
        let error = write(WRITTEN, &arm, description).unwrap_err();
        let made = urdf::mjcf(description, Some(&arm));
        assert_eq!(made, Err(error.clone()));
        error.to_string()
    };
    let mut other = description.clone();
    other.joints.pop();
    assert!(error(&other).starts_with("the description has 1 joints, the arm has 2"));
    let mut other = description.clone();
    other.joints[0].name = "hip".to_owned();
    assert!(error(&other).contains("joint `hip` in the place of `shoulder`"));
    let mut other = description.clone();
    other.joints[1].d_m += 0.001;
    assert!(error(&other).contains("joint `elbow` with other lengths or angles"));

    let text = WRITTEN.replace("\"lower\"", "\"forearm\"");
    let refused = write(&text, &arm, &description);
    assert!(matches!(refused, Err(UrdfError::OtherChild { .. })), "{refused:?}");
    let text = WRITTEN.replace("\"cable\"", "\"rope\"");
    let refused = write(&text, &arm, &description).unwrap_err();
    assert!(refused.to_string().starts_with("the arm names link `cable`, which is not there"));
}
