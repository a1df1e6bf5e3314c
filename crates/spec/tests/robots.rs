//! Robots given by descriptions: their defaults, and the descriptions that are refused.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use serde_json::{Value, json};
use spec::{JobSpec, SimulateSpec, parse};

fn arm_of_six() -> Value {
    serde_json::from_str(include_str!("../../../tests/data/arm_of_six.json")).unwrap()
}

fn simulate(robot: &Value, fields: &Value) -> Value {
    let mut spec = json!({
        "kind": "simulate",
        "trajectories": 100,
        "excitation": {"multisine": {"frequency_hz": {"fixed": 0.15}}},
        "robot": robot,
    });
    spec.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    spec
}

fn accepted(spec: &Value) -> SimulateSpec {
    match parse(spec.to_string().as_bytes()).unwrap() {
        JobSpec::Simulate(spec) => spec,
        other => panic!("{other:?}"),
    }
}

/// Checks the error of a description with `value` at the JSON pointer `at`.
#[track_caller]
fn check_refused(at: &str, value: Value, expected: &[&str]) {
    let mut model = arm_of_six();
    let (parent, field) = at.rsplit_once('/').unwrap();
    let parent = model.pointer_mut(parent).unwrap();
    match parent {
        Value::Array(items) => items[field.parse::<usize>().unwrap()] = value,
        Value::Object(fields) => drop(fields.insert(field.to_owned(), value)),
        other => panic!("{other}"),
    }
    check_robot_refused(&json!({"model": model}), expected);
}

#[track_caller]
fn check_robot_refused(robot: &Value, expected: &[&str]) {
    let text = simulate(robot, &json!({})).to_string();
    let error = parse(text.as_bytes()).unwrap_err().to_string();
    for part in expected {
        assert!(error.contains(part), "{error:?} lacks {part:?}");
    }
}

#[test]
fn a_spec_takes_what_it_does_not_say_from_the_robot_s_description() {
    let spec =
        accepted(&simulate(&json!({"model": arm_of_six(), "mass_fraction": 0.2}), &json!({})));
    assert_eq!(spec.joints(), 6);
    assert_eq!(spec.robot.damping_nm_s_rad, [12.0, 12.0, 9.0, 4.0, 4.0, 2.0]);
    assert_eq!(spec.robot.armature_kg_m2, [0.02; 6]);
    assert_eq!((spec.robot.mass_fraction, spec.robot.geometry_fraction), (0.2, 0.05));
    assert_eq!(spec.initial_state.center_rad, [0.0, -1.1, 1.0, 0.2, 0.3, 0.0]);
    let multisine = spec.excitation.multisine.as_ref().unwrap();
    assert_eq!(multisine.torque_divisor, [1.3, 1.0, 1.4, 3.0, 3.0, 5.0]);
    assert_eq!(spec.robot.friction, None);

    let rubbing = json!({"model": arm_of_six(), "friction": {"phi1_fraction": 0.3}});
    let friction = accepted(&simulate(&rubbing, &json!({}))).robot.friction.unwrap();
    assert_eq!((friction.phi1_nm, friction.phi1_fraction), (vec![0.4; 6], 0.3));
}

#[test]
fn a_spec_with_a_description_is_self_contained_and_one_with_a_name_is_short() {
    let given = simulate(&json!({"model": arm_of_six()}), &json!({}));
    let JobSpec::Simulate(spec) = parse(given.to_string().as_bytes()).unwrap() else { panic!() };
    let stored = JobSpec::Simulate(spec.clone()).to_json();
    assert_eq!(accepted(&stored), spec);
    assert_eq!(stored["robot"]["model"]["joints"].as_array().unwrap().len(), 6);

    let panda = accepted(&simulate(&json!({"model": "panda"}), &json!({})));
    assert_eq!(JobSpec::Simulate(panda.clone()).to_json()["robot"]["model"], "panda");
    assert_eq!(panda, accepted(&simulate(&json!({}), &json!({}))));
}

#[test]
fn a_stream_may_have_a_robot_of_its_own() {
    let evaluate = json!({
        "kind": "evaluate",
        "data": {"stream": simulate(&json!({"model": arm_of_six()}), &json!({}))},
    });
    let JobSpec::Evaluate(spec) = parse(evaluate.to_string().as_bytes()).unwrap() else { panic!() };
    let spec::DataSource::Stream(stream) = spec.data else { panic!("not a stream") };
    assert_eq!(stream.initial_state.center_rad.len(), 6);
}

