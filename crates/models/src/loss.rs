//! The loss of a step, entry by entry.

use burn::tensor::{Tensor, TensorData};
use spec::PointLoss;

use crate::ModelError;
use crate::device::host_values;

/// The loss of a training step, entry by entry.
pub(crate) struct Loss {
    /// The error of each entry, `[batch, sample, channel]`. It is 0 for entries that do not count.
    /// Errors of whole series are `[batch, 1, channel]`.
    pub errors: Tensor<3>,
    /// The divisor of the sum of errors.
    pub count: usize,
    /// The predicted y of the horizon, if the loss is computed from a prediction.
    pub predicted: Option<Tensor<3>>,
}

/// Errors of normalized positions well below this count less in a root mean square.
const LEAST_NORMALIZED: f64 = 1e-4;

impl Loss {
    /// The loss of the predictions `answer` against `target`, both `[batch, horizon, joint]` in
    /// `unit`.
    pub fn of_points(
        kind: PointLoss,
        answer: Tensor<3>,
        target: Tensor<3>,
        unit: Tensor<3>,
    ) -> Self {
        let errors = answer.clone() - target;
        match kind {
            PointLoss::MeanSquare => {
                let errors = errors.square();
                let count = errors.shape().num_elements();
                Self { errors, count, predicted: Some(answer) }
            }
            PointLoss::RootMeanSquare => {
                Self::root_mean_square(errors * unit, LEAST_NORMALIZED, answer)
            }
        }
    }

    /// The root mean square over samples of each joint's errors `[batch, sample, joint]`. Errors
    /// well below `least` count less, so that the derivative exists at 0.
    pub fn root_mean_square(errors: Tensor<3>, least: f64, predicted: Tensor<3>) -> Self {
        let errors = (errors.square().mean_dim(1) + least * least).sqrt();
        let count = errors.shape().num_elements();
        Self { errors, count, predicted: Some(predicted) }
    }

    /// Multiplies the errors of y, the last channels, by the weight of their joint.
    #[expect(clippy::cast_possible_truncation, reason = "losses are computed in f32")]
    pub fn weighted(self, weights: &[f64]) -> Self {
        let [.., channels] = self.errors.dims();
        let others = std::iter::repeat_n(1.0, channels - weights.len());
        let values: Vec<f32> = others.chain(weights.iter().map(|&weight| weight as f32)).collect();
        let data = TensorData::new(values, [1, 1, channels]);
        let weights = Tensor::from_data(data, &self.errors.device());
        Self { errors: self.errors * weights, ..self }
    }

    /// The loss as a tensor with gradients.
    pub fn tensor(&self) -> Tensor<1> {
        let entries = self.errors.shape().num_elements();
        let mean = self.errors.clone().mean();
        if entries == self.count { mean } else { mean * (entries as f64 / self.count as f64) }
    }

    /// The loss as a number. It is summed here and in order, because the order in which the backend
    /// adds large tensors depends on the threads.
    pub fn value(&self) -> Result<f64, ModelError> {
        let errors = host_values(self.errors.clone().inner())?;
        Ok(errors.into_iter().map(f64::from).sum::<f64>() / self.count as f64)
    }
}
