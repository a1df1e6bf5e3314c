use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use store::{Location, S3Options, Transfer};

use crate::arguments::{ConfigArguments, StoreArguments};
use crate::commands::copied_store;

/// Copies a backup into a new data folder, or into a new PostgreSQL database and bucket, and
/// compares every row and file with the backup. The place that `--data`, `--database` and
/// `--objects` name must be empty. Tasks that were running when the backup was made are queued
/// again.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Data folder that `torqued backup` made
    #[arg(value_name = "DIR")]
    from: PathBuf,

    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    to: StoreArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let from = Location::in_folder(arguments.from);
    let to = arguments.to.location();
    let transfer = Transfer::prepare_backup(&from, &to, &S3Options::from_env()?).await?;
    copied_store::copy(transfer, &from, &to, copied_store::RESTORING).await?;
    println!("start a server on it with: {}", copied_store::serve_command(&to));
    Ok(ExitCode::SUCCESS)
}
