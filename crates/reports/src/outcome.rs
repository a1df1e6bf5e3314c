//! How one predictor compares with another.

use wire::Interval;

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
}

impl ComparisonOutcome {
    /// The outcome that follows from a difference of errors. A difference below 0 is better.
    pub fn of(difference: Interval) -> Self {
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
        }
    }

    /// The words before the name of the other predictor.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Better => "better than",
            Self::Worse => "worse than",
            Self::NotClear => "not clearly different from",
        }
    }
}
