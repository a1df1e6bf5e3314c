//! The values of decoded columns of a Parquet file.

use std::ops::Range;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{
    Decimal128Type, Float16Type, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type,
    Int64Type, Time32MillisecondType, Time64MicrosecondType, Time64NanosecondType,
    TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType,
    TimestampSecondType, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::{DataType, TimeUnit as ArrowTimeUnit};
use spec::TimeUnit;

use super::DecodeError;
use crate::error::{Place, RowError};
use crate::rows::{TimeColumn, absent, check_name};

/// A column, after checking that it has no nulls.
pub(super) fn complete(
    batch: &RecordBatch,
    name: &str,
    first: u64,
) -> Result<ArrayRef, DecodeError> {
    let column = batch
        .column_by_name(name)
        .ok_or_else(|| DecodeError::File(format!("column {name:?} cannot be decoded")))?;
    if column.null_count() > 0 {
        let row = (0..column.len()).position(|row| column.is_null(row)).unwrap_or(0);
        return Err(absent(Place::Row(first + row as u64 + 1), name).into());
    }
    Ok(Arc::clone(column))
}

/// The elements of lists that are read.
#[derive(Clone)]
pub(super) enum Elements {
    /// All of them, which are so many.
    All(usize),
    /// Those that the spec names.
    Named(Range<usize>),
}

/// The elements of lists, one channel for each place in a list. `name` is the column in errors.
pub(super) fn lists(
    column: &ArrayRef,
    elements: &Elements,
    first: u64,
    name: &str,
) -> Result<Vec<Vec<f64>>, DecodeError> {
    let lists = column.as_list_opt::<i32>().ok_or_else(|| not_decoded(column))?;
    let values = floats(lists.values())?;
    let (chosen, is_long_enough): (Range<usize>, &dyn Fn(usize) -> bool) = match elements {
        Elements::All(count) => (0..*count, &|length| length == *count),
        Elements::Named(named) => (named.clone(), &|length| length >= named.end),
    };
    let mut channels = vec![Vec::with_capacity(lists.len()); chosen.len()];
    for (row, ends) in (first + 1..).zip(lists.value_offsets().windows(2)) {
        let place = Place::Row(row);
        let start = usize::try_from(ends[0]).unwrap_or_default();
        let length = usize::try_from(ends[1] - ends[0]).unwrap_or_default();
        if !is_long_enough(length) {
            let found = format!("a list of {length} elements");
            let allowed = match elements {
                Elements::All(count) => format!("{count}, one for each joint of the robot"),
                Elements::Named(named) => format!("at least {}", named.end),
            };
            return Err(RowError::value(place, name, found, allowed).into());
        }
        for (channel, element) in channels.iter_mut().zip(chosen.clone()) {
            if lists.values().is_null(start + element) {
                return Err(absent(place, name).into());
            }
            channel.push(values[start + element]);
        }
    }
    Ok(channels)
}

pub(super) fn time_column(
    column: &ArrayRef,
    unit: Option<TimeUnit>,
) -> Result<TimeColumn, DecodeError> {
    Ok(match unit {
        Some(unit) => TimeColumn::Dated(integers(column)?, unit),
        None if is_decimal(column.data_type()) => TimeColumn::Decimal(floats(column)?),
        None => TimeColumn::Integer(integers(column)?),
    })
}

pub(super) fn names(column: &ArrayRef, first: u64, name: &str) -> Result<Vec<String>, DecodeError> {
    let names: Vec<String> = match column.data_type() {
        DataType::Utf8 => text(column.as_string::<i32>().iter()),
        DataType::LargeUtf8 => text(column.as_string::<i64>().iter()),
        DataType::UInt64 => written(column.as_primitive::<UInt64Type>().values()),
        _ => written(&integers(column)?),
    };
    for (row, value) in (first + 1..).zip(&names) {
        check_name(value, Place::Row(row), name)?;
    }
    Ok(names)
}

fn text<'a>(values: impl Iterator<Item = Option<&'a str>>) -> Vec<String> {
    values.map(|value| value.unwrap_or_default().to_owned()).collect()
}

fn written(values: &[impl ToString]) -> Vec<String> {
    values.iter().map(ToString::to_string).collect()
}

/// Evaluates `$body` with `$values` bound to the values of a column of integers or times.
macro_rules! with_integers {
    ($column:ident, |$values:ident| $body:expr, else $other:expr) => {
        with_integers!(@ $column, $values, $body, $other,
            Int8 => Int8Type, Int16 => Int16Type, Int32 => Int32Type, Int64 => Int64Type,
            UInt8 => UInt8Type, UInt16 => UInt16Type, UInt32 => UInt32Type, UInt64 => UInt64Type,
            Timestamp(ArrowTimeUnit::Second, _) => TimestampSecondType,
            Timestamp(ArrowTimeUnit::Millisecond, _) => TimestampMillisecondType,
            Timestamp(ArrowTimeUnit::Microsecond, _) => TimestampMicrosecondType,
            Timestamp(ArrowTimeUnit::Nanosecond, _) => TimestampNanosecondType,
            Time32(ArrowTimeUnit::Millisecond) => Time32MillisecondType,
            Time64(ArrowTimeUnit::Microsecond) => Time64MicrosecondType,
            Time64(ArrowTimeUnit::Nanosecond) => Time64NanosecondType,
        )
    };
    (@ $column:ident, $values:ident, $body:expr, $other:expr,
        $($name:ident $(($($part:pat),*))? => $type:ty,)*) => {
        match $column.data_type() {
            $(DataType::$name $(($($part),*))? => {
                let $values = $column.as_primitive::<$type>().values();
                $body
            })*
            _ => $other,
        }
    };
}

/// The values as floats. Integers with more than 53 bits are rounded.
pub(super) fn floats(column: &ArrayRef) -> Result<Vec<f64>, DecodeError> {
    match column.data_type() {
        DataType::Float16 => {
            let values = column.as_primitive::<Float16Type>().values();
            Ok(values.iter().map(|value| value.to_f64()).collect())
        }
        DataType::Float32 => {
            let values = column.as_primitive::<Float32Type>().values();
            Ok(values.iter().map(|value| f64::from(*value)).collect())
        }
        DataType::Decimal128(_, scale) => {
            let one = 10f64.powi((*scale).into());
            let values = column.as_primitive::<Decimal128Type>().values();
            Ok(values.iter().map(|value| *value as f64 / one).collect())
        }
        DataType::Float64 => Ok(column.as_primitive::<Float64Type>().values().to_vec()),
        _ => with_integers!(
            column,
            |values| Ok(values.iter().map(|value| *value as f64).collect()),
            else Err(not_decoded(column))
        ),
    }
}

fn integers(column: &ArrayRef) -> Result<Vec<i64>, DecodeError> {
    with_integers!(column, |values| signed(values), else Err(not_decoded(column)))
}

fn signed<T: TryInto<i64> + Copy>(values: &[T]) -> Result<Vec<i64>, DecodeError> {
    let too_large =
        |_| DecodeError::File("its times do not fit into 64 bits with a sign".to_owned());
    values.iter().map(|value| (*value).try_into().map_err(too_large)).collect()
}

fn not_decoded(column: &ArrayRef) -> DecodeError {
    DecodeError::File(format!("a column of type {} cannot be decoded", column.data_type()))
}

pub(super) const fn is_decimal(data_type: &DataType) -> bool {
    matches!(
        data_type,
        DataType::Float16 | DataType::Float32 | DataType::Float64 | DataType::Decimal128(..)
    )
}
