//! The Kalman filter of a motion that is linear around a path.

/// Rounding error of a step of the law, rad/s.
const ROUNDING: f64 = 2e-5;

/// A step of the law, linearized around a state of the path. The state has angles and velocities.
pub(super) struct Step {
    /// The state that the law predicts from the path, before the path's next state is subtracted:
    /// angles in rad, then velocities in rad/s.
    defect: Vec<f64>,
    /// `[angle or velocity, angle or velocity or damping]`.
    transition: Vec<f64>,
    /// `[angle or velocity, torque]`.
    torque: Vec<f64>,
}

impl Step {
    /// Builds the step from the last two positions of each variant and from the position after
    /// them. `change` is the perturbation of each variant except the first.
    pub fn new(
        y: &[f32],
        next: &[f32],
        joints: usize,
        rate_hz: f64,
        change: impl Fn(usize) -> f64,
    ) -> Self {
        let after = |variant: usize, place: usize| {
            let joint = place % joints;
            let angle = f64::from(next[variant * joints + joint]);
            if place < joints {
                return angle;
            }
            rate_hz * (angle - f64::from(y[variant * 2 * joints + joints + joint]))
        };
        let mut step = Self {
            defect: (0..2 * joints).map(|place| after(0, place)).collect(),
            transition: Vec::with_capacity(6 * joints * joints),
            torque: Vec::with_capacity(2 * joints * joints),
        };
        for place in 0..2 * joints {
            let slope =
                |variant: usize| (after(1 + variant, place) - after(0, place)) / change(variant);
            step.transition.extend((0..3 * joints).map(slope));
            step.torque.extend((3 * joints..4 * joints).map(slope));
        }
        step
    }
}

/// Estimate and covariance of the difference to the path: angles, velocities, dampings.
pub(super) struct Belief {
    pub mean: Vec<f64>,
    /// `[row, column]`
    pub covariance: Vec<f64>,
    /// The negative log-likelihood so far, up to a constant.
    pub surprise: f64,
}

impl Belief {
    /// Predicts over a step. The path is at `path` where the step ends.
    pub fn advance(
        &mut self,
        step: &Step,
        path: &[f64],
        deviations: &[f64],
        rate_hz: f64,
        room: &mut [f64],
    ) {
        let (joints, width) = (deviations.len(), self.mean.len());
        let active = 2 * joints;
        let rows = || step.transition.chunks_exact(width);
        let mean: Vec<f64> = rows()
            .zip(&step.defect)
            .zip(path)
            .map(|((row, led), path)| led - path + dot(row, &self.mean))
            .collect();
        self.mean[..active].copy_from_slice(&mean);
        // The transition matrix times the covariance, which is symmetric.
        for (row, room) in rows().zip(room.chunks_exact_mut(width)) {
            room.fill(0.0);
            for (&factor, covariance) in row.iter().zip(self.covariance.chunks_exact(width)) {
                for (sum, entry) in room.iter_mut().zip(covariance) {
                    *sum += factor * entry;
                }
            }
        }
        for (row, moved) in room.chunks_exact(width).enumerate() {
            for (column, factors) in rows().enumerate().take(row + 1) {
                let torques = step.torque[row * joints..][..joints]
                    .iter()
                    .zip(&step.torque[column * joints..][..joints]);
                let noise = torques
                    .zip(deviations)
                    .map(|((a, b), deviation)| a * b * deviation * deviation);
                let mut entry = dot(moved, factors) + noise.sum::<f64>();
                if row == column {
                    let rounding = if row < joints { ROUNDING / rate_hz } else { ROUNDING };
                    entry += rounding * rounding;
                }
                self.covariance[row * width + column] = entry;
                self.covariance[column * width + row] = entry;
            }
            for (column, &entry) in moved.iter().enumerate().skip(active) {
                self.covariance[row * width + column] = entry;
                self.covariance[column * width + row] = entry;
            }
        }
    }

    /// Updates with the measured position of each joint, one after the other.
    pub fn measure(&mut self, innovations: &[f64], joints: usize, variance: f64) {
        let width = self.mean.len();
        let mut gain = vec![0.0; width];
        for (joint, measured) in innovations.iter().enumerate().take(joints) {
            gain.copy_from_slice(&self.covariance[joint * width..][..width]);
            let total = gain[joint] + variance;
            let innovation = measured - self.mean[joint];
            self.surprise += 0.5 * (total.ln() + innovation * innovation / total);
            for row in 0..width {
                let share = gain[row] / total;
                self.mean[row] += share * innovation;
                for (entry, other) in self.covariance[row * width..][..width].iter_mut().zip(&gain)
                {
                    *entry -= share * other;
                }
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
