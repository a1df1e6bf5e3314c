//! Moments on pages. The server writes them in UTC, and a script shows them in the reader's time zone.

use std::fmt::{self, Display, Formatter};

use askama::filters::HtmlSafe;
use store::Timestamp;

/// An RFC 3339 time of this server, to the second, as an element of HTML.
#[derive(Debug)]
pub struct Instant {
    /// Date and time to the second, without a zone.
    seconds: String,
}

impl Instant {
    /// `None` for a time before 1970, which clients send for none.
    pub fn of_milliseconds(since_1970: i64) -> Option<Self> {
        let time = (since_1970 > 0).then(|| Timestamp::from_milliseconds(since_1970));
        time.map(|time| Self::new(&time.to_string()))
    }

    pub fn new(time: &str) -> Self {
        let seconds = time.split('.').next().unwrap_or_default();
        let is_of_time = |c: &char| c.is_ascii_digit() || matches!(c, '-' | ':' | 'T');
        Self { seconds: seconds.chars().filter(is_of_time).collect() }
    }
}

// Nothing but digits and marks is left of the time.
impl HtmlSafe for Instant {}

impl Display for Instant {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { seconds } = self;
        write!(f, "<time datetime=\"{seconds}Z\">{} UTC</time>", seconds.replace('T', " "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_read_by_people_and_by_scripts_and_brings_no_markup() {
        let expected = "<time datetime=\"2026-11-21T11:10:34Z\">2026-11-21 11:10:34 UTC</time>";
        for time in ["2026-11-21T11:10:34.123Z", "2026-11-21T11:10:34Z"] {
            assert_eq!(Instant::new(time).to_string(), expected);
        }
        assert!(!Instant::new("<script>").to_string().contains("script"));
    }
}
