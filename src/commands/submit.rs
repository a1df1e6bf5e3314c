//! Submits, retries and cancels jobs.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::json;
use spec::PresetPlace;

use crate::arguments::{AskArguments, LabelArguments, OutputArguments};
use crate::client::{Client, Reuse, Submitted};
use crate::commands::watch;
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job as JSON, or the name of a preset, which `torqued presets` lists; `-` reads standard
    /// input. A file of the name comes first
    #[arg(value_name = "FILE|PRESET")]
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
    ask: AskArguments,
}

/// The largest spec that the server accepts.
pub const MAX_SPEC_BYTES: u64 = 1 << 20;

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { spec, force, watch, labels, ask } = arguments;
    let spec = read_spec(&spec)?;
    let client = ask.client()?;
    let reuse = if force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let submitted = client.submit_labelled(spec, reuse, &labels.parameters()).await?;
    show(&client, &submitted, "submitted before", watch, ask.output).await
}

/// Prints a submitted job, and follows it to its end if that is wanted.
async fn show(
    client: &Client,
    Submitted { job, existed }: &Submitted,
    before: &str,
    watch: bool,
    output: OutputArguments,
) -> anyhow::Result<ExitCode> {
    let note = if *existed { format!(", {before}") } else { String::new() };
    match (output.json, watch) {
        (false, _) => {
            let page = client.url(&format!("/jobs/{}", job.id));
            println!("job {} {}{note}: {page}", job.id, job.state);
        }
        (true, false) => write_json(job)?,
        (true, true) => {}
    }
    for warning in &job.warnings {
        eprintln!("warning: {warning}");
    }
    if !watch {
        return Ok(ExitCode::SUCCESS);
    }
    watch::follow_to_end(client, job.id, output).await
}

#[derive(Debug, Args)]
pub struct RetryArguments {
    /// The id of a job that failed or was cancelled
    id: i64,

    /// Follow the new job until it ends
    #[arg(long)]
    watch: bool,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn retry(arguments: RetryArguments) -> anyhow::Result<ExitCode> {
    let RetryArguments { id, watch, ask } = arguments;
    let client = ask.client()?;
    let submitted = client.retry(id).await?;
    show(&client, &submitted, "retried before", watch, ask.output).await
}

#[derive(Debug, Args)]
pub struct CancelArguments {
    /// The job's id
    id: i64,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn cancel(CancelArguments { id, ask }: CancelArguments) -> anyhow::Result<ExitCode> {
    let job = ask.client()?.cancel(id).await?;
    ask.print(&job, |job| match job.state.is_final() {
        true => format!("job {} {}", job.id, job.state),
        false => format!("job {} {}, its worker was told to stop", job.id, job.state),
    })
}

/// Reads a spec from a file, or makes it from the name of a preset if there is no such file.
fn read_spec(path: &Path) -> anyhow::Result<Vec<u8>> {
    match path.to_str() {
        Some(name) if name != "-" && !path.exists() => of_preset(name),
        _ => read_json(path, MAX_SPEC_BYTES),
    }
}

/// The spec of the preset of a job.
fn of_preset(name: &str) -> anyhow::Result<Vec<u8>> {
    let preset = spec::presets().iter().find(|preset| preset.name == name);
    match preset.map(|preset| preset.place) {
        Some(PresetPlace::Job) => Ok(json!({ "preset": name }).to_string().into_bytes()),
        Some(PresetPlace::Model) => bail!(
            "{name} is the preset of a model, and no file; it belongs in a train job: \
             {{\"kind\": \"train\", \"model\": {{\"preset\": \"{name}\"}}, ...}}"
        ),
        None => {
            let jobs = spec::presets().iter().filter(|preset| preset.place == PresetPlace::Job);
            let names: Vec<&str> = jobs.map(|preset| preset.name.as_str()).collect();
            match spec::nearest(name, names.iter().copied()) {
                Some(meant) => bail!(
                    "there is no file {name}, and no preset of that name; did you mean {meant}?"
                ),
                None => bail!(
                    "there is no file {name}, and no preset of that name; the presets are {}",
                    names.join(", ")
                ),
            }
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_preset_is_its_spec_and_another_name_is_answered_with_near_ones() {
        let spec = read_spec(Path::new("quickstart")).unwrap();
        assert_eq!(spec, br#"{"preset":"quickstart"}"#);
        let error = |name: &str| read_spec(Path::new(name)).unwrap_err().to_string();
        assert!(error("quickstrat").ends_with("did you mean quickstart?"));
        assert!(error("lagrangian-tiny").contains(r#""model": {"preset": "lagrangian-tiny"}"#));
        let strange = error("no/such.json");
        assert!(strange.contains("there is no file no/such.json"), "{strange}");
        assert!(strange.contains("the presets are"), "{strange}");
    }

    #[test]
    fn a_file_comes_before_a_preset_of_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("quickstart");
        std::fs::write(&file, "{}").unwrap();
        assert_eq!(read_spec(&file).unwrap(), b"{}");
        let broken = read_spec(folder.path()).unwrap_err();
        assert!(format!("{broken:#}").contains("cannot read"), "{broken:#}");
    }
}
