//! Somebody's own recordings: decoded in a child process, checked, put on a dataset's clock, and cut
//! into trajectories.
//!
//! A Parquet file says of itself how much memory its decoder should reserve, and a decoder believes
//! it. So a stranger's file is decoded by a [`Decoder`], a child with limits on its memory and its
//! time, which hands rows back over a pipe. [`Conversion`] makes trajectories of them.

mod confinement;
mod conversion;
mod decoder;
mod decoding;
mod error;
mod frames;
mod recording;
mod rows;
mod samples;
mod tables;
mod windows;

pub use confinement::{BATCH_SECONDS, MEMORY_BYTES, TimedOutput, confine};
pub use conversion::Conversion;
pub use decoder::{Decoder, DecoderProgram};
pub use decoding::{decode, decode_standard_input};
pub use error::{ImportError, Place, RowError};
pub use frames::Frames;
pub use rows::Rows;
pub use tables::{ImportedTrajectories, TableSchemas};