#[test]
fn tables_have_a_column_for_every_joint_of_the_robot() {
    let spec = accepted(&simulate(&json!({"model": arm_of_six()}), &json!({})));
    let names: Vec<String> =
        spec.trajectory_columns().into_iter().skip(2).map(|column| column.name).collect();
    let expected = ["u1", "u2", "u3", "u4", "u5", "u6", "q1", "q2", "q3", "q4", "q5", "q6"];
    assert_eq!(names, expected);
    let robots = spec.robot_columns();
    assert!(robots.iter().any(|column| column.name == "mass_6"));
    assert!(robots.iter().all(|column| !column.name.ends_with("_7")));
    let last = robots.iter().find(|column| column.name == "mass_6").unwrap();
    assert!(last.about.contains("gripper and payload included"), "{}", last.about);
}

#[test]
fn a_field_of_a_description_is_named_with_its_value_and_what_is_allowed() {
    check_robot_refused(&json!({"model": "ur5"}), &["robot.model", "ur5", "panda"]);
    check_robot_refused(
        &json!({"model": 7}),
        &["robot.model is 7", "\"panda\", \"ur10e\" or an object with"],
    );
    for model in [json!("UR lab"), json!({"name": "UR lab"}), json!({"id": 7})] {
        let expected = format!(
            "robot.model is {model}, allowed: \"panda\", \"ur10e\", a description, or a robot that the server keeps as \
             {{\"robot\": ID}} or {{\"digest\": HEX}}; `torqued robot list` has their ids"
        );
        check_robot_refused(&json!({"model": model}), &[&expected]);
    }
    check_refused("/jonts", json!([]), &["robot.model.jonts", "joints"]);
    check_refused("/joints/2/link/mass", json!(1), &["robot.model.joints[2].link.mass", "mass_kg"]);
    check_refused("/joints/0/a_m", json!("far"), &["robot.model.joints[0].a_m", "far"]);
    check_refused(
        "/joints/1/link/mass_kg",
        json!(-1),
        &["robot.model.joints[1].link.mass_kg is -1", "0.000001 to 10000"],
    );
    check_refused(
        "/joints/3/position_rad",
        json!([2.0, -2.0]),
        &["robot.model.joints[3].position_rad", "min not above max"],
    );
    check_refused("/joints/3/torque_nm", json!(0), &["joints[3].torque_nm is 0", "0.001"]);
    check_refused("/joints/4/name", json!("axis 1"), &["joints.name", "axis 1", "each once"]);
    check_refused("/hand/yaw_deg", json!(1e3), &["hand.yaw_deg is 1000", "-360 to 360"]);
}

#[test]
fn inertias_that_no_body_has_are_refused_unless_the_nearest_is_asked_for() {
    let flat = json!([0.002462, -2e-6, -1e-6, 0.000492, -1.5e-5, 0.000691]);
    let at = "/joints/5/link/inertia_kg_m2";
    check_refused(at, flat.clone(), &["joints[5].link.inertia_kg_m2", "nearest_physical"]);
    let mut model = arm_of_six();
    let link = model.pointer_mut("/joints/5/link").unwrap();
    link["inertia_kg_m2"] = flat;
    link["nearest_physical"] = json!(true);
    accepted(&simulate(&json!({"model": model}), &json!({})));
}

#[test]
fn an_arm_has_one_to_eight_joints_and_lists_have_one_number_for_each() {
    check_refused("/joints", json!([]), &["joints is 0 joints", "1 to 8 joints"]);
    let mut joints = arm_of_six()["joints"].as_array().unwrap().clone();
    joints.extend(joints.clone());
    check_refused("/joints", json!(joints), &["joints is 12 joints", "1 to 8 joints"]);
    let robot = json!({"model": arm_of_six(), "damping_nm_s_rad": vec![1.0; 7]});
    let expected = ["robot.damping_nm_s_rad is 7 numbers", "6 numbers, one for each joint"];
    check_robot_refused(&robot, &expected);
    let panda = json!({"damping_nm_s_rad": vec![1.0; 6]});
    check_robot_refused(&panda, &["robot.damping_nm_s_rad is 6 numbers", "7 numbers"]);
}

