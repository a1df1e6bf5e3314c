//! `torqued robot` with URDFs: an arm is shown, drawn, computed, checked and simulated, without a server
//! and with one that keeps it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use spec::RobotDescription;

use crate::product::{Product, run_to_end, torqued};

/// An arm of so many equal links that turn about y and x by turns, with a tool that is welded to the last one.
fn urdf(joints: usize) -> String {
    let inertial = r#"<inertial><origin xyz="0 0 0.1"/><mass value="0.8"/>
        <inertia ixx="0.004" iyy="0.004" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    let mut text = String::from(r#"<?xml version="1.0"?><robot name="chain"><link name="foot"/>"#);
    let mut before = "foot".to_owned();
    for joint in 1..=joints {
        let axis = if joint % 2 == 1 { "0 1 0" } else { "1 0 0" };
        let link = format!("link{joint}");
        write!(
            text,
            r#"<link name="{link}">{inertial}</link>
            <joint name="joint{joint}" type="revolute"><parent link="{before}"/><child link="{link}"/>
            <origin xyz="0 0 0.2" rpy="0 0 0.1"/><axis xyz="{axis}"/>
            <limit lower="-2.5" upper="2.5" effort="40" velocity="3"/><dynamics damping="4"/></joint>"#
        )
        .unwrap();
        before = link;
    }
    write!(
        text,
        r#"<link name="tool"/><joint name="weld" type="fixed"><parent link="{before}"/><child link="tool"/>
        <origin xyz="0 0 0.2"/></joint></robot>"#
    )
    .unwrap();
    text
}

fn written(folder: &Path, name: &str, content: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).unwrap();
    path
}

/// What `torqued robot` prints with these arguments.
fn robot(arguments: &[&str]) -> String {
    let (code, output, errors) = run_to_end(&mut torqued(&[&["robot"], arguments].concat()));
    assert_eq!(code, Some(0), "{arguments:?}: {errors}");
    output
}

fn refused(arguments: &[&str]) -> String {
    let (code, output, errors) = run_to_end(&mut torqued(&[&["robot"], arguments].concat()));
    assert_eq!((code, output.as_str()), (Some(1), ""), "{arguments:?}: {errors}");
    errors
}

#[test]
fn a_urdf_becomes_a_description_that_a_simulation_takes() {
    let folder = tempfile::tempdir().unwrap();
    let file = written(folder.path(), "arm.urdf", &urdf(5));
    let [file, figure] = [file, folder.path().join("arm.svg")];
    let [file, figure] = [&file, &figure].map(|path| path.to_str().unwrap());
    let shown = robot(&["show", file, "--figure", figure]);
    for words in
        ["from link foot to link tool", "5 joints", "general kernels", "joint5", "link5, tool"]
    {
        assert!(shown.contains(words), "{words}: {shown}");
    }
    assert!(shown.contains("reach 1.000 m"), "{shown}");
    let svg = std::fs::read_to_string(figure).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains(">joint3</text>"), "{svg}");

    let shorter = robot(&["show", file, "--tip", "link3", "--lock", "joint2=0.5", "--json"]);
    let description: Value = serde_json::from_str(&shorter).unwrap();
    assert_eq!(description["joints"].as_array().unwrap().len(), 2);
    let spec = json!({
        "kind": "simulate", "trajectories": 4, "samples": 30,
        "excitation": {"chirp": {"frequency_hz": {"fixed": 0.3}, "amplitude_nm": [-1, 1]}},
        "robot": {"model": description},
    });
    let spec = written(folder.path(), "simulate.json", &spec.to_string());
    let out = folder.path().join("out");
    let [spec, out] = [&spec, &out].map(|path| path.to_str().unwrap());
    let (code, _, errors) = run_to_end(&mut torqued(&["simulate", "--spec", spec, "--out", out]));
    assert_eq!(code, Some(0), "{errors}");

    let message = refused(&["show", file, "--tip", "hand"]);
    assert!(message.contains("arm.urdf: ") && message.contains("hand"), "{message}");
    let nine = written(folder.path(), "nine.urdf", &urdf(9));
    let message = refused(&["show", nine.to_str().unwrap()]);
    assert!(message.contains("9 joints move") && message.contains("--lock"), "{message}");
}

