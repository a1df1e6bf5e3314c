use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Args;
use serde_json::Value;
use wire::Job;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::client::{Client, Reuse, Submitted};
use crate::commands::watch;
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The recordings: a Parquet or CSV file
    #[arg(value_name = "FILE")]
    file: PathBuf,

    /// The import spec, which says what each column means; `kind` and `file` may be left out
    #[arg(long, value_name = "MAPPING.json")]
    spec: PathBuf,

    /// Import again, even if the same file was imported in the same way before
    #[arg(long)]
    force: bool,

    /// Follow the import until it ends
    #[arg(long)]
    wait: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let spec = read_spec(&arguments.spec, &arguments.file)?;
    let client = arguments.server.client()?;
    let reuse = if arguments.force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let Submitted { job, existed } = client.import(&arguments.file, &spec, reuse).await?;
    let output = arguments.output;
    match (output.json, arguments.wait) {
        (false, _) => print_places(&client, &job, existed),
        (true, false) => write_json(&job)?,
        (true, true) => {}
    }
    if !arguments.wait {
        return Ok(ExitCode::SUCCESS);
    }
    watch::to_the_end(&client, job.id, output).await
}

fn print_places(client: &Client, job: &Job, existed: bool) {
    let note = if existed { ", imported before" } else { "" };
    println!("job {} {}{note}: {}", job.id, job.state, client.url(&format!("/jobs/{}", job.id)));
    if let Some(dataset) = job.dataset {
        println!("dataset {dataset}: {}", client.url(&format!("/datasets/{dataset}")));
    }
}

/// Reads the spec. If it has no format, adds the one that the file's name suggests.
fn read_spec(path: &Path, file: &Path) -> anyhow::Result<Value> {
    let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut spec: Value = serde_json::from_slice(&text)
        .with_context(|| format!("{} is not valid JSON", path.display()))?;
    let fields =
        spec.as_object_mut().with_context(|| format!("{} is not a JSON object", path.display()))?;
    if !fields.contains_key("format") {
        let extension = file.extension().and_then(|extension| extension.to_str());
        let format = extension.map(str::to_ascii_lowercase);
        let known = format.as_deref().filter(|format| ["csv", "parquet"].contains(format));
        ensure!(
            known.is_some(),
            "the name {} does not show whether the file is Parquet or CSV; add \"format\" to {}",
            file.display(),
            path.display()
        );
        fields.insert("format".to_owned(), known.into());
    }
    Ok(spec)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_format_comes_from_the_spec_or_else_from_the_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mapping.json");
        let format = |spec: &str, file: &str| {
            std::fs::write(&path, spec).unwrap();
            read_spec(&path, Path::new(file)).map(|spec| spec["format"].clone())
        };
        assert_eq!(format("{}", "a.CSV").unwrap(), "csv");
        assert_eq!(format("{}", "a.b.parquet").unwrap(), "parquet");
        assert_eq!(format(r#"{"format": "csv"}"#, "a.txt").unwrap(), "csv");
        assert!(format("{}", "a.txt").unwrap_err().to_string().contains("a.txt"));
        assert!(format("[]", "a.csv").is_err());
    }
}
