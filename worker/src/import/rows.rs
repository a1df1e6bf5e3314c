//! Rows as both formats give them: some at a time, in the order of the file.

use spec::{ImportColumns, JOINTS};

use super::error::{ImportError, RowError};

/// Rows that follow each other.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// Index of the first in the file.
    pub first: u64,
    pub count: usize,
    /// As written in the file; `None` without a time column.
    pub time: Option<TimeColumn>,
    /// `None` without a recording column.
    pub recording: Option<Vec<String>>,
    /// One per column of [`channel_columns`], in the file's units.
    pub channels: Vec<Vec<f64>>,
}

/// Times in the file's unit. Whole numbers stay such: nanoseconds since 1970 do not fit into f64.
#[derive(Debug, PartialEq)]
pub(super) enum TimeColumn {
    Integer(Vec<i64>),
    Decimal(Vec<f64>),
}

/// Bytes of a recording's name.
pub(super) const MAX_NAME_BYTES: usize = 200;

/// Columns of torques, positions and, if there are any, velocities.
pub(super) fn channel_columns(columns: &ImportColumns) -> Vec<&str> {
    let all = [Some(&columns.u), Some(&columns.q), columns.qd.as_ref()];
    all.into_iter().flatten().flatten().map(String::as_str).collect()
}

/// Channels of a sample at most: torques, positions, velocities.
pub(super) const MAX_CHANNELS: usize = 3 * JOINTS;

/// Finds each column that `columns` asks for among those of the file, once.
///
/// Returns their positions, in the order of [`ImportColumns::named`].
pub(super) fn find_columns(
    columns: &ImportColumns,
    existing: &[&str],
) -> Result<Vec<usize>, ImportError> {
    let mut found = Vec::new();
    let mut missing = Vec::new();
    for (field, name) in columns.named() {
        let mut places = existing.iter().enumerate().filter(|(_, other)| **other == name);
        match (places.next(), places.next()) {
            (Some((place, _)), None) => found.push(place),
            (None, _) => missing.push(format!("{name:?} (columns.{field})")),
            (Some(_), Some(_)) => {
                let reason = format!("it has more than one column {name:?} (columns.{field})");
                return Err(ImportError::file(reason));
            }
        }
    }
    if missing.is_empty() {
        return Ok(found);
    }
    let reason = format!("it has no column {}; it has {}", missing.join(", "), listed(existing));
    Err(ImportError::file(reason))
}

/// Names for people to look through, cut where there are too many.
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 50;
    let shown: Vec<String> = names.iter().take(SHOWN).map(|name| format!("{name:?}")).collect();
    match names.len().checked_sub(SHOWN) {
        None | Some(0) => shown.join(", "),
        Some(more) => format!("{} and {more} more", shown.join(", ")),
    }
}

/// A value that is not there.
pub(super) fn absent(row: u64, column: &str) -> RowError {
    RowError {
        recording: None,
        row,
        column: Some(column.to_owned()),
        found: "nothing".to_owned(),
        allowed: "a value in every row".to_owned(),
    }
}

pub(super) fn check_name(name: &str, row: u64, column: &str) -> Result<(), RowError> {
    if name.len() <= MAX_NAME_BYTES {
        return Ok(());
    }
    Err(RowError {
        recording: None,
        row,
        column: Some(column.to_owned()),
        found: format!("a name of {} bytes", name.len()),
        allowed: format!("at most {MAX_NAME_BYTES}"),
    })
}
