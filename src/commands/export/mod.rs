//! Data, models and runs in others' formats, so that their tools open them.

mod hugging_face;
mod lerobot;
mod lerobot_shard;
mod mlflow;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, bail, ensure};
use clap::{ArgGroup, Args};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::exit::INTERRUPTED;
use crate::output::write_json;
use crate::progress::{Part, follow_parts};
use crate::resource::Reference;

pub use mlflow::MlflowError;

/// Everything is downloaded with its digest compared. DIR appears when it is whole; what an interruption leaves in DIR.part goes on.
/// Runs that are in MLflow already are brought up to date there.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("what").required(true)))]
pub struct Arguments {
    /// Write this dataset in LeRobot's format v3.0
    #[arg(long, value_name = "DATASET", group = "what")]
    lerobot: Option<i64>,

    /// Write this checkpoint, by its id or an alias, as a model of the Hugging Face hub, with a model card
    #[arg(long, value_name = "CHECKPOINT", group = "what")]
    hugging_face: Option<Reference>,

    /// Write runs to this MLflow server (http://HOST:PORT); select them with --run, --filter or --all
    #[arg(long, value_name = "URL", group = "what")]
    mlflow: Option<String>,

    /// Folder to write; it must not exist, or be empty
    #[arg(value_name = "DIR", required_unless_present = "mlflow", conflicts_with = "mlflow")]
    dir: Option<PathBuf>,

    #[command(flatten)]
    runs: mlflow::MlflowArguments,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { lerobot, hugging_face, mlflow, dir, runs, output, server } = arguments;
    let client = server.client()?;
    if let Some(address) = mlflow {
        return mlflow::export(&client, &address, runs, output.json).await;
    }
    let dir = dir.context("expected a folder")?;
    let part = unfinished(&dir)?;
    std::fs::create_dir_all(&part).with_context(|| format!("cannot create {}", part.display()))?;
    let done = Done::default();
    let work = async {
        match (lerobot, hugging_face) {
            (Some(dataset), _) => {
                let info = lerobot::export(&client, dataset, &part, &done).await?;
                Ok((format!("dataset {dataset}"), info))
            }
            (None, Some(checkpoint)) => {
                let card = hugging_face::export(&client, &checkpoint, &part, &done).await?;
                Ok((format!("checkpoint {checkpoint}"), card))
            }
            (None, None) => bail!("expected --lerobot or --hugging-face"),
        }
    };
    let Some(ended) = follow_parts(work, || vec![done.part()]).await? else {
        eprintln!("interrupted; repeat the command to continue");
        return Ok(ExitCode::from(INTERRUPTED));
    };
    let (what, document) = ended?;
    if dir.exists() {
        std::fs::remove_dir(&dir).with_context(|| format!("cannot replace {}", dir.display()))?;
    }
    std::fs::rename(&part, &dir).with_context(|| format!("cannot create {}", dir.display()))?;
    if output.json {
        write_json(&document)?;
    } else {
        println!("{what} in {}", dir.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// The folder in which the export is written until it is complete.
fn unfinished(dir: &Path) -> anyhow::Result<PathBuf> {
    if let Ok(mut entries) = std::fs::read_dir(dir) {
        ensure!(entries.next().is_none(), "{} is not empty; choose another folder", dir.display());
    }
    let name = dir.file_name().with_context(|| format!("{} has no name", dir.display()))?;
    let mut name = name.to_owned();
    name.push(".part");
    Ok(dir.with_file_name(name))
}

/// Number of bytes downloaded and written, and their total.
#[derive(Default)]
struct Done {
    bytes: AtomicU64,
    total: AtomicU64,
}

impl Done {
    fn begin(&self, total: u64) {
        self.total.store(total, Ordering::Relaxed);
    }

    fn add(&self, bytes: u64) {
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    fn part(&self) -> Part {
        let kilobytes = |bytes: &AtomicU64| bytes.load(Ordering::Relaxed).div_ceil(1000);
        let (done, total) = (kilobytes(&self.bytes), kilobytes(&self.total).max(1));
        Part { name: "export", unit: "kB", done, total }
    }
}
