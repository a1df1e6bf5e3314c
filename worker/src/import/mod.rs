//! Imports of recordings, which are written as a dataset like a simulation.
//!
//! Each file becomes an upload, a row with its digest, before the job that names the digest is
//! submitted. The number of trajectories is known only at the end, so the transaction that commits
//! the shard writes it to the dataset. The result is a function of (files, spec).

mod check;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use recordings::{Conversion, Decoder, Files, Lengths, Measured, Rows, TableSchemas};
use spec::{Column, DataSpec, Digest, ImportSpec};
use store::{
    FileContent, ObjectWriter, ShardContents, ShardSummary, TableWriter, Upload, object_path,
};
use wire::ImportCounts;

pub use check::{Rehearsal, RehearsedFile, read_logs, recording_lengths, rehearse};

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::kinds::KindModule;
use crate::simulate::{ProgressCallback, VERSION, VERSION_KEY};
use crate::summary::SummaryBuilder;

pub(crate) const MODULE: KindModule = KindModule { run, computes_models: false };

/// Imports the uploaded files that the spec of a task names.
fn run(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: ImportSpec = attempt.spec()?;
    let (store, task) = (&attempt.store, &attempt.task);
    let upload = |file: Digest| {
        let missing = || TaskError::Missing { what: "the upload", name: file.to_string() };
        attempt.wait(store.upload(file))?.ok_or_else(missing)
    };
    let files = spec.sources().into_iter();
    let rows = decode(attempt, files.map(|(name, file)| Ok((name, upload(file)?))), &spec);
    let object = |content| {
        let path = object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
        attempt.wait(store.write_object(&path))
    };
    let (trajectories, table) = (object(FileContent::Trajectories)?, object(FileContent::Robots)?);
    let written = convert(rows, &spec, trajectories, table, &|done| attempt.show(done))?;
    let ImportCounts { rows, recordings, trajectories, .. } = &written.counts;
    tracing::info!(rows, recordings, trajectories, "converted and published");
    let check = check::check(&spec, written.measured);
    let mut counts = written.counts;
    counts.warnings.extend(check.iter().flat_map(|check| check.doubts.iter().cloned()));
    for warning in &counts.warnings {
        tracing::warn!("{warning}");
    }
    let mut result = written.summary.to_result();
    result["import"] = serde_json::to_value(counts)?;
    if let Some(check) = check {
        result["check"] = serde_json::to_value(check)?;
    }
    attempt.end(store.commit_import(attempt.fence(), &written.shard, &result))
}

/// The rows of uploads, each decoded in a process of its own.
pub(crate) fn decode<'a>(
    attempt: &'a Attempt,
    uploads: impl Iterator<Item = Result<(Option<&'a str>, Upload), TaskError>> + 'a,
    spec: &'a ImportSpec,
) -> impl Iterator<Item = Result<Rows, TaskError>> + 'a {
    Files::new(uploads.map(|upload| {
        let (name, upload) = upload?;
        tracing::info!(file = upload.name, bytes = upload.object.size, "decodes a file");
        let file = attempt.store.open_upload(&upload)?;
        let rows = Decoder::start(&attempt.decoder, file, &upload.name, spec)?;
        Ok((name.map(str::to_owned), rows))
    }))
}

/// Imported files, written as the only shard of a dataset.
pub(crate) struct WrittenImport {
    pub shard: ShardContents,
    pub counts: ImportCounts,
    pub summary: ShardSummary,
    /// The lengths of the recordings.
    lengths: Lengths,
    /// What a check of the torques looks at.
    measured: Vec<Measured>,
}

/// Converts the rows of files into the two tables of a dataset. Their bytes depend only on the
/// files and on `spec`.
///
/// # Errors
/// [`TaskError::Import`] when a file cannot be imported as `spec` says. [`TaskError::Stopped`]
/// when `progress` breaks. Nothing is published then.
pub(crate) fn convert(
    rows: impl Iterator<Item = Result<Rows, TaskError>>,
    spec: &ImportSpec,
    trajectories: ObjectWriter,
    table: ObjectWriter,
    progress: ProgressCallback<'_>,
) -> Result<WrittenImport, TaskError> {
    let columns = [spec.trajectory_columns(), spec.table_columns()];
    let [samples, origins] = columns.each_ref().map(|columns| store::table_schema(columns));
    let schemas = TableSchemas { samples: samples.clone(), table: origins.clone() };
    let footer = footer_entries(spec, &columns[0])?;
    let mut trajectories = TableWriter::trajectories(trajectories, samples, spec.samples, &footer)?;
    let footer = footer_entries(spec, &columns[1])?;
    let mut table = TableWriter::table(table, origins, &footer)?;

    let mut summary = SummaryBuilder::new(spec.samples, spec.rate_hz).beginning_at(0);
    let mut conversion = Conversion::new(rows, spec, schemas);
    while let Some(imported) = conversion.next_trajectories()? {
        if progress(conversion.trajectories()).is_break() {
            return Err(TaskError::Stopped);
        }
        if imported.table.num_rows() > 0 {
            summary.add(&imported.samples);
            trajectories.write(imported.samples)?;
            table.write(imported.table)?;
        }
    }
    let measured = conversion.take_measured();
    let lengths = conversion.lengths().clone();
    let counts = conversion.finish()?;
    let shard = ShardContents {
        first: 0,
        count: counts.trajectories,
        rejected: 0,
        trajectories: trajectories.finish()?,
        robots: table.finish()?,
    };
    Ok(WrittenImport { shard, counts, summary: summary.finish(), lengths, measured })
}

/// The file's metadata: enough to make it again, byte for byte, from the same uploads.
fn footer_entries(
    spec: &ImportSpec,
    columns: &[Column],
) -> Result<BTreeMap<String, String>, TaskError> {
    let job = DataSpec::Import(spec.clone()).job();
    let entries = [
        ("torqued.spec", job.to_json().to_string()),
        ("torqued.digest", job.digest().to_string()),
        ("torqued.columns", serde_json::to_string(columns)?),
        (VERSION_KEY, VERSION.to_owned()),
    ];
    Ok(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}
