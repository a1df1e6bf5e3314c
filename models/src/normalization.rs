use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use spec::{JOINTS, Normalization};

use crate::sequence_model::ModelInput;
use crate::{Batch, ModelError, PredictionInput};

/// Smaller standard deviations count as this one (N·m and rad): a joint that stands still is not
/// to be magnified until rounding looks like motion. 1e-3 rad is 0.06°.
const SMALLEST_STANDARD_DEVIATION: f32 = 1e-3;

/// Mean and standard deviation of each joint's torque (N·m) and position (rad).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    pub u_mean: [f32; JOINTS],
    pub u_std: [f32; JOINTS],
    pub y_mean: [f32; JOINTS],
    pub y_std: [f32; JOINTS],
}

impl Statistics {
    pub(crate) fn is_usable(&self) -> bool {
        let means = self.u_mean.iter().chain(&self.y_mean);
        let mut deviations = self.u_std.iter().chain(&self.y_std);
        means.into_iter().all(|mean| mean.is_finite())
            && deviations.all(|&deviation| deviation.is_finite() && deviation > 0.0)
    }

    fn of(u: &[f32], y: &[f32]) -> Self {
        let mut accumulator = StatisticsAccumulator::default();
        accumulator.add(u, y);
        accumulator.finish()
    }
}

/// Gathers the statistics of a dataset, some trajectories at a time.
#[derive(Clone, Debug, Default)]
pub struct StatisticsAccumulator {
    u: ChannelSums,
    y: ChannelSums,
}

impl StatisticsAccumulator {
    /// `u` and `y` are `[.., 7]`, any number of samples.
    pub fn add(&mut self, u: &[f32], y: &[f32]) {
        self.u.add(u);
        self.y.add(y);
    }

    /// Population statistics of all that was added; mean 0 and deviation 1 of nothing.
    pub fn finish(&self) -> Statistics {
        let (u_mean, u_std) = self.u.mean_and_deviation();
        let (y_mean, y_std) = self.y.mean_and_deviation();
        Statistics { u_mean, u_std, y_mean, y_std }
    }
}

/// Running mean and sum of squared deviations per channel (Welford 1962), which loses no digits
/// where the mean is large beside the deviation.
#[derive(Clone, Debug, Default)]
struct ChannelSums {
    count: u64,
    mean: [f64; JOINTS],
    squares: [f64; JOINTS],
}

impl ChannelSums {
    fn add(&mut self, series: &[f32]) {
        for sample in series.chunks_exact(JOINTS) {
            self.count += 1;
            let weight = 1.0 / self.count as f64;
            for (joint, &value) in sample.iter().enumerate() {
                let difference = f64::from(value) - self.mean[joint];
                self.mean[joint] += difference * weight;
                self.squares[joint] += difference * (f64::from(value) - self.mean[joint]);
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "statistics are applied in f32")]
    fn mean_and_deviation(&self) -> ([f32; JOINTS], [f32; JOINTS]) {
        if self.count == 0 {
            return ([0.0; JOINTS], [1.0; JOINTS]);
        }
        let deviation = self.squares.map(|squares| {
            ((squares / self.count as f64).sqrt() as f32).max(SMALLEST_STANDARD_DEVIATION)
        });
        (self.mean.map(|mean| mean as f32), deviation)
    }
}

/// How raw series become what a model sees, and its answers positions again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Normalizer {
    /// By each trajectory's own context.
    Context,
    /// By these statistics, whatever the trajectory.
    Dataset(Statistics),
    /// By each trajectory's own context and horizon, as in the paper's code.
    PaperLeaky,
}

impl Normalizer {
    pub(crate) fn new(
        normalization: Normalization,
        dataset: Option<Statistics>,
    ) -> Result<Self, ModelError> {
        match (normalization, dataset) {
            (Normalization::Context, _) => Ok(Self::Context),
            (Normalization::PaperLeaky, _) => Ok(Self::PaperLeaky),
            (Normalization::Dataset, Some(statistics)) => Ok(Self::Dataset(statistics)),
            (Normalization::Dataset, None) => Err(ModelError::MissingStatistics),
        }
    }

