use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use store::{Location, S3Options, Transfer};

use crate::arguments::{ConfigArguments, StoreArguments};
use crate::commands::copied_store;

/// Copies all rows as they are at one moment, and all files that rows name, into a new data folder.
/// Compares everything with its digest. Servers and workers keep running meanwhile. The backup is
/// an ordinary data folder: `torqued serve --data DIR` shows it, and `torqued restore DIR` copies
/// it to another place.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Data folder for the backup; created if missing
    #[arg(value_name = "DIR")]
    to: PathBuf,

    #[command(flatten)]
    config: ConfigArguments,

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
