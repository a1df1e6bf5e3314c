use std::any::Any;
use std::fmt;

use parquet::errors::ParquetError;
use thiserror::Error;

/// Why a file cannot be imported. All of it is for whoever sent the file.
#[derive(Debug, Error)]
pub enum ImportError {
    /// What can be told from the file as a whole.
    #[error("the file cannot be imported: {0}")]
    File(String),

    #[error("the file cannot be read as Parquet")]
    Parquet(#[from] ParquetError),

    #[error("the file cannot be read as CSV")]
    Csv(#[from] csv::Error),

    #[error("the file is damaged: decoding it broke off ({0})")]
    Decoder(String),

    #[error("{0}")]
    Row(RowError),
}

/// What is wrong in one row.
#[derive(Debug)]
pub struct RowError {
    /// The recording, if the file names them.
    pub recording: Option<String>,
    /// From 0 over the whole file, a header not counted.
    pub row: u64,
    pub column: Option<String>,
    pub found: String,
    pub allowed: String,
}

impl ImportError {
    pub fn file(reason: impl Into<String>) -> Self {
        Self::File(reason.into())
    }

    /// Of a panic inside a decoder.
    pub fn decoder(panic: &(dyn Any + Send)) -> Self {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
        Self::Decoder(text.unwrap_or_else(|| "without a reason".to_owned()))
    }
}

impl From<RowError> for ImportError {
    fn from(error: RowError) -> Self {
        Self::Row(error)
    }
}

impl fmt::Display for RowError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(recording) = &self.recording {
            write!(f, "recording {recording:?}, ")?;
        }
        write!(f, "row {}", self.row)?;
        if let Some(column) = &self.column {
            write!(f, ", column {column:?}")?;
        }
        write!(f, ": {}, allowed: {}", self.found, self.allowed)
    }
}
