//! Checks whether the torques of a file can be those of the robot that its import names.

use std::fs::File;
use std::ops::ControlFlow;

use identification::{Log, LogRow, Recording, check_log};
use recordings::{
    Conversion, Decoder, DecoderProgram, Files, Lengths, Measured, MeasuredRow, Rows, TableSchemas,
};
use serde::Serialize;
use spec::{Gravity, ImportSpec};
use store::ObjectWriter;
use wire::{ImportCounts, LogCheck};

use super::convert;
use crate::error::{ImportRehearsalError, TaskError};

/// The result that an import would have.
#[derive(Debug, Serialize)]
pub struct Rehearsal {
    /// The counts and the warnings.
    pub import: ImportCounts,
    /// The length and the rate of each recording.
    pub lengths: Lengths,
    /// The torques beside those of the robot, if the spec names one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub check: Option<LogCheck>,
}

/// A file that a rehearsal reads.
pub struct RehearsedFile {
    /// The name of its recordings, if there are several files.
    pub recording: Option<String>,
    /// Its own name, for errors.
    pub name: String,
    /// The file, at its beginning.
    pub content: File,
}

/// Reads files as their import would, and publishes nothing.
///
/// # Errors
/// When the files cannot be imported as `spec` says.
pub fn rehearse(
    decoder: &DecoderProgram,
    files: Vec<RehearsedFile>,
    spec: &ImportSpec,
) -> Result<Rehearsal, ImportRehearsalError> {
    let rows = rows(decoder, files, spec);
    let nowhere = || ObjectWriter::digest_only("rehearsal");
    let go_on = |_| ControlFlow::Continue(());
    let written = convert(rows, spec, nowhere(), nowhere(), &go_on)?;
    let check = check(spec, written.measured);
    Ok(Rehearsal { import: written.counts, lengths: written.lengths, check })
}

/// The lengths of the recordings of files, at the rate of `spec`.
///
/// # Errors
/// When the files cannot be imported as `spec` says.
pub fn recording_lengths(
    decoder: &DecoderProgram,
    files: Vec<RehearsedFile>,
    spec: &ImportSpec,
) -> Result<Lengths, ImportRehearsalError> {
    let mut conversion = Conversion::new(rows(decoder, files, spec), spec, schemas(spec));
    while conversion.next_trajectories()?.is_some() {}
    let lengths = conversion.lengths().clone();
    conversion.finish().map_err(TaskError::from)?;
    Ok(lengths)
}

/// The rows of files, each decoded in a process of its own.
fn rows(
    decoder: &DecoderProgram,
    files: Vec<RehearsedFile>,
    spec: &ImportSpec,
) -> impl Iterator<Item = Result<Rows, TaskError>> {
    Files::new(files.into_iter().map(|RehearsedFile { recording, name, content }| {
        Ok::<_, TaskError>((recording, Decoder::start(decoder, content, &name, spec)?))
    }))
}

fn schemas(spec: &ImportSpec) -> TableSchemas {
    TableSchemas {
        samples: store::table_schema(&spec.trajectory_columns()),
        table: store::table_schema(&spec.table_columns()),
    }
}

/// The recordings of a file as they were measured, and what was left out of them.
///
/// # Errors
/// When the file cannot be imported as `spec` says.
pub fn read_logs(
    decoder: &DecoderProgram,
    file: RehearsedFile,
    spec: &ImportSpec,
) -> Result<(Vec<Log>, Vec<String>), ImportRehearsalError> {
    let rows = rows(decoder, vec![file], spec);
    let mut conversion = Conversion::new(rows, spec, schemas(spec)).keeping_all();
    while conversion.next_trajectories()?.is_some() {}
    let logs = conversion.take_measured().into_iter().map(log).collect();
    let counts = conversion.finish().map_err(TaskError::from)?;
    Ok((logs, counts.warnings))
}

/// Compares what was measured with the robot. `None` if the spec names none, and for a description
/// that no arm can have.
pub(super) fn check(spec: &ImportSpec, measured: Vec<Measured>) -> Option<LogCheck> {
    let robot = spec.robot.as_ref()?;
    let logs: Vec<Log> = measured.into_iter().map(log).collect();
    let rate_hz = logs.first().map_or(spec.rate_hz, Log::rate_hz);
    let recordings: Vec<Recording> = logs.iter().map(|log| log.recording(rate_hz)).collect();
    match check_log(robot.description(), &recordings) {
        Ok(mut check) => {
            check.doubts.extend(of_gravity(robot.gravity, &check));
            check.doubts.extend(robot.friction_doubt().map(|doubt| doubt.to_string()));
            Some(check)
        }
        Err(error) => {
            tracing::warn!("the torques were not compared with the robot: {error}");
            None
        }
    }
}

fn log(measured: Measured) -> Log {
    let row = |MeasuredRow { time_s, q, u }| LogRow { time_s, q, u };
    Log { name: measured.name, rows: measured.rows.into_iter().map(row).collect() }
}

/// What the torques carry against what the spec says of gravity.
fn of_gravity(declared: Gravity, check: &LogCheck) -> Option<String> {
    let carries = |expected: bool| {
        check.channels.iter().any(|channel| channel.carries_weight == Some(expected))
    };
    match (declared, carries(true), carries(false)) {
        (Gravity::Off, true, false) => Some(
            "u carries the arm's weight, but robot.gravity is off: say \"on\", or \"compensated\" if a controller adds the weight"
                .to_owned(),
        ),
        (Gravity::On | Gravity::Compensated, false, true) => Some(
            "u does not carry the arm's weight, but robot.gravity says that it does: leave it out"
                .to_owned(),
        ),
        _ => None,
    }
}
