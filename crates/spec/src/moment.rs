use std::fmt;
use std::str::FromStr;

use chrono::{DateTime, SecondsFormat};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use utoipa::openapi::schema::{KnownFormat, SchemaFormat, Type};
use utoipa::openapi::{ObjectBuilder, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// A moment, precise to the millisecond. It is read as RFC 3339 in any time zone, and written in
/// UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Moment(i64);

impl Moment {
    /// The moment this long after 1970-01-01T00:00:00Z, ms.
    pub const fn from_milliseconds(milliseconds: i64) -> Self {
        Self(milliseconds)
    }

    /// Milliseconds since 1970-01-01T00:00:00Z.
    pub const fn milliseconds(self) -> i64 {
        self.0
    }
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let time = DateTime::from_timestamp_millis(self.0).unwrap_or_default();
        f.write_str(&time.to_rfc3339_opts(SecondsFormat::AutoSi, true))
    }
}

/// A text that is no moment.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "{0:?}, allowed: a moment with its zone, such as 2026-12-01T08:00:00Z or \
     2026-12-01T09:00:00+01:00"
)]
pub struct ParseMomentError(String);

impl FromStr for Moment {
    type Err = ParseMomentError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let time = DateTime::parse_from_rfc3339(text);
        time.map(|time| Self(time.timestamp_millis()))
            .map_err(|_| ParseMomentError(text.to_owned()))
    }
}

impl TryFrom<String> for Moment {
    type Error = ParseMomentError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<Moment> for String {
    fn from(moment: Moment) -> Self {
        moment.to_string()
    }
}

impl PartialSchema for Moment {
    fn schema() -> RefOr<Schema> {
        ObjectBuilder::new()
            .schema_type(Type::String)
            .format(Some(SchemaFormat::KnownFormat(KnownFormat::DateTime)))
            .description(Some("RFC 3339 with a zone"))
            .into()
    }
}

impl ToSchema for Moment {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_read_in_any_zone_and_written_in_utc() {
        let moment: Moment = "2026-12-01T09:00:00.5+01:00".parse().unwrap();
        assert_eq!(moment.to_string(), "2026-12-01T08:00:00.500Z");
        assert_eq!("2026-12-01T08:00:00.500Z".parse(), Ok(moment));
        assert_eq!("1970-01-01T00:00:00Z".parse::<Moment>().unwrap().milliseconds(), 0);
    }

    #[test]
    fn a_moment_without_a_zone_is_none() {
        for text in ["2026-12-01T08:00:00", "2026-12-01", "tomorrow", ""] {
            let error = text.parse::<Moment>().unwrap_err().to_string();
            assert!(error.contains("with its zone"), "{error}");
        }
    }
}