#[test]
fn the_torques_of_gravity_hold_an_arm_at_any_mount() {
    let folder = tempfile::tempdir().unwrap();
    let file = written(folder.path(), "arm.urdf", &urdf(6));
    let file = file.to_str().unwrap();
    for mount in ["0,0,0,0,0,0", "-1,0.5,2,180,0,0", "0,0,0,0,45,30"] {
        let line =
            |document: &Value| written(folder.path(), "states.jsonl", &format!("{document}\n"));
        let q = json!([0.4, -0.3, 0.8, 1.2, -0.5, 0.1]);
        let states = line(&json!({"q": q}));
        let arguments = ["dynamics", file, "--mount", mount, "--states", states.to_str().unwrap()];
        let held: Value = serde_json::from_str(&robot(&arguments)).unwrap();
        line(&json!({"q": q, "u": held["gravity"]}));
        let still: Value = serde_json::from_str(&robot(&arguments)).unwrap();
        let accelerations = still["qdd"].as_array().unwrap();
        assert_eq!(accelerations.len(), 6);
        assert!(accelerations.iter().all(|qdd| qdd.as_f64().unwrap().abs() < 1e-9), "{still}");
        let single: Value =
            serde_json::from_str(&robot(&[&arguments[..], &["--precision", "f32"]].concat()))
                .unwrap();
        assert!(single["mass_matrix"][0][0] != still["mass_matrix"][0][0], "{single}");
    }
    let states =
        written(folder.path(), "states.jsonl", "{\"q\": [0, 0, 0, 0, 0, 0]}\n{\"q\": [0]}\n");
    let arguments = ["robot", "dynamics", file, "--states", states.to_str().unwrap()];
    let (code, output, errors) = run_to_end(&mut torqued(&arguments));
    assert_eq!((code, output.lines().count()), (Some(1), 1));
    assert!(errors.contains("states.jsonl, line 2: q has 1 numbers, allowed: 6"), "{errors}");
}

#[test]
fn a_check_says_how_many_draws_are_kept_and_which_joints_refuse_others() {
    let folder = tempfile::tempdir().unwrap();
    let file = written(folder.path(), "arm.urdf", &urdf(4));
    let file = file.to_str().unwrap();
    let controlled = robot(&["check", file, "--trajectories", "60"]);
    let kept: u64 = controlled.split(' ').next().unwrap().parse().unwrap();
    assert!(kept > 50 && controlled.contains("of 60 draws kept"), "{controlled}");
    assert!(controlled.contains("lost their reference"), "{controlled}");
    let arguments = ["check", file, "--open-loop", "--trajectories", "60", "--json"];
    let survey: Value = serde_json::from_str(&robot(&arguments)).unwrap();
    let count = |value: &Value| value.as_u64().unwrap();
    let joints = survey["joints"].as_array().unwrap();
    let refused: u64 = joints.iter().map(|joint| count(&joint["refused"])).sum();
    assert_eq!(count(&survey["draws"]), 60);
    assert_eq!(count(&survey["kept"]) + count(&survey["diverged"]) + refused, 60, "{survey}");
    assert_eq!(survey["spec"]["kind"], "simulate");
    assert_eq!(survey["spec"]["robot"]["gravity"], "compensated");
    let shown = robot(&["check", file, "--open-loop", "--trajectories", "60"]);
    let kept = format!("{} of 60 draws kept", survey["kept"]);
    assert!(shown.contains(&kept) && shown.contains("trajectories/s"), "{shown}");
}

