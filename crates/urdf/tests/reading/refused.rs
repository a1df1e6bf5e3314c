//! What is refused, and what the messages say.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::{Duration, Instant};

use spec::BaseDescription;
use urdf::{Options, UrdfError, read};

/// An arm of two joints, with a fixed hand.
pub const ARM: &str = r#"
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1"/>
      <mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.003"/>
    </inertial>
  </link>
  <link name="lower">
    <inertial>
      <origin xyz="0.1 0 0"/>
      <mass value="1.5"/>
      <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.015" iyz="0" izz="0.015"/>
    </inertial>
  </link>
  <link name="hand"/>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.2"/>
    <parent link="base"/>
    <child link="upper"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="40" velocity="2"/>
  </joint>
  <joint name="elbow" type="revolute">
    <origin xyz="0 0 0.3"/>
    <parent link="upper"/>
    <child link="lower"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="20" velocity="3"/>
  </joint>
  <joint name="wrist" type="fixed">
    <origin xyz="0.3 0 0"/>
    <parent link="lower"/>
    <child link="hand"/>
  </joint>
</robot>"#;

/// `ARM` with `old` replaced by `new`.
#[track_caller]
pub fn arm_with(old: &str, new: &str) -> String {
    assert!(ARM.contains(old), "{old}");
    ARM.replacen(old, new, 1)
}

fn tip(link: &str) -> Options {
    Options { tip: Some(link.to_owned()), ..Options::default() }
}

fn lock(joint: &str, position: f64) -> Options {
    Options { locks: BTreeMap::from([(joint.to_owned(), position)]), ..Options::default() }
}

/// The arm is refused with a message that has all these words.
#[track_caller]
fn check(text: &str, options: &Options, words: &[&str]) {
    let error = read(text, options).expect_err("the arm is taken").to_string();
    for word in words {
        assert!(error.contains(word), "{error}\nlacks {word:?}");
    }
}

#[track_caller]
fn check_replaced(old: &str, new: &str, words: &[&str]) {
    check(&arm_with(old, new), &Options::default(), words);
}

#[test]
fn texts_that_are_no_urdf() {
    let options = Options::default();
    check("", &options, &["line 1", "no element"]);
    check("hello", &options, &["line 1 is not XML"]);
    // PostgreSQL keeps no text with a NUL.
    check("<robot>\n\0</robot>", &options, &["line 2 is not XML", "NUL character"]);
    check("<robot name='a'>\n<link name='b'>\n</robot>", &options, &["line 3 is not XML"]);
    check("<robot name='a'><link name='b'/>", &options, &["ends inside"]);
    check("<robot name='a'/><robot name='b'/>", &options, &["second root"]);
    check("<mujoco model='a'/>", &options, &["root element is `mujoco`", "allowed: `robot`"]);
    check("<robot/>", &options, &["the robot has no attribute `name`"]);
    check("<robot name='a'/>", &options, &["no <link>"]);
    check("<robot name='a'><link/></robot>", &options, &["attribute `name` in a <link>"]);
    check(&" ".repeat(5 << 20), &options, &["5242880 bytes", "at most 4194304"]);
}

#[test]
fn xacro_before_it_is_processed() {
    let element = "<xacro:property name='pi' value='3.14'/><link name=\"base\"/>";
    check_replaced("<link name=\"base\"/>", element, &["<xacro:property>", "only xacro"]);
    check_replaced("0 0 0.2", "0 0 ${height}", &["joint `shoulder`", "${height}", "only xacro"]);
}

#[test]
fn entities_are_not_expanded() {
    let bomb = "<!DOCTYPE robot [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>]>";
    check(&format!("{bomb}{ARM}"), &Options::default(), &["<!DOCTYPE>", "not allowed"]);
    check_replaced("name=\"arm\"", "name=\"&b;\"", &["is not XML"]);
}

#[test]
fn names() {
    check_replaced("link name=\"lower\"", "link name=\"upper\"", &["link `upper` is there twice"]);
    check_replaced("name=\"elbow\"", "name=\"shoulder\"", &["joint `shoulder` is there twice"]);
    check_replaced(
        "parent link=\"upper\"",
        "parent link=\"uper\"",
        &["<parent> of joint `elbow`", "link `uper`", "did you mean `upper`?"],
    );
    check_replaced("child link=\"hand\"", "child link=\"x\"", &["<child> of joint `wrist`"]);
    check(ARM, &tip("hnad"), &["the tip names link `hnad`", "did you mean `hand`?"]);
    check(ARM, &lock("elbw", 0.0), &["a lock names joint `elbw`", "did you mean `elbow`?"]);
    let there = "joint `foo`, which is not there. The joints are `shoulder`, `elbow`, `wrist`";
    check(ARM, &lock("foo", 0.0), &[there]);
    let base = Options { base: Some("floor".to_owned()), ..Options::default() };
    check(ARM, &base, &["the base names link `floor`"]);
}

