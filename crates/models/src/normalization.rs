//! Torques and positions in units of their mean and standard deviation.

use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use series::{Observed, SeriesView, Shape, Track};
use spec::Normalization;

use crate::ModelError;
use crate::architecture::ModelInput;
use crate::frame::Frame;

/// Smaller standard deviations count as this one (N·m and rad). Otherwise the rounding errors of a
/// joint at rest would be magnified until they look like motion. 1e-3 rad is 0.06°.
pub(crate) const SMALLEST_STANDARD_DEVIATION: f32 = 1e-3;

/// Mean and standard deviation of each joint's torque (N·m) and position (rad).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Mean torque of each joint, N·m.
    pub u_mean: Vec<f32>,
    /// Standard deviation of its torque, N·m.
    pub u_std: Vec<f32>,
    /// Mean position of each joint, rad.
    pub y_mean: Vec<f32>,
    /// Standard deviation of its position, rad.
    pub y_std: Vec<f32>,
}

impl Statistics {
    /// Whether these are valid statistics of an arm of `joints` joints.
    pub(crate) fn is_usable(&self, joints: usize) -> bool {
        let each = [&self.u_mean, &self.u_std, &self.y_mean, &self.y_std];
        let means = self.u_mean.iter().chain(&self.y_mean);
        let mut deviations = self.u_std.iter().chain(&self.y_std);
        each.iter().all(|values| values.len() == joints)
            && means.into_iter().all(|mean| mean.is_finite())
            && deviations.all(|&deviation| deviation.is_finite() && deviation > 0.0)
    }

    /// Mean 0 and standard deviation 1. The model sees N·m and rad.
    pub(crate) fn identity(joints: usize) -> Self {
        let [zeros, ones] = [0.0, 1.0].map(|value| vec![value; joints]);
        Self { u_mean: zeros.clone(), u_std: ones.clone(), y_mean: zeros, y_std: ones }
    }

    /// The statistics of the first `samples` samples of one trajectory.
    fn of(u: Track<'_>, y: Track<'_>, samples: usize) -> Self {
        let (mut of_u, mut of_y) = (ChannelSums::new(u.joints()), ChannelSums::new(y.joints()));
        of_u.add(u.iter().take(samples));
        of_y.add(y.iter().take(samples));
        StatisticsAccumulator { u: of_u, y: of_y }.finish()
    }
}

/// Computes the statistics of a dataset from several sets of trajectories.
#[derive(Clone, Debug)]
pub struct StatisticsAccumulator {
    u: ChannelSums,
    y: ChannelSums,
}

impl StatisticsAccumulator {
    /// No samples yet, for an arm of so many joints.
    pub fn new(joints: usize) -> Self {
        Self { u: ChannelSums::new(joints), y: ChannelSums::new(joints) }
    }

    /// Adds trajectories.
    ///
    /// # Panics
    /// If the trajectories have another number of joints.
    pub fn add(&mut self, trajectories: &SeriesView<'_>) {
        for robot in 0..trajectories.robots() {
            self.u.add(trajectories.u(robot).iter());
            self.y.add(trajectories.y(robot).iter());
        }
    }

    /// Population statistics of all trajectories so far. Without any the mean is 0 and the standard
    /// deviation 1.
    pub fn finish(&self) -> Statistics {
        let (u_mean, u_std) = self.u.mean_and_deviation();
        let (y_mean, y_std) = self.y.mean_and_deviation();
        Statistics { u_mean, u_std, y_mean, y_std }
    }
}

/// Running mean and sum of squared deviations per channel (Welford 1962). This loses no digits
/// where the mean is large compared with the deviation.
#[derive(Clone, Debug)]
struct ChannelSums {
    count: u64,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl ChannelSums {
    fn new(channels: usize) -> Self {
        Self { count: 0, mean: vec![0.0; channels], squares: vec![0.0; channels] }
    }

    fn add<'a>(&mut self, samples: impl Iterator<Item = &'a [f32]>) {
        for sample in samples {
            assert_eq!(sample.len(), self.mean.len(), "channels");
            self.count += 1;
            let weight = 1.0 / self.count as f64;
            let sums = self.mean.iter_mut().zip(&mut self.squares);
            for (&value, (mean, squares)) in sample.iter().zip(sums) {
                let difference = f64::from(value) - *mean;
                *mean += difference * weight;
                *squares += difference * (f64::from(value) - *mean);
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "statistics are applied in f32")]
    fn mean_and_deviation(&self) -> (Vec<f32>, Vec<f32>) {
        let channels = self.mean.len();
        if self.count == 0 {
            return (vec![0.0; channels], vec![1.0; channels]);
        }
        let deviation = self.squares.iter().map(|squares| {
            ((squares / self.count as f64).sqrt() as f32).max(SMALLEST_STANDARD_DEVIATION)
        });
        (self.mean.iter().map(|&mean| mean as f32).collect(), deviation.collect())
    }
}

/// The normalization of a model's input. Its inverse turns answers into positions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Normalizer {
    /// Uses the statistics of each trajectory's own context.
    Context,
    /// Uses these statistics for all trajectories.
    Dataset(Statistics),
    /// Uses the statistics of each trajectory's own context and horizon, as the paper's code does.
    PaperLeaky,
    /// No normalization: the model sees N·m and rad.
    None,
}

