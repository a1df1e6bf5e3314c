use std::process::ExitCode;

use clap::Args;
use clap::builder::PossibleValuesParser;
use reports::{Align, Table};
use spec::JobKind;
use wire::{Job, JobState, Progress};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Only jobs in this state
    #[arg(long, value_name = "STATE", value_parser = states())]
    state: Option<String>,

    /// Only jobs of this kind
    #[arg(long, value_name = "KIND", value_parser = kinds())]
    kind: Option<String>,

    /// At most so many
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100))]
    limit: u32,

    /// Only jobs older than this one
    #[arg(long, value_name = "ID")]
    before: Option<i64>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let path = path(&arguments);
    let client = arguments.server.client()?;
    if arguments.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let list = client.jobs(&path).await?;
    let mut table = Table::new([
        ("id", Align::Right),
        ("kind", Align::Left),
        ("name", Align::Left),
        ("state", Align::Left),
        ("done", Align::Right),
        ("submitted", Align::Right),
        ("took", Align::Right),
        ("waits", Align::Left),
    ]);
    for job in list.jobs {
        table.push(row(job));
    }
    print!("{}", table.render());
    if let Some(next) = list.next {
        println!("older ones: torqued jobs --before {next}");
    }
    Ok(ExitCode::SUCCESS)
}

fn states() -> PossibleValuesParser {
    PossibleValuesParser::new(JobState::ALL.map(JobState::as_str))
}

fn kinds() -> PossibleValuesParser {
    PossibleValuesParser::new(JobKind::ALL.iter().map(|kind| kind.as_str()))
}

fn path(Arguments { state, kind, limit, before, .. }: &Arguments) -> String {
    let mut path = format!("/v1/jobs?limit={limit}");
    for (key, value) in [("state", state), ("kind", kind)] {
        path.extend(value.iter().map(|value| format!("&{key}={value}")));
    }
    path.extend(before.iter().map(|id| format!("&before={id}")));
    path
}

fn row(job: Job) -> Vec<String> {
    let Progress { done, total, .. } = job.progress;
    let share = if total > 0 {
        format!("{:.0} %", 100.0 * (done as f64 / total as f64).min(1.0))
    } else {
        String::new()
    };
    let age =
        measure::since(&job.created_at, None).map(|age| format!("{} ago", measure::duration(age)));
    let took =
        job.started_at.as_deref().and_then(|from| measure::since(from, job.finished_at.as_deref()));
    vec![
        job.id.to_string(),
        job.kind.to_string(),
        job.name,
        job.state.to_string(),
        share,
        age.unwrap_or_default(),
        took.map(measure::duration).unwrap_or_default(),
        job.waits_for.unwrap_or_default(),
    ]
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Jobs {
        #[command(flatten)]
        arguments: Arguments,
    }

    /// Catches a list of kinds kept by hand, which `control` was missing from.
    #[test]
    fn jobs_of_every_kind_can_be_listed() {
        for kind in JobKind::ALL {
            let jobs = Jobs::try_parse_from(["jobs", "--kind", kind.as_str()]).unwrap();
            assert!(path(&jobs.arguments).ends_with(&format!("&kind={kind}")), "{kind}");
        }
    }
}
