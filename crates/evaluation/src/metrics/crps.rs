//! The continuous ranked probability score.

/// Continuous ranked probability score of samples of one number, in its unit. It is the fair
/// estimator
///
/// mean |x_i - y| - Σ_i Σ_j |x_i - x_j| / (2 K (K - 1)),
///
/// whose expectation is the score of the samples' distribution, whatever their number K (Ferro
/// 2014, "Fair scores for ensemble forecasts", equation 8). `None` below two samples. The function
/// sorts the samples.
pub fn crps(samples: &mut [f64], truth: f64) -> Option<f64> {
    if samples.len() < 2 {
        return None;
    }
    samples.sort_by(f64::total_cmp);
    let count = samples.len() as f64;
    let mut distance = 0.0;
    // Σ_i Σ_j |x_i - x_j| = 2 Σ_k (2 k - K + 1) x_k for sorted x, k from 0.
    let mut spread = 0.0;
    for (k, x) in samples.iter().enumerate() {
        distance += (x - truth).abs();
        // Distances are from the truth, so that no large numbers cancel.
        spread += (2.0 * k as f64 - count + 1.0) * (x - truth);
    }
    Some(distance / count - spread / (count * (count - 1.0)))
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::metrics::normal::{density, distribution, samples};

    fn by_definition(samples: &[f64], truth: f64) -> f64 {
        let count = samples.len() as f64;
        let distance: f64 = samples.iter().map(|x| (x - truth).abs()).sum();
        let pairs = samples.iter().flat_map(|a| samples.iter().map(move |b| (a - b).abs()));
        distance / count - pairs.sum::<f64>() / (2.0 * count * (count - 1.0))
    }

    proptest! {
        #[test]
        fn it_is_the_double_sum_of_its_definition(
            mut samples in proptest::collection::vec(-5.0..5.0f64, 2..40),
            truth in -6.0..6.0f64,
        ) {
            let expected = by_definition(&samples, truth);
            prop_assert!((crps(&mut samples, truth).unwrap() - expected).abs() < 1e-12);
        }

        #[test]
        fn it_moves_and_scales_with_its_unit(
            samples in proptest::collection::vec(-5.0..5.0f64, 2..20),
            truth in -6.0..6.0f64, shift in -100.0..100.0f64, scale in 0.01..100.0f64,
        ) {
            let plain = crps(&mut samples.clone(), truth).unwrap();
            let mut moved: Vec<f64> = samples.iter().map(|x| scale * x + shift).collect();
            let moved = crps(&mut moved, scale * truth + shift).unwrap();
            prop_assert!((moved - scale * plain).abs() < 1e-10 * scale.max(1.0));
        }
    }

    /// Gneiting and Raftery 2007, equation 21: σ (z (2 Φ(z) - 1) + 2 φ(z) - 1 / √π).
    fn crps_of_normal(mean: f64, deviation: f64, truth: f64) -> f64 {
        let z = (truth - mean) / deviation;
        let pi = std::f64::consts::PI;
        deviation * (z * (2.0 * distribution(z) - 1.0) + 2.0 * density(z) - 1.0 / pi.sqrt())
    }

    #[test]
    fn of_normal_samples_it_is_the_closed_form_on_average_however_few_they_are() {
        let (mean, deviation) = (0.3, 2.0);
        for truth in [-1.0, 0.3, 4.0] {
            let expected = crps_of_normal(mean, deviation, truth);
            for count in [2, 5, 50] {
                let rounds = 100_000 / count;
                let total: f64 = (0..rounds)
                    .map(|round| {
                        let mut drawn = samples(round as u64, count);
                        drawn.iter_mut().for_each(|x| *x = mean + deviation * *x);
                        crps(&mut drawn, truth).unwrap()
                    })
                    .sum();
                let found = total / rounds as f64;
                assert!((found - expected).abs() < 0.03, "{count} at {truth}: {found} {expected}");
            }
        }
    }

    #[test]
    fn one_sample_has_no_spread_to_judge() {
        assert_eq!(crps(&mut [1.0], 0.0), None);
    }
}
