//! How one predictor compares with another.

use wire::{GroupSummary, Interval, PairedDifference, Report};

/// How a predictor compares with another one. A difference counts if its 95 % confidence interval
/// does not contain zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComparisonOutcome {
    /// The whole interval of the difference of errors lies below 0.
    Better,
    /// The whole interval lies above 0.
    Worse,
    /// The interval contains 0.
    NotClear,
    /// The interval rests on fewer than [`FEWEST_SCENARIOS`], and is too narrow.
    TooFew,
}

/// A bootstrap of fewer scenarios has intervals that are far too narrow.
const FEWEST_SCENARIOS: u64 = 5;

impl ComparisonOutcome {
    /// The outcome of a pair of `report`.
    pub fn of(report: &Report, pair: &PairedDifference) -> Self {
        let is_of_pair = |group: &&GroupSummary| {
            (group.name.as_str(), group.position_noise_rad)
                == (pair.group.as_str(), pair.position_noise_rad)
        };
        match report.groups.iter().find(is_of_pair) {
            Some(group) => Self::on(group.scenarios, pair.difference_deg),
            None => Self::of_interval(pair.difference_deg),
        }
    }

    /// The outcome of a difference of errors on so many scenarios.
    pub fn on(scenarios: u64, difference: Interval) -> Self {
        if scenarios < FEWEST_SCENARIOS { Self::TooFew } else { Self::of_interval(difference) }
    }

    /// The outcome that follows from a difference of errors. A difference below 0 is better.
    pub fn of_interval(difference: Interval) -> Self {
        if difference.high < 0.0 {
            Self::Better
        } else if difference.low > 0.0 {
            Self::Worse
        } else {
            Self::NotClear
        }
    }

    /// The word for a cell of a table.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::NotClear => "not clear",
            Self::TooFew => "too few scenarios",
        }
    }

    /// The words after two errors that may be equal. `None` for a difference that counts.
    pub const fn doubt(self) -> Option<&'static str> {
        match self {
            Self::Better | Self::Worse => None,
            Self::NotClear => Some("not clearly different"),
            Self::TooFew => Some("too few scenarios to tell"),
        }
    }

    /// The words before the name of the other predictor.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Better => "better than",
            Self::Worse => "worse than",
            Self::NotClear => "not clearly different from",
            Self::TooFew => "compared on too few scenarios with",
        }
    }
}
