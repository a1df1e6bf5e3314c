//! `torqued import`: sends files of recordings, or one of predictions, and submits the job that reads
//! them.

mod check;
mod local;
mod samples;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde::Deserialize;
use serde_json::{Value, json};
use spec::{DataSpec, FileFormat, JobSpec, MAX_POSITION_NOISE_RAD};
use wire::{Dataset, ImportCounts, Job, JobState};

use crate::arguments::{LabelArguments, OutputArguments, ServerArguments};
use crate::bags::recorded_file;
use crate::client::{Client, RecordedFile, Reuse, Submitted};
use crate::commands::watch;
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The recordings, or a model's predictions: a Parquet, CSV, NumPy (.npz) or MCAP file, or a bag's folder with one MCAP file. Several files become one dataset; their recordings are called as they are, without the extension
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,

    /// The import spec, which says what each column means; `kind` and `file` may be left out
    #[arg(long, value_name = "MAPPING.json", required_unless_present = "predictions_of")]
    spec: Option<PathBuf>,

    /// Instead of a spec: the file has predictions of the horizons of this dataset, in its columns `trajectory`, `u1`,
    /// `u2`, .., `q1`, `q2`, ..
    #[arg(long, value_name = "DATASET", conflicts_with = "spec")]
    predictions_of: Option<i64>,

    /// Samples before the horizon that was predicted: `rounds` and `context` of the evaluation together
    #[arg(long, value_name = "SAMPLES", default_value_t = 320, requires = "predictions_of")]
    context: u32,

    /// Standard deviation of the noise of the recorded positions, rad, 0 to 0.1; replaces
    /// `position_noise_rad` of the spec
    #[arg(long, value_name = "RAD")]
    position_noise_rad: Option<f64>,

    /// Make positions continuous that the recording wraps at ±π or at 2π, as `unwrap` of the spec
    #[arg(long)]
    unwrap: bool,

    /// Import again, even if the same file was imported in the same way before
    #[arg(long)]
    force: bool,

    /// Follow the import until it ends
    #[arg(long)]
    wait: bool,

    /// Import nothing: say what the import would give, and what looks wrong in the recordings beside the robot of the spec
    #[arg(long, conflicts_with_all = ["force", "wait", "predictions_of"])]
    check: bool,

    #[command(flatten)]
    labels: LabelArguments,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let paths = arguments.files.iter().map(|path| recorded_file(path));
    let paths = paths.collect::<anyhow::Result<Vec<PathBuf>>>()?;
    let files = RecordedFile::named(&paths);
    let mut spec = match (&arguments.spec, arguments.predictions_of) {
        (Some(path), _) => read_spec(path, &paths)?,
        (None, Some(dataset)) => {
            let dataset = client.dataset(dataset).await?;
            let [file] = paths.as_slice() else {
                bail!("{} files of predictions, allowed: one", files.len());
            };
            let format = format_of(file)
                .with_context(|| format!("{} ends in none of {}", file.display(), endings()))?;
            mapping_of_predictions(&dataset, arguments.context, format)?
        }
        (None, None) => bail!("--spec or --predictions-of is missing"),
    };
    if let Some(noise) = arguments.position_noise_rad {
        ensure!(
            (0.0..=MAX_POSITION_NOISE_RAD).contains(&noise),
            "--position-noise-rad is {noise}, allowed: 0 to {MAX_POSITION_NOISE_RAD}"
        );
        spec["position_noise_rad"] = json!(noise);
    }
    if arguments.unwrap {
        spec["unwrap"] = json!(true);
    }
    if let Some(samples) = samples::count(&client, &files, &mut spec).await? {
        eprintln!("note: samples is {samples}, the length of each recording");
    }
    if arguments.check {
        return check::run(&client, &files, spec, arguments.output).await;
    }
    let reuse = if arguments.force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let labels = arguments.labels.parameters();
    let Submitted { job, existed } = client.import(&files, &spec, reuse, &labels).await?;
    let output = arguments.output;
    if !output.json {
        let note = if existed { ", imported before" } else { "" };
        let page = client.url(&format!("/jobs/{}", job.id));
        println!("job {} {}{note}: {page}", job.id, job.state);
    }
    match (output.json, arguments.wait) {
        (true, true) => watch::follow_to_end(&client, job.id, output).await,
        (false, true) => {
            let code = watch::follow_to_end(&client, job.id, output).await?;
            // Only a job that succeeded leaves a dataset that can be used.
            let ended = client.job(job.id).await?;
            if ended.state == JobState::Succeeded {
                print_warnings(&client, &ended).await?;
                print_dataset(&client, &ended);
            }
            Ok(code)
        }
        (true, false) => {
            write_json(&job)?;
            Ok(ExitCode::SUCCESS)
        }
        (false, false) => {
            print_dataset(&client, &job);
            Ok(ExitCode::SUCCESS)
        }
    }
}

