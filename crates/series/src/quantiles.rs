//! Quantiles of two kinds: interpolated between values, and measured values.

/// The quantile of `rising` values, with linear interpolation between two of them like numpy's
/// default. `share` is from 0 to 1.
///
/// # Panics
/// If there is no value.
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

/// The smallest of the `rising` values that at least a `share` of all values do not exceed. It is a
/// measured value. `share` is from 0 to 1.
///
/// # Panics
/// If there is no value.
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
/// If there is no value.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    interpolated_quantile(&values, 0.5)
}

/// The 97.5 % quantile of Student's t with `degrees_of_freedom` (from the standard table, with
/// three decimals). It is half the width of a 95 % interval, in standard errors.
///
/// # Panics
/// Without any degree of freedom.
pub fn student_quantile_975(degrees_of_freedom: usize) -> f64 {
    const QUANTILES: [f64; 30] = [
        12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160,
        2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056,
        2.052, 2.048, 2.045, 2.042,
    ];
    assert!(degrees_of_freedom > 0, "a variance needs two values");
    // Beyond the table, this is the first term of the expansion around the normal quantile 1.960.
    let beyond = || 1.960 * (1.0 + 1.21 / degrees_of_freedom as f64);
    QUANTILES.get(degrees_of_freedom - 1).copied().unwrap_or_else(beyond)
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
    fn students_quantiles_fall_to_that_of_the_normal_law() {
        assert_eq!([1, 4, 30].map(student_quantile_975), [12.706, 2.776, 2.042]);
        // Tables have 2.000 and 1.980 for 60 and 120 degrees of freedom.
        assert!((student_quantile_975(60) - 2.000).abs() < 2e-3);
        assert!((student_quantile_975(120) - 1.980).abs() < 2e-3);
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
