//! Numbers and times in a form that is easy to read.

use std::time::{Duration, SystemTime};

/// A whole number with thin groups of three: `16 384`.
pub fn count(number: u64) -> String {
    grouped(&number.to_string())
}

fn grouped(digits: &str) -> String {
    let mut text = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// A number with about three digits.
pub fn rounded(number: f64) -> String {
    if number >= 100.0 {
        grouped(&format!("{number:.0}"))
    } else if number >= 10.0 {
        format!("{number:.1}")
    } else {
        format!("{number:.2}")
    }
}

/// A duration, e.g. `9s`, `2m 05s`, `3h 07m`.
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs();
    match seconds {
        0..60 => format!("{seconds}s"),
        60..3600 => format!("{}m {:02}s", seconds / 60, seconds % 60),
        _ => format!("{}h {:02}m", seconds / 3600, seconds % 3600 / 60),
    }
}

/// Time from one RFC 3339 instant to another, or to now.
pub fn since(from: &str, to: Option<&str>) -> Option<Duration> {
    let from = humantime::parse_rfc3339_weak(from).ok()?;
    let to =
        to.map_or_else(|| Some(SystemTime::now()), |to| humantime::parse_rfc3339_weak(to).ok())?;
    Some(to.duration_since(from).unwrap_or_default())
}

/// How long ago an RFC 3339 instant was: `2m 05s ago`.
pub fn ago(from: &str) -> String {
    since(from, None).map(|age| format!("{} ago", duration(age))).unwrap_or_default()
}

/// A count with its noun: `1 worker`, `3 workers`.
pub fn counted(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}

/// A size in a suitable unit, e.g. `12.3 MB`.
pub fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_by_three_from_the_right() {
        let texts = [7, 999, 1000, 16_384, 10_000_000].map(count);
        assert_eq!(texts, ["7", "999", "1 000", "16 384", "10 000 000"]);
    }

    #[test]
    fn a_size_is_in_the_unit_that_suits_it() {
        let texts = [999, 1_500, 12_345_678, 7_000_000_000].map(size);
        assert_eq!(texts, ["999 B", "1.5 kB", "12.3 MB", "7.0 GB"]);
    }

    #[test]
    fn times_show_their_two_largest_units() {
        let texts = [9, 125, 11_220].map(|seconds| duration(Duration::from_secs(seconds)));
        assert_eq!(texts, ["9s", "2m 05s", "3h 07m"]);
    }
}
