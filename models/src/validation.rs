use spec::JOINTS;

use crate::Batch;

/// What of a batch a model is validated with.
#[derive(Clone, Copy, Debug)]
pub struct ValidationPart<'a> {
    pub batch: &'a Batch,
    /// Place of the batch's first trajectory among all of the validation. The noise of a
    /// trajectory is keyed by its place: the same at every validation.
    pub first: usize,
    /// How many trajectories of the batch, the first ones, a denoiser has to predict. A model that
    /// predicts in one pass predicts all.
    pub predicted: usize,
}

impl<'a> ValidationPart<'a> {
    /// A validation with one batch, all of it predicted.
    pub fn whole(batch: &'a Batch) -> Self {
        Self { batch, first: 0, predicted: batch.size }
    }
}

/// How the model does on trajectories that it was not trained on; sums over several parts by `+=`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ValidationReport {
    loss_sum: f64,
    trajectories: usize,
    rmse_sum: f64,
    predicted: usize,
}

impl ValidationReport {
    pub(crate) fn new(loss: f64, trajectories: usize) -> Self {
        Self { loss_sum: loss * trajectories as f64, trajectories, ..Self::default() }
    }

    /// Takes in predictions `[.., horizon, 7]` of the first trajectories of `batch`, rad.
    pub(crate) fn add_predictions(&mut self, predicted: &[f32], batch: &Batch, context: usize) {
        let row = (batch.samples - context) * JOINTS;
        self.rmse_sum += rmse_sum(predicted, batch, context);
        self.predicted += predicted.len() / row;
    }

    /// As of [`crate::StepReport`]; NaN of no trajectories.
    pub fn loss(&self) -> f64 {
        self.loss_sum / self.trajectories as f64
    }

    /// Of [`crate::TrainedModel::predict`]: √(mean over the horizon of the squared error) of each
    /// joint of each trajectory that was predicted, averaged over both; rad; NaN of none.
    pub fn rmse_rad(&self) -> f64 {
        self.rmse_sum / (self.predicted * JOINTS) as f64
    }
}

impl std::ops::AddAssign for ValidationReport {
    fn add_assign(&mut self, other: Self) {
        self.loss_sum += other.loss_sum;
        self.trajectories += other.trajectories;
        self.rmse_sum += other.rmse_sum;
        self.predicted += other.predicted;
    }
}

/// Of each joint of each trajectory, added up in order.
fn rmse_sum(predicted: &[f32], batch: &Batch, context: usize) -> f64 {
    let horizon = batch.samples - context;
    let mut total = 0.0;
    let truths = batch.y.chunks_exact(batch.samples * JOINTS);
    for (predicted, truth) in predicted.chunks_exact(horizon * JOINTS).zip(truths) {
        let mut squares = [0.0; JOINTS];
        let truth = truth[context * JOINTS..].chunks_exact(JOINTS);
        for (predicted, truth) in predicted.chunks_exact(JOINTS).zip(truth) {
            for joint in 0..JOINTS {
                squares[joint] += f64::from(predicted[joint] - truth[joint]).powi(2);
            }
        }
        total += squares.map(|sum: f64| (sum / horizon as f64).sqrt()).iter().sum::<f64>();
    }
    total
}
