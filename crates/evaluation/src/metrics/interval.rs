//! Coverage and width of central intervals.

/// The central interval with `probability` of the distribution of the `sorted` samples.
///
/// Its ends are the order statistics at p (K + 1), counted from 1 and interpolated. If this is a
/// whole number, one more sample of the same law falls between the ends with exactly this
/// `probability`, for every law (type 6 of Hyndman and Fan 1996, "Sample quantiles in statistical
/// packages"). `None` with fewer samples than [`least_samples`], because the extremes of so few do
/// not reach far enough.
pub fn central_interval(sorted: &[f64], probability: f64) -> Option<(f64, f64)> {
    let tail = 0.5 * (1.0 - probability);
    Some((order_statistic(sorted, tail)?, order_statistic(sorted, 1.0 - tail)?))
}

/// The smallest number of samples with a central interval of `probability`: 3 for a half, 19 for 90
/// %.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a small positive number, or as many as there can be"
)]
pub fn least_samples(probability: f64) -> usize {
    (2.0 / (1.0 - probability) - 1.0 - ROUNDING).ceil() as usize
}

/// Rounding of p (K + 1), which may be whole in decimals but not in binary.
const ROUNDING: f64 = 1e-9;

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a position within a slice, checked to be"
)]
fn order_statistic(sorted: &[f64], p: f64) -> Option<f64> {
    let count = sorted.len();
    let position = p * (count + 1) as f64;
    if position < 1.0 - ROUNDING || position > count as f64 + ROUNDING {
        return None;
    }
    let position = position.clamp(1.0, count as f64);
    let below = position.floor() as usize;
    let (low, high) = (sorted[below - 1], sorted[below.min(count - 1)]);
    Some(low + (high - low) * position.fract())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::normal::samples;

    #[test]
    fn three_samples_span_a_half_and_nineteen_span_nine_tenths() {
        assert_eq!(central_interval(&[1.0, 2.0, 5.0], 0.5), Some((1.0, 5.0)));
        assert_eq!(central_interval(&[1.0, 2.0, 5.0], 0.9), None);
        let nineteen: Vec<f64> = (1..=19).map(f64::from).collect();
        assert_eq!(central_interval(&nineteen, 0.9), Some((1.0, 19.0)));
        assert_eq!(central_interval(&nineteen, 0.5), Some((5.0, 15.0)));
        assert_eq!(central_interval(&nineteen[..18], 0.9), None);
        for probability in [0.1, 0.5, 0.8, 0.9, 0.95] {
            let enough = least_samples(probability);
            let sorted = vec![0.0; enough];
            assert!(central_interval(&sorted, probability).is_some(), "{probability}");
            assert!(central_interval(&sorted[1..], probability).is_none(), "{probability}");
        }
    }

    #[test]
    fn a_calibrated_ensemble_covers_what_it_says_however_few_its_samples() {
        for count in [19, 20, 50] {
            for probability in [0.5, 0.9] {
                let rounds = 20_000;
                let covered = (0..rounds)
                    .filter(|&round| {
                        let mut drawn = samples(round, count + 1);
                        let truth = drawn.pop().unwrap();
                        drawn.sort_by(f64::total_cmp);
                        let (low, high) = central_interval(&drawn, probability).unwrap();
                        (low..=high).contains(&truth)
                    })
                    .count();
                let share = covered as f64 / rounds as f64;
                assert!((share - probability).abs() < 0.012, "{count}, {probability}: {share}");
            }
        }
    }

    #[test]
    fn of_many_normal_samples_it_is_the_normal_laws() {
        let mut drawn = samples(5, 100_000);
        drawn.sort_by(f64::total_cmp);
        let (low, high) = central_interval(&drawn, 0.9).unwrap();
        assert!((low + 1.6449).abs() < 0.03 && (high - 1.6449).abs() < 0.03, "{low} {high}");
    }
}
