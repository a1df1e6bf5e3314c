//! Quantiles, of which there are two: between values, and among them.

/// The quantile of rising values by linear interpolation between two of them, as numpy's default
/// has it.
///
/// # Panics
/// When there is no value.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a position within a slice, not negative"
)]
pub fn interpolated_quantile(rising: &[f64], share: f64) -> f64 {
    let last = rising.len() - 1;
    let position = share * last as f64;
    let below = (position.floor() as usize).min(last);
    let above = (below + 1).min(last);
    rising[below] + (rising[above] - rising[below]) * (position - below as f64)
}

/// The smallest of rising values that a share of all does not exceed: one that was measured.
///
/// # Panics
/// When there is no value.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a rank among the values, not negative"
)]
pub fn measured_quantile(rising: &[f64], share: f64) -> f64 {
    let rank = (share * rising.len() as f64).ceil() as usize;
    rising[rank.clamp(1, rising.len()) - 1]
}

/// The middle of several values, or the mean of the two in the middle.
///
/// # Panics
/// When there is no value.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    interpolated_quantile(&values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_values_a_quantile_lies_on_the_line() {
        let values = [0.0, 1.0, 4.0, 9.0, 16.0];
        for (share, expected) in [(0.0, 0.0), (0.5, 4.0), (0.875, 12.5), (1.0, 16.0)] {
            assert_eq!(interpolated_quantile(&values, share), expected);
        }
        assert_eq!(interpolated_quantile(&[3.0], 0.7), 3.0);
    }

    #[test]
    fn among_values_a_quantile_is_one_of_them() {
        let values: Vec<f64> = (1..=200).map(f64::from).collect();
        let found = [0.0, 0.5, 0.99, 1.0].map(|share| measured_quantile(&values, share));
        assert_eq!(found, [1.0, 100.0, 198.0, 200.0]);
        assert_eq!(measured_quantile(&[3.0], 0.99), 3.0);
    }

    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(median(vec![5.0, 1.0, 3.0]), 3.0);
        assert_eq!(median(vec![5.0, 1.0, 2.0, 3.0]), 2.5);
    }
}
