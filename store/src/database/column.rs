//! The types of parameters and columns: those that all databases have, and ours that are stored as
//! one of them.

use std::time::Duration;

use serde::Serialize;
use serde_json::Value;
use spec::Digest;
use sqlx::error::BoxDynError;
use sqlx::{Decode, Postgres, Sqlite, Type};

/// The value of a parameter: one of the types that all databases have, or `NULL` with its type.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Parameter {
    Integer(Option<i64>),
    Truth(Option<bool>),
    Real(Option<f64>),
    Text(Option<String>),
    /// A list, for the fragments `ids`, `texts` and `items`.
    Json(Option<String>),
}

/// A list as a parameter.
pub(crate) fn json(list: &(impl Serialize + ?Sized)) -> Parameter {
    // Lists of numbers and texts can always be written.
    Parameter::Json(Some(serde_json::to_string(list).unwrap_or_default()))
}

/// A type whose values can be parameters.
pub(crate) trait IntoParameter {
    const NULL: Parameter;

    fn into_parameter(self) -> Parameter;
}

impl IntoParameter for Parameter {
    const NULL: Parameter = Parameter::Json(None);

    fn into_parameter(self) -> Parameter {
        self
    }
}

impl<T: IntoParameter> IntoParameter for Option<T> {
    const NULL: Parameter = T::NULL;

    fn into_parameter(self) -> Parameter {
        self.map_or(T::NULL, T::into_parameter)
    }
}

impl<T: IntoParameter + Clone> IntoParameter for &T {
    const NULL: Parameter = T::NULL;

    fn into_parameter(self) -> Parameter {
        self.clone().into_parameter()
    }
}

/// A type whose values can be read from columns.
pub(crate) trait Column: Sized {
    /// The type of the column.
    type Sql: Readable;

    fn from_sql(value: Self::Sql) -> Result<Self, BoxDynError>;
}

/// A type of columns that all databases have.
pub(crate) trait Readable:
    for<'r> Decode<'r, Sqlite> + Type<Sqlite> + for<'r> Decode<'r, Postgres> + Type<Postgres>
{
}

impl<T> Readable for T where
    T: for<'r> Decode<'r, Sqlite> + Type<Sqlite> + for<'r> Decode<'r, Postgres> + Type<Postgres>
{
}

impl<T: Column> Column for Option<T> {
    type Sql = Option<T::Sql>;

    fn from_sql(value: Self::Sql) -> Result<Self, BoxDynError> {
        value.map(T::from_sql).transpose()
    }
}

macro_rules! column {
    ($($type:ty: $sql:ty, $parameter:ident, |$value:ident| $write:expr, |$found:ident| $read:expr;)+) => {
        $(
            impl $crate::database::column::IntoParameter for $type {
                const NULL: $crate::database::column::Parameter =
                    $crate::database::column::Parameter::$parameter(None);

                fn into_parameter(self) -> $crate::database::column::Parameter {
                    let $value = self;
                    $crate::database::column::Parameter::$parameter(Some($write))
                }
            }

            impl $crate::database::column::Column for $type {
                type Sql = $sql;

                fn from_sql($found: $sql) -> Result<Self, sqlx::error::BoxDynError> {
                    Ok($read)
                }
            }
        )+
    };
}
pub(crate) use column;

// A count is a signed integer of 64 bits in every database. Counts come from checked specs and from
// sizes of files, and are far below 2^63.
column! {
    i64: i64, Integer, |value| value, |found| found;
    i32: i64, Integer, |value| i64::from(value), |found| found.try_into()?;
    u16: i64, Integer, |value| i64::from(value), |found| found.try_into()?;
    u32: i64, Integer, |value| i64::from(value), |found| found.try_into()?;
    u64: i64, Integer, |value| i64::try_from(value).unwrap_or(i64::MAX), |found| found.try_into()?;
    bool: bool, Truth, |value| value, |found| found;
    f64: f64, Real, |value| value, |found| found;
    String: String, Text, |value| value, |found| found;
    Digest: String, Text, |value| value.to_string(), |found| found.parse()?;
    Value: String, Text, |value| value.to_string(), |found| serde_json::from_str(&found)?;
}

impl IntoParameter for &str {
    const NULL: Parameter = Parameter::Text(None);

    fn into_parameter(self) -> Parameter {
        Parameter::Text(Some(self.to_owned()))
    }
}

/// A duration is written in milliseconds, the unit of `{now}`.
impl IntoParameter for Duration {
    const NULL: Parameter = Parameter::Integer(None);

    fn into_parameter(self) -> Parameter {
        Parameter::Integer(Some(milliseconds(self)))
    }
}

/// A duration in milliseconds, which is the unit of `{now}`.
pub(crate) fn milliseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX / 2)
}

/// Lets types that hold one `i64` be parameters and columns.
macro_rules! integer_column {
    ($name:ident) => {
        $crate::database::column::column! {
            $name: i64, Integer, |value| value.0, |found| $name(found);
        }
    };
}
pub(crate) use integer_column;

/// Lets enums of words be parameters and columns.
macro_rules! word_columns {
    ($($name:ty),+ $(,)?) => {
        $crate::database::column::column! {
            $($name: String, Text, |value| value.as_str().to_owned(), |found| found.parse()?;)+
        }
    };
}

pub(crate) use word_columns;

word_columns!(
    wire::AttemptOutcome,
    wire::DatasetState,
    wire::EventKind,
    wire::ItemKind,
    wire::JobState,
    wire::PlacementState,
    wire::Scope,
    wire::TaskState,
);
