//! Checks the error of the default integrator in f32 over whole trajectories.

use serde_json::{Value, json};

use super::{chirp, multisine, run, spec};

use crate::JOINTS;

/// The largest position error of each of 256 trajectories, rad, ascending.
fn errors(excitation: &Value, robot: &Value, integrator: &Value) -> Vec<f32> {
    let with = |precision: &str, integrator: &Value| {
        let fields = json!({
            "robot": robot,
            "rejection": {"position_margin_rad": null},
            "precision": precision,
            "integrator": integrator,
        });
        let spec = spec(excitation, &fields);
        let row = spec.samples as usize * JOINTS;
        (run(&spec, 0..256).series.y().to_vec(), row)
    };
    let (q, row) = with("f32", integrator);
    let (exact, _) = with("f64", &json!({"scheme": "rk4", "substeps": 24}));
    let mut errors: Vec<f32> = q
        .chunks_exact(row)
        .zip(exact.chunks_exact(row))
        .map(|(q, exact)| {
            q.iter().zip(exact).map(|(q, exact)| (q - exact).abs()).fold(0.0, f32::max)
        })
        .collect();
    errors.sort_by(f32::total_cmp);
    errors
}

fn check_99th_percentile(excitation: &Value, robot: &Value, integrator: &Value, limit_rad: f32) {
    let errors = errors(excitation, robot, integrator);
    let (median, p99) = (errors[errors.len() / 2], errors[errors.len() * 99 / 100]);
    println!("{excitation}, {robot}, {integrator}: median {median:.1e}, p99 {p99:.1e} rad");
    assert!(p99 < limit_rad, "{excitation}, {robot}: {p99:e} rad");
}

#[test]
fn the_default_integrator_is_within_a_ten_thousandth_of_a_radian() {
    let default = json!({"scheme": "extrapolated"});
    let loaded = json!({
        "gravity": "on",
        "geometry_fraction": 0.1,
        "armature_fraction": 0.1,
        "payload": {"mass_kg": [0.0, 3.0]},
    });
    for robot in [json!({}), json!({"gravity": "on"}), json!({"gravity": "compensated"}), loaded] {
        for excitation in [chirp(0.3), multisine(0.1), multisine(0.3)] {
            check_99th_percentile(&excitation, &robot, &default, 1e-4);
        }
    }
}

#[test]
fn with_friction_the_default_integrator_follows_mild_torques_and_runge_kutta_all() {
    let robot = json!({"gravity": "on", "friction": {}});
    let default = json!({"scheme": "extrapolated"});
    check_99th_percentile(&chirp(0.3), &robot, &default, 1e-4);
    check_99th_percentile(&multisine(0.1), &robot, &default, 1.5e-4);
    for excitation in [chirp(0.3), multisine(0.1), multisine(0.3)] {
        check_99th_percentile(&excitation, &robot, &json!({"scheme": "rk4"}), 1e-4);
    }
}

#[test]
fn the_reference_integrator_is_as_coarse_as_the_simulator_it_stands_for() {
    let reference = json!({"scheme": "reference"});
    check_99th_percentile(&chirp(0.3), &json!({}), &reference, 1e-2);
    assert!(errors(&chirp(0.3), &json!({}), &reference)[128] > 1e-4);
}
