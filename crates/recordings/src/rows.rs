//! Rows in the form that both formats share: several at a time, in the order of the file.

use std::collections::HashMap;

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

/// Finds each column of `columns` among those of the file. Each must occur once. Spaces around a
/// name count only if two columns differ in nothing else.
///
/// Returns their indices, in the order of [`ImportColumns::named`].
///
/// # Errors
/// The missing columns, with the existing ones.
pub(crate) fn find_columns(
    columns: &ImportColumns,
    existing: &[&str],
) -> Result<Vec<usize>, String> {
    let mut found = Vec::new();
    let mut missing = Vec::new();
    let mut fields = HashMap::new();
    for (field, name) in columns.named() {
        let Some(place) = find_column(name, existing)
            .map_err(|()| format!("it has more than one column {name:?} (columns.{field})"))?
        else {
            missing.push(format!("{name:?} (columns.{field})"));
            continue;
        };
        if let Some(other) = fields.insert(place, field.clone()) {
            return Err(format!(
                "columns.{field} and columns.{other} are both its column {:?}",
                existing[place]
            ));
        }
        found.push(place);
    }
    if missing.is_empty() {
        return Ok(found);
    }
    Err(format!("it has no column {}; it has {}", missing.join(", "), listed(existing)))
}

/// The place of a column, if there is one; an error if there are several.
fn find_column(name: &str, existing: &[&str]) -> Result<Option<usize>, ()> {
    let equal: &dyn Fn(&str) -> bool = &|other| other == name;
    let trimmed: &dyn Fn(&str) -> bool = &|other| other.trim() == name.trim();
    for is_it in [equal, trimmed] {
        let mut places = existing.iter().enumerate().filter(|(_, other)| is_it(other));
        match (places.next(), places.next()) {
            (Some((place, _)), None) => return Ok(Some(place)),
            (Some(_), Some(_)) => return Err(()),
            (None, _) => {}
        }
    }
    Ok(None)
}

/// A list of names for an error, cut if there are too many.
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 50;
    let shown: Vec<String> = names.iter().take(SHOWN).map(|name| format!("{name:?}")).collect();
    match names.len().checked_sub(SHOWN) {
        None | Some(0) => shown.join(", "),
        Some(more) => format!("{} and {more} more", shown.join(", ")),
    }
}

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
