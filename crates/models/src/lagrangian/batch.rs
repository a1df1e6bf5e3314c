use rayon::prelude::*;
use series::MeasurementNoise;

use super::filtering::smoother;
use super::motion::Recorded;
use super::values;
use crate::architecture::ModelInput;

/// Torques and positions of a batch in the memory of the processor, where regressions run.
pub(super) struct HostBatch {
    u: Vec<f32>,
    y: Vec<f32>,
    samples: usize,
    context: usize,
    joints: usize,
    rate_hz: f32,
}

impl HostBatch {
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn new(input: &ModelInput) -> Self {
        let [_, samples, joints] = input.u.dims();
        let [_, context, _] = input.y_context.dims();
        Self {
            u: values(input.u.clone()),
            y: values(input.y_context.clone()),
            samples,
            context,
            joints,
            rate_hz: input.rate_hz as f32,
        }
    }

    /// Smooths noisy positions, because the regression uses their differences.
    pub fn smooth(&mut self, noise: MeasurementNoise) {
        if noise.position_rad <= 0.0 || self.y.is_empty() {
            return;
        }
        let smoother = smoother(&self.robot(0), noise);
        let (joints, row) = (self.joints, self.context * self.joints);
        self.y.par_chunks_exact_mut(row).for_each(|y| {
            let smoothed = smoother.smooth_robot(y, joints);
            y.copy_from_slice(&smoothed);
        });
    }

    pub fn robot(&self, robot: usize) -> Recorded<'_> {
        let &Self { samples, context, joints, rate_hz, .. } = self;
        Recorded {
            u: &self.u[robot * samples * joints..][..samples * joints],
            y: &self.y[robot * context * joints..][..context * joints],
            joints,
            rate_hz,
        }
    }
}
