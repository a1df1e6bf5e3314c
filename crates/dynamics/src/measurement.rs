//! Measured motions: Gaussian noise on positions and torques, and the resolution of encoders.

use rayon::prelude::*;
use series::{MeasurementNoise, Series};
use spec::SimulateSpec;

use crate::draws::{Draws, Purpose};

/// Adds the noise that `spec` asks for to each robot of `series`. The true values are kept beside
/// the measured ones. `first` is the index of the first trajectory, which keys its noise. Positions
/// that a controller measured already are in `measured`.
pub(crate) fn measure(
    series: &mut Series,
    spec: &SimulateSpec,
    first: u64,
    measured: Option<&[f32]>,
) {
    let observations = &spec.observations;
    if !observations.measures_positions() && !observations.measures_torques() {
        return;
    }
    let (torque_nm, position_rad) = (observations.torque_noise_nm, observations.position_noise_rad);
    let row = (series.samples() * series.joints()).max(1);
    let noise = MeasurementNoise::new(observations.position_deviation_rad(), torque_nm);
    let (u, y) = series.add_noise(noise);
    if let Some(measured) = measured {
        y.copy_from_slice(measured);
    }
    let position_rad = if measured.is_some() { 0.0 } else { position_rad };
    let rows = u.par_chunks_exact_mut(row).zip(y.par_chunks_exact_mut(row));
    rows.enumerate().for_each(|(robot, (u, y))| {
        let draws = |purpose| Draws::new(spec.seed, first + robot as u64, purpose, 0);
        disturb(u, torque_nm, draws(Purpose::TorqueNoise));
        disturb(y, position_rad, draws(Purpose::PositionNoise));
        round_to(y, observations.position_resolution_rad);
    });
}

/// Adds Gaussian noise of `deviation_rad` to the positions of the first `samples` samples of each
/// robot, in addition to the noise that they have. The true values are kept beside the measured
/// ones.
///
/// The noise is keyed by (seed, trajectory). The noise of a sample and joint is proportional to the
/// deviation, so all levels of noise share their draws. `first` is the index of the first
/// trajectory.
///
/// # Panics
/// If the series has fewer samples.
pub fn add_position_noise(
    series: &mut Series,
    deviation_rad: f64,
    samples: usize,
    seed: u64,
    first: u64,
) {
    if deviation_rad <= 0.0 {
        return;
    }
    let joints = series.joints();
    let row = (series.samples() * joints).max(1);
    let noise = MeasurementNoise::new(deviation_rad, 0.0);
    let (_, y) = series.add_noise(noise);
    y.par_chunks_exact_mut(row).enumerate().for_each(|(robot, y)| {
        let draws = Draws::new(seed, first + robot as u64, Purpose::AddedPositionNoise, 0);
        disturb(&mut y[..samples * joints], deviation_rad, draws);
    });
}

/// Adds Gaussian noise of `deviation` to `values`.
#[expect(clippy::cast_possible_truncation, reason = "series hold f32")]
fn disturb(values: &mut [f32], deviation: f64, mut draws: Draws) {
    if deviation <= 0.0 {
        return;
    }
    let mut normal = vec![0.0; values.len()];
    draws.fill_normal(&mut normal);
    for (value, normal) in values.iter_mut().zip(normal) {
        *value = deviation.mul_add(normal, f64::from(*value)) as f32;
    }
}

/// Rounds `values` to multiples of `step`. A step of 0 leaves them as they are.
#[expect(clippy::cast_possible_truncation, reason = "series hold f32")]
fn round_to(values: &mut [f32], step: f64) {
    if step <= 0.0 {
        return;
    }
    for value in values {
        *value = ((f64::from(*value) / step).round() * step) as f32;
    }
}
