use std::process::ExitCode;

use clap::Args;
use wire::{Deleted, Dependent, Dependents};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;
use crate::progress::measure;
use crate::resource::{Deletable, Reference};

/// Moves things into the trash; `torqued undelete` restores them. A job is deleted with its logs
/// and all its results, and a run with its checkpoints. Jobs that have not ended prevent the
/// deletion of their inputs. Jobs that have ended do so unless `--force` is given.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The kind of things
    #[arg(value_name = "KIND")]
    kind: Deletable,

    /// Their ids, or aliases of checkpoints
    #[arg(value_name = "ID", required = true)]
    ids: Vec<Reference>,

    /// Delete even if ended jobs depend on them; those jobs stay as they are
    #[arg(long)]
    force: bool,

    /// Only print what would be deleted with them, and which jobs depend on them
    #[arg(long, conflicts_with = "force")]
    dry_run: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { kind, force, dry_run, output, .. } = arguments;
    let client = arguments.server.client()?;
    for id in arguments.ids {
        let path = kind.api_path(id);
        if dry_run {
            let found: Dependents = client.get(&format!("{path}/dependents")).await?;
            if output.json {
                write_json(&found)?;
            } else {
                print!("{}", foretold(&found));
            }
            continue;
        }
        let force = if force { "?force=true" } else { "" };
        let deleted: Deleted = client.delete(&format!("{path}{force}")).await?;
        if output.json {
            write_json(&deleted)?;
        } else {
            let along = in_words(&deleted.along);
            let Deleted { kind, id, purge_at, .. } = deleted;
            println!("{kind} {id} is in the trash until {purge_at}{along}");
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn foretold(found: &Dependents) -> String {
    let Dependents { kind, id, bytes, .. } = *found;
    let along = in_words(&found.along);
    let lines = found.jobs.iter().map(|job| format!("  {}\n", dependent(job))).collect::<String>();
    format!("{kind} {id}: {}{along}\n{lines}", measure::size(bytes))
}

fn dependent(job: &Dependent) -> String {
    let relation = job.relation.phrase();
    let Dependent { id, kind, name, state, .. } = job;
    let weight = if state.is_final() { "--force ignores it" } else { "prevents the deletion" };
    format!("{kind} job {id} ({name}, {state}) {relation}: {weight}")
}

/// A phrase with the things that are deleted or restored together with another one; empty without
/// any.
pub fn in_words(along: &[wire::Item]) -> String {
    const NAMED: usize = 10;
    if along.is_empty() {
        return String::new();
    }
    let mut names: Vec<String> =
        along.iter().take(NAMED).map(|item| format!("{} {}", item.kind, item.id)).collect();
    if along.len() > NAMED {
        names.push(format!("{} more", along.len() - NAMED));
    }
    format!(", with {}", names.join(", "))
}