/// Prints what looks wrong in the recordings.
async fn print_warnings(client: &Client, job: &Job) -> anyhow::Result<()> {
    let results = client.tasks(job.id).await?.into_iter().filter_map(|task| task.result);
    for counts in results.filter_map(|result| ImportCounts::deserialize(&result["import"]).ok()) {
        for warning in counts.warnings {
            println!("warning: {warning}");
        }
    }
    Ok(())
}

fn print_dataset(client: &Client, job: &Job) {
    if let Some(dataset) = job.dataset {
        println!("dataset {dataset}: {}", client.url(&format!("/datasets/{dataset}")));
    }
}

/// Reads the spec. If it has no format, adds the one that the files' names suggest.
fn read_spec(path: &Path, files: &[PathBuf]) -> anyhow::Result<Value> {
    let text = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut spec: Value = serde_json::from_slice(&text)
        .with_context(|| format!("{} is not valid JSON", path.display()))?;
    let fields =
        spec.as_object_mut().with_context(|| format!("{} is not a JSON object", path.display()))?;
    if !fields.contains_key("format") {
        let mut formats = Vec::new();
        for file in files {
            ensure!(
                !is_compressed(file),
                "{} is compressed; unpack it first, such as with gunzip",
                file.display()
            );
            formats.push(format_of(file).with_context(|| {
                format!(
                    "the name {} has none of the endings {}; add \"format\" to {}",
                    file.display(),
                    endings(),
                    path.display()
                )
            })?);
        }
        ensure!(
            formats.windows(2).all(|pair| pair[0] == pair[1]),
            "the files have different endings, allowed: files of one format"
        );
        fields.insert("format".to_owned(), serde_json::to_value(formats.first())?);
    }
    Ok(spec)
}

/// The format that the file's extension implies.
pub fn format_of(file: &Path) -> Option<FileFormat> {
    FileFormat::of_name(file.to_str()?)
}

/// The extensions that imply a format.
fn endings() -> String {
    FileFormat::ALL.map(|format| format!(".{}", format.as_str())).join(", ")
}

/// Whether the name has the extension of a compressed file.
fn is_compressed(file: &Path) -> bool {
    let extensions = ["gz", "zst", "xz", "bz2", "lz4", "zip"];
    file.extension().is_some_and(|extension| {
        extensions.iter().any(|other| extension.eq_ignore_ascii_case(other))
    })
}

/// The import spec for predictions on `dataset`: all samples after the first `context` of each
/// trajectory. The robot is that of the dataset, but predictions may exceed its joint limits, and
/// jump.
fn mapping_of_predictions(
    dataset: &Dataset,
    context: u32,
    format: FileFormat,
) -> anyhow::Result<Value> {
    let job: JobSpec = serde_json::from_value(dataset.spec.clone())?;
    let data = DataSpec::of(&job).context("the dataset has the spec of another kind of job")?;
    ensure!(
        context < data.samples(),
        "--context is {context}; allowed: less than the {} samples of dataset {}",
        data.samples(),
        dataset.id
    );
    let columns = |quantity: &str| -> Vec<String> {
        (1..=data.joints()).map(|joint| format!("{quantity}{joint}")).collect()
    };
    let (any, wide) = ([-1e6, 1e6], [-1000.0, 1000.0]);
    let mut mapping = json!({
        "format": format,
        "columns": {"recording": "trajectory", "u": columns("u"), "q": columns("q")},
        "ranges": {"u_nm": any, "q_rad": wide, "qd_rad_s": any},
        "rate_hz": data.rate_hz(),
        "samples": data.samples() - context,
    });
    let robot = match &data {
        DataSpec::Simulation(spec) => Some(&spec.robot),
        DataSpec::Import(spec) => spec.robot.as_ref(),
    };
    if let Some(robot) = robot {
        mapping["robot"] = serde_json::to_value(robot)?;
    }
    Ok(mapping)
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
            let files: Vec<PathBuf> = file.split(' ').map(PathBuf::from).collect();
            read_spec(&path, &files).map(|spec| spec["format"].clone())
        };
        assert_eq!(format("{}", "a.CSV").unwrap(), "csv");
        assert_eq!(format("{}", "a.b.parquet").unwrap(), "parquet");
        assert_eq!(format("{}", "arm.npz").unwrap(), "npz");
        assert_eq!(format(r#"{"format": "csv"}"#, "a.txt").unwrap(), "csv");
        assert!(format("{}", "a.txt").unwrap_err().to_string().contains("a.txt"));
        assert!(format("{}", "a.csv.gz").unwrap_err().to_string().contains("gunzip"));
        assert!(format("[]", "a.csv").is_err());
        assert_eq!(format("{}", "a.csv b.csv").unwrap(), "csv");
        assert!(format("{}", "a.csv b.npz").unwrap_err().to_string().contains("one format"));
    }
}
