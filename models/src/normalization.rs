use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use spec::{JOINTS, Normalization};

use crate::frame::Frame;
use crate::sequence_model::ModelInput;
use crate::{Batch, ModelError, PredictionInput};

/// Smaller standard deviations count as this one (N·m and rad): a joint that stands still is not
/// to be magnified until rounding looks like motion. 1e-3 rad is 0.06°.
pub(crate) const SMALLEST_STANDARD_DEVIATION: f32 = 1e-3;

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

/// What the model sees of `input`, each trajectory by its own statistics and frame.
pub(crate) fn model_input(
    input: &PredictionInput,
    statistics: &[Statistics],
    frames: &[Frame],
    device: &Device,
) -> ModelInput {
    let rows = |series: &[f32]| series.len() / input.size.max(1);
    let samples = rows(&input.u) / JOINTS;
    let context = rows(&input.y_context) / JOINTS;
    let mut all_u = Vec::with_capacity(input.u.len());
    let mut y_context = Vec::with_capacity(input.y_context.len());
    let mut seen_context = Vec::with_capacity(input.y_context.len());
    let mut path = Vec::with_capacity(input.u.len());
    let torques = input.u.chunks_exact(samples * JOINTS);
    let positions = input.y_context.chunks_exact(context * JOINTS);
    for (((u, y), statistics), frame) in torques.zip(positions).zip(statistics).zip(frames) {
        for u in u.chunks_exact(JOINTS) {
            all_u.extend(normalized(u, &statistics.u_mean, &statistics.u_std));
        }
        for y in y.chunks_exact(JOINTS) {
            y_context.extend(normalized(y, &statistics.y_mean, &statistics.y_std));
        }
        frame.extend_seen(y, 0, &mut seen_context);
        for center in frame.center().chunks_exact(JOINTS) {
            path.extend(normalized(center, &statistics.y_mean, &statistics.y_std));
        }
    }
    let tensor = |values, samples| {
        Tensor::from_data(TensorData::new(values, [input.size, samples, JOINTS]), device)
    };
    ModelInput {
        u: tensor(all_u, samples),
        y_context: tensor(y_context, context),
        seen_context: tensor(seen_context, context),
        path: tensor(path, samples),
    }
}

/// Positions of the horizon as the frames see them, `[size, horizon, 7]`.
pub(crate) fn target(
    batch: &Batch,
    frames: &[Frame],
    context: usize,
    device: &Device,
) -> Tensor<3> {
    let horizon = batch.samples - context;
    let mut target = Vec::with_capacity(batch.size * horizon * JOINTS);
    for (y, frame) in batch.y.chunks_exact(batch.samples * JOINTS).zip(frames) {
        frame.extend_seen(&y[context * JOINTS..], context, &mut target);
    }
    Tensor::from_data(TensorData::new(target, [batch.size, horizon, JOINTS]), device)
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
