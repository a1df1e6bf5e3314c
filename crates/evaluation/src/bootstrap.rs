//! Percentile bootstrap: confidence intervals of a mean over scenarios.

use random::{ChaCha8Rng, SeedableRng};
use series::interpolated_quantile;
use spec::Bootstrap;
use wire::Interval;

/// The mean over all values of all strata, resampled within each stratum.
///
/// Strata are the cells of a grid. Their frequencies are chosen and not drawn, so only the robots
/// within each are resampled. Strata of a single value are resampled together, because one value does not
/// say how robots differ (Cochran 1977, "Sampling Techniques", section 5A.12). The result depends only on the values and on `bootstrap`.
///
/// # Panics
/// If there is no value.
pub fn stratified_mean(strata: &[Vec<f64>], bootstrap: Bootstrap) -> Interval {
    let count: usize = strata.iter().map(Vec::len).sum();
    assert!(count > 0, "a mean needs a value");
    let mean_of = |sum: f64| sum / count as f64;
    let mean = mean_of(strata.iter().flatten().sum());
    let mut generator = ChaCha8Rng::seed_from_u64(bootstrap.seed);
    let single: Vec<f64> =
        strata.iter().filter(|values| values.len() == 1).flatten().copied().collect();
    let several = strata.iter().filter(|values| values.len() > 1);
    let strata: Vec<&[f64]> = several.map(Vec::as_slice).chain([single.as_slice()]).collect();
    let mut means: Vec<f64> = (0..bootstrap.resamples)
        .map(|_| mean_of(strata.iter().map(|values| resampled_sum(values, &mut generator)).sum()))
        .collect();
    means.sort_by(f64::total_cmp);
    let [low, high] = [0.025, 0.975].map(|share| interpolated_quantile(&means, share));
    Interval { mean, low, high }
}

/// The sum of all `values` over the sum of all `reference`. Both have the same strata and are
/// resampled together.
///
/// # Panics
/// If there is no value.
pub fn stratified_ratio(
    values: &[Vec<f64>],
    reference: &[Vec<f64>],
    bootstrap: Bootstrap,
) -> Interval {
    let sum = |strata: &[Vec<f64>]| strata.iter().flatten().sum::<f64>();
    assert!(values.iter().any(|values| !values.is_empty()), "a ratio needs a value");
    let mean = sum(values) / sum(reference);
    let mut generator = ChaCha8Rng::seed_from_u64(bootstrap.seed);
    let mut ratios: Vec<f64> = (0..bootstrap.resamples)
        .map(|_| {
            let (mut above, mut below) = (0.0, 0.0);
            for (values, reference) in values.iter().zip(reference) {
                for _ in 0..values.len() {
                    let drawn = random::below(&mut generator, values.len());
                    above += values[drawn];
                    below += reference[drawn];
                }
            }
            above / below
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let [low, high] = [0.025, 0.975].map(|share| interpolated_quantile(&ratios, share));
    Interval { mean, low, high }
}

fn resampled_sum(values: &[f64], generator: &mut ChaCha8Rng) -> f64 {
    (0..values.len()).map(|_| values[random::below(generator, values.len())]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOOTSTRAP: Bootstrap = Bootstrap { resamples: 4000, seed: 7 };

    #[test]
    fn equal_values_have_no_spread() {
        let interval = stratified_mean(&[vec![2.0; 10], vec![2.0; 5]], BOOTSTRAP);
        assert_eq!(interval, Interval { mean: 2.0, low: 2.0, high: 2.0 });
    }

    #[test]
    fn the_interval_is_that_of_the_normal_law_for_many_values() {
        let values: Vec<f64> = (0..1000).map(|k| f64::from(k) / 999.0).collect();
        let interval = stratified_mean(&[values], BOOTSTRAP);
        // The mean of n uniform values has standard deviation sqrt(1 / 12 n).
        let half_width = 1.96 * (1.0_f64 / 12_000.0).sqrt();
        assert!((interval.mean - 0.5).abs() < 1e-12);
        assert!((interval.high - 0.5 - half_width).abs() < 0.1 * half_width, "{interval:?}");
        assert!((0.5 - interval.low - half_width).abs() < 0.1 * half_width, "{interval:?}");
    }

    #[test]
    fn strata_of_one_value_are_resampled_together() {
        let values: Vec<f64> = (0..20).map(f64::from).collect();
        let each: Vec<Vec<f64>> = values.iter().map(|value| vec![*value]).collect();
        assert_eq!(stratified_mean(&each, BOOTSTRAP), stratified_mean(&[values], BOOTSTRAP));
    }

    #[test]
    fn differences_between_strata_do_not_widen_the_interval() {
        let interval = stratified_mean(&[vec![1.0; 50], vec![9.0; 50]], BOOTSTRAP);
        assert_eq!(interval, Interval { mean: 5.0, low: 5.0, high: 5.0 });
    }

    #[test]
    fn the_same_seed_gives_the_same_interval() {
        let strata = [(0..50).map(|k| f64::from(k).sin()).collect::<Vec<_>>()];
        assert_eq!(stratified_mean(&strata, BOOTSTRAP), stratified_mean(&strata, BOOTSTRAP));
    }
}
