use wire::Interval;

/// How a predictor stands against another. A difference counts when its 95 % interval leaves zero out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    Better,
    Worse,
    NotClear,
}

impl Standing {
    /// Of a difference of errors: below 0 is better.
    pub fn of(difference: Interval) -> Self {
        if difference.high < 0.0 {
            Self::Better
        } else if difference.low > 0.0 {
            Self::Worse
        } else {
            Self::NotClear
        }
    }

    /// As a cell of a table says it.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::NotClear => "not clear",
        }
    }

    /// Before what it is compared with.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Better => "better than",
            Self::Worse => "worse than",
            Self::NotClear => "not clearly different from",
        }
    }
}
