//! Checks how far simulated arms move, which sets the scale of every RMSE on them.
//!
//! The expected values come from an independent simulation of the same laws (robots ±10 %, no
//! gravity, last 80 of 400 samples, RMSE over time per joint, then averaged over joints and
//! robots). They use 40 robots per row, so their statistical error is about 15 %.

use serde_json::Value;

use super::{chirp, multisine, run, spec};

use crate::JOINTS;

const CONTEXT: usize = 320;

/// Mean RMSE in degrees over the horizon. `predict` gets the context's last position and the
/// torques.
fn rmse_deg(excitation: &Value, predict: impl Fn(f64, &[f64]) -> Vec<f64>) -> f64 {
    let spec = spec(excitation, &serde_json::json!({}));
    let trajectories = run(&spec, 0..400);
    let row = spec.samples as usize * JOINTS;
    let mut sum = 0.0;
    for (u, q) in
        trajectories.series.u().chunks_exact(row).zip(trajectories.series.y().chunks_exact(row))
    {
        for joint in 0..JOINTS {
            let channel = |values: &[f32]| -> Vec<f64> {
                values.chunks_exact(JOINTS).map(|sample| f64::from(sample[joint])).collect()
            };
            let (u, q) = (channel(u), channel(q));
            let predicted = predict(q[CONTEXT - 1], &u[CONTEXT - 1..]);
            let squares = predicted.iter().zip(&q[CONTEXT..]).map(|(p, q)| (p - q).powi(2));
            sum += (squares.sum::<f64>() / (q.len() - CONTEXT) as f64).sqrt();
        }
    }
    (sum / (JOINTS * trajectories.series.robots()) as f64).to_degrees()
}

fn hold_last(last: f64, u: &[f64]) -> Vec<f64> {
    vec![last; u.len() - 1]
}

/// Predicts by q̇ = u / 10 from the last known position on.
fn damped_integrator(last: f64, u: &[f64]) -> Vec<f64> {
    let mut q = last;
    let step = |torque: &f64| {
        q += torque / 10.0 / 60.0;
        q
    };
    u[..u.len() - 1].iter().map(step).collect()
}

fn check(excitation: &Value, expected_hold_deg: f64, expected_integrator_deg: f64) {
    let hold = rmse_deg(excitation, hold_last);
    let integrator = rmse_deg(excitation, damped_integrator);
    println!(
        "{excitation}: hold-last {hold:.2}° ({expected_hold_deg}°), q̇ = u/10 {integrator:.2}° ({expected_integrator_deg}°)"
    );
    for (value, expected) in [(hold, expected_hold_deg), (integrator, expected_integrator_deg)] {
        let ratio: f64 = value / expected;
        assert!((0.65..1.5).contains(&ratio), "{excitation}: {value:.2}° instead of {expected}°");
    }
}

#[test]
fn chirps_move_the_arm_as_calibrated() {
    check(&chirp(0.1), 2.7, 0.42);
    check(&chirp(0.3), 1.4, 0.53);
    check(&chirp(0.7), 1.2, 0.25);
    check(&chirp(1.0), 0.7, 0.19);
}

#[test]
fn multisines_move_the_arm_as_calibrated() {
    check(&multisine(0.05), 3.0, 0.34);
    check(&multisine(0.15), 7.6, 1.5);
    check(&multisine(0.3), 10.0, 3.2);
    check(&multisine(0.45), 11.6, 4.3);
}
