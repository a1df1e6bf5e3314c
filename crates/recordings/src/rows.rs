//! Rows in the form that both formats share: several at a time, in the order of the file.

use spec::{ImportColumns, ImportSpec, MAX_JOINTS, TimeUnit};

use crate::{Place, RowError};

/// Consecutive rows.
#[derive(Debug, Default, PartialEq)]
pub struct Rows {
    /// The name of their file, if there are several.
    pub(crate) file: Option<String>,
    /// Index of the first row in the file.
    pub(crate) first: u64,
    pub(crate) count: usize,
    /// The lines in which the rows of a CSV file begin; `None` for Parquet.
    pub(crate) lines: Option<Vec<u64>>,
    /// The last line of a CSV file, if it was cut off. It is none of the rows.
    pub(crate) cut_line: Option<u64>,
    /// Times as written in the file; `None` without a time column.
    pub(crate) time: Option<TimeColumn>,
    /// Names of recordings; `None` without a recording column.
    pub(crate) recording: Option<Vec<String>>,
    /// Values, one list per channel, in the file's units: torques, positions, velocities.
    pub(crate) channels: Vec<Vec<f64>>,
}

impl Rows {
    /// These rows as those of one of several files. Recordings are named by it.
    pub(crate) fn of_file(mut self, name: &str) -> Self {
        self.recording = Some(match self.recording {
            None => vec![name.to_owned(); self.count],
            Some(names) => names.iter().map(|recording| format!("{name}/{recording}")).collect(),
        });
        self.file = Some(name.to_owned());
        self
    }

    /// The place of the row at `index` in the file.
    pub(crate) fn place(&self, index: usize) -> Place {
        match &self.lines {
            Some(lines) => Place::Line(lines[index]),
            None => Place::Row(self.first + index as u64 + 1),
        }
    }
}

/// Times in the file's unit. Integers stay integers, because nanoseconds since 1970 do not fit into
/// f64.
#[derive(Debug, PartialEq)]
pub(crate) enum TimeColumn {
    Integer(Vec<i64>),
    Decimal(Vec<f64>),
    /// Dates or durations, whose type has this unit.
    Dated(Vec<i64>, TimeUnit),
}

/// Number of rows that are decoded and handed on together.
pub(crate) const MAX_BATCH_ROWS: usize = 8192;

/// The largest number of bytes of a recording's name.
pub(crate) const MAX_NAME_BYTES: usize = 200;

/// Columns of torques, positions and, if there are any, velocities.
pub(crate) fn channel_columns(columns: &ImportColumns) -> Vec<&str> {
    let all = [Some(&columns.u), Some(&columns.q), columns.qd.as_ref()];
    all.into_iter().flatten().flatten().map(String::as_str).collect()
}

/// Number of channels of a sample: torques, positions and, if there are any, velocities.
pub(crate) fn channel_count(spec: &ImportSpec) -> usize {
    spec.joints() * if spec.columns.qd.is_some() { 3 } else { 2 }
}

/// The largest number of channels of a sample: torques, positions, velocities.
pub(crate) const MAX_CHANNELS: usize = 3 * MAX_JOINTS;

/// The error for a missing value.
pub(crate) fn absent(place: Place, column: &str) -> RowError {
    RowError::value(place, column, "nothing", "a value in every row")
}

pub(crate) fn check_name(name: &str, place: Place, column: &str) -> Result<(), RowError> {
    if name.len() <= MAX_NAME_BYTES {
        return Ok(());
    }
    let found = format!("a name of {} bytes", name.len());
    Err(RowError::value(place, column, found, format!("at most {MAX_NAME_BYTES}")))
}
