//! From a URDF to the motion that shows its parameters, on the command line.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::product::{Product, run_to_end, torqued};

/// Two links about horizontal axes. Nothing is said about the first joint's speed.
const URDF: &str = r#"<?xml version="1.0"?>
<robot name="crane">
  <link name="stand"/>
  <joint name="shoulder" type="revolute">
    <parent link="stand"/>
    <child link="upper"/>
    <origin xyz="0 0 0.8"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="1" effort="60" velocity="0"/>
  </joint>
  <link name="upper">
    <inertial>
      <origin xyz="0.2 0 0"/>
      <mass value="3"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/>
    </inertial>
  </link>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" effort="20" velocity="3"/>
  </joint>
  <link name="lower">
    <inertial>
      <origin xyz="0.15 0 0"/>
      <mass value="1.5"/>
      <inertia ixx="0.005" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
  </link>
  <joint name="flange" type="fixed">
    <parent link="lower"/>
    <child link="hand"/>
    <origin xyz="0.3 0 0"/>
  </joint>
  <link name="hand"/>
</robot>
"#;

const FLAGS: [&str; 6] = ["--seconds", "8", "--harmonics", "4", "--table-z", "0.2"];

fn excite(folder: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    let mut command = torqued(&["excite", "arm.urdf"]);
    run_to_end(command.args(FLAGS).args(more).current_dir(folder))
}

#[test]
fn a_urdf_becomes_a_motion_for_its_controller() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    let (code, output, errors) = excite(folder, &["--rate-hz", "200", "--out", "motion"]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(errors.contains("shoulder") && errors.contains("velocity"), "{errors}");
    assert!(output.contains("random motions within the same limits"), "{output}");
    assert!(output.contains("above the table"), "{output}");

    let motion = folder.join("motion");
    let text = fs::read_to_string(motion.join("trajectory.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("t,q1,q2,qd1,qd2,qdd1,qdd2,u1,u2"));
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 8 * 200 + 1);
    for row in [&rows[0], &rows[8 * 200]] {
        assert!(row[3..7].iter().all(|value| value.abs() < 1e-6), "{row:?}");
    }
    assert_eq!(rows[8 * 200][0], 8.0);
    for row in &rows {
        assert!((-1.85..=0.85).contains(&row[1]) && row[2].abs() <= 1.35, "{row:?}");
        assert!(row[4].abs() <= 2.7 && row[7].abs() <= 54.0 && row[8].abs() <= 18.0, "{row:?}");
    }

    // The coefficients are the rows' motion.
    let json: Value =
        serde_json::from_slice(&fs::read(motion.join("trajectory.json")).unwrap()).unwrap();
    let joint = &json["joints"][1];
    let number = |value: &Value| value.as_f64().unwrap();
    let base_hz = number(&json["base_frequency_hz"]);
    for row in rows.iter().step_by(77) {
        let mut q = number(&joint["offset_rad"]);
        for (k, (sine, cosine)) in (1_u32..).zip(
            joint["sine_rad"]
                .as_array()
                .unwrap()
                .iter()
                .zip(joint["cosine_rad"].as_array().unwrap()),
        ) {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) * base_hz * row[0]).sin_cos();
            q += number(sine) * sin + number(cosine) * cos;
        }
        assert!((q - row[2]).abs() < 1e-7, "{q} {row:?}");
    }
    let parameters = fs::read_to_string(motion.join("parameters.csv")).unwrap();
    assert_eq!(parameters.lines().count(), 1 + 2 * 16);
    assert!(fs::read_to_string(motion.join("figure.svg")).unwrap().starts_with("<svg"));

    let (code, _, errors) = excite(folder, &["--out", "motion"]);
    assert_eq!(code, Some(1));
    assert!(errors.contains("motion has files, allowed: a folder that is empty"), "{errors}");
    let (code, report, errors) = excite(folder, &["--out", "again", "--json"]);
    assert_eq!(code, Some(0), "{errors}");
    let report: Value = serde_json::from_str(&report).unwrap();
    let first: Value =
        serde_json::from_slice(&fs::read(motion.join("report.json")).unwrap()).unwrap();
    assert_eq!(report, first);
}

#[tokio::test]
async fn a_motion_is_designed_for_an_arm_that_a_server_keeps() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    let server = ["--server", product.url.as_str()];
    let mut add = torqued(&["robot", "add", "arm.urdf"]);
    let (code, _, errors) = run_to_end(add.args(server).current_dir(folder));
    assert_eq!(code, Some(0), "{errors}");
    let (code, of_file, errors) = excite(folder, &["--out", "file", "--json"]);
    assert_eq!(code, Some(0), "{errors}");
    let mut kept = torqued(&["excite", "crane", "--out", "kept", "--json"]);
    let (code, of_server, doubts) = run_to_end(kept.args(FLAGS).args(server).current_dir(folder));
    assert_eq!(code, Some(0), "{doubts}");
    assert_eq!(of_server, of_file);
    assert!(doubts.contains("shoulder") && doubts.contains("velocity"), "{doubts}");
}

#[test]
fn what_leaves_no_room_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("arm.urdf"), URDF).unwrap();
    for (flags, said) in [
        (&["--clearance", "3"][..], "--table-z is 0.2 m, allowed with a clearance of 3 m: below "),
        (&["--margin", "1"], "--margin is 1, allowed: 0 to 0.9"),
        (&["--rate-hz", "2"], "--rate-hz is 2, allowed: 10 to 10000 Hz for this motion"),
        (&["--noise-nm", "1"], "--noise-nm has 1 numbers, allowed: 2, one per joint"),
        (
            &["--base-frequency", "0.3"],
            "--base-frequency is 0.3, allowed: a whole number of periods",
        ),
    ] {
        let (code, _, errors) = excite(folder, flags);
        assert_eq!(code, Some(1), "{flags:?}");
        assert!(errors.contains(&format!("error: {said}")), "{errors}");
    }
}

/// Runs on the URDF of a real UR10e, which is not part of the repository.
#[test]
fn a_ur10e_moves_above_its_table_and_shows_its_base_parameters() {
    let urdf =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/reference/real/ur10e/ur10e.urdf");
    if !urdf.exists() {
        println!("skipped: there is no URDF of a UR10e beside the repository");
        return;
    }
    let out = tempfile::tempdir().unwrap();
    let mut command = torqued(&["excite"]);
    command.arg(urdf).args(["--seconds", "10", "--harmonics", "5", "--table-z", "0", "--json"]);
    let (code, report, errors) = run_to_end(command.arg("--out").arg(out.path().join("motion")));
    assert_eq!(code, Some(0), "{errors}");
    let report: Value = serde_json::from_str(&report).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    // 36 of the links, Coulomb and viscous friction, its bends, offsets, and the rotors of the last four
    // joints.
    assert_eq!(number(&report["base_parameters"]), 64.0);
    assert!(number(&report["lowest_m"]) >= 0.1);
    assert!(number(&report["log_det"]) > number(&report["random"]["best_log_det"]));
    for joint in report["joints"].as_array().unwrap() {
        assert!(number(&joint["torque_nm"]) <= 0.9 * number(&joint["torque_limit_nm"]), "{joint}");
    }
}
