//! Imports of recordings: they are decoded in a child process, checked, resampled to a dataset's
//! rate, and cut into trajectories.
//!
//! A Parquet file states how much memory its decoder should reserve, and a decoder believes it. So
//! a foreign file is decoded by a [`Decoder`]: a child process with limits on its memory and time,
//! which has no secrets, can open no other file and no connection, and returns rows over a pipe.
//! [`Conversion`] turns them into trajectories.

#![warn(missing_docs)]

mod confinement;
mod conversion;
mod decoder;
mod decoding;
mod error;
mod files;
mod frames;
mod frozen;
mod isolation;
mod jumps;
mod lengths;
mod measured;
mod recording;
mod resampling;
mod rows;
mod samples;
mod selection;
mod tables;
mod turns;
mod windows;

pub use confinement::{BATCH_SECONDS, MEMORY_BYTES, TimedOutput, confine};
pub use conversion::Conversion;
pub use decoder::{Decoder, DecoderProgram};
pub use decoding::{decode, decode_standard_input};
pub use error::{ImportError, Place, RowError};
pub use files::Files;
pub use frames::Frames;
pub use isolation::{Mechanism, missing_mechanisms};
pub use lengths::{Lengths, RecordingLength};
pub use measured::{Measured, MeasuredRow};
pub use rows::Rows;
pub use tables::{ImportedTrajectories, TableSchemas};
