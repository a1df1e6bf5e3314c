//! The cases in which explicit damping diverges. The spec refuses them by the robot's description.

use std::ops::ControlFlow;

use dynamics::{Robot, mass_matrix, simulate};
use nalgebra::SMatrix;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use serde_json::json;
use spec::{Integrator, Range, RobotSpec, SimulateSpec};

use super::{chirp, spec};

use crate::JOINTS;

#[test]
fn the_least_inertias_that_stability_is_judged_by_are_those_of_the_nominal_arm() {
    let bare = RobotSpec { armature_kg_m2: vec![0.0; JOINTS], ..RobotSpec::default() };
    let panda = Robot::nominal(&bare);
    let description = bare.description();
    let configurations: Vec<_> = description.per_joint(|joint| {
        let Range { min, max } = joint.position_rad;
        min..max
    });
    let mut least = [f64::INFINITY; JOINTS];
    let mut runner = TestRunner::new_with_rng(
        Config::with_cases(20_000),
        TestRng::deterministic_rng(RngAlgorithm::ChaCha),
    );
    let least_found = std::cell::RefCell::new(&mut least);
    runner
        .run(&configurations, |q| {
            let m = mass_matrix(&panda, q.as_slice());
            let m = SMatrix::<f64, 7, 7>::from_fn(|row, column| m[row][column]);
            let inverse = m.try_inverse().unwrap();
            let mut least = least_found.borrow_mut();
            for joint in 0..JOINTS {
                // The acceleration of a joint per torque of its own while the others are free.
                least[joint] = least[joint].min(1.0 / inverse[(joint, joint)]);
            }
            Ok(())
        })
        .unwrap();
    let stated = description.per_joint(|joint| joint.least_inertia_kg_m2.unwrap());
    for (joint, (found, constant)) in least.iter().zip(stated).enumerate() {
        let ratio = found / constant;
        assert!((0.98..1.1).contains(&ratio), "joint {}: {found} kg·m²", joint + 1);
    }
}

/// Whether some of 64 trajectories are not finite.
fn diverges(damping: f64, substeps: u32) -> bool {
    let fields = json!({
        "robot": {"damping_nm_s_rad": vec![damping; JOINTS], "damping_fraction": 0},
        "rejection": {"position_margin_rad": null},
    });
    let checked = spec(&chirp(0.3), &fields);
    let spec = SimulateSpec { integrator: Integrator::Rk4 { substeps }, ..checked };
    simulate(&spec, 0..64, &|_| ControlFlow::Continue(())).is_err()
}

fn refused(damping: f64, substeps: u32) -> bool {
    let text = json!({
        "kind": "simulate", "trajectories": 1,
        "excitation": chirp(0.3),
        "robot": {"damping_nm_s_rad": vec![damping; JOINTS]},
        "integrator": {"scheme": "rk4", "substeps": substeps},
    });
    spec::parse(text.to_string().as_bytes()).is_err()
}

#[test]
fn runge_kutta_diverges_where_it_is_refused_and_not_where_it_is_beyond_doubt() {
    for substeps in [4, 8, 16] {
        let limit = (1..1000).map(f64::from).find(|&damping| refused(damping, substeps)).unwrap();
        assert!(diverges(1.1 * limit, substeps), "{substeps} substeps, damping {}", 1.1 * limit);
        assert!(!diverges(0.85 * limit, substeps), "{substeps} substeps, damping {}", 0.85 * limit);
    }
}
