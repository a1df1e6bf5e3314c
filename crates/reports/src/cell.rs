//! A cell of a table.

use std::fmt::{self, Display, Formatter};

use spec::Digest;
use wire::{Interval, Measured, Unit};

use crate::numbers::{count, degrees, percent, signed_degrees, value as significant};

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// There is no value.
    Missing,
    /// Words, or numbers that are already formatted.
    Text(String),
    /// Words of which page, terminal and Markdown show the beginning. CSV has them whole.
    Long(String),
    /// A whole number of things.
    Count(u64),
    /// A value in its unit.
    Number(f64, Unit),
    /// A mean with its interval.
    Interval(Interval, Unit),
    /// The best mean of its column.
    Best(Interval, Unit),
    /// The difference of two means in degrees, with its sign.
    Difference(Interval),
}

impl Cell {
    /// The value of a measure.
    pub(crate) fn measured(value: Measured, unit: Unit) -> Self {
        match value {
            Measured::Missing => Self::Missing,
            Measured::Number(value) => Self::Number(value, unit),
            Measured::Mean(interval) => Self::Interval(interval, unit),
        }
    }

    /// The cell without its interval.
    pub(crate) fn mean(self) -> Self {
        match self {
            Self::Interval(interval, unit) | Self::Best(interval, unit) => {
                Self::Number(interval.mean, unit)
            }
            other => other,
        }
    }

    /// Whether the page highlights the cell.
    pub const fn is_best(&self) -> bool {
        matches!(self, Self::Best(..))
    }

    /// The text of its value where it is read by people; empty if it is missing.
    pub fn shown(&self) -> String {
        match self {
            Self::Long(text) => shortened(text),
            other => other.value(),
        }
    }

    /// The words of which [`Self::shown`] has the beginning; empty if it has all of them.
    pub fn whole(&self) -> &str {
        match self {
            Self::Long(text) if shortened(text) != *text => text,
            _ => "",
        }
    }

    /// The whole text of its value; empty if it is missing.
    pub fn value(&self) -> String {
        match self {
            Self::Missing => String::new(),
            Self::Text(text) | Self::Long(text) => text.clone(),
            Self::Count(number) => count(*number),
            Self::Number(value, unit) => in_unit(*value, *unit),
            Self::Interval(interval, unit) | Self::Best(interval, unit) => {
                in_unit(interval.mean, *unit)
            }
            Self::Difference(interval) => signed_degrees(interval.mean),
        }
    }

    /// The ends of its interval; empty without one.
    pub fn ends(&self) -> String {
        let ends = |Interval { low, high, .. }: &Interval, show: &dyn Fn(f64) -> String| {
            format!("[{}, {}]", show(*low), show(*high))
        };
        match self {
            Self::Interval(interval, unit) | Self::Best(interval, unit) => {
                ends(interval, &|value| in_unit(value, *unit))
            }
            Self::Difference(interval) => ends(interval, &signed_degrees),
            _ => String::new(),
        }
    }
}

/// The longest text of a value that tables show whole.
const LONGEST: usize = 48;

/// The beginning of a digest or of a long text.
pub(crate) fn shortened(text: &str) -> String {
    if let Ok(digest) = text.parse::<Digest>() {
        return format!("{}…", digest.short());
    }
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

fn in_unit(value: f64, unit: Unit) -> String {
    match unit {
        Unit::Degrees | Unit::NewtonMetres => degrees(value),
        Unit::Milliseconds | Unit::Radians | Unit::Other => significant(value),
        Unit::Share => percent(value),
        Unit::Ratio => format!("{value:.2}"),
    }
}

/// The text of a cell on the terminal.
impl Display for Cell {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if *self == Self::Missing {
            return f.write_str("-");
        }
        f.write_str(&self.shown())?;
        match self.ends() {
            ends if ends.is_empty() => Ok(()),
            ends => write!(f, " {ends}"),
        }
    }
}

impl<C: Into<Self>> From<Option<C>> for Cell {
    fn from(value: Option<C>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_and_a_long_text_are_shown_by_their_beginning() {
        let digest = Cell::Long("3f41".repeat(16));
        assert_eq!((digest.shown().as_str(), digest.to_string().len()), ("3f413f413f41…", 15));
        assert_eq!((digest.whole().len(), digest.value().len()), (64, 64));
        let list = Cell::Long("é".repeat(60));
        assert_eq!((list.shown(), list.whole()), ("é".repeat(48) + "…", "é".repeat(60).as_str()));
        let short = Cell::Long("adam".to_owned());
        assert_eq!((short.shown().as_str(), short.whole()), ("adam", ""));
    }
}