#[test]
fn values() {
    for number in ["nan", "inf", "1e400", "1,5", "0x1", "", "1e300"] {
        let xyz = format!("0 {number} 0.2");
        check_replaced("0 0 0.2", &xyz, &["joint `shoulder`: origin xyz is", "allowed:"]);
        let mass = format!("value=\"{number}\"");
        check_replaced("value=\"2\"", &mass, &["link `upper`: mass value is", "allowed: a number"]);
    }
    check_replaced("0 0 0.2", "0 0.2", &["three numbers"]);
    check_replaced("0 0 0.2", "0 0 0.2 0", &["three numbers"]);
    check_replaced("0 0 0.2", "1 oops 2 3", &["three numbers"]);
    check_replaced("xyz=\"0 1 0\"", "xyz=\"0 0 0\"", &["joint `elbow`: axis xyz", "direction"]);
    check_replaced(
        "type=\"fixed\"",
        "type=\"ball\"",
        &["joint `wrist`: type is `ball`", "revolute"],
    );
    check_replaced("<mass value=\"2\"/>", "", &["link `upper` has no <mass>"]);
    check_replaced("ixy=\"0\"", "", &["link `upper` has no `ixy`"]);
    check_replaced(
        "<mass value=\"2\"/>",
        "<mass value=\"2\"/><mass value=\"2\"/>",
        &["two <mass>"],
    );
    check_replaced("value=\"2\"", "value=\"2\" value=\"3\"", &["two attributes `value`"]);
    check_replaced("<parent link=\"base\"/>", "", &["joint `shoulder` has no <parent>"]);
}

#[test]
fn limits() {
    let words = ["joint `shoulder`: limit lower, upper is"];
    check_replaced("upper=\"2\"", "upper=\"200\"", &[words[0], "within ±100 rad"]);
    check_replaced("upper=\"2\"", "upper=\"-2\"", &[words[0], "--lock shoulder=VALUE"]);
    check_replaced("upper=\"2\"", "upper=\"-3\"", &[words[0], "above the lower"]);
    check_replaced("upper=\"2\"", "upper=\"nan\"", &["limit upper is `nan`"]);
    check_replaced(
        "effort=\"40\"",
        "effort=\"-1\"",
        &["limit effort is -1", "0.001 to 100000 N·m"],
    );
    check_replaced("velocity=\"2\"", "velocity=\"1e-9\"", &["limit velocity is 0.000000001"]);
    let damped = "<axis xyz=\"0 0 1\"/><dynamics damping=\"-1\"/>";
    check_replaced("<axis xyz=\"0 0 1\"/>", damped, &["dynamics damping is -1", "0 to 1000"]);
    let rough = "<axis xyz=\"0 0 1\"/><dynamics friction=\"60\"/>";
    check_replaced("<axis xyz=\"0 0 1\"/>", rough, &["dynamics friction is 60", "0 to 50"]);
    check_replaced("0 0 0.3", "0 30 0", &["joint `elbow`.shift_m", "allowed: "]);
}

#[test]
fn mounts() {
    for number in [f64::NAN, f64::INFINITY, 1e9] {
        let mount = BaseDescription { position_m: [0.0; 3], rpy_deg: [number, 0.0, 1.0] };
        let options = Options { mount, ..Options::default() };
        check(ARM, &options, &["base.rpy_deg", "allowed: "]);
    }
}

#[test]
fn trees() {
    let options = Options::default();
    check_replaced(
        "child link=\"hand\"",
        "child link=\"upper\"",
        &["link `upper` is the child of the joints `shoulder` and `wrist`"],
    );
    check_replaced("parent link=\"base\"", "parent link=\"hand\"", &["loop"]);
    check_replaced("parent link=\"base\"", "parent link=\"upper\"", &["`upper`", "loop"]);
    let second = arm_with("<link name=\"base\"/>", "<link name=\"base\"/><link name=\"table\"/>");
    check(&second, &options, &["`base`, `table` are the child of no joint", "--base LINK"]);
    let base = Options { base: Some("base".to_owned()), ..Options::default() };
    let doubts = read(&second, &base).unwrap().doubts;
    assert!(doubts[0].text.contains("`table`"), "{doubts:?}");
}

#[test]
fn chains() {
    check(ARM, &tip("base"), &["no joint moves between link `base` and link `base`"]);
    let base = Options { base: Some("lower".to_owned()), ..tip("upper") };
    check(ARM, &base, &["link `upper` does not follow link `lower`"]);
    let base = Options { base: Some("lower".to_owned()), ..Options::default() };
    check(ARM, &base, &["no joint moves between link `lower` and link `hand`"]);
    check_replaced(
        "name=\"shoulder\" type=\"revolute\"",
        "name=\"shoulder\" type=\"prismatic\"",
        &["joint `shoulder` between base and tip is prismatic", "--lock shoulder=VALUE"],
    );
    check(ARM, &lock("elbow", f64::NAN), &["joint `elbow`: the lock's position is NaN"]);
    check(ARM, &lock("wrist", 1.0), &["joint `wrist`", "allowed: 0, as the joint is fixed"]);

    let branch = "<link name='other'/><joint name='other_elbow' type='revolute'>\
                  <parent link='upper'/><child link='other'/></joint>";
    let text = arm_with("</robot>", &format!("{branch}</robot>"));
    check(&text, &Options::default(), &["2 moving joints", "`other`, `hand`", "--tip LINK"]);
}

