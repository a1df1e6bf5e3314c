//! Measurement noise has a purpose of its own and leaves the true values as they are.

use dynamics::add_position_noise;
use serde_json::json;
use spec::SimulateSpec;

use super::{mixed, run, spec};

fn noisy(position_rad: f64, resolution_rad: f64, torque_nm: f64) -> SimulateSpec {
    let observations = json!({
        "position_noise_rad": position_rad,
        "position_resolution_rad": resolution_rad,
        "torque_noise_nm": torque_nm,
    });
    spec(&mixed(), &json!({"samples": 60, "seed": 5, "observations": observations}))
}

fn deviation(measured: &[f32], truth: &[f32]) -> f64 {
    let squares = measured.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2));
    (squares.sum::<f64>() / truth.len() as f64).sqrt()
}

#[test]
fn the_truth_is_that_of_a_simulation_without_noise_and_the_noise_is_what_was_asked_for() {
    let clean = run(&noisy(0.0, 0.0, 0.0), 0..40).series;
    let series = run(&noisy(1e-2, 0.0, 0.5), 0..40).series;
    assert!(clean.y() == series.true_y() && clean.u() == series.true_u());
    let (of_y, of_u) =
        (deviation(series.y(), series.true_y()), deviation(series.u(), series.true_u()));
    assert!((of_y / 1e-2 - 1.0).abs() < 0.02, "{of_y}");
    assert!((of_u / 0.5 - 1.0).abs() < 0.02, "{of_u}");
    let noise = series.noise();
    assert_eq!((noise.position_rad, noise.torque_nm), (1e-2, 0.5));
    assert!(clean.y() == clean.true_y() && clean.noise() == series::MeasurementNoise::default());
}

#[test]
fn positions_are_rounded_to_the_encoders_steps_with_the_deviation_that_is_told() {
    let step = 4e-3;
    let series = run(&noisy(0.0, step, 0.0), 0..40).series;
    for &q in series.y() {
        let steps = f64::from(q) / step;
        assert!((steps - steps.round()).abs() < 1e-3, "{q}");
    }
    let (found, told) = (deviation(series.y(), series.true_y()), series.noise().position_rad);
    assert!((told - step / 12.0_f64.sqrt()).abs() < 1e-12);
    assert!((found / told - 1.0).abs() < 0.05, "{found} {told}");
    assert!(series.u() == series.true_u());
}

#[test]
fn noise_is_that_of_the_trajectory_whatever_it_is_simulated_with() {
    let spec = noisy(1e-3, 1e-4, 0.1);
    let whole = run(&spec, 0..30).series;
    let part = run(&spec, 11..17).series;
    assert!(part == whole.copy(11..17));
}

#[test]
fn levels_of_added_noise_have_the_same_draws_on_contexts_alone() {
    let clean = run(&noisy(0.0, 0.0, 0.0), 0..6).series;
    let at = |level: f64| {
        let mut series = clean.clone();
        add_position_noise(&mut series, level, 40, 9, 0);
        series
    };
    assert!(at(0.0) == clean);
    let (little, much) = (at(1e-3), at(1e-2));
    let joints = clean.joints();
    for robot in 0..clean.robots() {
        let [clean, little, much] =
            [&clean, &little, &much].map(|series| series.part(robot..robot + 1).y(0));
        for sample in 0..60 {
            for joint in 0..joints {
                let truth = clean[sample][joint];
                let (low, high) = (little[sample][joint] - truth, much[sample][joint] - truth);
                assert!((10.0 * low - high).abs() < 1e-5, "{low} {high}");
                assert_eq!(sample < 40, high != 0.0);
            }
        }
    }
    assert!(little.true_y() == clean.y());
    let mut others = clean.copy(2..4);
    add_position_noise(&mut others, 1e-3, 40, 9, 2);
    assert!(others == little.copy(2..4));
}

#[test]
fn planned_torques_are_the_true_ones() {
    let mut series = run(&noisy(1e-3, 0.0, 0.5), 0..5).series;
    let measured = series.u().to_vec();
    series.plan_from(40);
    let row = 60 * series.joints();
    for (k, u) in series.u().iter().enumerate() {
        let is_planned = k % row >= 40 * series.joints();
        assert_eq!(*u, if is_planned { series.true_u()[k] } else { measured[k] });
    }
}
