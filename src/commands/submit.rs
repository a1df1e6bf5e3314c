use std::io::Read;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Args;

use crate::arguments::ServerArguments;
use crate::client::{Reuse, Submitted};
use crate::commands::watch;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job's JSON; `-` reads standard input
    #[arg(value_name = "FILE")]
    spec: PathBuf,

    /// Compute anew, even if the same job was done before
    #[arg(long)]
    force: bool,

    /// Follow the job until it ends
    #[arg(long)]
    watch: bool,

    #[command(flatten)]
    server: ServerArguments,
}

/// The largest spec the server takes.
const MAX_SPEC_BYTES: u64 = 1 << 20;

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let spec = read_spec(&arguments.spec)?;
    let client = arguments.server.client()?;
    let reuse = if arguments.force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let Submitted { job, existed } = client.submit(spec, reuse).await?;
    let note = if existed { ", submitted before" } else { "" };
    println!("job {} {}{note}: {}", job.id, job.state, client.url(&format!("/jobs/{}", job.id)));
    for warning in &job.warnings {
        eprintln!("warning: {warning}");
    }
    if arguments.watch { watch::to_the_end(&client, job.id).await } else { Ok(ExitCode::SUCCESS) }
}

/// Reads a spec's JSON; `-` is standard input.
pub fn read_spec(path: &PathBuf) -> anyhow::Result<Vec<u8>> {
    let mut spec = Vec::new();
    if path.as_os_str() == "-" {
        std::io::stdin()
            .take(MAX_SPEC_BYTES + 1)
            .read_to_end(&mut spec)
            .context("cannot read standard input")?;
    } else {
        std::fs::File::open(path)
            .and_then(|file| file.take(MAX_SPEC_BYTES + 1).read_to_end(&mut spec))
            .with_context(|| format!("cannot read {}", path.display()))?;
    }
    ensure!(
        spec.len() as u64 <= MAX_SPEC_BYTES,
        "{} is larger than 1 MiB, the most a spec may have",
        path.display()
    );
    Ok(spec)
}
