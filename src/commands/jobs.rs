use std::process::ExitCode;

use clap::Args;
use clap::builder::PossibleValuesParser;
use reports::{Align, Table};
use spec::JobKind;
use wire::{Job, JobState, Jobs, Progress};

use crate::lists::ListArguments;
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Only jobs in this state
    #[arg(long, value_name = "STATE", value_parser = states())]
    state: Option<String>,

    /// Only jobs of this kind
    #[arg(long, value_name = "KIND", value_parser = kinds())]
    kind: Option<String>,

    #[command(flatten)]
    list: ListArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { kind, state, list } = arguments;
    let client = list.server.client()?;
    let filters = [("kind", &kind), ("state", &state)];
    let mut last = None;
    let mut table = Table::new([
        ("id", Align::Right),
        ("kind", Align::Left),
        ("name", Align::Left),
        ("state", Align::Left),
        ("done", Align::Right),
        ("submitted", Align::Right),
        ("took", Align::Right),
        ("tags", Align::Left),
        ("waits", Align::Left),
    ]);
    let rest = list.each_page(&client, "/v1/jobs", &filters, |page| {
        if list.output.json {
            println!("{page}");
            return Ok(());
        }
        let page: Jobs = serde_json::from_str(page)?;
        for job in page.jobs {
            last = Some(job.id);
            table.push(row(job));
        }
        Ok(())
    });
    let rest = rest.await?;
    if !list.output.json {
        print!("{}", table.render());
        list.print_rest("jobs", &rest, last);
    }
    Ok(ExitCode::SUCCESS)
}

pub fn states() -> PossibleValuesParser {
    PossibleValuesParser::new(JobState::ALL.map(JobState::as_str))
}

pub fn kinds() -> PossibleValuesParser {
    PossibleValuesParser::new(JobKind::ALL.iter().map(|kind| kind.as_str()))
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
        job.tags.join(" "),
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

    /// Catches a hand-written list of kinds, which lacked `control`.
    #[test]
    fn jobs_of_every_kind_can_be_listed() {
        for kind in JobKind::ALL {
            let jobs = Jobs::try_parse_from(["jobs", "--kind", kind.as_str()]).unwrap();
            assert_eq!(jobs.arguments.kind.as_deref(), Some(kind.as_str()));
        }
    }
}
