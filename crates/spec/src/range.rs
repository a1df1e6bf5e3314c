use serde::{Deserialize, Serialize};
use utoipa::openapi::schema::{ArrayBuilder, Type};
use utoipa::openapi::{Object, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// A closed interval, written `[min, max]`. Draws from it are uniform.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "[f64; 2]", into = "[f64; 2]")]
pub struct Range {
    /// The lower end.
    pub min: f64,
    /// The upper end.
    pub max: f64,
}

impl Range {
    /// The interval from `min` to `max`. Checks of specs refuse one whose ends are out of order or
    /// not finite.
    pub const fn new(min: f64, max: f64) -> Self {
        Self { min, max }
    }

    /// Whether a value lies within, or on an end.
    pub fn contains(&self, value: f64) -> bool {
        self.min <= value && value <= self.max
    }

    /// The value at position `unit` in [0, 1) of the interval.
    pub fn at(&self, unit: f64) -> f64 {
        self.min + (self.max - self.min) * unit
    }
}

impl From<[f64; 2]> for Range {
    fn from([min, max]: [f64; 2]) -> Self {
        Self { min, max }
    }
}

impl From<Range> for [f64; 2] {
    fn from(range: Range) -> Self {
        [range.min, range.max]
    }
}

impl PartialSchema for Range {
    fn schema() -> RefOr<Schema> {
        ArrayBuilder::new()
            .items(Object::with_type(Type::Number))
            .min_items(Some(2))
            .max_items(Some(2))
            .description(Some("[min, max]"))
            .into()
    }
}

impl ToSchema for Range {}
