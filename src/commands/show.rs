//! Shows one thing of a server, with everything known about it.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::process::ExitCode;

use anyhow::bail;
use clap::Args;
use reports::{Align, Table};
use serde_json::Value;
use wire::{Checkpoint, Dataset, Evaluation, Job, LatestMetric, Member, Run, TaskState};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;
use crate::resource::{Reference, Resource};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The kind of thing
    #[arg(value_name = "KIND")]
    resource: Resource,

    /// Its id, or the alias of a checkpoint
    #[arg(value_name = "ID")]
    id: Reference,

    /// Print only its spec, which can be submitted again
    #[arg(long, conflicts_with = "json")]
    spec: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { resource, id, .. } = arguments;
    let client = arguments.server.client()?;
    let answer = client.raw(&resource.api_path(id)).await?;
    if arguments.output.json {
        println!("{answer}");
    } else if arguments.spec {
        let answer: Value = serde_json::from_str(&answer)?;
        let Some(spec) = answer.get("spec") else {
            bail!("a {} has no spec of its own, but its job has", resource.as_str());
        };
        println!("{}", serde_json::to_string_pretty(spec)?);
    } else {
        print!("{}", text(resource, &answer)?);
    }
    Ok(ExitCode::SUCCESS)
}

/// The server's answer about a thing as text.
pub fn text(resource: Resource, answer: &str) -> anyhow::Result<String> {
    Ok(match resource {
        Resource::Job => job_text(serde_json::from_str(answer)?),
        Resource::Dataset => dataset_text(&serde_json::from_str(answer)?),
        Resource::Run => run_text(&serde_json::from_str(answer)?),
        Resource::Checkpoint => checkpoint_text(&serde_json::from_str(answer)?),
        Resource::Evaluation => evaluation_text(serde_json::from_str(answer)?),
    })
}

