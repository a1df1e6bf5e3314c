//! The errors of an import.

use std::fmt;
use std::io;
use std::process::ExitStatus;

use thiserror::Error;

use crate::confinement::{BATCH_SECONDS, MEMORY_BYTES};

/// Why a file cannot be imported. The sender of the file can act on all of these except
/// [`Self::Start`] and [`Self::Pipe`].
#[derive(Debug, Error)]
pub enum ImportError {
    /// A fault of the file as a whole.
    #[error("the file cannot be imported: {0}")]
    File(String),

    /// A fault of one row.
    #[error(transparent)]
    Row(#[from] RowError),

    /// The decoder's own message.
    #[error("{0}")]
    Undecodable(String),

    /// The decoder reached [`MEMORY_BYTES`].
    #[error(
        "{file:?} cannot be imported: reading it took more than {} MiB of memory; write it with \
         smaller row groups and pages",
        MEMORY_BYTES >> 20
    )]
    Memory {
        /// The file's name.
        file: String,
    },

    /// The decoder worked on one batch of rows for longer than [`BATCH_SECONDS`].
    #[error(
        "{file:?} cannot be imported: reading the next rows took more than {BATCH_SECONDS} s of \
         processor time; write the file again"
    )]
    Time {
        /// The file's name.
        file: String,
    },

    /// The decoder ended in another way, for example because of a fault of its own.
    #[error("{file:?} cannot be imported: the process that read it ended by {status} ({said})")]
    Died {
        /// The file's name.
        file: String,
        /// Its exit code or signal.
        status: ExitStatus,
        /// Its messages on standard error, on one line.
        said: String,
    },

    /// A fault of one of several files, which has this name.
    #[error("file {0:?}: {1}")]
    InFile(String, Box<ImportError>),

    /// The system could not start the decoder.
    #[error("the file cannot be imported: no process could be started to read it")]
    Start(#[source] io::Error),

    /// The decoder's rows could not be read.
    #[error("the file cannot be imported: the process that read it sent invalid data")]
    Pipe(#[from] io::Error),
}

impl ImportError {
    pub(crate) fn file(reason: impl Into<String>) -> Self {
        Self::File(reason.into())
    }

    /// Whether another attempt may import the same file.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::InFile(_, error) => error.may_pass(),
            error => matches!(error, Self::Start(_) | Self::Pipe(_)),
        }
    }
}

/// The place of a row in its file, as an editor shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The line of a CSV file in which the row begins. The header is line 1.
    Line(u64),
    /// The row of a Parquet file. The first is 1.
    Row(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Row(row) => write!(f, "row {row} (counted from 1)"),
        }
    }
}

/// The fault of one row.
#[derive(Debug, Error)]
pub struct RowError {
    /// The recording, if the file names them.
    pub recording: Option<String>,
    /// Where the row is in the file.
    pub place: Place,
    /// The column, if the fault is in one.
    pub column: Option<String>,
    /// The value, or what is wrong about it.
    pub found: String,
    /// The allowed values.
    pub allowed: String,
}

impl RowError {
    /// The fault of a value, in a recording that is not known here.
    pub(crate) fn value(
        place: Place,
        column: &str,
        found: impl Into<String>,
        allowed: impl Into<String>,
    ) -> Self {
        let (found, allowed) = (found.into(), allowed.into());
        Self { recording: None, place, column: Some(column.to_owned()), found, allowed }
    }
}

impl fmt::Display for RowError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(recording) = &self.recording {
            write!(f, "recording {recording:?}, ")?;
        }
        write!(f, "{}", self.place)?;
        if let Some(column) = &self.column {
            write!(f, ", column {column:?}")?;
        }
        write!(f, ": {}, allowed: {}", self.found, self.allowed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A job shows an error with its causes.
    #[test]
    fn the_fault_of_a_row_is_shown_once() {
        let (found, allowed) = ("nothing".to_owned(), "a value in every row".to_owned());
        let row = RowError {
            recording: None,
            place: Place::Row(7),
            column: Some("t".to_owned()),
            found,
            allowed,
        };
        let text = "row 7 (counted from 1), column \"t\": nothing, allowed: a value in every row";
        assert_eq!(spec::causes(&ImportError::from(row)), text);
    }
}
