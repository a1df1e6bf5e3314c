//! Numbers, times and sizes in a readable form.

use wire::Interval;

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

/// A size with a decimal prefix, as for disks and networks.
#[expect(clippy::cast_precision_loss, reason = "three digits are shown")]
pub fn size(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["kB", "MB", "GB", "TB", "PB"];
    if bytes < 1000 {
        return format!("{bytes} B");
    }
    let mut value = bytes as f64 / 1000.0;
    let mut unit = 0;
    while value >= 999.5 && unit + 1 < UNITS.len() {
        value /= 1000.0;
        unit += 1;
    }
    let decimals = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
    format!("{value:.decimals$} {}", UNITS[unit])
}

/// A duration in its two largest units.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to what u64 holds"
)]
pub fn duration(seconds: f64) -> String {
    let whole = seconds.clamp(0.0, 1e12).round() as u64;
    match whole {
        0 if seconds > 0.0 => "less than 1 s".to_owned(),
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        3600..86_400 => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
        _ => format!("{} d {:02} h", whole / 86_400, whole % 86_400 / 3600),
    }
}

/// A rate with the significant digits.
pub fn rate(per_second: f64) -> String {
    if per_second >= 100.0 {
        return format!("{per_second:.0}/s");
    }
    if per_second >= 1.0 {
        return format!("{per_second:.1}/s");
    }
    format!("{:.1}/min", per_second * 60.0)
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

/// Like [`value`], with a minus sign as wide as a digit.
pub fn signed(x: f64) -> String {
    value(x).replace('-', "\u{2212}")
}

/// An RFC 3339 time to the second.
pub fn instant(time: &str) -> String {
    let seconds = time.split('.').next().unwrap_or("").trim_end_matches('Z');
    format!("{} UTC", seconds.replace('T', " "))
}

/// An angle in degrees with two decimals. Smaller angles have two significant digits.
pub fn degrees(x: f64) -> String {
    format!("{x:.*}", decimals(x))
}

/// A difference of angles in degrees, with its sign.
pub fn signed_degrees(x: f64) -> String {
    format!("{x:+.*}", decimals(x)).replace('-', "\u{2212}")
}

/// The ends of an interval of angles.
pub fn interval(Interval { low, high, .. }: Interval) -> String {
    format!("[{}, {}]", degrees(low), degrees(high))
}

/// The ends of an interval of differences of angles.
pub fn signed_interval(Interval { low, high, .. }: Interval) -> String {
    format!("[{}, {}]", signed_degrees(low), signed_degrees(high))
}

/// The number of decimals: two, and more for a value below 0.1, so that it has two significant
/// digits; at most six.
fn decimals(x: f64) -> usize {
    match x.abs() {
        0.0 | 0.1.. => 2,
        0.01.. => 3,
        0.001.. => 4,
        1e-4.. => 5,
        _ => 6,
    }
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
    fn sizes_have_three_digits() {
        let cases = [
            (0, "0 B"),
            (999, "999 B"),
            (1000, "1.00 kB"),
            (999_499, "999 kB"),
            (999_600, "1.00 MB"),
            (12_345_678, "12.3 MB"),
            (u64::MAX, "18447 PB"),
        ];
        for (bytes, text) in cases {
            assert_eq!(size(bytes), text);
        }
    }

    #[test]
    fn durations_have_two_units() {
        let cases = [
            (0.0, "0 s"),
            (0.2, "less than 1 s"),
            (59.4, "59 s"),
            (59.6, "1 min 00 s"),
            (3725.0, "1 h 02 min"),
            (90_000.0, "1 d 01 h"),
            (-5.0, "0 s"),
        ];
        for (seconds, text) in cases {
            assert_eq!(duration(seconds), text);
        }
    }

    #[test]
    fn an_instant_is_told_to_the_second() {
        assert_eq!(instant("2026-11-21T11:10:34.123Z"), "2026-11-21 11:10:34 UTC");
        assert_eq!(instant("2026-11-21T11:10:34Z"), "2026-11-21 11:10:34 UTC");
    }

    #[test]
    fn small_angles_keep_two_digits() {
        let cases = [(0.0, "0.00"), (1.258, "1.26"), (0.0009, "0.00090"), (0.0337, "0.034")];
        for (x, text) in cases {
            assert_eq!(degrees(x), text);
        }
        assert_eq!(signed_degrees(-0.0042), "\u{2212}0.0042");
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
