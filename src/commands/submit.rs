use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Args;

use crate::arguments::{LabelArguments, OutputArguments, ServerArguments};
use crate::client::{Reuse, Submitted};
use crate::commands::watch;
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job as JSON; `-` reads standard input
    #[arg(value_name = "FILE")]
    spec: PathBuf,

    /// Compute again, even if the same job was done before
    #[arg(long)]
    force: bool,

    /// Follow the job until it ends
    #[arg(long)]
    watch: bool,

    #[command(flatten)]
    labels: LabelArguments,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// The largest spec that the server accepts.
pub const MAX_SPEC_BYTES: u64 = 1 << 20;

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let spec = read_json(&arguments.spec, MAX_SPEC_BYTES)?;
    let client = arguments.server.client()?;
    let reuse = if arguments.force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let labels = arguments.labels.parameters();
    let Submitted { job, existed } = client.submit_labelled(spec, reuse, &labels).await?;
    let output = arguments.output;
    let note = if existed { ", submitted before" } else { "" };
    match (output.json, arguments.watch) {
        (false, _) => {
            let page = client.url(&format!("/jobs/{}", job.id));
            println!("job {} {}{note}: {page}", job.id, job.state);
        }
        (true, false) => write_json(&job)?,
        (true, true) => {}
    }
    for warning in &job.warnings {
        eprintln!("warning: {warning}");
    }
    if !arguments.watch {
        return Ok(ExitCode::SUCCESS);
    }
    watch::follow_to_end(&client, job.id, output).await
}

/// Reads a spec or a request of at most `max_bytes`; `-` is standard input.
pub fn read_json(path: &Path, max_bytes: u64) -> anyhow::Result<Vec<u8>> {
    let mut spec = Vec::new();
    if path.as_os_str() == "-" {
        std::io::stdin()
            .take(max_bytes + 1)
            .read_to_end(&mut spec)
            .context("cannot read standard input")?;
    } else {
        std::fs::File::open(path)
            .and_then(|file| file.take(max_bytes + 1).read_to_end(&mut spec))
            .with_context(|| format!("cannot read {}", path.display()))?;
    }
    ensure!(
        spec.len() as u64 <= max_bytes,
        "{} is larger than {} MiB, the most that is allowed",
        path.display(),
        max_bytes >> 20
    );
    Ok(spec)
}
