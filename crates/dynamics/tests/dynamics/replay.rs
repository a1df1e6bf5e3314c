//! Moves drawn robots again outside their simulation.

use dynamics::{Anchor, InstructionSet, Joints, Motion, Replay, Robot, Trajectories};
use serde_json::json;
use spec::SimulateSpec;

use super::{mixed, run, spec};

use crate::JOINTS;

fn with_everything(precision: &str) -> SimulateSpec {
    spec(
        &mixed(),
        &json!({
            "samples": 90,
            "precision": precision,
            "robot": {
                "armature_fraction": 0.2,
                "geometry_fraction": 0.1,
                "friction": {},
                "payload": {"mass_kg": [0.1, 2.0]},
                "gravity": "compensated",
            },
            "integrator": {"scheme": "rk4", "substeps": 16},
        }),
    )
}

fn motions(trajectories: &Trajectories) -> Vec<Motion<'_>> {
    let torques = trajectories.series.u().chunks_exact(trajectories.series.samples() * JOINTS);
    trajectories
        .scenarios
        .iter()
        .zip(torques)
        .map(|(scenario, u)| Motion {
            robot: &scenario.robot,
            q0: scenario.q0,
            qd0: scenario.qd0,
            u,
            anchors: &[],
        })
        .collect()
}

#[test]
fn a_drawn_robot_moves_again_to_the_same_bits_on_every_instruction_set() {
    for precision in ["f32", "f64"] {
        for spec in [spec(&mixed(), &json!({"precision": precision})), with_everything(precision)] {
            let trajectories = run(&spec, 5..42);
            for instructions in InstructionSet::available() {
                let replay = Replay { instructions, ..Replay::of(&spec) };
                let q = replay.run(&motions(&trajectories));
                assert!(q == trajectories.series.y(), "{instructions}, {precision}");
            }
        }
    }
}

#[test]
fn a_motion_that_diverges_leaves_its_neighbours_alone() {
    let spec = spec(&mixed(), &json!({}));
    let trajectories = run(&spec, 0..5);
    let absurd = Joints::splat(JOINTS, f64::NAN);
    let mut motions = motions(&trajectories);
    motions[2].qd0 = absurd;
    let q = Replay::of(&spec).run(&motions);
    let samples = trajectories.series.samples();
    for (row, q) in q.chunks_exact(samples * JOINTS).enumerate() {
        let expected = &trajectories.series.y()[row * samples * JOINTS..][..samples * JOINTS];
        if row == 2 {
            assert!(q[(samples - 1) * JOINTS..].iter().all(|q| q.is_nan()));
        } else {
            assert!(q == expected, "motion {row}");
        }
    }
}

#[test]
fn no_motions_and_no_torques_have_no_positions() {
    let replay = Replay::of(&spec(&mixed(), &json!({})));
    assert!(replay.run(&[]).is_empty());
    let robot = Robot::panda();
    let zero = Joints::splat(JOINTS, 0.0);
    let still = Motion { robot: &robot, q0: zero, qd0: zero, u: &[], anchors: &[] };
    assert!(replay.run(&[still]).is_empty());
}

#[test]
fn an_arm_that_is_put_elsewhere_goes_on_from_there_with_its_velocity_or_another() {
    let fields = json!({"precision": "f64", "observations": {"joint_velocities": true}});
    let spec = spec(&mixed(), &fields);
    let trajectories = run(&spec, 0..3);
    let velocities = trajectories.qd.as_ref().unwrap().as_chunks::<JOINTS>().0;
    let (sample, elsewhere) = (70, Joints::from([0.1, -0.2, 0.3, -1.4, 0.2, 1.7, 0.4]));
    let anchors = [Anchor { sample, q: elsewhere, qd: None }];
    let samples = trajectories.series.samples();
    for (row, motion) in motions(&trajectories).into_iter().enumerate() {
        let anchored = Replay::of(&spec).run(&[Motion { anchors: &anchors, ..motion }]);
        let before = &trajectories.series.y()[row * samples * JOINTS..][..(sample + 1) * JOINTS];
        assert!(&anchored[..(sample + 1) * JOINTS] == before);

        let qd0 = velocities[row * samples + sample].map(f64::from).into();
        let from_there = Motion { q0: elsewhere, qd0, u: &motion.u[sample * JOINTS..], ..motion };
        let expected = Replay::of(&spec).run(&[from_there]);
        let later = anchored[(sample + 1) * JOINTS..].iter();
        for (anchored, expected) in later.zip(&expected[JOINTS..]) {
            assert!((anchored - expected).abs() < 1e-5, "{anchored} {expected}");
        }

        let anchors = [Anchor { sample, q: elsewhere, qd: Some(motion.qd0) }];
        let anchored = Replay::of(&spec).run(&[Motion { anchors: &anchors, ..motion }]);
        let from_there = Motion { qd0: motion.qd0, ..from_there };
        let expected = Replay::of(&spec).run(&[from_there]);
        for (anchored, expected) in
            anchored[(sample + 1) * JOINTS..].iter().zip(&expected[JOINTS..])
        {
            assert!((anchored - expected).abs() < 1e-5, "{anchored} {expected}");
        }
    }
}

#[test]
fn a_motion_goes_on_from_the_state_that_its_first_half_ended_in() {
    for precision in ["f32", "f64"] {
        let spec = with_everything(precision);
        let trajectories = run(&spec, 0..20);
        let motions = motions(&trajectories);
        let replay = Replay::of(&spec);
        let half = trajectories.series.samples() / 2;
        let first: Vec<_> = motions
            .iter()
            .map(|motion| Motion { u: &motion.u[..half * JOINTS], ..*motion })
            .collect();
        let (_, ends) = replay.run_through(&first);
        let second: Vec<_> = motions
            .iter()
            .zip(&ends)
            .map(|(motion, end)| Motion {
                q0: end.q,
                qd0: end.qd,
                u: &motion.u[half * JOINTS..],
                ..*motion
            })
            .collect();
        let later = replay.run(&second);
        let whole = trajectories.series.y().chunks_exact(trajectories.series.samples() * JOINTS);
        for (later, whole) in
            later.chunks_exact((trajectories.series.samples() - half) * JOINTS).zip(whole)
        {
            for (later, whole) in later.iter().zip(&whole[half * JOINTS..]) {
                assert!((later - whole).abs() < 2e-6, "{precision}: {later} {whole}");
            }
        }
    }
}
