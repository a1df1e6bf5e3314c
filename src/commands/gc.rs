//! `torqued gc`: deletes what is no longer needed.

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use reports::{Align, Table};
use serde_json::json;
use store::{Access, Garbage, GarbageKind, Outdated, Ripe, Store};

use crate::arguments::{
    ConfigArguments, ORPHANED_AFTER, RetentionArguments, StoreArguments, days_long,
};
use crate::output::write_json;
use crate::progress::measure;

/// Permanently deletes things whose time in the trash is over, files that nothing refers to, and
/// files of this machine that killed workers did not finish. A server does this once an hour; this
/// command may run beside it.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Only print what would be deleted
    #[arg(long)]
    dry_run: bool,

    /// Delete things that were moved into the trash this many days ago, whatever their date
    /// [default: each at its date]
    #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u16).range(0..=3650))]
    older_than: Option<u16>,

    /// Print deleted things as JSON, one per line
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    retention: RetentionArguments,

    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    store: StoreArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let ripe = match arguments.older_than {
        Some(days) => Ripe::After(days_long(days)),
        None => Ripe::AtItsDate { leap: Duration::ZERO },
    };
    let store = Store::open_at(&arguments.store.location(), Access::Worker).await?;
    let retention = arguments.retention.retention();
    let outdated = store.outdated(retention).await?;
    let logs = match retention.logs {
        Some(age) => store.outdated_logs(age).await?.len(),
        None => 0,
    };
    let found = if arguments.dry_run {
        store.garbage(ripe, ORPHANED_AFTER).await?
    } else {
        store.collect_garbage(ripe, ORPHANED_AFTER).await?
    };
    store.close().await;
    if !arguments.json {
        for Outdated { item, name, reason } in outdated {
            println!("a server will move {item} ({name}) into the trash: {reason}");
        }
        if let Some(days) = arguments.retention.keep_logs_days.filter(|_| logs > 0) {
            let jobs = if logs == 1 { "job" } else { "jobs" };
            println!(
                "a server will delete the logs of {logs} {jobs}: logs are kept for {days} days"
            );
        }
    }
    if arguments.json {
        for garbage in &found {
            let (kind, id) = names(garbage);
            let Garbage { name, files, bytes, .. } = garbage;
            let line =
                json!({"kind": kind, "id": id, "name": name, "files": files, "bytes": bytes});
            write_json(&line)?;
        }
    } else {
        print!("{}", table(&found));
        println!("{}", summary(&found, arguments.dry_run));
    }
    Ok(ExitCode::SUCCESS)
}

fn names(garbage: &Garbage) -> (String, String) {
    match &garbage.kind {
        GarbageKind::Item(item) => (item.kind.to_string(), item.id.to_string()),
        GarbageKind::TrackedRun(run) => ("mlflow run".to_owned(), run.clone()),
        GarbageKind::Upload(digest) => ("upload".to_owned(), digest.short()),
        GarbageKind::Orphans => ("orphans".to_owned(), String::new()),
        GarbageKind::Unfinished => ("unfinished".to_owned(), String::new()),
    }
}

fn table(found: &[Garbage]) -> String {
    if found.is_empty() {
        return String::new();
    }
    let mut table = Table::new([
        ("kind", Align::Left),
        ("id", Align::Right),
        ("name", Align::Left),
        ("files", Align::Right),
        ("size", Align::Right),
    ]);
    for garbage in found {
        let (kind, id) = names(garbage);
        let (files, size) = (measure::count(garbage.files), measure::size(garbage.bytes));
        table.push(vec![kind, id, garbage.name.clone(), files, size]);
    }
    table.render()
}

fn summary(found: &[Garbage], dry_run: bool) -> String {
    let verb = if dry_run { "would delete" } else { "deleted" };
    let files = measure::count(found.iter().map(|garbage| garbage.files).sum());
    let size = measure::size(found.iter().map(|garbage| garbage.bytes).sum());
    let is_thing = |garbage: &&Garbage| {
        !matches!(garbage.kind, GarbageKind::Orphans | GarbageKind::Unfinished)
    };
    let things = found.iter().filter(is_thing).count();
    format!("{verb} {things} things, {files} files, {size}")
}
