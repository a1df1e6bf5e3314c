//! Numbers in a form that is easy to read.

/// An integer with its digits in groups of three, separated by thin spaces.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut grouped = String::with_capacity(digits.len() * 2);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            grouped.push('\u{2009}');
        }
        grouped.push(digit);
    }
    grouped
}

/// A measured value with four significant digits, without trailing zeros.
pub fn value(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let magnitude = x.abs();
    if !(1e-3..1e6).contains(&magnitude) {
        return format!("{x:.3e}");
    }
    let decimals = match magnitude {
        m if m >= 1000.0 => return format!("{x:.0}"),
        m if m >= 100.0 => 1,
        m if m >= 10.0 => 2,
        m if m >= 1.0 => 3,
        m if m >= 0.1 => 4,
        m if m >= 0.01 => 5,
        _ => 6,
    };
    let digits = format!("{x:.decimals$}");
    digits.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// An angle in hundredths of a degree. Smaller ones have two significant digits, and at most six
/// decimals.
pub fn degrees(x: f64) -> String {
    format!("{x:.*}", decimals(x))
}

/// A difference of angles in degrees, with its sign.
pub(crate) fn signed_degrees(x: f64) -> String {
    format!("{x:+.*}", decimals(x))
}

fn decimals(x: f64) -> usize {
    match x.abs() {
        0.0 | 0.1.. => 2,
        0.01.. => 3,
        0.001.. => 4,
        1e-4.. => 5,
        _ => 6,
    }
}

/// A part of 1 in percent.
pub(crate) fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// The last step of a part of the horizon, from 0.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast saturates, and a step too late has no number"
)]
pub(crate) fn step_at(seconds: f64, rate_hz: f64) -> usize {
    ((seconds * rate_hz).round() as usize).saturating_sub(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_in_threes() {
        assert_eq!(count(7), "7");
        assert_eq!(count(1234), "1\u{2009}234");
        assert_eq!(count(10_000_000), "10\u{2009}000\u{2009}000");
    }

    #[test]
    fn small_angles_keep_two_digits() {
        let cases = [(0.0, "0.00"), (1.258, "1.26"), (0.0009, "0.00090"), (0.0337, "0.034")];
        for (x, text) in cases {
            assert_eq!(degrees(x), text);
        }
        assert_eq!(signed_degrees(-0.0042), "-0.0042");
        assert_eq!(signed_degrees(0.2), "+0.20");
    }

    #[test]
    fn values_keep_their_significant_digits() {
        let cases = [
            (0.0, "0"),
            (1230.4, "1230"),
            (1.5, "1.5"),
            (-20.004, "-20"),
            (0.012_345, "0.01235"),
            (0.001, "0.001"),
            (6e-4, "6.000e-4"),
            (f64::NAN, "NaN"),
        ];
        for (x, text) in cases {
            assert_eq!(value(x), text);
        }
    }
}
