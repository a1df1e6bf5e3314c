//! Arms without compiled kernels, on every kind of lanes.

use std::ops::ControlFlow;

use dynamics::{InstructionSet, Motion, Replay, Robot, mass_matrix, simulate_on};
use serde_json::{Value, json};
use spec::{JobSpec, SimulateSpec};

use super::determinism::digest;
use super::{mixed, run};

fn arm_of_six() -> Value {
    serde_json::from_str(include_str!("../../../../tests/data/arm_of_six.json")).unwrap()
}

fn spec_of(model: &Value, fields: &Value) -> SimulateSpec {
    let mut text = json!({
        "kind": "simulate", "trajectories": 1_000_000, "seed": 3, "samples": 80,
        "excitation": mixed(),
        "robot": {"model": model, "friction": {}, "payload": {"mass_kg": [0.1, 1.0]}, "gravity": "compensated"},
        "observations": {"joint_velocities": true, "end_effector_pose": true},
    });
    text.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    match spec::parse(text.to_string().as_bytes()).unwrap() {
        JobSpec::Simulate(spec) => spec,
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_arm_of_six_has_the_same_bits_on_every_instruction_set_and_when_it_moves_again() {
    for precision in ["f32", "f64"] {
        let spec = spec_of(&arm_of_six(), &json!({"precision": precision}));
        let best = run(&spec, 0..40);
        assert_eq!((best.series.joints(), best.series.y().len()), (6, 40 * 80 * 6));
        let motions: Vec<Motion<'_>> = best
            .scenarios
            .iter()
            .zip(best.series.u().chunks_exact(80 * 6))
            .map(|(scenario, u)| Motion {
                robot: &scenario.robot,
                q0: scenario.q0,
                qd0: scenario.qd0,
                u,
                anchors: &[],
            })
            .collect();
        for instructions in InstructionSet::available() {
            let go_on = |_| ControlFlow::Continue(());
            let again = simulate_on(instructions, &spec, 0..40, &go_on).unwrap();
            assert!(again == best, "{instructions}, {precision}");
            let replay = Replay { instructions, ..Replay::of(&spec) };
            assert!(replay.run(&motions) == best.series.y(), "{instructions}, {precision}");
        }
    }
}

#[test]
fn single_precision_follows_double_precision() {
    let of = |precision: &str| {
        let spec = spec_of(
            &arm_of_six(),
            &json!({"precision": precision, "robot": {"model": arm_of_six()}}),
        );
        run(&spec, 0..20)
    };
    let (single, double) = (of("f32"), of("f64"));
    let largest = single
        .series
        .y()
        .iter()
        .zip(double.series.y())
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(largest < 1e-4, "{largest}");
}

/// The arm is a Panda with a length of almost zero that the compiled structure does not have.
#[test]
fn the_general_kernel_moves_the_panda_as_the_specialized_one_does() {
    let panda: Value =
        serde_json::from_str(include_str!("../../../spec/robots/panda.json")).unwrap();
    let mut almost = panda.clone();
    almost["joints"][1]["d_m"] = json!(1e-12);
    let [specialized, general] = [panda, almost].map(|model| {
        let fields = json!({
            "precision": "f64",
            "robot": {"model": model, "gravity": "on"},
            "rejection": {"position_margin_rad": null},
        });
        run(&spec_of(&model, &fields), 0..30)
    });
    assert!(specialized.series.u() == general.series.u());
    let differences =
        specialized.series.y().iter().zip(general.series.y()).map(|(a, b)| (a - b).abs());
    let largest = differences.fold(0.0, f32::max);
    assert!(largest < 1e-5, "{largest}");
}

/// Catches a change of the laws or of the arithmetic for robots by description.
#[test]
fn the_bytes_of_an_arm_of_six_are_pinned() {
    let spec = spec_of(&arm_of_six(), &json!({}));
    assert_eq!(
        digest(&run(&spec, 0..40)),
        "1f65c9cf4449782c7542fba44ff0a14efa735b3e671b4e7c18d9617cb81553fb"
    );
}

#[test]
fn one_joint_is_a_pendulum() {
    let mut model = arm_of_six();
    let joint = json!({
        "name": "hinge", "a_m": 0, "alpha_deg": -90, "d_m": 0.1,
        "position_rad": [-3, 3], "velocity_rad_s": 3, "torque_nm": 10, "damping_nm_s_rad": 0.5,
        "link": {"mass_kg": 2, "center_m": [0.5, 0, 0], "inertia_kg_m2": [0.01, 0, 0, 0.02, 0, 0.02]},
    });
    model["joints"] = json!([joint]);
    model["hand"] = json!({});
    model["initial_state"]["center_rad"] = json!([0]);
    let spec = spec_of(&model, &json!({"robot": {"model": model, "gravity": "on"}}));
    let robot = Robot::nominal(&spec.robot);
    let inertia = mass_matrix(&robot, [0.3])[0][0];
    assert!((inertia - (0.02 + 2.0 * 0.25)).abs() < 1e-12, "{inertia}");
    // The axis is horizontal. Gravity pulls the centre down, which is level with the axis at angle
    // 0.
    let torque = dynamics::gravity(&robot, [0.3])[0];
    assert!((torque.abs() - 2.0 * 9.81 * 0.5 * 0.3_f64.cos()).abs() < 1e-12, "{torque}");
}