#[tokio::test]
async fn a_server_keeps_an_arm_that_specs_name() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(&folder.path().join("data"));
    let file = written(folder.path(), "arm.urdf", &urdf(3));
    let server = ["--server", product.url.as_str()];
    let with_server = |arguments: &[&str]| robot(&[arguments, &server].concat());
    let added = with_server(&["add", file.to_str().unwrap(), "--name", "my arm"]);
    assert!(added.starts_with("robot 1: my arm, 3 joints\n"), "{added}");
    assert!(added.contains("\"robot\": {\"model\": {\"robot\": 1}}"), "{added}");
    let again = with_server(&["add", file.to_str().unwrap(), "--json"]);
    let known: Value = serde_json::from_str(&again).unwrap();
    assert_eq!((&known["id"], &known["name"]), (&json!(1), &json!("my arm")));
    let renamed = with_server(&["add", file.to_str().unwrap(), "--name", "arm of the lab"]);
    let kept = "robot 1: my arm, 3 joints, which the server had already: it keeps this name, not \"arm of the lab\"\n";
    assert!(renamed.starts_with(kept), "{renamed}");
    let other = ["add", file.to_str().unwrap(), "--lock", "joint2=0.5", "--mount", "0,0,1,180,0,0"];
    let other = with_server(&other);
    assert!(other.starts_with("robot 2: chain, 2 joints\n"), "{other}");
    let listed = with_server(&["list"]);
    assert!(listed.contains("my arm") && listed.contains("URDF, foot to tool"), "{listed}");

    let shown = robot(&["show", file.to_str().unwrap()]);
    let digest = known["digest"].as_str().unwrap();
    for name in ["1", "my arm", digest] {
        assert_eq!(with_server(&["show", name]), shown, "{name}");
    }
    let description = |document: &Value| -> RobotDescription {
        serde_json::from_value(document.clone()).unwrap()
    };
    let printed: Value = serde_json::from_str(&with_server(&["show", "1", "--json"])).unwrap();
    assert_eq!(description(&printed), description(&known["description"]));
    let checked = with_server(&["check", "my arm", "--trajectories", "5", "--json"]);
    let checked: Value = serde_json::from_str(&checked).unwrap();
    let model = &checked["spec"]["robot"]["model"];
    assert_eq!(description(model), description(&known["description"]));
    let computed = robot(&["dynamics", file.to_str().unwrap()]);
    assert_eq!(with_server(&["dynamics", "my arm"]), computed);
    let at_server = |arguments: &[&str]| refused(&[arguments, &server].concat());
    let message = at_server(&["show", "9"]);
    assert!(message.contains("9 is neither a file nor a built-in robot: "), "{message}");
    assert!(message.contains("there is no robot 9"), "{message}");
    assert!(message.contains("`torqued robot list` lists those that it keeps"), "{message}");
    let message = at_server(&["check", "your arm"]);
    assert!(message.contains("no robot with the name or the digest \"your arm\""), "{message}");
    let message = at_server(&["show", "1", "--tip", "link1"]);
    assert!(message.contains("1 is a robot of the server, and --tip is only for"), "{message}");
    assert!(!message.contains("edit the description"), "{message}");
    let nobody = ["robot", "dynamics", "1", "--server", "http://127.0.0.1:1"];
    let (code, _, message) = run_to_end(&mut torqued(&nobody));
    assert_eq!(code, Some(4), "{message}");
    assert!(message.contains("no answer from http://127.0.0.1:1"), "{message}");
    for command in ["show", "check", "dynamics"] {
        let message = refused(&[command, "1"]);
        assert!(message.contains("--server URL names a server that keeps it"), "{message}");
    }

    let simulation = |model: Value| {
        json!({
            "kind": "simulate", "trajectories": 4, "samples": 30, "robot": {"model": model},
            "excitation": {"chirp": {"frequency_hz": {"fixed": 0.3}, "amplitude_nm": [-1, 1]}},
        })
    };
    let named = product.submit(&simulation(json!({"robot": 1}))).await;
    let named = product.succeeded(named).await;
    let in_place = product.submit(&simulation(known["description"].clone())).await;
    assert_eq!(in_place, named["id"], "one digest");
    let spec = serde_json::to_vec(&simulation(known["description"].clone())).unwrap();
    assert_eq!(named["digest"], spec::parse(&spec).unwrap().digest().to_string());

    let spec = simulation(json!({"robot": 9})).to_string();
    let (status, problem) = product.post("/v1/jobs", spec.clone()).await;
    assert_eq!(status.as_u16(), 422);
    assert_eq!(problem["violations"][0]["field"], "robot.model.robot");
    assert_eq!(problem["violations"][0]["allowed"], "the id of a robot, the newest are 2, 1");
    let spec = written(folder.path(), "simulate.json", &spec);
    let out = folder.path().join("out");
    let [spec, out] = [&spec, &out].map(|path| path.to_str().unwrap());
    let (code, _, errors) = run_to_end(&mut torqued(&["simulate", "--spec", spec, "--out", out]));
    assert_eq!(code, Some(1));
    assert!(errors.contains("a robot of a server can only be named in specs"), "{errors}");

    let removed = with_server(&["remove", "1"]);
    assert!(removed.contains("robot 1 is deleted; jobs keep their copies"), "{removed}");
    assert_eq!(product.try_get("/v1/robots/1").await.0.as_u16(), 404);
    let message = refused(&["remove", "1", "--server", product.url.as_str()]);
    assert!(message.contains("there is no robot 1"), "{message}");
    let nine = written(folder.path(), "nine.urdf", &urdf(9));
    let message = refused(&["add", nine.to_str().unwrap(), "--server", product.url.as_str()]);
    assert!(message.contains("nine.urdf: 9 joints move"), "{message}");
}
