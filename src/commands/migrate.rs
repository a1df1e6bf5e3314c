use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use store::{DatabaseUrl, Location, ObjectsUrl, S3Options, Transfer};

use crate::arguments::{ConfigArguments, StoreArguments};
use crate::commands::copied_store;

/// Copies all jobs with their ids, and all files, and compares them with their digests. The store
/// that `--data`, `--database` and `--objects` name does not change. Its servers and workers must
/// be stopped. If the move is interrupted, repeat the command to continue (docs/scale.md).
#[derive(Debug, Args)]
pub struct Arguments {
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

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { from, to_data, to_database, to_objects, .. } = arguments;
    let from = from.location();
    let to =
        Location { database: to_database, objects: to_objects, ..Location::in_folder(to_data) };
    let transfer = Transfer::prepare(&from, &to, &S3Options::from_env()?).await?;
    copied_store::copy(transfer, &from, &to, copied_store::MOVING).await?;
    println!(
        "{from} has not changed; start a server on the new place with: {}",
        copied_store::serve_command(&to)
    );
    Ok(ExitCode::SUCCESS)
}
