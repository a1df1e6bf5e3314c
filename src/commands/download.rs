//! `torqued download`: downloads the files of a dataset, a checkpoint or a run.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, bail, ensure};
use clap::Args;
use wire::{Artifact, Checkpoint, Dataset, DatasetFile, DatasetState, Evaluation, Run, StoredFile};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::client::{Client, ClientError, Fetched};
use crate::exit::INTERRUPTED;
use crate::output::write_json;
use crate::progress::{Part, follow_parts, measure};
use crate::resource::{Reference, Resource};

/// Downloads files and compares each with the server's SHA-256 digest. Existing files are kept, and
/// an interrupted download continues where it ended.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The kind of thing whose files to download
    #[arg(value_name = "KIND")]
    resource: Resource,

    /// Its id, or the alias of a checkpoint
    #[arg(value_name = "ID")]
    id: Reference,

    /// Folder for the files; created if missing [default: KIND-ID]
    #[arg(value_name = "DIR")]
    dir: Option<PathBuf>,

    /// Only this file; may be given several times
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { resource, id, dir, only, output, server } = arguments;
    let client = server.client()?;
    let name = resource.as_str();
    let files = chosen(files(&client, resource, &id).await?, &only, &format!("{name} {id}"))?;
    let dir = dir.unwrap_or_else(|| PathBuf::from(format!("{name}-{id}")));
    std::fs::create_dir_all(&dir).with_context(|| format!("cannot create {}", dir.display()))?;

    let total: u64 = files.iter().map(|file| file.size).sum();
    let done = AtomicU64::new(0);
    let work = async {
        let (mut kept, mut before) = (0_usize, 0);
        for file in &files {
            let progress = |bytes| done.store(before + bytes, Ordering::Relaxed);
            if client.fetch(file, &dir, progress).await? == Fetched::Kept {
                kept += 1;
            }
            before += file.size;
        }
        Ok::<usize, ClientError>(kept)
    };
    let kilobytes = |bytes: u64| bytes.div_ceil(1000);
    let parts = || {
        let done = kilobytes(done.load(Ordering::Relaxed));
        vec![Part { name: "download", unit: "kB", done, total: kilobytes(total) }]
    };
    let Some(kept) = follow_parts(work, parts).await? else {
        eprintln!("interrupted; repeat the command to continue");
        return Ok(ExitCode::from(INTERRUPTED));
    };
    let kept = kept?;
    if output.json {
        for file in &files {
            write_json(file)?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let note = if kept > 0 { format!(", {kept} were there before") } else { String::new() };
    println!(
        "{}: {} files, {}{note}; every SHA-256 digest is right",
        dir.display(),
        files.len(),
        measure::size(total)
    );
    Ok(ExitCode::SUCCESS)
}

async fn files(
    client: &Client,
    resource: Resource,
    id: &Reference,
) -> anyhow::Result<Vec<StoredFile>> {
    let path = resource.api_path(id);
    Ok(match resource {
        Resource::Job => bail!(
            "a job has no files of its own; `torqued show job {id}` names its dataset, its run and \
             its checkpoints"
        ),
        Resource::Dataset => {
            let dataset: Dataset = client.get(&path).await?;
            if dataset.state != DatasetState::Complete {
                eprintln!("warning: dataset {id} is {}; these are its files so far", dataset.state);
            }
            dataset.files.into_iter().map(of_dataset).collect()
        }
        Resource::Checkpoint => client.get::<Checkpoint>(&path).await?.files,
        Resource::Run => {
            let run: Run = client.get(&path).await?;
            ensure!(
                !(run.artifacts.is_empty() && run.state.is_final()),
                "run {id} is {} and left no files of its own; `torqued show job {}` names its checkpoints",
                run.state,
                run.job
            );
            run.artifacts.into_iter().map(artifact).collect()
        }
        Resource::Evaluation => {
            let evaluation: Evaluation = client.get(&path).await?;
            evaluation.artifacts.into_iter().map(artifact).collect()
        }
    })
}

fn of_dataset(DatasetFile { name, size, sha256, url, .. }: DatasetFile) -> StoredFile {
    StoredFile { name, size, sha256, url }
}

fn artifact(Artifact { name, size, sha256, url, .. }: Artifact) -> StoredFile {
    StoredFile { name, size, sha256, url }
}

/// The files with these names, or all files if none is named.
fn chosen(files: Vec<StoredFile>, only: &[String], of: &str) -> anyhow::Result<Vec<StoredFile>> {
    ensure!(!files.is_empty(), "{of} has no files yet");
    for name in only {
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        ensure!(
            names.contains(&name.as_str()),
            "there is no file {name:?} in {of}, only {}",
            names.join(", ")
        );
    }
    let is_chosen = |file: &StoredFile| only.is_empty() || only.contains(&file.name);
    Ok(files.into_iter().filter(is_chosen).collect())
}
