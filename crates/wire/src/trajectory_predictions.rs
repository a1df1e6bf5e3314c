//! Predictions of stored trajectories, beside what happened.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{PredictedQuantile, Warning};

/// A stored trajectory, and what checkpoints predict for it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryPredictions {
    /// The dataset that holds it.
    pub dataset: i64,
    /// Its index there.
    pub trajectory: u64,
    /// Samples per second.
    pub rate_hz: f64,
    /// Its number of samples.
    pub samples: usize,
    /// The sample at which the horizon begins. The context of a model ends with the one before.
    pub begin: usize,
    /// The sample at which `truth` begins, within the longest context.
    pub first: usize,
    /// The true joint positions `[sample][joint]`, rad, to the end of the longest horizon. As much of
    /// the context is there as of the horizon.
    pub truth: Vec<Vec<f32>>,
    /// The predictions of the checkpoints in the order of the request, then that of `hold-last`.
    pub predictions: Vec<TrajectoryPrediction>,
}

/// The prediction of one checkpoint, or of the baseline `hold-last`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryPrediction {
    /// The name in tables and figures.
    pub name: String,
    /// The checkpoint; missing for the baseline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checkpoint: Option<i64>,
    /// Joint positions `[horizon][joint]`, rad. With several samples, their mean.
    pub y: Vec<Vec<f32>>,
    /// The 5 % and 95 % quantiles of each position, of a model with samples.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub quantiles: Vec<PredictedQuantile>,
    /// The first samples `[sample][horizon][joint]`, rad, of a model with samples.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub samples: Vec<Vec<Vec<f32>>>,
    /// Passes through the model for each sample, of a model that removes noise; the sampler's steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<u32>,
    /// RMSE over the horizon, degrees, mean over joints.
    pub rmse_deg: f64,
    /// RMSE over the horizon of each joint, degrees.
    pub joint_rmse_deg: Vec<f64>,
    /// At each step of the horizon, the root of the mean square over joints, degrees.
    pub step_rmse_deg: Vec<f64>,
    /// How long the computation took, ms; missing for the baseline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compute_ms: Option<f64>,
    /// Data outside the checkpoint's training data, contexts without information, and predictions
    /// beyond the joints' limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

impl TrajectoryPrediction {
    /// Sets the errors, with the true positions of the horizon.
    #[must_use]
    pub fn against(self, truth: &[Vec<f32>]) -> Self {
        let joints = truth.first().map_or(0, Vec::len);
        let error = |(true_q, q): (&f32, &f32)| (f64::from(*q) - f64::from(*true_q)).to_degrees();
        // [step][joint].
        let squares: Vec<Vec<f64>> = truth
            .iter()
            .zip(&self.y)
            .map(|(truth, y)| truth.iter().zip(y).map(error).map(|error| error * error).collect())
            .collect();
        let root = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
            if count == 0.0 { 0.0 } else { f64::sqrt(sum / count) }
        };
        let joint_rmse_deg: Vec<f64> =
            (0..joints).map(|joint| root(&mut squares.iter().map(|step| step[joint]))).collect();
        let step_rmse_deg = squares.iter().map(|step| root(&mut step.iter().copied())).collect();
        let rmse_deg = joint_rmse_deg.iter().sum::<f64>() / (joints.max(1) as f64);
        Self { rmse_deg, joint_rmse_deg, step_rmse_deg, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_those_of_joints_of_steps_and_of_all() {
        let prediction = TrajectoryPrediction {
            y: vec![vec![0.0, 1.0], vec![0.0, 1.0]],
            ..TrajectoryPrediction::default()
        };
        // The errors are 0.3 and 0.4 rad at the first step, and none and 0.4 rad at the second.
        let found = prediction.against(&[vec![0.3, 0.6], vec![0.0, 0.6]]);
        let degrees = |radians: f64| radians.to_degrees();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-5, "{a} and {b}");
        close(found.joint_rmse_deg[0], degrees(0.3 / 2.0_f64.sqrt()));
        close(found.joint_rmse_deg[1], degrees(0.4));
        close(found.step_rmse_deg[0], degrees(0.5 / 2.0_f64.sqrt()));
        close(found.step_rmse_deg[1], degrees(0.4 / 2.0_f64.sqrt()));
        close(found.rmse_deg, (degrees(0.3 / 2.0_f64.sqrt()) + degrees(0.4)) / 2.0);
    }
}
