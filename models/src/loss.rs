use burn::tensor::{Tensor, TensorData};

use crate::ModelError;
use crate::device::host_values;

/// The loss of a training step, entry by entry.
pub(crate) struct Loss {
    /// The error of each entry, `[batch, sample, channel]`, 0 where it does not count.
    pub errors: Tensor<3>,
    /// The number that their sum is divided by.
    pub count: usize,
    /// y of the horizon, where the loss is that of a prediction.
    pub predicted: Option<Tensor<3>>,
}

impl Loss {
    /// The errors of y, the last channels, times the weight of their joint.
    #[expect(clippy::cast_possible_truncation, reason = "losses are computed in f32")]
    pub fn weighted(self, weights: &[f64]) -> Self {
        let [.., channels] = self.errors.dims();
        let others = std::iter::repeat_n(1.0, channels - weights.len());
        let values: Vec<f32> = others.chain(weights.iter().map(|&weight| weight as f32)).collect();
        let data = TensorData::new(values, [1, 1, channels]);
        let weights = Tensor::from_data(data, &self.errors.device());
        Self { errors: self.errors * weights, ..self }
    }

    /// As a tensor of which gradients can be asked.
    pub fn tensor(&self) -> Tensor<1> {
        let entries = self.errors.shape().num_elements();
        let mean = self.errors.clone().mean();
        if entries == self.count { mean } else { mean * (entries as f64 / self.count as f64) }
    }

    /// Summed here and in order: the backend adds large tensors in an order that depends on which
    /// thread was free.
    pub fn value(&self) -> Result<f64, ModelError> {
        let errors = host_values(self.errors.clone().inner())?;
        Ok(errors.into_iter().map(f64::from).sum::<f64>() / self.count as f64)
    }
}
