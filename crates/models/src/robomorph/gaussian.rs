//! A head that predicts its uncertainty: mean and variance of each entry, independent of the
//! others.

use burn::tensor::{Tensor, activation};

/// Mean and logarithm of the variance.
pub(super) const NUMBERS: usize = 2;

/// Arrays in the shape of a head's numbers that [`negative_log_likelihood`] keeps.
pub(super) const KEPT_BY_LOSS: usize = 8;

/// Bounds of the logarithm of the variance. They are standard deviations of 9e-4 and 7.4 in
/// normalized units. A smaller one is below rounding. A variance that falls without end on easy
/// entries would also outweigh all other entries. A larger one is no prediction.
const LEAST_LOG_VARIANCE: f32 = -14.0;
const LARGEST_LOG_VARIANCE: f32 = 4.0;

/// Splits the output of a head `[batch, sample, 2 · channel]` into the mean and the logarithm of
/// the variance, `[batch, sample, channel]` each. The bounds are soft (Chua et al. 2018), so that
/// every entry has a gradient.
pub(super) fn split(numbers: &Tensor<3>) -> (Tensor<3>, Tensor<3>) {
    let [mean, raw] = halves(numbers);
    // softplus(x) = x + softplus(-x). In this form the added terms are small within the bounds.
    let above = activation::softplus(raw.clone() - LARGEST_LOG_VARIANCE, 1.0);
    let capped = raw - above;
    let below = activation::softplus(capped.clone().neg() + LEAST_LOG_VARIANCE, 1.0);
    let log_variance = capped + below;
    (mean, log_variance)
}

/// The first and the second half of the channels.
pub(super) fn halves(numbers: &Tensor<3>) -> [Tensor<3>; 2] {
    let [batch, samples, width] = numbers.dims();
    let channels = width / NUMBERS;
    [0..channels, channels..width]
        .map(|channels| numbers.clone().slice([0..batch, 0..samples, channels]))
}

/// Negative log-likelihood of each entry, without the constant ½ ln 2π.
pub(super) fn negative_log_likelihood(numbers: &Tensor<3>, truth: Tensor<3>) -> Tensor<3> {
    let (mean, log_variance) = split(numbers);
    let squares = (truth - mean).square() * log_variance.clone().neg().exp();
    (squares + log_variance) * 0.5
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Tensor, TensorData};

    use super::{negative_log_likelihood, split};
    use crate::device::host_values;

    fn numbers(mean: f32, raw: f32) -> Tensor<3> {
        Tensor::from_data(TensorData::new(vec![mean, raw], [1, 1, 2]), &Device::flex())
    }

    #[test]
    fn the_variance_is_free_between_its_bounds_and_never_beyond() {
        let log_variance = |raw| host_values(split(&numbers(0.0, raw)).1).unwrap()[0];
        for raw in [-6.0, -2.0, 0.0] {
            assert!((log_variance(raw) - raw).abs() < 0.03, "{raw}: {}", log_variance(raw));
        }
        for raw in [-1e6, -30.0, 30.0, 1e6] {
            assert!((-14.001..=4.02).contains(&log_variance(raw)), "{raw}: {}", log_variance(raw));
        }
    }

    #[test]
    fn the_likelihood_is_the_normal_distributions() {
        let truth = Tensor::from_data(TensorData::new(vec![1.5_f32], [1, 1, 1]), &Device::flex());
        let found = host_values(negative_log_likelihood(&numbers(0.5, -1.0), truth)).unwrap()[0];
        let log_variance = host_values(split(&numbers(0.5, -1.0)).1).unwrap()[0];
        let expected = 0.5 * ((-log_variance).exp() + log_variance);
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}
