//! Errors of a model on trajectories that it is not trained on.

use series::{Series, SeriesView, Shape};

/// The part of a batch with which a model is validated.
#[derive(Clone, Debug)]
pub struct ValidationPart<'a> {
    /// The trajectories.
    pub batch: SeriesView<'a>,
    /// Index of the batch's first trajectory in the whole validation. The noise of a trajectory is
    /// keyed by its index, so it is the same at every validation.
    pub first: usize,
    /// The number of trajectories, the first of the batch, that a denoiser predicts. A model that
    /// predicts in one pass predicts all.
    pub predicted: usize,
}

impl<'a> ValidationPart<'a> {
    /// A validation on a whole batch, with predictions for all of it.
    pub fn whole(batch: &'a Series) -> Self {
        Self { batch: batch.view(), first: 0, predicted: batch.robots() }
    }
}

/// Sums of loss and error over validation trajectories. `+=` adds the sums of another part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ValidationReport {
    loss_sum: f64,
    trajectories: usize,
    rmse_sum: f64,
    /// Number of predicted joints, over all trajectories.
    predicted: usize,
}

impl ValidationReport {
    pub(crate) fn new(loss: f64, trajectories: usize) -> Self {
        Self { loss_sum: loss * trajectories as f64, trajectories, ..Self::default() }
    }

    /// Adds predictions `[.., horizon, joint]` of the first trajectories of `batch`, rad.
    pub(crate) fn add_predictions(
        &mut self,
        predicted: &[f32],
        batch: &SeriesView<'_>,
        context: usize,
    ) {
        self.rmse_sum += rmse_sum(predicted, batch, context);
        self.predicted += predicted.len() / (batch.samples() - context);
    }

    /// The mean loss, as in [`crate::StepReport`]; NaN without trajectories.
    pub fn loss(&self) -> f64 {
        self.loss_sum / self.trajectories as f64
    }

    /// The error of [`crate::TrainedModel::predict`] in rad: √(mean over the horizon of the squared
    /// error) of each joint of each predicted trajectory, averaged over both. NaN without
    /// predictions.
    pub fn rmse_rad(&self) -> f64 {
        self.rmse_sum / self.predicted as f64
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

/// The sum, in order, of the error of each joint of each trajectory.
fn rmse_sum(predicted: &[f32], batch: &SeriesView<'_>, context: usize) -> f64 {
    let Shape { samples, joints, .. } = batch.shape();
    let horizon = samples - context;
    let mut total = 0.0;
    for (robot, predicted) in predicted.chunks_exact(horizon * joints).enumerate() {
        let mut squares = vec![0.0; joints];
        let truth = batch.true_y(robot).iter().skip(context);
        for (predicted, truth) in predicted.chunks_exact(joints).zip(truth) {
            for joint in 0..joints {
                squares[joint] += f64::from(predicted[joint] - truth[joint]).powi(2);
            }
        }
        total += squares.iter().map(|sum: &f64| (sum / horizon as f64).sqrt()).sum::<f64>();
    }
    total
}
