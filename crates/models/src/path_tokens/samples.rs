//! The features of each sample in its token.

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

use crate::architecture::ModelInput;

/// The unit of distances from the path is the way at the trajectory's speed in this time, s.
const DISTANCE_S: f32 = 0.5;

/// Added to every speed, rad/s, so that a trajectory without motion or torque has a unit, too.
const LEAST_SPEED: f64 = 1e-3;

/// Channels of each sample: for each joint its torque, velocity, distance from the path, sine and
/// cosine; whether the sample lies in the horizon; and the logarithm of the trajectory's speed.
pub(super) const fn channels(joints: usize) -> usize {
    5 * joints + 2
}

/// The samples of a batch, one robot after the other.
pub(super) struct Samples {
    robots: Vec<Robot>,
    joints: usize,
    context: usize,
}

/// One robot's samples, `[sample, joint]` each.
struct Robot {
    /// Velocities at which a damper holds the torques, rad/s.
    driven: Vec<f32>,
    /// Measured angles in the context and the path's angles in the horizon, rad.
    angles: Vec<f32>,
    /// Mean velocities since the sample before, rad/s.
    velocities: Vec<f32>,
    /// Distances of the measured angles from the path in the context, rad.
    distances: Vec<f32>,
    /// Root mean square over samples and joints of the driven velocities and of the context's
    /// velocities, rad/s.
    speed: f32,
}

impl Samples {
    /// The samples of `input`. The path has a damper of `damping`, N·m·s/rad.
    pub fn of(input: &ModelInput, damping: f64) -> Self {
        let [_, samples, joints] = input.u.dims();
        let [_, context, _] = input.y_context.dims();
        let [u, y, path] = [&input.u, &input.y_context, &input.path].map(values);
        let row = samples * joints;
        let each = u.par_chunks_exact(row).zip(path.par_chunks_exact(row));
        let robots = each
            .zip(y.par_chunks_exact(context * joints))
            .map(|((u, path), y)| Robot::new(u, y, path, joints, damping, input.rate_hz))
            .collect();
        Self { robots, joints, context }
    }

    /// The speed of each trajectory, `[robot, 1, 1]`, rad/s.
    pub fn speeds(&self, device: &Device) -> Tensor<3> {
        let speeds: Vec<f32> = self.robots.iter().map(|robot| robot.speed).collect();
        Tensor::from_data(TensorData::new(speeds, [self.robots.len(), 1, 1]), device)
    }

    /// Tokens of `patch` samples and the one before them, `[robot, token, (patch + 1) · channel]`.
    /// Before the first sample all channels are 0.
    pub fn tokens(&self, patch: usize, device: &Device) -> Tensor<3> {
        let channels = channels(self.joints);
        let width = (patch + 1) * channels;
        let samples = self.robots.first().map_or(0, |robot| robot.angles.len() / self.joints);
        let tokens = samples / patch;
        let mut all = vec![0.0; self.robots.len() * tokens * width];
        let each = all.par_chunks_exact_mut(tokens * width).zip(&self.robots);
        each.for_each(|(tokens, robot)| {
            let described = robot.described(self.joints, self.context);
            for (index, token) in tokens.chunks_exact_mut(width).enumerate() {
                let first = index * patch * channels;
                let known = first.saturating_sub(channels)..first + patch * channels;
                token[width - known.len()..].copy_from_slice(&described[known]);
            }
        });
        Tensor::from_data(TensorData::new(all, [self.robots.len(), tokens, width]), device)
    }
}

impl Robot {
    #[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
    fn new(u: &[f32], y: &[f32], path: &[f32], joints: usize, damping: f64, rate_hz: f64) -> Self {
        let per_torque = 1.0 / damping as f32;
        let driven: Vec<f32> = u.iter().map(|torque| torque * per_torque).collect();
        let angles: Vec<f32> = y.iter().chain(&path[y.len()..]).copied().collect();
        let rate = rate_hz as f32;
        let steps = angles.iter().zip(&angles[joints..]);
        let later = steps.map(|(before, here)| (here - before) * rate);
        // The first sample has none before it, so it gets the velocity of the second.
        let first = angles.iter().zip(&angles[joints..]).take(joints);
        let first = first.map(|(before, here)| (here - before) * rate);
        let velocities: Vec<f32> = first.chain(later).collect();
        let distances = y.iter().zip(path).map(|(y, path)| y - path).collect();
        let speed = (mean_square(&driven) + mean_square(&velocities[..y.len()])).sqrt();
        let speed = (speed + LEAST_SPEED) as f32;
        Self { driven, angles, velocities, distances, speed }
    }

    /// The channels of each sample, `[sample, channel]`.
    fn described(&self, joints: usize, context: usize) -> Vec<f32> {
        let per_speed = 1.0 / self.speed;
        let per_distance = per_speed / DISTANCE_S;
        let mut described = Vec::with_capacity(self.angles.len() / joints * channels(joints));
        for (sample, angles) in self.angles.chunks_exact(joints).enumerate() {
            let here = sample * joints..(sample + 1) * joints;
            let distances = self.distances.get(here.clone());
            described.extend(self.driven[here.clone()].iter().map(|driven| driven * per_speed));
            described.extend(self.velocities[here].iter().map(|velocity| velocity * per_speed));
            match distances {
                Some(distances) => {
                    described.extend(distances.iter().map(|far| far * per_distance));
                }
                None => described.extend(std::iter::repeat_n(0.0, joints)),
            }
            described.extend(angles.iter().map(|angle| angle.sin()));
            described.extend(angles.iter().map(|angle| angle.cos()));
            described.push(if sample < context { 0.0 } else { 1.0 });
            described.push(self.speed.ln());
        }
        described
    }
}

fn mean_square(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>() / values.len() as f64
}

fn values(series: &Tensor<3>) -> Vec<f32> {
    series.clone().inner().into_data().iter().collect()
}
