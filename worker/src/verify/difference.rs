//! Finds the first difference of two tables.

use std::fmt;

use arrow_array::cast::AsArray;
use arrow_array::types::ArrowPrimitiveType;
use arrow_array::types::{Float32Type, Float64Type, Int32Type, Int64Type};
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::DataType;

/// How far apart two numbers may be and still count as equal: |a - b| ≤ absolute + relative · |b|.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerance {
    pub absolute: f64,
    pub relative: f64,
}

impl Tolerance {
    /// Only bitwise equal numbers count as equal.
    pub const NONE: Self = Self { absolute: 0.0, relative: 0.0 };

    fn allows(self, a: f64, b: f64) -> bool {
        // Bits are compared first, so NaN equals itself, and -0 differs from 0.
        a.to_bits() == b.to_bits()
            || self != Self::NONE && (a - b).abs() <= self.absolute + self.relative * b.abs()
    }
}

impl fmt::Display for Tolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.absolute > 0.0, self.relative > 0.0) {
            (true, true) => write!(f, "{:e} + {:e} of the value", self.absolute, self.relative),
            (true, false) => write!(f, "{:e}", self.absolute),
            (false, _) => write!(f, "{:e} of the value", self.relative),
        }
    }
}

/// The first value that differs when it is computed again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Difference {
    pub row: usize,
    pub column: String,
    pub stored: String,
    pub made: String,
}

/// The first difference: in the earliest row, and there in the first column. `None` when all values
/// agree.
///
/// Both tables have the same columns and the same number of rows.
pub(crate) fn first_difference(
    stored: &RecordBatch,
    made: &RecordBatch,
    tolerance: Tolerance,
) -> Option<Difference> {
    let mut first: Option<Difference> = None;
    for (i, field) in made.schema_ref().fields().iter().enumerate() {
        let (stored, made) = (stored.column(i), made.column(i));
        let before = first.as_ref().map_or(made.len(), |difference| difference.row);
        if let Some(row) = first_row(stored, made, tolerance, before) {
            first = Some(Difference {
                row,
                column: field.name().clone(),
                stored: text(stored, row),
                made: text(made, row),
            });
        }
    }
    first
}

/// The first row below `before` that differs.
fn first_row(
    stored: &ArrayRef,
    made: &ArrayRef,
    tolerance: Tolerance,
    before: usize,
) -> Option<usize> {
    let (stored, made) = (stored.slice(0, before), made.slice(0, before));
    if tolerance == Tolerance::NONE && stored.to_data() == made.to_data() && !is_float(&made) {
        return None;
    }
    match made.data_type() {
        DataType::Float32 => first_number::<Float32Type>(&stored, &made, |a, b| {
            a.to_bits() == b.to_bits() || tolerance.allows(f64::from(a), f64::from(b))
        }),
        DataType::Float64 => {
            first_number::<Float64Type>(&stored, &made, |a, b| tolerance.allows(a, b))
        }
        DataType::Int32 => first_number::<Int32Type>(&stored, &made, |a, b| a == b),
        DataType::Int64 => first_number::<Int64Type>(&stored, &made, |a, b| a == b),
        _ => {
            (0..before).find(|&row| stored.slice(row, 1).to_data() != made.slice(row, 1).to_data())
        }
    }
}

fn is_float(values: &ArrayRef) -> bool {
    matches!(values.data_type(), DataType::Float32 | DataType::Float64)
}

fn first_number<T: ArrowPrimitiveType>(
    stored: &ArrayRef,
    made: &ArrayRef,
    equal: impl Fn(T::Native, T::Native) -> bool,
) -> Option<usize> {
    let (stored, made) = (stored.as_primitive::<T>(), made.as_primitive::<T>());
    let same = |row: usize| match (stored.is_null(row), made.is_null(row)) {
        (false, false) => equal(stored.value(row), made.value(row)),
        (stored, made) => stored == made,
    };
    (0..made.len()).find(|&row| !same(row))
}

/// A value as text, numbers with all their digits.
fn text(values: &ArrayRef, row: usize) -> String {
    if values.is_null(row) {
        return "null".to_owned();
    }
    match values.data_type() {
        DataType::Float32 => values.as_primitive::<Float32Type>().value(row).to_string(),
        DataType::Float64 => values.as_primitive::<Float64Type>().value(row).to_string(),
        DataType::Int32 => values.as_primitive::<Int32Type>().value(row).to_string(),
        DataType::Int64 => values.as_primitive::<Int64Type>().value(row).to_string(),
        DataType::Boolean => values.as_boolean().value(row).to_string(),
        DataType::Utf8 => values.as_string::<i32>().value(row).to_owned(),
        other => format!("a value of type {other}"),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::{Float32Array, Float64Array, Int32Array, StringArray};

    use super::*;

    fn table(step: [i32; 3], q: [f32; 3], mass: [Option<f64>; 3], name: [&str; 3]) -> RecordBatch {
        RecordBatch::try_from_iter([
            ("step", Arc::new(Int32Array::from(step.to_vec())) as ArrayRef),
            ("q1", Arc::new(Float32Array::from(q.to_vec()))),
            ("mass", Arc::new(Float64Array::from(mass.to_vec()))),
            ("family", Arc::new(StringArray::from(name.to_vec()))),
        ])
        .unwrap()
    }

    fn made() -> RecordBatch {
        table([0, 1, 2], [0.5, f32::NAN, 0.25], [Some(1.0), None, Some(2.0)], ["a", "b", "c"])
    }

    fn differs(stored: &RecordBatch) -> Option<(usize, String, String, String)> {
        first_difference(stored, &made(), Tolerance::NONE).map(|difference| {
            (difference.row, difference.column, difference.stored, difference.made)
        })
    }

    #[test]
    fn the_earliest_row_counts_whatever_its_column() {
        assert_eq!(differs(&made()), None);
        let mass = [Some(1.0), None, Some(2.0)];
        let stored = table([0, 1, 3], [0.5, 0.75, 0.25], mass, ["a", "b", "c"]);
        let expected = (1, "q1".to_owned(), "0.75".to_owned(), "NaN".to_owned());
        assert_eq!(differs(&stored), Some(expected));
        let stored = table([0, 1, 2], [0.5, f32::NAN, 0.25], [Some(1.0); 3], ["a", "b", "c"]);
        let expected = (1, "mass".to_owned(), "1".to_owned(), "null".to_owned());
        assert_eq!(differs(&stored), Some(expected));
        let stored = table([0, 1, 2], [0.5, f32::NAN, 0.25], mass, ["x", "b", "c"]);
        let expected = (0, "family".to_owned(), "x".to_owned(), "a".to_owned());
        assert_eq!(differs(&stored), Some(expected));
    }

    #[test]
    fn the_last_bit_counts_without_a_tolerance_and_not_with_one() {
        let mass = [Some(1.0), None, Some(2.0)];
        let next = f32::from_bits(0.25f32.to_bits() + 1);
        let stored = table([0, 1, 2], [0.5, f32::NAN, next], mass, ["a", "b", "c"]);
        assert_eq!(differs(&stored).unwrap().0, 2);
        let tolerance = Tolerance { absolute: 1e-6, relative: 0.0 };
        assert_eq!(first_difference(&stored, &made(), tolerance), None);
    }
}
