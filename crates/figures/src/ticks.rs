//! The positions and labels of an axis's ticks.

use crate::Scale;

/// A labelled tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    pub(crate) value: f64,
    pub(crate) label: String,
}

/// Sets of ticks for the range, the densest first, each with its labels.
///
/// `most` limits the number of a linear axis's ticks. There is always at least one set.
pub(crate) fn candidates(scale: Scale, low: f64, high: f64, most: u32) -> Vec<Vec<Tick>> {
    match scale {
        Scale::Linear => (1..=most.max(1)).rev().map(|n| linear(low, high, n)).collect(),
        Scale::Log => logarithmic(low, high, most),
    }
}

/// Unlabelled grid lines: 2 to 9 times each power of ten, if they are far enough apart.
pub(crate) fn minor(scale: Scale, low: f64, high: f64) -> Vec<f64> {
    if scale == Scale::Linear || (high / low).log10() > 8.0 {
        return Vec::new();
    }
    multiples(low, high, &[2, 3, 4, 5, 6, 7, 8, 9]).into_iter().map(Multiple::value).collect()
}

/// Ticks at multiples of 1, 2 or 5 times a power of ten, about `count` of them.
fn linear(low: f64, high: f64, count: u32) -> Vec<Tick> {
    let step = round_step((high - low) / f64::from(count));
    let first = (low / step - 1e-9).ceil();
    let last = (high / step + 1e-9).floor();
    // `first` is added as a float, because the index of a tick far from zero can exceed an integer.
    let values: Vec<f64> = (0..=200)
        .map(|i| first + f64::from(i))
        .take_while(|n| *n <= last)
        .map(|n| n * step)
        .collect();
    let notation = Notation::of(low.abs().max(high.abs()), step);
    // Adding 0.0 turns -0.0 into 0.0.
    values
        .into_iter()
        .map(|value| Tick { value: value + 0.0, label: notation.write(value) })
        .collect()
}

/// The smallest of 1, 2, 5 times a power of ten that is at least `wanted`.
fn round_step(wanted: f64) -> f64 {
    let decade = 10f64.powf(wanted.log10().floor());
    let factors = [1.0, 2.0, 5.0, 10.0];
    let factor = factors.into_iter().find(|f| f * decade >= wanted * (1.0 - 1e-9)).unwrap_or(10.0);
    factor * decade
}

/// The notation of a linear axis's labels.
#[derive(Debug, Clone, Copy)]
enum Notation {
    /// With this divisor, suffix and number of decimals: `0.25`, `150k`, `2.5M`.
    Plain { divisor: f64, suffix: &'static str, decimals: usize },
    /// As digits times a power of ten, with this number of decimals.
    Scientific { decimals: usize },
}

impl Notation {
    fn of(largest: f64, step: f64) -> Self {
        let (divisor, suffix) = match largest {
            l if l < 1e4 => (1.0, ""),
            l if l < 1e6 => (1e3, "k"),
            _ => (1e6, "M"),
        };
        let decimals = decimals_for(step / divisor);
        if (1e-3..1e9).contains(&largest) && decimals <= 5 {
            return Self::Plain { divisor, suffix, decimals };
        }
        Self::Scientific { decimals: decimals_for(step / 10f64.powf(largest.log10().floor())) }
    }

    fn write(self, value: f64) -> String {
        // A tick at zero has the rounding error of the others, so it is written as "0".
        match self {
            _ if value == 0.0 => "0".to_owned(),
            Self::Plain { divisor, suffix, decimals } => {
                signed(&format!("{:.decimals$}{suffix}", value / divisor))
            }
            Self::Scientific { decimals } => {
                let written = format!("{value:.decimals$e}");
                let (digits, exponent) = written.split_once('e').unwrap_or((&written, "0"));
                signed(&format!("{digits}×10{}", superscript(exponent)))
            }
        }
    }
}

/// The number with a minus sign in place of a hyphen.
fn signed(number: &str) -> String {
    number.replacen('-', "−", 1)
}

/// The number of decimals that distinguishes multiples of a round step.
fn decimals_for(step: f64) -> usize {
    (0..17)
        .find(|decimals| step * 10f64.powi(*decimals) >= 1.0 - 1e-9)
        .map_or(17, |d| d.unsigned_abs() as usize)
}

/// A number with the form digit times a power of ten.
#[derive(Debug, Clone, Copy)]
struct Multiple {
    digit: i32,
    exponent: i32,
}

impl Multiple {
    fn value(self) -> f64 {
        let power = 10f64.powi(self.exponent.abs());
        // Dividing rounds only once, while multiplying by a negative power would round twice.
        if self.exponent < 0 {
            f64::from(self.digit) / power
        } else {
            f64::from(self.digit) * power
        }
    }

