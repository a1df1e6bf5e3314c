use std::process::ExitCode;

use anyhow::bail;
use clap::Args;
use jobs::{LeftOut, Rebuilt};
use store::{Access, Duty, JobId, Store};

use crate::arguments::{ConfigArguments, StoreArguments};
use crate::commands::copies;

/// Rebuilds jobs in a database without jobs. The files of datasets and checkpoints say which job
/// made them. That job is recorded again under its old id and as completed, so that it is found by
/// its digest. Metrics, logs, evaluations, pipelines, tokens and MLflow's runs are lost, because
/// only the lost database had them: keep backups (docs/operate.md).
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    store: StoreArguments,

    /// Continue although some files do not describe themselves; a server deletes those that torqued
    /// made when they are 8 h old
    #[arg(long)]
    leave_out: bool,
}

/// Number of files that are listed by name.
const NAMED: usize = 50;

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let location = arguments.store.location();
    let store = Store::open_at(&location, Access::Rebuilding).await?;
    let mut duty = store.duty(Duty::Sweeping);
    if !duty.is_mine().await? {
        bail!("a server works on this database; stop it first");
    }
    let found = jobs::find_objects(&store).await?;
    if found.jobs() == 0 {
        bail!("no dataset and no checkpoint of {location} describes itself; nothing was changed");
    }
    if !found.left_out.is_empty() && !arguments.leave_out {
        name(&found.left_out);
        bail!(
            "{} files would be left out, and a server deletes files of torqued that its database does not name; copy those that you need, \
             then repeat with --leave-out; nothing was changed",
            found.left_out.len()
        );
    }
    store.mark_place().await?;
    let before = found.left_out.len();
    let rebuilt = jobs::rebuild(&store, found).await?;
    name(&rebuilt.left_out[before..]);
    store.close().await;
    println!("{}", summary(&rebuilt));
    println!("start a server on it with: {}", copies::serve_command(&location));
    Ok(ExitCode::SUCCESS)
}

/// Lists files that are left out, with the reasons.
fn name(left_out: &[LeftOut]) {
    for LeftOut { path, reason } in left_out.iter().take(NAMED) {
        eprintln!("left out: {path}: {reason}");
    }
    if let Some(more) = left_out.len().checked_sub(NAMED).filter(|more| *more > 0) {
        eprintln!("left out: {more} more");
    }
}

fn summary(rebuilt: &Rebuilt) -> String {
    let Rebuilt { datasets, shards, trainings, checkpoints, uploads, unfinished, left_out } =
        rebuilt;
    let mut summary = format!(
        "rebuilt: {datasets} datasets with {shards} shards, {trainings} trainings with \
         {checkpoints} checkpoints, {uploads} uploads; {} files left out",
        left_out.len()
    );
    if !unfinished.is_empty() {
        let jobs: Vec<String> = unfinished.iter().map(JobId::to_string).collect();
        summary.push_str(&format!("; workers make the missing parts of jobs {}", jobs.join(", ")));
    }
    summary
}
