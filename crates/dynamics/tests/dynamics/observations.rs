//! Quantities that are recorded besides the paper's torques and positions, and torques besides its
//! excitation.

use std::ops::ControlFlow;

use dynamics::{
    InstructionSet, Joints, Robot, Trajectories, forward_dynamics, gravity, simulate_into,
};
use serde_json::json;
use spec::SimulateSpec;

use super::determinism::digest;
use super::{mixed, run, spec};

use crate::JOINTS;

/// A spec that asks for every quantity.
fn complete(precision: &str) -> SimulateSpec {
    spec(
        &mixed(),
        &json!({
            "samples": 90,
            "precision": precision,
            "robot": {
                "armature_fraction": 0.2,
                "geometry_fraction": 0.1,
                "friction": {},
                "payload": {"mass_kg": [0.1, 2.0], "radius_m": [0.02, 0.06]},
                "gravity": "compensated",
            },
            "observations": {"joint_velocities": true, "end_effector_pose": true},
            "integrator": {"scheme": "rk4", "substeps": 16},
            "rejection": {"position_margin_rad": 0.9},
        }),
    )
}

/// The seven values of one sample of one trajectory.
fn sample(series: &[f32], row: usize, k: usize, samples: usize) -> [f64; 7] {
    let sample = series.as_chunks::<7>().0[row * samples + k];
    sample.map(f64::from)
}

#[test]
fn every_instruction_set_gives_the_same_bits_with_everything_asked_for() {
    for precision in ["f32", "f64"] {
        let spec = complete(precision);
        let best = run(&spec, 5..75);
        assert!(best.rejected > 0);
        for instructions in InstructionSet::available() {
            let mut trajectories = Trajectories::default();
            let go_on = |_| ControlFlow::Continue(());
            simulate_into(instructions, &spec, 5..75, &go_on, &mut trajectories).unwrap();
            assert!(trajectories == best, "{instructions}, {precision}");
        }
    }
}

#[test]
fn the_bytes_of_everything_that_can_be_asked_for_are_pinned() {
    assert_eq!(
        digest(&run(&complete("f32"), 5..45)),
        "3ef935a87925f06764a294b3fc31a2e53923082855b2b69a2c30b7af9b82e1ea"
    );
    assert_eq!(
        digest(&run(&complete("f64"), 5..45)),
        "ce91ba0b697ebb22bd20422bb6e28ab7a3ca6fbd153131d6a1de4a11b87f9ccd"
    );
}

/// Position and velocity one period later, by 64 steps of Runge-Kutta.
fn one_period_later(
    robot: &Robot,
    mut q: [f64; 7],
    mut qd: [f64; 7],
    u: [f64; 7],
) -> [[f64; 7]; 2] {
    let h = 1.0 / 60.0 / 64.0;
    let moved = |from: [f64; 7], by: [f64; 7], h: f64| -> [f64; 7] {
        std::array::from_fn(|joint| from[joint] + h * by[joint])
    };
    for _ in 0..64 {
        let slope = |q: [f64; 7], qd: [f64; 7]| -> [f64; 7] {
            forward_dynamics(robot, q, qd, u)[..].try_into().unwrap()
        };
        let a1 = slope(q, qd);
        let v2 = moved(qd, a1, h / 2.0);
        let a2 = slope(moved(q, qd, h / 2.0), v2);
        let v3 = moved(qd, a2, h / 2.0);
        let a3 = slope(moved(q, v2, h / 2.0), v3);
        let v4 = moved(qd, a3, h);
        let a4 = slope(moved(q, v3, h), v4);
        for joint in 0..JOINTS {
            q[joint] += h / 6.0 * (qd[joint] + 2.0 * (v2[joint] + v3[joint]) + v4[joint]);
            qd[joint] += h / 6.0 * (a1[joint] + 2.0 * (a2[joint] + a3[joint]) + a4[joint]);
        }
    }
    [q, qd]
}

