//! Errors in JSON text, with line and column as in an editor.

use std::fmt;

use serde::de::DeserializeOwned;
use thiserror::Error;

/// The place where a text is not valid JSON.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub struct JsonFault {
    /// From 1.
    line: usize,
    /// Number of the character in the line, from 1.
    column: usize,
    /// The text from there on, cut.
    found: String,
    expected: &'static str,
}

/// Reads JSON of any type.
///
/// # Errors
/// The first place where `text` is not valid JSON, or does not fit this type.
pub fn read_json<T: DeserializeOwned>(text: &[u8]) -> Result<T, JsonFault> {
    serde_json::from_slice(text).map_err(|error| JsonFault::new(text, &error))
}

impl JsonFault {
    /// The fault that serde_json found in `text`.
    pub fn new(text: &[u8], error: &serde_json::Error) -> Self {
        let at = if error.is_eof() { text.len() } else { beginning(text, error) };
        let (before, rest) = text.split_at(at);
        let line_begin =
            before.iter().rposition(|byte| *byte == b'\n').map_or(0, |index| index + 1);
        let rest = String::from_utf8_lossy(rest);
        Self {
            line: before.iter().filter(|byte| **byte == b'\n').count() + 1,
            column: String::from_utf8_lossy(&before[line_begin..]).chars().count() + 1,
            found: rest.lines().next().unwrap_or_default().trim_end().chars().take(20).collect(),
            expected: expected(&error.to_string()),
        }
    }
}

/// The beginning of the word that serde_json did not expect. serde_json counts bytes, and stops
/// behind or inside the word.
fn beginning(text: &[u8], error: &serde_json::Error) -> usize {
    let lines = text.split_inclusive(|byte| *byte == b'\n').take(error.line().saturating_sub(1));
    let read: usize = lines.map(<[u8]>::len).sum::<usize>() + error.column();
    let mut at = read.saturating_sub(1).min(text.len());
    while at > 0 && text[at - 1].is_ascii_alphanumeric() {
        at -= 1;
    }
    at
}

impl fmt::Display for JsonFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}: ", self.line, self.column)?;
        if self.found.is_empty() {
            return write!(f, "the text ends, where {} was expected", self.expected);
        }
        write!(f, "found {:?}, where {} was expected", self.found, self.expected)
    }
}

/// Translates a message of serde_json for readers.
fn expected(message: &str) -> &'static str {
    const WORDS: [(&str, &str); 13] = [
        ("expected ident", "true, false or null"),
        ("expected value", "a value"),
        ("expected `,` or `}`", "a comma or }"),
        ("expected `,` or `]`", "a comma or ]"),
        ("expected `:`", "a colon"),
        ("trailing characters", "the end"),
        ("trailing comma", "another item after the comma"),
        ("key must be a string", "the name of a field in double quotes"),
        ("invalid number", "a number"),
        ("number out of range", "a number below 1.8e308"),
        ("recursion limit", "no more than 128 levels"),
        ("control character", "a text without line breaks and other control characters"),
        ("escape", "an escape sequence of JSON"),
    ];
    let known =
        WORDS.iter().find(|(theirs, _)| message.starts_with(theirs) || message.contains(theirs));
    known.map_or("more", |(_, ours)| ours)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> String {
        read_json::<serde_json::Value>(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn a_fault_is_where_an_editor_shows_it() {
        assert_eq!(
            fault("{\n  \"ü\": nul\n}"),
            "line 2, column 8: found \"nul\", where true, false or null was expected"
        );
        assert_eq!(
            fault("{\"a\": 1,}"),
            "line 1, column 9: found \"}\", where another item after the comma was expected"
        );
        assert_eq!(fault("[1"), "line 1, column 3: the text ends, where more was expected");
    }
}
