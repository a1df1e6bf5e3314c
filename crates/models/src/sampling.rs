//! How a denoiser makes its answers: sampler, steps and start.

use series::Observed;
use spec::{Generation, SamplerSpec};

use crate::ModelError;

/// The options of [`crate::TrainedModel::sample`].
#[derive(Clone, Debug, PartialEq)]
pub struct Sampling {
    /// The sampler, or `None` for the checkpoint's own.
    pub sampler: Option<SamplerSpec>,
    /// The seed. Together with the scenario and the number of the sample it is the key of all
    /// randomness.
    pub seed: u64,
    /// Samples of each trajectory.
    pub samples: usize,
    /// Scenario of the first trajectory. The others follow. The samples of a scenario do not depend
    /// on the other trajectories of the call.
    pub first_scenario: u64,
    /// Where chains begin, unless they begin at noise.
    pub warm_start: Option<WarmStart>,
}

/// A warm start begins with an earlier prediction instead of noise (Janner et al. 2022, as its
/// author described it). The prediction is shifted in time and noised to level `steps` - 1 of the
/// training. The last `steps` levels then remove the noise one by one. A flow noises it to its
/// `warm_start_time` and continues in `steps` even steps.
#[derive(Clone, Debug, PartialEq)]
pub struct WarmStart {
    /// Positions of the horizon, predicted `shift` samples ago, `[robot, horizon, joint]`, rad.
    pub previous: Vec<f32>,
    /// Samples between the two predictions, 1 in the paper. Samples beyond the end of the previous
    /// prediction repeat its last one.
    pub shift: usize,
    /// Steps from there on.
    pub steps: u32,
}

impl Default for Sampling {
    /// One sample of seed 0 with the checkpoint's sampler. [`crate::TrainedModel::predict`] uses
    /// this for a denoiser.
    fn default() -> Self {
        Self { sampler: None, seed: 0, samples: 1, first_scenario: 0, warm_start: None }
    }
}

impl WarmStart {
    pub(crate) fn check(
        &self,
        observed: &Observed<'_>,
        generation: &Generation<'_>,
    ) -> Result<(), ModelError> {
        let values = observed.horizon() * observed.joints();
        let expected = observed.robots().saturating_mul(values);
        let actual = self.previous.len();
        if actual != expected {
            return Err(ModelError::Length { what: "warm_start.previous", actual, expected });
        }
        if let Some(index) = self.previous.iter().position(|value| !value.is_finite()) {
            let trajectory = index / values;
            let what = "warm_start.previous";
            return Err(ModelError::NotFiniteInput { what, trajectory });
        }
        let most = generation.most_warm_steps();
        if !(1..=most).contains(&self.steps) {
            return Err(ModelError::Sampling {
                field: "warm_start.steps",
                value: self.steps.to_string(),
                allowed: format!("1 to {}, which is {most}", generation.limit_of_warm_steps()),
            });
        }
        Ok(())
    }

    /// The previous prediction of trajectory `index`, shifted in time.
    pub(crate) fn shifted(&self, index: usize, horizon: usize, joints: usize) -> Vec<f32> {
        let previous = &self.previous[index * horizon * joints..][..horizon * joints];
        (0..horizon)
            .flat_map(|sample| {
                let from = sample.saturating_add(self.shift).min(horizon - 1);
                &previous[from * joints..][..joints]
            })
            .copied()
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::WarmStart;

    const JOINTS: usize = 6;

    #[test]
    fn a_warm_start_moves_on_in_time_and_holds_the_last_sample() {
        let previous: Vec<f32> =
            (0..8).flat_map(|row| std::iter::repeat_n(row as f32, JOINTS)).collect();
        let warm = |shift| WarmStart { previous: previous.clone(), shift, steps: 1 };
        let firsts = |shift, index| -> Vec<f32> {
            warm(shift).shifted(index, 4, JOINTS).iter().step_by(JOINTS).copied().collect()
        };
        assert_eq!(firsts(1, 0), [1.0, 2.0, 3.0, 3.0]);
        assert_eq!(firsts(0, 1), [4.0, 5.0, 6.0, 7.0]);
        assert_eq!(firsts(9, 1), [7.0; 4]);
    }
}
