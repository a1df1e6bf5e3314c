//! How far the default integrator in f32 is from the solution, over whole trajectories.

use serde_json::{Value, json};
use spec::JOINTS;

use super::{chirp, multisine, run, spec};

/// The largest position error of each of 256 trajectories, rad, ascending.
fn errors(excitation: &Value, gravity: &str, integrator: &Value) -> Vec<f32> {
    let with = |precision: &str, integrator: &Value| {
        let fields = json!({
            "robot": {"gravity": gravity},
            "rejection": {"position_margin_rad": null},
            "precision": precision,
            "integrator": integrator,
        });
        let spec = spec(excitation, &fields);
        let row = spec.samples as usize * JOINTS;
        (run(&spec, 0..256).q, row)
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

fn check_99th_percentile(excitation: &Value, gravity: &str, integrator: &Value, limit_rad: f32) {
    let errors = errors(excitation, gravity, integrator);
    let (median, p99) = (errors[errors.len() / 2], errors[errors.len() * 99 / 100]);
    println!(
        "{excitation}, gravity {gravity}, {integrator}: median {median:.1e}, p99 {p99:.1e} rad"
    );
    assert!(p99 < limit_rad, "{excitation}, gravity {gravity}: {p99:e} rad");
}

#[test]
fn the_default_integrator_is_within_a_ten_thousandth_of_a_radian() {
    let default = json!({"scheme": "extrapolated"});
    check_99th_percentile(&chirp(0.3), "off", &default, 1e-4);
    check_99th_percentile(&chirp(0.3), "on", &default, 1e-4);
    check_99th_percentile(&multisine(0.1), "off", &default, 1e-4);
    check_99th_percentile(&multisine(0.3), "off", &default, 1e-4);
}

#[test]
fn the_reference_integrator_is_as_coarse_as_the_simulator_it_stands_for() {
    let reference = json!({"scheme": "reference"});
    check_99th_percentile(&chirp(0.3), "off", &reference, 1e-2);
    assert!(errors(&chirp(0.3), "off", &reference)[128] > 1e-4);
}
