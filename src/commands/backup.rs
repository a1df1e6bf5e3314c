use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use store::{Location, S3Options, Transfer};

use crate::arguments::StoreArguments;
use crate::commands::copied_store;

/// Copies every row as it is at one moment, and every file that a row names, into a new data folder, and compares all with their
/// digests. Servers and workers go on meanwhile. The backup is a data folder like any other: `torqued serve --data DIR` shows it,
/// and `torqued restore DIR` copies it to another place.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Data folder for the backup; created if missing
    #[arg(value_name = "DIR")]
    to: PathBuf,

    #[command(flatten)]
    from: StoreArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let from = arguments.from.location();
    let to = Location::in_folder(arguments.to);
    let transfer = Transfer::prepare_backup(&from, &to, &S3Options::from_env()?).await?;
    copied_store::copy(transfer, &from, &to, copied_store::SAVING).await?;
    let folder = to.folder.display();
    println!("restore it with: torqued restore {folder} --data NEW-DIR");
    Ok(ExitCode::SUCCESS)
}