impl Normalizer {
    pub(crate) fn new(
        normalization: Normalization,
        dataset: Option<Statistics>,
    ) -> Result<Self, ModelError> {
        match (normalization, dataset) {
            (Normalization::Context, _) => Ok(Self::Context),
            (Normalization::PaperLeaky, _) => Ok(Self::PaperLeaky),
            (Normalization::None, _) => Ok(Self::None),
            (Normalization::Dataset, Some(statistics)) => Ok(Self::Dataset(statistics)),
            (Normalization::Dataset, None) => Err(ModelError::MissingStatistics),
        }
    }

    /// The fixed statistics, where there are any.
    pub(crate) fn statistics(&self) -> Option<Statistics> {
        match self {
            Self::Dataset(statistics) => Some(statistics.clone()),
            Self::Context | Self::PaperLeaky | Self::None => None,
        }
    }

    /// The normalization's name in specs.
    pub(crate) const fn name(&self) -> &'static str {
        match self {
            Self::Context => "context",
            Self::Dataset(_) => "dataset",
            Self::PaperLeaky => "paper-leaky",
            Self::None => "none",
        }
    }

    /// The statistics of each trajectory of a training batch, whose horizon's y is known.
    pub(crate) fn statistics_of_batch(
        &self,
        batch: &SeriesView<'_>,
        context: usize,
    ) -> Vec<Statistics> {
        let seen = match self {
            Self::Context => context,
            Self::PaperLeaky => batch.samples(),
            Self::Dataset(statistics) => return vec![statistics.clone(); batch.robots()],
            Self::None => return vec![Statistics::identity(batch.joints()); batch.robots()],
        };
        let robots = 0..batch.robots();
        robots.map(|robot| Statistics::of(batch.u(robot), batch.y(robot), seen)).collect()
    }

    /// The statistics of each trajectory from the data that a predictor may see.
    pub(crate) fn statistics_of_observed(
        &self,
        observed: &Observed<'_>,
    ) -> Result<Vec<Statistics>, ModelError> {
        let (robots, context) = (observed.robots(), observed.context());
        match self {
            Self::Dataset(statistics) => Ok(vec![statistics.clone(); robots]),
            Self::PaperLeaky => Err(ModelError::LeakRequired),
            Self::None => Ok(vec![Statistics::identity(observed.joints()); robots]),
            Self::Context => {
                let of = |robot| Statistics::of(observed.u(robot), observed.y(robot), context);
                Ok((0..robots).map(of).collect())
            }
        }
    }
}

/// The model's input from `observed`, with the statistics and the frame of each trajectory. This is
/// the only copy between a batch and its tensors.
pub(crate) fn model_input(
    observed: &Observed<'_>,
    statistics: &[Statistics],
    frames: &[Frame],
    device: &Device,
) -> ModelInput {
    let Shape { robots, samples, joints } = observed.shape();
    let context = observed.context();
    let mut u = Vec::with_capacity(robots * samples * joints);
    let mut y_context = Vec::with_capacity(robots * context * joints);
    let mut seen_context = Vec::with_capacity(robots * context * joints);
    let mut path = Vec::with_capacity(robots * samples * joints);
    let mut unit = Vec::with_capacity(robots * samples * joints);
    for (robot, (statistics, frame)) in statistics.iter().zip(frames).enumerate() {
        let Statistics { u_mean, u_std, y_mean, y_std } = statistics;
        for torques in observed.u(robot) {
            u.extend(normalized(torques, u_mean, u_std));
        }
        for positions in observed.y(robot) {
            y_context.extend(normalized(positions, y_mean, y_std));
        }
        frame.extend_seen(observed.y(robot).values(), 0, &mut seen_context);
        for center in frame.center().chunks_exact(joints) {
            path.extend(normalized(center, y_mean, y_std));
        }
        for scale in frame.scale().chunks_exact(joints) {
            unit.extend(scale.iter().zip(y_std).map(|(scale, deviation)| scale / deviation));
        }
    }
    let tensor = |values, samples| {
        Tensor::from_data(TensorData::new(values, [robots, samples, joints]), device)
    };
    ModelInput {
        u: tensor(u, samples),
        y_context: tensor(y_context, context),
        seen_context: tensor(seen_context, context),
        path: tensor(path, samples),
        unit: tensor(unit, samples),
        rate_hz: observed.rate_hz(),
        measurement_noise: observed.noise(),
    }
}

/// True positions of the horizon in the frames, `[robot, horizon, joint]`.
pub(crate) fn target(
    batch: &SeriesView<'_>,
    frames: &[Frame],
    context: usize,
    device: &Device,
) -> Tensor<3> {
    let Shape { robots, samples, joints } = batch.shape();
    let horizon = samples - context;
    let mut target = Vec::with_capacity(robots * horizon * joints);
    for (robot, frame) in frames.iter().enumerate() {
        frame.extend_seen(&batch.true_y(robot).values()[context * joints..], context, &mut target);
    }
    Tensor::from_data(TensorData::new(target, [robots, horizon, joints]), device)
}

fn normalized(sample: &[f32], mean: &[f32], deviation: &[f32]) -> impl Iterator<Item = f32> {
    sample
        .iter()
        .zip(mean)
        .zip(deviation)
        .map(|((value, mean), deviation)| (value - mean) / deviation)
}
