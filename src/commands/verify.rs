use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use clap::Args;
use worker::{DatasetFolder, Verified};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::commands::simulate::compute_with;
use crate::commands::watch;
use crate::progress::{self, OwnWork, ProgressCallback, measure};

#[derive(Debug, Args)]
pub struct Arguments {
    /// A folder with a dataset, or the id of a server's dataset
    #[arg(value_name = "DIR|ID")]
    dataset: String,

    /// Threads to compute with, for a folder [default: the machine's]
    #[arg(long, value_name = "N")]
    threads: Option<NonZero<usize>>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// The dataset to verify.
#[derive(Debug, PartialEq, Eq)]
enum Target {
    Folder(PathBuf),
    Server(i64),
}

impl Target {
    /// A number is an id. A folder with such a name can be written as `./7`.
    fn of(dataset: &str) -> Self {
        dataset.parse().map_or_else(|_| Self::Folder(PathBuf::from(dataset)), Self::Server)
    }
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    match Target::of(&arguments.dataset) {
        Target::Server(id) => {
            let client = arguments.server.client()?;
            let job = client.verify(id).await?;
            if !arguments.output.json {
                let page = client.url(&format!("/jobs/{}", job.id));
                println!("job {} {}: {page}", job.id, job.state);
            }
            watch::follow_to_end(&client, job.id, arguments.output).await
        }
        Target::Folder(_) if arguments.output.json => {
            bail!("--json is for the id of a server's dataset, not for a folder")
        }
        Target::Folder(dir) => {
            compute_with(arguments.threads)?;
            verify_folder(&dir).await
        }
    }
}

async fn verify_folder(dir: &Path) -> anyhow::Result<ExitCode> {
    let folder = DatasetFolder::open(dir)?;
    let trajectories = folder.spec().trajectories;
    let work = move |progress: ProgressCallback<'_>| folder.verify(progress);
    let verified =
        progress::follow_own(OwnWork::on_trajectories("verify", trajectories), work).await??;
    let Verified { shards, trajectories, by_other_versions } = verified;
    for note in &by_other_versions {
        println!("{note}");
    }
    let trajectories = measure::count(trajectories);
    let what = if by_other_versions.is_empty() { "every byte" } else { "every value" };
    println!("{}: {trajectories} trajectories in {shards} shards, {what} equal", dir.display());
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_an_id_and_all_else_a_folder() {
        assert_eq!(Target::of("7"), Target::Server(7));
        assert_eq!(Target::of("./7"), Target::Folder("./7".into()));
        assert_eq!(Target::of("data"), Target::Folder("data".into()));
    }
}
