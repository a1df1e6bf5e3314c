//! Validation of values: collects every violation instead of stopping at the first.

use std::collections::HashSet;
use std::fmt::Display;
use std::hash::Hash;
use std::ops::RangeInclusive;

use serde::Serialize;
use serde_json::Value;

use crate::shorten::shorten;
use crate::{Range, SpecError, Violation};

/// A spec, or a part of one, that can check its own values.
pub(crate) trait Check {
    fn check(&self, violations: &mut Violations);
}

/// The violations found so far and the path of the part being checked.
#[derive(Default)]
pub(crate) struct Violations {
    path: Vec<String>,
    found: SpecError,
    /// The bounds of checked values, if they are collected.
    bounds: Option<Vec<Bound>>,
}

/// The bounds of a number in a check. The OpenAPI document gets its bounds from these.
pub(crate) struct Bound {
    /// Path of the field, as in violations.
    pub field: String,
    pub of: Bounded,
    pub least: Value,
    pub most: Value,
}

/// The quantity that is bounded.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bounded {
    /// The value itself.
    Value,
    /// The value itself, which must be less than the upper bound.
    ValueBelow,
    /// The number of items of a list, or of bytes of a text.
    Length,
}

impl Violations {
    pub fn finish(self) -> Result<(), SpecError> {
        self.found.into_result()
    }

    /// Also collects the bounds of checked values.
    pub fn with_bounds() -> Self {
        Self { bounds: Some(Vec::new()), ..Self::default() }
    }

    pub fn into_bounds(self) -> Vec<Bound> {
        self.bounds.unwrap_or_default()
    }

    pub fn count(&self) -> usize {
        self.found.count()
    }

    /// Checks `part`. Its fields are reported as `field.…`.
    pub fn part(&mut self, field: &str, part: &impl Check) {
        self.path.push(field.to_owned());
        part.check(self);
        self.path.pop();
    }

    pub fn add(&mut self, field: &str, value: impl Display, allowed: impl Into<String>) {
        self.add_with(field, || (value.to_string(), allowed.into()));
    }

    /// Adds a violation. `describe` gives its value and what is allowed. It is called only if the
    /// violation is listed.
    pub fn add_with(&mut self, field: &str, describe: impl FnOnce() -> (String, String)) {
        let Self { path, found, .. } = self;
        found.add_with(|| {
            let (value, allowed) = describe();
            Violation::new(path_to(path, field), value, allowed)
        });
    }

    fn note(&mut self, field: &str, of: Bounded, [least, most]: [&impl Serialize; 2]) {
        if self.bounds.is_none() {
            return;
        }
        let field = path_to(&self.path, field);
        let [least, most] =
            [least, most].map(|value| serde_json::to_value(value).unwrap_or_default());
        self.bounds.get_or_insert_default().push(Bound { field, of, least, most });
    }

    pub fn within<T: PartialOrd + Display + Serialize>(
        &mut self,
        field: &str,
        value: T,
        allowed: RangeInclusive<T>,
    ) {
        self.note(field, Bounded::Value, [allowed.start(), allowed.end()]);
        self.hold(field, value, &allowed);
    }

    /// Checks the number of items of a list, or of bytes of a text.
    pub fn length(&mut self, field: &str, length: usize, allowed: RangeInclusive<usize>) {
        let measured = field.strip_suffix(".length").unwrap_or(field);
        self.note(measured, Bounded::Length, [allowed.start(), allowed.end()]);
        self.hold(field, length, &allowed);
    }

    /// Checks a share that must be less than 1.
    pub fn below_one(&mut self, field: &str, share: f64) {
        self.note(field, Bounded::ValueBelow, [&0.0, &1.0]);
        if !(0.0..1.0).contains(&share) {
            self.add(field, share, "0 to below 1");
        }
    }

    fn hold<T: PartialOrd + Display>(
        &mut self,
        field: &str,
        value: T,
        allowed: &RangeInclusive<T>,
    ) {
        // NaN lies in no interval, so this refuses it too.
        if !allowed.contains(&value) {
            self.add(field, value, format!("{} to {}", allowed.start(), allowed.end()));
        }
    }

    pub fn all_within(&mut self, field: &str, values: &[f64], allowed: &RangeInclusive<f64>) {
        for (i, value) in values.iter().enumerate() {
            self.within(&format!("{field}[{i}]"), *value, allowed.clone());
        }
    }

    /// Checks a list that must have one number per joint, `joints` in all.
    pub fn one_per_joint(&mut self, field: &str, values: &[f64], joints: usize) {
        if values.len() != joints {
            let allowed = format!("{joints} numbers, one for each joint of the robot");
            self.add(field, format!("{} numbers", values.len()), allowed);
        }
    }

    /// Checks an interval: its ends must be in order and lie in `allowed`.
    pub fn interval(&mut self, field: &str, range: Range, allowed: &RangeInclusive<f64>) {
        self.within(&format!("{field}[0]"), range.min, allowed.clone());
        self.within(&format!("{field}[1]"), range.max, allowed.clone());
        if range.min > range.max {
            self.add(
                field,
                format!("[{}, {}]", range.min, range.max),
                "[min, max] with min not above max",
            );
        }
    }

    /// Checks that a list has no repetitions.
    pub fn no_duplicates<T: Eq + Hash + Serialize>(&mut self, field: &str, items: &[T]) {
        if let Some(repeated) = first_repeated(items) {
            let value = serde_json::to_value(repeated).unwrap_or_default();
            self.add(field, format!("{} twice", shorten(&value)), "each once");
        }
    }

    /// Checks a seed. JSON numbers are exact only up to 2^53.
    pub fn seed(&mut self, field: &str, seed: u64) {
        self.within(field, seed, 0..=(1 << 53) - 1);
    }
}

fn path_to(path: &[String], field: &str) -> String {
    let names = path.iter().map(String::as_str).chain([field]);
    names.collect::<Vec<&str>>().join(".")
}

/// The first item that occurs before in the list.
pub(crate) fn first_repeated<T: Eq + Hash>(items: &[T]) -> Option<&T> {
    let mut seen = HashSet::new();
    items.iter().find(|item| !seen.insert(*item))
}