#[test]
fn nine_joints_are_too_many() {
    let mut text = "<robot name='long'><link name='l0'/>".to_owned();
    for joint in 1..=9 {
        write!(
            text,
            "<link name='l{joint}'><inertial><mass value='1'/><inertia ixx='.1' ixy='0' ixz='0' iyy='.1' iyz='0' izz='.1'/></inertial></link>\
             <joint name='j{joint}' type='revolute'><parent link='l{}'/><child link='l{joint}'/>\
             <limit lower='-1' upper='1' effort='1' velocity='1'/></joint>",
            joint - 1
        )
        .unwrap();
    }
    text += "</robot>";
    check(&text, &Options::default(), &["9 joints move", "`j1`, `j2`", "--lock JOINT=VALUE"]);
    assert_eq!(read(&text, &lock("j3", 0.5)).unwrap().description.joints.len(), 8);
}

#[test]
fn inertias() {
    let impossible = arm_with("izz=\"0.003\"", "izz=\"0.3\"");
    check(&impossible, &Options::default(), &["link `upper`", "0.3]", "--nearest-physical"]);
    let negative = arm_with("value=\"2\"", "value=\"-2\"");
    check(&negative, &Options::default(), &["link `upper` has mass -2 kg"]);
    let none = ARM.replace("inertial>", "nothing>");
    check(&none, &Options::default(), &["joint `shoulder` moves no mass", "(`upper`)"]);
    let point = ARM
        .replace("ixx=\"0.02\"", "ixx=\"0\"")
        .replace("iyy=\"0.02\"", "iyy=\"0\"")
        .replace("izz=\"0.003\"", "izz=\"0\"");
    check(
        &point,
        &Options::default(),
        &["joint `shoulder` moves (`upper`)", "point, rod or sheet"],
    );
    for text in [impossible, negative, none, point] {
        let options = Options { nearest_physical: true, ..Options::default() };
        let arm = read(&text, &options).unwrap();
        assert!(arm.description.joints.iter().all(|joint| joint.link.has_second_moments()));
        assert!(!arm.doubts.is_empty());
    }
    // What stands needs no inertia.
    let base = "<link name='base'><inertial><mass value='-1'/><inertia ixx='-1' ixy='0' ixz='0' \
                iyy='0' iyz='0' izz='0'/></inertial></link>";
    read(&arm_with("<link name=\"base\"/>", base), &Options::default()).unwrap();
}

/// The time is for unoptimised builds on busy machines. A quadratic reader would take minutes.
#[track_caller]
fn check_soon(text: &str, words: &[&str]) {
    let start = Instant::now();
    check(text, &Options::default(), words);
    let took = start.elapsed();
    assert!(took < Duration::from_secs(20), "{took:?}");
}

#[test]
fn hostile_texts_are_refused_soon() {
    let nested = |tag: &str| {
        let many = 100_000;
        let (open, close) = (format!("<{tag}>").repeat(many), format!("</{tag}>").repeat(many));
        format!("<robot name='a'><link name='b'>{open}{close}</link></robot>")
    };
    check_soon(&nested("a"), &["more than 100 elements inside each other"]);
    check_soon(&nested("visual"), &["inside each other"]);
    let many = format!("<robot name='a'>{}</robot>", "<a/>".repeat(300_000));
    check_soon(&many, &["more than 200000 elements"]);
    let attributes: String = (0..300_000).map(|index| format!("a{index}='' ")).collect();
    check_soon(&format!("<robot name='a'><link {attributes}/></robot>"), &["attribute `name`"]);
    let spaces = "xmlns:a='b' ".repeat(300_000);
    check_soon(&format!("<robot name='a' {spaces}/>"), &["no <link>"]);
    let long = "x".repeat(1 << 20);
    let error =
        read(&arm_with("name=\"elbow\"", &format!("name=\"{long}\"")), &lock(&long, f64::NAN));
    assert!(error.unwrap_err().to_string().len() < 1000);
}

#[test]
fn long_chains_of_links_are_walked_soon() {
    let many = 9_000;
    let mut text = "<robot name='long'><link name='l0'/>".to_owned();
    for index in 1..=many {
        write!(
            text,
            "<link name='l{index}'/><joint name='j{index}' type='fixed'><parent link='l{}'/>\
             <child link='l{index}'/></joint>",
            index - 1
        )
        .unwrap();
    }
    check_soon(&(text.clone() + "</robot>"), &["no joint moves"]);
    let mimics = text.replace("</joint>", "<mimic joint='j1'/></joint>");
    check_soon(&(mimics + "</robot>"), &["no joint moves"]);
    // Every name is compared with this one.
    let lost = "<joint name='x' type='fixed'><parent link='m1'/><child link='l1'/></joint></robot>";
    check_soon(&(text + lost), &["link `m1`, which is not there"]);
}

#[test]
fn errors_can_be_told_apart() {
    let error = read(ARM, &tip("base")).unwrap_err();
    assert!(matches!(error, UrdfError::NothingMoves { .. }));
}
