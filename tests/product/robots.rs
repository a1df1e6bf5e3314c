//! `torqued robot` with URDFs: an arm is shown, drawn, computed, checked and simulated, without a server.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::product::{run_to_end, torqued};

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
    let arguments = ["check", file.to_str().unwrap(), "--trajectories", "60", "--json"];
    let survey: Value = serde_json::from_str(&robot(&arguments)).unwrap();
    let count = |value: &Value| value.as_u64().unwrap();
    let joints = survey["joints"].as_array().unwrap();
    let refused: u64 = joints.iter().map(|joint| count(&joint["refused"])).sum();
    assert_eq!(count(&survey["draws"]), 60);
    assert_eq!(count(&survey["kept"]) + count(&survey["diverged"]) + refused, 60, "{survey}");
    assert_eq!(survey["spec"]["kind"], "simulate");
    assert_eq!(survey["spec"]["robot"]["gravity"], "compensated");
    let shown = robot(&["check", file.to_str().unwrap(), "--trajectories", "60"]);
    let kept = format!("{} of 60 draws kept", survey["kept"]);
    assert!(shown.contains(&kept) && shown.contains("trajectories/s"), "{shown}");
}
