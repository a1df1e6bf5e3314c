use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use store::{
    DatabaseUrl, Location, ObjectsUrl, S3Options, StoreContents, Transfer, TransferProgress,
};

use crate::arguments::StoreArguments;
use crate::progress::{self, Part, measure};

/// Every job with its id and every file are copied and compared with their digests; what `--data`, `--database` and `--objects` name
/// stays as it is. Its servers and workers must be stopped. A move that was interrupted goes on when the command is
/// repeated (docs/scale.md).
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    from: StoreArguments,

    /// Data folder of the new place; created if missing
    #[arg(long, env = "TORQUED_TO_DATA", value_name = "DIR")]
    to_data: PathBuf,

    /// PostgreSQL database of the new place, as postgres://USER:PASSWORD@HOST:PORT/DATABASE, without jobs so far; SQLite in the folder
    /// without it
    #[arg(long, env = "TORQUED_TO_DATABASE", value_name = "URL", hide_env_values = true)]
    to_database: Option<DatabaseUrl>,

    /// Bucket of the new place, as s3://BUCKET/PREFIX, without objects so far; files in the folder without it. It is reached as that
    /// of --objects is, with the same keys
    #[arg(long, env = "TORQUED_TO_OBJECTS", value_name = "URL")]
    to_objects: Option<ObjectsUrl>,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { from, to_data, to_database, to_objects } = arguments;
    let from = from.location();
    let to = Location { folder: to_data, database: to_database, objects: to_objects };
    let transfer = Transfer::prepare(&from, &to, &S3Options::from_env()?).await?;
    let contents = transfer.contents();
    eprintln!("moving {} from {from} to {to}", describe(&contents));
    let progress = TransferProgress::default();
    let parts = || parts(&contents, &progress);
    let Some(moved) = progress::follow_parts(transfer.run(&progress), parts).await? else {
        bail!(
            "interrupted; {to} is unfinished, and the command goes on with it when it is repeated"
        );
    };
    moved.with_context(|| {
        format!("{to} is unfinished; repeat the command when this is put right")
    })?;
    println!("{}", summary(&contents, &progress));
    println!("{from} is as it was; start a server on the new place with: {}", serve_command(&to));
    Ok(ExitCode::SUCCESS)
}

fn summary(contents: &StoreContents, progress: &TransferProgress) -> String {
    let found = match progress.found() {
        0 => String::new(),
        found => format!(", {} of them copied before", measure::count(found)),
    };
    let digests = measure::count(contents.objects);
    format!(
        "moved {}{found}; {digests} SHA-256 digests and all rows are the same",
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

/// The URL of the database is left out: it has a password.
fn serve_command(to: &Location) -> String {
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
        assert_eq!(summary(&CONTENTS, &TransferProgress::default()), expected);
    }
}