#[test]
fn each_sample_follows_from_the_one_before_under_the_recorded_torque() {
    let spec = complete("f64");
    let trajectories = run(&spec, 0..6);
    let (u, q) = (trajectories.series.u(), trajectories.series.y());
    let qd = trajectories.qd.as_ref().unwrap();
    for (row, scenario) in trajectories.scenarios.iter().enumerate() {
        for k in (0..trajectories.series.samples() - 1).step_by(11) {
            let at = |series: &[f32], k| sample(series, row, k, trajectories.series.samples());
            let [later_q, later_qd] =
                one_period_later(&scenario.robot, at(q, k), at(qd, k), at(u, k));
            for joint in 0..JOINTS {
                // The recorded values are rounded to f32.
                assert!((later_q[joint] - at(q, k + 1)[joint]).abs() < 1e-6, "q {row} {k} {joint}");
                assert!(
                    (later_qd[joint] - at(qd, k + 1)[joint]).abs() < 2e-5,
                    "q̇ {row} {k} {joint}"
                );
            }
        }
        assert_eq!(
            Joints::from(sample(qd, row, 0, trajectories.series.samples())),
            scenario.qd0.map(|qd| f64::from(qd as f32))
        );
    }
}

#[test]
fn compensated_torques_are_the_excitation_and_the_gravity_of_this_robot_at_every_sample() {
    for precision in ["f32", "f64"] {
        let trajectories = run(&complete(precision), 0..40);
        for (row, scenario) in trajectories.scenarios.iter().enumerate() {
            for k in 0..trajectories.series.samples() {
                let at = |series: &[f32]| sample(series, row, k, trajectories.series.samples());
                let (u, q) = (at(trajectories.series.u()), at(trajectories.series.y()));
                let excitation = scenario.excitation.torques().unwrap().at(k as f64 / 60.0);
                for (joint, g) in gravity(&scenario.robot, q).iter().enumerate() {
                    let error = (u[joint] - excitation[joint] - g).abs();
                    assert!(error < 3e-5, "{row}, sample {k}, joint {joint}: {error:e} N·m");
                }
            }
        }
    }
}

#[test]
fn recorded_poses_are_those_of_the_recorded_positions_without_jumps_of_sign() {
    let trajectories = run(&complete("f32"), 0..40);
    let poses = trajectories.end_effector.as_ref().unwrap();
    for (row, scenario) in trajectories.scenarios.iter().enumerate() {
        let mut before = None;
        for k in 0..trajectories.series.samples() {
            let q = sample(trajectories.series.y(), row, k, trajectories.series.samples());
            let [x, y, z, quaternion @ ..] = sample(poses, row, k, trajectories.series.samples());
            let expected = scenario.robot.kinematics.end_effector_pose(q);
            assert_eq!([x, y, z], expected.position_m.map(|meters| f64::from(meters as f32)));
            let dot =
                |a: [f64; 4], b: [f64; 4]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
            assert!((dot(quaternion, expected.quaternion_xyzw).abs() - 1.0).abs() < 1e-6);
            assert!(before.map_or(quaternion[3] >= 0.0, |before| dot(before, quaternion) > 0.0));
            before = Some(quaternion);
        }
    }
}

#[test]
fn recording_more_changes_neither_torques_nor_positions() {
    let more = complete("f32");
    let less = SimulateSpec { observations: spec::Observations::default(), ..more.clone() };
    let (more, less) = (run(&more, 0..40), run(&less, 0..40));
    assert!((more.series, more.scenarios) == (less.series, less.scenarios));
    assert_eq!((less.qd, less.end_effector), (None, None));
}

#[test]
fn used_memory_is_filled_as_fresh_memory_is() {
    let paper = spec(&mixed(), &json!({"samples": 200}));
    let mut used = Trajectories::default();
    for spec in [complete("f32"), paper, complete("f64"), complete("f32")] {
        for range in [0..30, 7..90, 4..4] {
            let go_on = |_| ControlFlow::Continue(());
            let instructions = InstructionSet::best();
            simulate_into(instructions, &spec, range.clone(), &go_on, &mut used).unwrap();
            assert!(used == run(&spec, range));
        }
    }
}

#[test]
fn a_cancelled_simulation_leaves_no_trajectories_behind() {
    let spec = complete("f32");
    let mut used = run(&spec, 0..20);
    let stop = |_| ControlFlow::Break(());
    assert!(simulate_into(InstructionSet::best(), &spec, 0..20, &stop, &mut used).is_err());
    assert_eq!(
        (used.series.robots(), used.series.u().len(), used.series.y().len(), used.scenarios.len()),
        (0, 0, 0, 0)
    );
}
