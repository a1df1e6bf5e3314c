//! Refused specs: their violations, and how long the texts of errors may be.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;
use utoipa::ToSchema;

/// Number of violations that an error lists. Further ones are only counted.
pub const LISTED_VIOLATIONS: usize = 100;

/// Bytes of a field's path in a violation. A longer one lacks its middle.
pub const FIELD_BYTES: usize = 300;

/// Bytes of a value in a violation. A longer one is cut.
pub const VALUE_BYTES: usize = 200;

/// Bytes of the text that says what is allowed. It may list the names that exist.
pub const ALLOWED_BYTES: usize = 2000;

/// One reason why a spec was refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Violation {
    /// Path of the field, e.g. `excitation.multisine.frequency_hz`. Empty for the whole spec.
    pub field: String,
    /// The offending value, as JSON.
    pub value: String,
    /// The values that are allowed.
    pub allowed: String,
}

impl Violation {
    /// Cuts texts that are too long for an error.
    pub fn new(
        field: impl Into<String>,
        value: impl Into<String>,
        allowed: impl Into<String>,
    ) -> Self {
        Self {
            field: without_middle(field.into(), FIELD_BYTES),
            value: cut(value.into(), VALUE_BYTES),
            allowed: cut(allowed.into(), ALLOWED_BYTES),
        }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let field = if self.field.is_empty() { "the spec" } else { &self.field };
        if self.value.is_empty() {
            write!(f, "{field}: {}", self.allowed)
        } else {
            write!(f, "{field} is {}, allowed: {}", self.value, self.allowed)
        }
    }
}

/// A spec was refused, for all these reasons.
///
/// Checks also collect their violations in one; [`SpecError::into_result`] says whether there are
/// any.
#[derive(Clone, Debug, Default, PartialEq, Eq, Error)]
pub struct SpecError {
    /// The first [`LISTED_VIOLATIONS`].
    pub violations: Vec<Violation>,
    /// Number of violations that are not listed.
    pub more: usize,
}

impl SpecError {
    /// An error with a single violation.
    pub fn one(
        field: impl Into<String>,
        value: impl Into<String>,
        allowed: impl Into<String>,
    ) -> Self {
        Self { violations: vec![Violation::new(field, value, allowed)], more: 0 }
    }

    /// Adds a violation. `describe` is called only if it is listed.
    pub fn add_with(&mut self, describe: impl FnOnce() -> Violation) {
        if self.is_full() {
            self.more += 1;
        } else {
            self.violations.push(describe());
        }
    }

    /// Adds the violations of `other`.
    pub fn append(&mut self, other: Self) {
        let room = LISTED_VIOLATIONS.saturating_sub(self.violations.len());
        self.more += other.more + other.violations.len().saturating_sub(room);
        self.violations.extend(other.violations.into_iter().take(room));
    }

    /// Whether it has no violation.
    pub const fn is_empty(&self) -> bool {
        self.violations.is_empty()
    }

    /// Whether further violations are only counted.
    pub const fn is_full(&self) -> bool {
        self.violations.len() >= LISTED_VIOLATIONS
    }

    /// Number of violations, with those that are not listed.
    pub const fn count(&self) -> usize {
        self.violations.len() + self.more
    }

    /// # Errors
    /// This error, if it has a violation.
    pub fn into_result(self) -> Result<(), Self> {
        if self.is_empty() { Ok(()) } else { Err(self) }
    }

    /// The same violations, with the fields as seen from an enclosing spec.
    pub fn within(mut self, outer: &str) -> Self {
        for violation in &mut self.violations {
            let field = match violation.field.as_str() {
                "" => outer.to_owned(),
                inner => format!("{outer}.{inner}"),
            };
            violation.field = without_middle(field, FIELD_BYTES);
        }
        self
    }
}

impl From<Violation> for SpecError {
    fn from(violation: Violation) -> Self {
        Self { violations: vec![violation], more: 0 }
    }
}

impl fmt::Display for SpecError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, violation) in self.violations.iter().enumerate() {
            if i > 0 {
                f.write_str("; ")?;
            }
            write!(f, "{violation}")?;
        }
        if self.more > 0 {
            write!(f, "; and {} more", self.more)?;
        }
        Ok(())
    }
}

const LEFT_OUT: &str = "...";

/// `text`, cut to `most` bytes.
pub fn cut(mut text: String, most: usize) -> String {
    if text.len() > most {
        text.truncate(text.floor_char_boundary(most - LEFT_OUT.len()));
        text.push_str(LEFT_OUT);
    }
    text
}

/// `text` without its middle, if it has more than `most` bytes. The end of a path names the field.
pub(crate) fn without_middle(text: String, most: usize) -> String {
    if text.len() <= most {
        return text;
    }
    let kept = (most - LEFT_OUT.len()) / 2;
    let begin = &text[..text.floor_char_boundary(kept)];
    let end = &text[text.ceil_char_boundary(text.len() - kept)..];
    format!("{begin}{LEFT_OUT}{end}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_lists_the_first_hundred_violations_and_counts_the_others() {
        let mut error = SpecError::default();
        let described = std::cell::Cell::new(0);
        for i in 0..250 {
            error.add_with(|| {
                described.set(described.get() + 1);
                Violation::new(format!("list[{i}]"), "0", "1")
            });
        }
        assert_eq!((error.violations.len(), error.more, described.get()), (100, 150, 100));
        assert!(error.to_string().ends_with("list[99] is 0, allowed: 1; and 150 more"), "{error}");

        let mut both = SpecError::one("seed", "-1", "0 or more");
        both.append(error);
        assert_eq!((both.violations.len(), both.more, both.count()), (100, 151, 251));
    }

    #[test]
    fn long_texts_are_cut_between_characters() {
        let long = "ü".repeat(1_000_000);
        let Violation { field, value, allowed } =
            Violation::new(format!("jobs.{long}.steps"), long.as_str(), long.as_str());
        assert!(field.len() <= FIELD_BYTES, "{}", field.len());
        assert!(field.starts_with("jobs.ü") && field.ends_with("ü.steps"), "{field}");
        assert!(value.len() <= VALUE_BYTES && value.ends_with("ü..."), "{value}");
        assert!(allowed.len() <= ALLOWED_BYTES && allowed.ends_with("ü..."));
        let within = SpecError::one("steps", "0", "1").within(&format!("jobs.{long}"));
        assert!(within.violations[0].field.len() <= FIELD_BYTES);
        assert_eq!(Violation::new("a", "ü", "1 to 2").to_string(), "a is ü, allowed: 1 to 2");
    }
}