/// Names and values, one pair per line. A missing value is left out.
struct Facts(Vec<(&'static str, String)>);

impl Facts {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn add(&mut self, name: &'static str, value: impl Display) {
        self.0.push((name, value.to_string()));
    }

    fn add_some(&mut self, name: &'static str, value: Option<impl Display>) {
        if let Some(value) = value {
            self.add(name, value);
        }
    }

    /// Adds the tags of a thing and of its job, and each line of its note.
    fn add_labels(&mut self, tags: &[String], job_tags: &[String], note: Option<&str>) {
        self.add_some("tags", Some(tags.join(" ")).filter(|tags| !tags.is_empty()));
        self.add_some("job's tags", Some(job_tags.join(" ")).filter(|tags| !tags.is_empty()));
        for line in note.into_iter().flat_map(str::lines) {
            self.add("note", line);
        }
    }

    /// Adds a time, and how long ago it was.
    fn add_time(&mut self, name: &'static str, time: Option<&str>) {
        self.add_some(name, time.map(|time| format!("{time}, {}", measure::ago(time))));
    }

    fn render(&self) -> String {
        let width = self.0.iter().map(|(name, _)| name.len()).max().unwrap_or_default();
        self.0.iter().map(|(name, value)| format!("{name:width$}  {value}\n")).collect()
    }
}

/// A table of files with name, size and digest.
fn file_table<'a>(files: impl Iterator<Item = (&'a str, u64, &'a spec::Digest)>) -> String {
    let mut table =
        Table::new([("file", Align::Left), ("size", Align::Right), ("sha256", Align::Left)]);
    for (name, size, sha256) in files {
        table.push(vec![name.to_owned(), measure::size(size), sha256.to_string()]);
    }
    format!("\n{}", table.render())
}

fn checkpoint_text(checkpoint: &Checkpoint) -> String {
    let mut facts = Facts::new();
    facts.add("checkpoint", checkpoint.id);
    facts.add_some("name", checkpoint.name.as_ref());
    facts.add_labels(&checkpoint.tags, &checkpoint.job_tags, checkpoint.note.as_deref());
    facts.add("model", &checkpoint.architecture);
    facts.add("step", measure::count(checkpoint.step));
    let aliases = Some(checkpoint.aliases.join(", "));
    facts.add_some("aliases", aliases.filter(|aliases| !aliases.is_empty()));
    facts.add_some("is", Some(checkpoint.marks().join(", ")).filter(|marks| !marks.is_empty()));
    facts.add("job", checkpoint.job);
    facts.add("run", checkpoint.run);
    for (key, value) in &checkpoint.metrics {
        facts.add("metric", format!("{key} {value}"));
    }
    facts.add_time("created", Some(&checkpoint.created_at));
    facts.add("digest", checkpoint.digest);
    let files = checkpoint.files.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    facts.render() + &file_table(files)
}

fn dataset_text(dataset: &Dataset) -> String {
    let mut facts = Facts::new();
    facts.add("dataset", dataset.id);
    facts.add("name", &dataset.name);
    facts.add_labels(&dataset.tags, &dataset.job_tags, dataset.note.as_deref());
    facts.add("state", dataset.state);
    facts.add("job", dataset.job);
    facts.add("trajectories", measure::count(dataset.trajectories));
    facts.add("samples", format!("{} each", dataset.samples));
    facts.add("refused", format!("{} draws", measure::count(dataset.rejected)));
    facts.add("size", measure::size(dataset.bytes));
    facts.add_time("created", Some(&dataset.created_at));
    facts.add_time("complete", dataset.completed_at.as_deref());
    facts.add("digest", dataset.digest);
    let files = dataset.files.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    facts.render() + &file_table(files)
}

fn evaluation_text(evaluation: Evaluation) -> String {
    let mut facts = Facts::new();
    facts.add("evaluation", evaluation.id);
    facts.add("name", &evaluation.name);
    facts.add_labels(&evaluation.tags, &[], evaluation.note.as_deref());
    facts.add("state", evaluation.state);
    facts.add_some("error", evaluation.error.as_ref());
    facts.add("run", evaluation.run);
    let done = evaluation.cells.iter().filter(|cell| cell.state == TaskState::Succeeded).count();
    facts.add("cells", format!("{done} of {}", evaluation.cells.len()));
    facts.add_time("created", Some(&evaluation.created_at));
    facts.add("digest", evaluation.digest);
    let report = evaluation.report.map(|report| format!("\n{}", reports::text(&report)));
    let files =
        evaluation.artifacts.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    let files = if evaluation.artifacts.is_empty() { String::new() } else { file_table(files) };
    facts.render() + &report.unwrap_or_default() + &files
}

fn job_text(job: Job) -> String {
    let mut facts = Facts::new();
    facts.add("job", job.id);
    facts.add("kind", job.kind);
    facts.add("name", &job.name);
    facts.add_labels(&job.tags, &[], job.note.as_deref());
    facts.add("state", job.state);
    facts.add_some("error", job.error.as_ref());
    facts.add_some("waits", job.waits_for.as_ref());
    if job.progress.total > 0 {
        let [done, total] = [job.progress.done, job.progress.total].map(measure::count);
        facts.add("done", format!("{done} of {total} {}", job.progress.unit));
    }
    facts.add_some("now", job.progress.message.as_ref());
    facts.add_some("needs", list(&job.needs));
    for of in &job.pipelines {
        facts.add("pipeline", format!("{} (job {}), where it is {}", of.name, of.id, of.member));
    }
    facts.add_some("dataset", job.dataset);
    facts.add_some("verifies", job.verifies.map(|id| format!("dataset {id}")));
    facts.add_some("run", job.run);
    facts.add_some("checkpoints", list(&job.checkpoints));
    facts.add("priority", job.priority);
    facts.add("attempts", format!("{} at most", job.max_attempts));
    facts.add_some("time limit", job.time_limit_s.map(|seconds| format!("{seconds} s")));
    facts.add_time("not before", job.not_before.as_deref());
    facts.add_time("submitted", Some(&job.created_at));
    facts.add_time("started", job.started_at.as_deref());
    facts.add_time("ended", job.finished_at.as_deref());
    facts.add("digest", job.digest);
    for warning in &job.warnings {
        facts.add("warning", warning);
    }
    let members = if job.members.is_empty() { String::new() } else { members(job.members) };
    facts.render() + &members
}

fn members(members: Vec<Member>) -> String {
    let mut table = Table::new([
        ("job", Align::Right),
        ("kind", Align::Left),
        ("name", Align::Left),
        ("state", Align::Left),
        ("error", Align::Left),
    ]);
    for member in members {
        let state = if member.reused { ", done before" } else { "" };
        table.push(vec![
            member.job.to_string(),
            member.kind.to_string(),
            member.name,
            format!("{}{state}", member.state),
            member.error.unwrap_or_default(),
        ]);
    }
    format!("\n{}", table.render())
}

fn list(ids: &[i64]) -> Option<String> {
    let ids: Vec<String> = ids.iter().map(ToString::to_string).collect();
    (!ids.is_empty()).then(|| ids.join(", "))
}

fn run_text(run: &Run) -> String {
    let mut facts = Facts::new();
    facts.add("run", run.id);
    facts.add("kind", run.kind);
    facts.add("name", &run.name);
    facts.add_labels(&run.tags, &run.job_tags, run.note.as_deref());
    facts.add("state", run.state);
    facts.add_some("error", run.error.as_ref());
    facts.add("job", run.job);
    facts.add_time("created", Some(&run.created_at));
    facts.add("digest", run.digest);
    let files = run.artifacts.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    let files = if run.artifacts.is_empty() { String::new() } else { file_table(files) };
    let metrics = if run.metrics.is_empty() { String::new() } else { metrics(&run.metrics) };
    facts.render() + &metrics + &files
}

fn metrics(latest: &BTreeMap<String, LatestMetric>) -> String {
    let mut table =
        Table::new([("metric", Align::Left), ("step", Align::Right), ("latest", Align::Right)]);
    for (key, metric) in latest {
        let value = metric.value.map_or_else(|| "not finite".to_owned(), |value| value.to_string());
        table.push(vec![key.clone(), measure::count(metric.step), value]);
    }
    format!("\n{}", table.render())
}
