//! Decodes in the child process: writes the rows of a file as frames to standard output.

mod csv_rows;
mod joint_state;
mod line_count;
mod mcap_columns;
mod mcap_rows;
mod npz_rows;
mod parquet_rows;
mod parquet_values;
mod section;
mod signature;
mod spaces;
mod zip;

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::fd::AsFd;
use std::panic::{AssertUnwindSafe, catch_unwind};

use ::csv::Error as CsvError;
use bytes::Bytes;
use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, Length};
use spec::{FileFormat, ImportSpec};
use thiserror::Error;

use crate::confinement::confine;
use crate::error::RowError;
use crate::frames::{write_end, write_refusal, write_rows};
use crate::rows::Rows;
use csv_rows::CsvRows;
use mcap_rows::McapRows;
use npz_rows::NpzRows;
use parquet_rows::ParquetRows;

/// Why a file cannot be decoded.
#[derive(Debug, Error)]
pub(crate) enum DecodeError {
    #[error("the file cannot be imported: {0}")]
    File(String),
    #[error("the file cannot be read as Parquet")]
    Parquet(#[from] ParquetError),
    #[error("the file cannot be read as CSV")]
    Csv(#[from] CsvError),
    #[error(transparent)]
    Row(#[from] RowError),
    #[error("the file is damaged: decoding it failed ({0})")]
    Panic(String),
}

/// The main function of a child process. It decodes the file on its standard input according to
/// `spec`, which is JSON, and writes to standard output.
///
/// # Errors
/// When the process cannot be limited, or nobody reads its output. A file that cannot be decoded is
/// no error here: a frame reports it.
pub fn decode_standard_input(spec: &str) -> io::Result<()> {
    let mut output = confine(io::stdout().lock())?;
    // A panic is reported in a frame, so standard error need not repeat it.
    std::panic::set_hook(Box::new(|_| {}));
    let spec: ImportSpec = serde_json::from_str(spec)?;
    let mut file = File::from(io::stdin().as_fd().try_clone_to_owned()?);
    let bytes = file.seek(SeekFrom::End(0))?;
    decode(OpenFile { file, bytes }, &spec, &mut output)
}

/// A file with its length. A confined process may not ask for it, because the same system call
/// finds other files.
struct OpenFile {
    file: File,
    bytes: u64,
}

impl Length for OpenFile {
    fn len(&self) -> u64 {
        self.bytes
    }
}

impl ChunkReader for OpenFile {
    type T = <File as ChunkReader>::T;

    fn get_read(&self, start: u64) -> parquet::errors::Result<Self::T> {
        self.file.get_read(start)
    }

    fn get_bytes(&self, start: u64, length: usize) -> parquet::errors::Result<Bytes> {
        self.file.get_bytes(start, length)
    }
}

/// Decodes `file` and writes its rows as frames. [`crate::Frames`] reads them.
///
/// # Errors
/// When `out` cannot be written.
pub fn decode<R: ChunkReader<T: 'static> + 'static>(
    file: R,
    spec: &ImportSpec,
    out: &mut impl Write,
) -> io::Result<()> {
    let mut source = match guarded(|| Source::open(file, spec)) {
        Ok(source) => source,
        Err(error) => return refuse(&error, out),
    };
    loop {
        match guarded(|| source.next()) {
            Ok(Some(rows)) => write_rows(out, &rows)?,
            Ok(None) => return write_end(out),
            Err(error) => return refuse(&error, out),
        }
    }
}

enum Source<R: ChunkReader> {
    Parquet(Box<ParquetRows<R>>),
    Csv(Box<CsvRows>),
    Npz(Box<NpzRows>),
    Mcap(Box<McapRows<R>>),
}

impl<R: ChunkReader<T: 'static> + 'static> Source<R> {
    fn open(file: R, spec: &ImportSpec) -> Result<Self, DecodeError> {
        Ok(match spec.format {
            FileFormat::Parquet => Self::Parquet(Box::new(ParquetRows::open(file, spec)?)),
            FileFormat::Csv => {
                check_signature(&file, &[])?;
                Self::Csv(Box::new(CsvRows::open(Box::new(file.get_read(0)?), spec)?))
            }
            FileFormat::Npz => {
                check_signature(&file, b"PK")?;
                Self::Npz(Box::new(NpzRows::open(file, spec)?))
            }
            FileFormat::Mcap => {
                check_signature(&file, b"\x89MCAP")?;
                Self::Mcap(Box::new(McapRows::open(file, spec)?))
            }
        })
    }

    fn next(&mut self) -> Result<Option<Rows>, DecodeError> {
        match self {
            Self::Parquet(rows) => rows.next(),
            Self::Csv(rows) => rows.next(),
            Self::Npz(rows) => rows.next(),
            Self::Mcap(rows) => rows.next(),
        }
    }
}

/// Refuses a file of another format than the one that begins with `own`.
fn check_signature<R: ChunkReader>(file: &R, own: &[u8]) -> Result<(), DecodeError> {
    let first = first_bytes(file)?;
    let is_own = !own.is_empty() && first.starts_with(own);
    match signature::describe(&first).filter(|_| !is_own) {
        Some(reason) => Err(DecodeError::File(reason)),
        None => Ok(()),
    }
}

/// The bytes that tell a format; fewer if the file is shorter.
fn first_bytes<R: ChunkReader>(file: &R) -> Result<Bytes, DecodeError> {
    let length = usize::try_from(file.len()).unwrap_or(usize::MAX);
    Ok(file.get_bytes(0, length.min(signature::LENGTH))?)
}

/// Reports an error with all its causes in a frame.
fn refuse(error: &DecodeError, out: &mut impl Write) -> io::Result<()> {
    write_refusal(out, &spec::causes(error))
}

/// Turns a panic into an error, because decoders may panic on damaged bytes.
fn guarded<T>(decode: impl FnOnce() -> Result<T, DecodeError>) -> Result<T, DecodeError> {
    let panicked = |message: &str| Err(DecodeError::Panic(message.to_owned()));
    catch_unwind(AssertUnwindSafe(decode))
        .unwrap_or_else(|panic| panicked(spec::panic_message(panic.as_ref())))
}
