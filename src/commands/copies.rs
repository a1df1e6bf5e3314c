//! Copies stores: backs up, restores, and moves to a new place.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use store::{
    DatabaseUrl, Location, ObjectsUrl, S3Options, StoreContents, Transfer, TransferProgress,
};

use crate::arguments::{ConfigArguments, StoreArguments};
use crate::progress::{self, Part, measure};

/// Copies all rows as they are at one moment, and all files that rows name, into a new data folder.
/// Compares everything with its digest. Servers and workers keep running meanwhile. The backup is
/// an ordinary data folder: `torqued serve --data DIR` shows it, and `torqued restore DIR` copies
/// it to another place.
#[derive(Debug, Args)]
pub struct BackupArguments {
    /// Data folder for the backup; created if missing
    #[arg(value_name = "DIR")]
    to: PathBuf,

    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    from: StoreArguments,
}

pub async fn backup(arguments: BackupArguments) -> anyhow::Result<ExitCode> {
    let from = arguments.from.location();
    let to = Location::in_folder(arguments.to);
    let transfer = Transfer::prepare_backup(&from, &to, &S3Options::from_env()?).await?;
    copy(transfer, &from, &to, SAVING).await?;
    let folder = to.folder.display();
    println!("restore it with: torqued restore {folder} --data NEW-DIR");
    Ok(ExitCode::SUCCESS)
}

/// Copies a backup into a new data folder, or into a new PostgreSQL database and bucket, and
/// compares every row and file with the backup. The place that `--data`, `--database` and
/// `--objects` name must be empty. Tasks that were running when the backup was made are queued
/// again.
#[derive(Debug, Args)]
pub struct RestoreArguments {
    /// Data folder that `torqued backup` made
    #[arg(value_name = "DIR")]
    from: PathBuf,

    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    to: StoreArguments,
}

pub async fn restore(arguments: RestoreArguments) -> anyhow::Result<ExitCode> {
    let from = Location::in_folder(arguments.from);
    let to = arguments.to.location();
    let transfer = Transfer::prepare_backup(&from, &to, &S3Options::from_env()?).await?;
    copy(transfer, &from, &to, RESTORING).await?;
    println!("start a server on it with: {}", serve_command(&to));
    Ok(ExitCode::SUCCESS)
}

/// Copies all jobs with their ids, and all files, and compares them with their digests. The store
/// that `--data`, `--database` and `--objects` name does not change. Its servers and workers must
/// be stopped. If the move is interrupted, repeat the command to continue (docs/scale.md).
#[derive(Debug, Args)]
pub struct MigrateArguments {
    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    from: StoreArguments,

    /// Data folder of the new place; created if missing
    #[arg(long, env = "TORQUED_TO_DATA", value_name = "DIR")]
    to_data: PathBuf,

    /// PostgreSQL database of the new place, as postgres://USER:PASSWORD@HOST:PORT/DATABASE; it
    /// must have no jobs [default: SQLite in the folder]
    #[arg(long, env = "TORQUED_TO_DATABASE", value_name = "URL", hide_env_values = true)]
    to_database: Option<DatabaseUrl>,

    /// Bucket of the new place, as s3://BUCKET/PREFIX; it must have no objects. It uses the same
    /// store and keys as --objects [default: files in the folder]
    #[arg(long, env = "TORQUED_TO_OBJECTS", value_name = "URL")]
    to_objects: Option<ObjectsUrl>,
}

pub async fn migrate(arguments: MigrateArguments) -> anyhow::Result<ExitCode> {
    let MigrateArguments { from, to_data, to_database, to_objects, .. } = arguments;
    let from = from.location();
    let to =
        Location { database: to_database, objects: to_objects, ..Location::in_folder(to_data) };
    let transfer = Transfer::prepare(&from, &to, &S3Options::from_env()?).await?;
    copy(transfer, &from, &to, MOVING).await?;
    println!(
        "{from} has not changed; start a server on the new place with: {}",
        serve_command(&to)
    );
    Ok(ExitCode::SUCCESS)
}