    fn label(self, plain: bool) -> String {
        match self.digit {
            _ if plain => self.value().to_string(),
            1 => format!("10{}", superscript(&self.exponent.to_string())),
            digit => format!("{digit}×10{}", superscript(&self.exponent.to_string())),
        }
    }
}

fn logarithmic(low: f64, high: f64, most: u32) -> Vec<Vec<Tick>> {
    // In this range, plain decimals are not longer than powers.
    let plain = low >= 0.9e-3 && high <= 1.2e4;
    let labelled = |multiples: Vec<Multiple>| -> Vec<Tick> {
        multiples.into_iter().map(|m| Tick { value: m.value(), label: m.label(plain) }).collect()
    };
    let decades = multiples(low, high, &[1]);
    let halves = multiples(low, high, &[1, 2, 5]);
    let mut sets = Vec::new();
    if halves.len() < 3 {
        // Less than a decade looks almost linear, and its own ticks would be too few.
        sets.extend((2..=most.max(2)).rev().map(|n| linear(low, high, n)));
    }
    if decades.len() <= 3 {
        sets.push(labelled(halves));
    }
    for stride in 1..=decades.len().max(1) {
        sets.push(labelled(decades.iter().copied().step_by(stride).collect()));
    }
    sets.retain(|set| !set.is_empty());
    if sets.is_empty() {
        sets.push(linear(low, high, 1));
    }
    sets
}

/// The numbers between `low` and `high` that are one of `digits` times a power of ten, ascending.
fn multiples(low: f64, high: f64, digits: &[i32]) -> Vec<Multiple> {
    // A relative margin, so that an axis that begins exactly at 0.1 has a tick there.
    let (low, high) = (low * (1.0 - 1e-9), high * (1.0 + 1e-9));
    (-151..=151)
        .flat_map(|exponent| digits.iter().map(move |&digit| Multiple { digit, exponent }))
        .filter(|m| (low..=high).contains(&m.value()))
        .collect()
}

fn superscript(integer: &str) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    integer
        .chars()
        .filter_map(|c| match c.to_digit(10) {
            Some(digit) => DIGITS.get(digit as usize).copied(),
            None => Some('⁻'),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: &[Tick]) -> Vec<&str> {
        ticks.iter().map(|tick| tick.label.as_str()).collect()
    }

    #[test]
    fn linear_ticks_are_round_and_share_their_decimals() {
        assert_eq!(labels(&linear(0.0, 1.0, 5)), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(&linear(-3.0, 2.0, 5)), ["−3", "−2", "−1", "0", "1", "2"]);
    }

    #[test]
    fn steps_of_a_training_are_written_in_thousands() {
        assert_eq!(labels(&linear(0.0, 200_000.0, 4)), ["0", "50k", "100k", "150k", "200k"]);
        assert_eq!(labels(&linear(0.0, 1e6, 2)), ["0", "0.5M", "1.0M"]);
    }

    #[test]
    fn very_small_and_very_large_numbers_are_written_as_powers() {
        assert_eq!(labels(&linear(0.0, 2e-5, 2)), ["0", "1×10⁻⁵", "2×10⁻⁵"]);
        assert_eq!(labels(&linear(0.0, 1e30, 2)), ["0", "5.0×10²⁹", "1.0×10³⁰"]);
    }

    #[test]
    fn a_wide_logarithmic_axis_labels_powers_of_ten() {
        let sets = candidates(Scale::Log, 1e-6, 1.0, 8);
        assert_eq!(labels(&sets[0]), ["10⁻⁶", "10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"]);
        assert_eq!(labels(&sets[1]), ["10⁻⁶", "10⁻⁴", "10⁻²", "10⁰"]);
    }

    #[test]
    fn a_logarithmic_axis_of_one_decade_labels_one_two_five() {
        let sets = candidates(Scale::Log, 0.1, 3.0, 8);
        assert_eq!(labels(&sets[0]), ["0.1", "0.2", "0.5", "1", "2"]);
    }

    #[test]
    fn a_narrow_logarithmic_axis_falls_back_to_linear_ticks() {
        let sets = candidates(Scale::Log, 0.031, 0.038, 4);
        assert_eq!(labels(&sets[0]), ["0.032", "0.034", "0.036", "0.038"]);
    }
}
