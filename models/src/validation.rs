use series::{Series, SeriesView, Shape};

/// What of a batch a model is validated with.
#[derive(Clone, Debug)]
pub struct ValidationPart<'a> {
    pub batch: SeriesView<'a>,
    /// Place of the batch's first trajectory among all of the validation. The noise of a
    /// trajectory is keyed by its place: the same at every validation.
    pub first: usize,
    /// How many trajectories of the batch, the first ones, a denoiser has to predict. A model that
    /// predicts in one pass predicts all.
    pub predicted: usize,
}

impl<'a> ValidationPart<'a> {
    /// A validation with one batch, all of it predicted.
    pub fn whole(batch: &'a Series) -> Self {
        Self { batch: batch.view(), first: 0, predicted: batch.robots() }
    }
}

/// How the model does on trajectories that it was not trained on; sums over several parts by `+=`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ValidationReport {
    loss_sum: f64,
    trajectories: usize,
    rmse_sum: f64,
    /// Joints of all trajectories that were predicted.
    predicted: usize,
}

impl ValidationReport {
    pub(crate) fn new(loss: f64, trajectories: usize) -> Self {
        Self { loss_sum: loss * trajectories as f64, trajectories, ..Self::default() }
    }

    /// Takes in predictions `[.., horizon, joint]` of the first trajectories of `batch`, rad.
    pub(crate) fn add_predictions(
        &mut self,
        predicted: &[f32],
        batch: &SeriesView<'_>,
        context: usize,
    ) {
        self.rmse_sum += rmse_sum(predicted, batch, context);
        self.predicted += predicted.len() / (batch.samples() - context);
    }

    /// As of [`crate::StepReport`]; NaN of no trajectories.
    pub fn loss(&self) -> f64 {
        self.loss_sum / self.trajectories as f64
    }

    /// Of [`crate::TrainedModel::predict`]: √(mean over the horizon of the squared error) of each
    /// joint of each trajectory that was predicted, averaged over both; rad; NaN of none.
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

/// Of each joint of each trajectory, added up in order.
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