/// The verbs for a copy in progress and for a finished one.
#[derive(Clone, Copy)]
struct Verbs {
    doing: &'static str,
    done: &'static str,
}

const MOVING: Verbs = Verbs { doing: "moving", done: "moved" };
const SAVING: Verbs = Verbs { doing: "saving", done: "saved" };
const RESTORING: Verbs = Verbs { doing: "restoring", done: "restored" };

/// Makes the copy, shows its progress, and prints what was compared.
///
/// # Errors
/// When it fails or is interrupted. `to` is unfinished then.
async fn copy(
    transfer: Transfer,
    from: &Location,
    to: &Location,
    verbs: Verbs,
) -> anyhow::Result<()> {
    let contents = transfer.contents();
    eprintln!("{} {} from {from} to {to}", verbs.doing, describe(&contents));
    let progress = TransferProgress::default();
    let parts = || parts(&contents, &progress);
    let Some(copied) = progress::follow_parts(transfer.run(&progress), parts).await? else {
        bail!("interrupted; {to} is unfinished; repeat the command to continue");
    };
    copied.with_context(|| format!("{to} is unfinished; repeat the command when this is fixed"))?;
    println!("{}", summary(verbs.done, &contents, &progress));
    Ok(())
}

fn summary(done: &str, contents: &StoreContents, progress: &TransferProgress) -> String {
    let found = match progress.found() {
        0 => String::new(),
        found => format!(", {} of them copied before", measure::count(found)),
    };
    let digests = measure::count(contents.objects);
    format!(
        "{done} {}{found}; {digests} SHA-256 digests and all rows are the same",
        describe(contents)
    )
}

fn describe(contents: &StoreContents) -> String {
    let StoreContents { jobs, rows, objects, bytes } = *contents;
    let [jobs, rows, objects] = [jobs, rows, objects].map(measure::count);
    let megabytes = bytes as f64 / 1e6;
    format!("{jobs} jobs ({rows} rows) and {objects} files ({megabytes:.1} MB)")
}

fn parts(contents: &StoreContents, progress: &TransferProgress) -> Vec<Part> {
    let kilobytes = |bytes: u64| bytes.div_ceil(1000);
    let part = |name, unit, done, total| Part { name, unit, done, total };
    vec![
        part("files", "kB", kilobytes(progress.bytes()), kilobytes(contents.bytes)),
        part("rows", "rows", progress.rows(), contents.rows),
        part("compare", "rows", progress.compared(), contents.rows),
    ]
}

/// The command that serves the copy. It leaves out the URL of the database, because that has a
/// password.
pub fn serve_command(to: &Location) -> String {
    let database = if to.database.is_some() { " --database URL" } else { "" };
    let objects = to.objects.iter().map(|url| format!(" --objects {url}")).collect::<String>();
    format!("torqued serve --data {}{database}{objects}", to.folder.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTENTS: StoreContents =
        StoreContents { jobs: 2, rows: 12_345, objects: 7, bytes: 1_234_567 };

    #[test]
    fn no_password_is_repeated() {
        let to = Location {
            database: Some("postgres://lab:secret@db.lab/arms".parse().unwrap()),
            objects: Some("s3://lab/arm".parse().unwrap()),
            ..Location::in_folder("shared")
        };
        let command = "torqued serve --data shared --database URL --objects s3://lab/arm";
        assert_eq!(serve_command(&to), command);
        assert_eq!(to.to_string(), "database arms of PostgreSQL at db.lab:5432 with s3://lab/arm");
    }

    #[test]
    fn the_summary_counts_what_was_compared() {
        let expected = "moved 2 jobs (12 345 rows) and 7 files (1.2 MB); \
                        7 SHA-256 digests and all rows are the same";
        assert_eq!(summary("moved", &CONTENTS, &TransferProgress::default()), expected);
    }
}
