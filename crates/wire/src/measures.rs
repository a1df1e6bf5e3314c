//! Measures of reports. A measure is declared once, where the field is that holds it: by its table,
//! its title and its unit, and by the documentation of the field, which says what it means.

use crate::Interval;

/// A measure that a `T` holds.
#[derive(Clone, Copy, Debug)]
pub struct Measure<T> {
    /// The name of the field, which is also its name in JSON.
    pub name: &'static str,
    /// The table that shows it.
    pub topic: Topic,
    /// The heading of its column.
    pub title: &'static str,
    /// The unit of its values.
    pub unit: Unit,
    /// The documentation of the field.
    pub about: &'static str,
    /// Its value in a `T`.
    pub get: fn(&T) -> Measured,
}

/// The tables of reports that have measures as columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// How predictions begin, how they jump, and how far they go.
    Continuity,
    /// The part of predictions above the signal's band.
    Jitter,
    /// The torques that predictors say for the measured motion.
    Torque,
    /// Samples as a distribution.
    Samples,
    /// Computing times.
    Latency,
    /// Controllers in the closed loop.
    Control,
}

/// The unit of a measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// An angle in degrees.
    Degrees,
    /// An angle in radians.
    Radians,
    /// A torque.
    NewtonMetres,
    /// A time.
    Milliseconds,
    /// A part of 1, shown in percent.
    Share,
    /// A number without a unit.
    Ratio,
    /// Another unit, which stands beside the value.
    Other,
}

impl Unit {
    /// The unit as it stands after a title. Empty for shares, whose values have their own sign.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Degrees => "°",
            Self::Radians => "rad",
            Self::NewtonMetres => "N·m",
            Self::Milliseconds => "ms",
            Self::Share | Self::Ratio | Self::Other => "",
        }
    }
}

/// The value of a measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measured {
    /// It was not measured.
    Missing,
    /// A single value.
    Number(f64),
    /// A mean over scenarios or robots, with its interval.
    Mean(Interval),
}

impl From<f64> for Measured {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

impl From<Interval> for Measured {
    fn from(interval: Interval) -> Self {
        Self::Mean(interval)
    }
}

impl<T: Into<Self>> From<Option<T>> for Measured {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

/// Declares a struct of a report. A field that is a measure is followed by `= Topic "title" Unit`.
macro_rules! measures {
    ($(#[$($meta:tt)*])* pub struct $of:ident {
        $($(#[$($attribute:tt)*])* pub $field:ident: $type:ty
            $(= $topic:ident $title:literal $unit:ident)?,)*
    }) => {
        $(#[$($meta)*])*
        pub struct $of {
            $($(#[$($attribute)*])* pub $field: $type,)*
        }

        impl $of {
            /// The measures among the fields, in the order of columns.
            pub fn measures() -> impl Iterator<Item = $crate::Measure<Self>> {
                let fields = [$($crate::measures::measure!(
                    $of $field [$([$($attribute)*])*] $($topic $title $unit)?
                )),*];
                fields.into_iter().flatten()
            }
        }
    };
}

/// The measure of a field; `None` for any other field.
macro_rules! measure {
    ($of:ident $field:ident $attributes:tt) => {
        None
    };
    ($of:ident $field:ident [$([$($attribute:tt)*])*] $topic:ident $title:literal $unit:ident) => {
        Some($crate::Measure {
            name: stringify!($field),
            topic: $crate::Topic::$topic,
            title: $title,
            unit: $crate::Unit::$unit,
            about: $crate::measures::documentation!($([$($attribute)*])*).trim_ascii(),
            get: |of: &$of| $crate::Measured::from(of.$field),
        })
    };
}

/// The text of a field's documentation.
macro_rules! documentation {
    () => { "" };
    ([doc = $line:literal] $($rest:tt)*) => {
        concat!($line, $crate::measures::documentation!($($rest)*))
    };
    ([$($other:tt)*] $($rest:tt)*) => { $crate::measures::documentation!($($rest)*) };
}

pub(crate) use {documentation, measure, measures};