    /// Statistics of each trajectory, for which the horizon's y may be seen.
    pub(crate) fn statistics_of_batch(&self, batch: &Batch, context: usize) -> Vec<Statistics> {
        let row = batch.samples * JOINTS;
        let seen = match self {
            Self::Context => context * JOINTS,
            Self::PaperLeaky => row,
            Self::Dataset(statistics) => return vec![*statistics; batch.size],
        };
        let trajectories = batch.u.chunks_exact(row).zip(batch.y.chunks_exact(row));
        trajectories.map(|(u, y)| Statistics::of(&u[..seen], &y[..seen])).collect()
    }

    /// Statistics of each trajectory from what a predictor may know.
    pub(crate) fn statistics_of_input(
        &self,
        input: &PredictionInput,
        samples: usize,
        context: usize,
    ) -> Result<Vec<Statistics>, ModelError> {
        match self {
            Self::Dataset(statistics) => Ok(vec![*statistics; input.size]),
            Self::PaperLeaky => Err(ModelError::LeakRequired),
            Self::Context => {
                let seen = context * JOINTS;
                let torques = input.u.chunks_exact(samples * JOINTS);
                let positions = input.y_context.chunks_exact(seen);
                Ok(torques.zip(positions).map(|(u, y)| Statistics::of(&u[..seen], y)).collect())
            }
        }
    }
}

/// What the model sees of `input`, each trajectory by its own statistics.
pub(crate) fn model_input(
    input: &PredictionInput,
    statistics: &[Statistics],
    samples: usize,
    context: usize,
    device: &Device,
) -> ModelInput {
    let horizon = samples - context;
    let mut known = Vec::with_capacity(input.size * context * 2 * JOINTS);
    let mut future_u = Vec::with_capacity(input.size * horizon * JOINTS);
    let torques = input.u.chunks_exact(samples * JOINTS);
    let positions = input.y_context.chunks_exact(context * JOINTS);
    for ((u, y), statistics) in torques.zip(positions).zip(statistics) {
        let (past_u, horizon_u) = u.split_at(context * JOINTS);
        for (u, y) in past_u.chunks_exact(JOINTS).zip(y.chunks_exact(JOINTS)) {
            known.extend(normalized(u, &statistics.u_mean, &statistics.u_std));
            known.extend(normalized(y, &statistics.y_mean, &statistics.y_std));
        }
        for u in horizon_u.chunks_exact(JOINTS) {
            future_u.extend(normalized(u, &statistics.u_mean, &statistics.u_std));
        }
    }
    let known = TensorData::new(known, [input.size, context, 2 * JOINTS]);
    let future_u = TensorData::new(future_u, [input.size, horizon, JOINTS]);
    ModelInput {
        context: Tensor::from_data(known, device),
        future_u: Tensor::from_data(future_u, device),
    }
}

/// Normalized positions of the horizon, `[size, horizon, 7]`.
pub(crate) fn target(
    batch: &Batch,
    statistics: &[Statistics],
    context: usize,
    device: &Device,
) -> Tensor<3> {
    let horizon = batch.samples - context;
    let mut target = Vec::with_capacity(batch.size * horizon * JOINTS);
    for (y, statistics) in batch.y.chunks_exact(batch.samples * JOINTS).zip(statistics) {
        for y in y[context * JOINTS..].chunks_exact(JOINTS) {
            target.extend(normalized(y, &statistics.y_mean, &statistics.y_std));
        }
    }
    Tensor::from_data(TensorData::new(target, [batch.size, horizon, JOINTS]), device)
}

/// Turns normalized positions of the horizon `[size, horizon, 7]` into rad.
pub(crate) fn denormalize(y: &mut [f32], statistics: &[Statistics], horizon: usize) {
    for (y, statistics) in y.chunks_exact_mut(horizon * JOINTS).zip(statistics) {
        for sample in y.chunks_exact_mut(JOINTS) {
            for (joint, value) in sample.iter_mut().enumerate() {
                *value = *value * statistics.y_std[joint] + statistics.y_mean[joint];
            }
        }
    }
}

fn normalized(
    sample: &[f32],
    mean: &[f32; JOINTS],
    deviation: &[f32; JOINTS],
) -> impl Iterator<Item = f32> {
    sample
        .iter()
        .zip(mean)
        .zip(deviation)
        .map(|((value, mean), deviation)| (value - mean) / deviation)
}