#[test]
fn friction_needs_numbers_that_the_description_or_the_spec_has() {
    let mut model = arm_of_six();
    model["joints"][2]["friction"] = Value::Null;
    let robot = json!({"model": model, "friction": {}});
    check_robot_refused(&robot, &["robot.friction.phi1_nm", "missing", "no friction"]);
}

#[test]
fn the_doubt_about_friction_names_the_joints_that_have_some_and_a_remedy_that_is_accepted() {
    let mut model = arm_of_six();
    model["joints"][0]["friction"] = Value::Null;
    for joint in 2..6 {
        model["joints"][joint]["friction"]["phi1_nm"] = 0.into();
    }
    let doubt = |model: &Value| {
        let spec = accepted(&simulate(&json!({"model": model}), &json!({})));
        spec.robot.friction_doubt().map(|doubt| doubt.reason)
    };
    let found = doubt(&model).unwrap();
    assert!(found.contains("friction of joint axis 2, which"), "{found}");
    assert!(found.contains("phi1_nm, phi2_s_rad and phi3_rad_s of every joint"), "{found}");
    model["joints"][1]["friction"] = Value::Null;
    assert_eq!(doubt(&model), None);
}

#[test]
fn explicit_steps_are_in_doubt_where_nothing_tells_whether_they_are_stable() {
    let rk4 = json!({"integrator": {"scheme": "rk4", "substeps": 12}});
    let doubts =
        accepted(&simulate(&json!({"model": arm_of_six(), "friction": {}}), &rk4)).doubts();
    assert_eq!(doubts.len(), 1);
    assert!(doubts[0].reason.contains("least_inertia_kg_m2"), "{}", doubts[0].reason);
}

/// An import of recordings with one column per joint, for `joints` joints.
fn import(joints: usize, fields: &Value) -> Value {
    let columns = |prefix: &str| -> Vec<String> {
        (1..=joints).map(|joint| format!("{prefix}{joint}")).collect()
    };
    let mut spec = json!({
        "kind": "import", "file": "0".repeat(64), "format": "csv",
        "columns": {"u": columns("u"), "q": columns("q")},
    });
    spec.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    spec
}

#[test]
fn a_recording_has_the_joints_of_its_robot_and_its_limits_unless_ranges_are_given() {
    let robot = json!({"robot": {"model": arm_of_six()}, "ranges": {"u_nm": [-5, 5]}});
    let job = parse(import(6, &robot).to_string().as_bytes()).unwrap();
    let JobSpec::Import(spec) = &job else { panic!("{job:?}") };
    assert_eq!(spec.joints(), 6);
    assert_eq!(spec.robot().damping_nm_s_rad, [12.0, 12.0, 9.0, 4.0, 4.0, 2.0]);
    let stored = job.to_json();
    assert_eq!(stored["ranges"], json!({"u_nm": [-5.0, 5.0], "q_rad": null, "qd_rad_s": null}));
    assert_eq!(parse(stored.to_string().as_bytes()).unwrap(), job);
    let columns: Vec<String> =
        spec.trajectory_columns().into_iter().map(|column| column.name).collect();
    assert_eq!(columns[2..8], ["u1", "u2", "u3", "u4", "u5", "u6"]);
    assert_eq!(columns.len(), 2 + 12);

    let unnamed = parse(import(7, &json!({})).to_string().as_bytes()).unwrap().to_json();
    assert_eq!((unnamed.get("robot"), unnamed.get("unwrap")), (None, None));
    assert_eq!(unnamed["ranges"]["q_rad"], json!([-6.5, 6.5]));
}

#[test]
fn a_recording_with_columns_for_another_number_of_joints_is_refused() {
    let refusal = |joints, fields: &Value| {
        parse(import(joints, fields).to_string().as_bytes()).unwrap_err().to_string()
    };
    let six = refusal(6, &json!({}));
    let lists = refusal(1, &json!({}));
    let seven = refusal(7, &json!({"robot": {"model": arm_of_six()}}));
    let null = refusal(7, &json!({"ranges": {"q_rad": null}}));
    for (error, parts) in [
        (six.clone(), ["columns.u is 6 columns", "7 columns, one for each joint"]),
        (six, ["a Panda because none is named", "\"robot\": {\"model\": {...}}"]),
        (lists, ["columns.u is 1 column,", "7 columns, one for each joint"]),
        (seven, ["columns.q is 7 columns", "6 columns, one for each joint"]),
        (null, ["ranges.q_rad is null", "where no robot is given"]),
    ] {
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
}
