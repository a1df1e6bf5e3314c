//! Shows one thing of a server, with everything known about it.

mod checkpoint;
mod dataset;
mod evaluation;
mod job;
mod run;

use std::fmt::Display;
use std::process::ExitCode;

use anyhow::bail;
use clap::Args;
use reports::{Align, Table};
use serde_json::Value;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;
use crate::resource::Resource;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The kind of thing
    #[arg(value_name = "KIND")]
    resource: Resource,

    /// Its id
    #[arg(value_name = "ID")]
    id: i64,

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
        Resource::Job => job::text(serde_json::from_str(answer)?),
        Resource::Dataset => dataset::text(&serde_json::from_str(answer)?),
        Resource::Run => run::text(&serde_json::from_str(answer)?),
        Resource::Checkpoint => checkpoint::text(&serde_json::from_str(answer)?),
        Resource::Evaluation => evaluation::text(serde_json::from_str(answer)?),
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
