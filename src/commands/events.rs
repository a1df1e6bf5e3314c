//! `torqued events`: prints events as they happen.

use std::process::ExitCode;

use clap::Args;
use wire::{DeletionEvent, Event, EventKind, ItemKind};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;
use crate::progress::measure;

/// Prints events as they happen: states of jobs and tasks, metrics and checkpoints. It runs until
/// Ctrl-C, or until the job ends.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Only events of this job, or of this pipeline and its jobs
    #[arg(long, value_name = "ID", conflicts_with_all = ["run", "kind"])]
    job: Option<i64>,

    /// Only events of the job with this run
    #[arg(long, value_name = "ID", conflicts_with = "kind")]
    run: Option<i64>,

    /// Only events of this kind: job, task, metrics or checkpoint
    #[arg(long, value_name = "KIND", value_parser = kind)]
    kind: Option<EventKind>,

    /// Begin with the stored events after the one with this id; 0 for all stored events
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(i64).range(0..))]
    after: Option<i64>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

fn kind(text: &str) -> Result<EventKind, String> {
    text.parse()
        .map_err(|_| format!("allowed: {}", EventKind::ALL.map(EventKind::as_str).join(", ")))
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let path = match (arguments.job, arguments.run, arguments.kind) {
        (Some(job), ..) => format!("/v1/jobs/{job}/events"),
        (_, Some(run), _) => format!("/v1/runs/{run}/events"),
        (.., Some(kind)) => format!("/v1/events?kind={kind}"),
        _ => "/v1/events".to_owned(),
    };
    let mut events = client.events(path, arguments.after);
    loop {
        let event = events.next().await?;
        if arguments.output.json {
            write_json(&event)?;
        } else {
            println!("{}", line(&event));
        }
        if matches!(event, Event::End(_)) {
            return Ok(ExitCode::SUCCESS);
        }
    }
}

/// An event as one line, for people.
fn line(event: &Event) -> String {
    let because = |error: &Option<String>| {
        error.as_ref().map(|error| format!(": {error}")).unwrap_or_default()
    };
    match event {
        Event::Job(event) => {
            let stops = event.cancel_requested && !event.state.is_final();
            let stops = if stops { ", to be cancelled" } else { "" };
            let because = because(&event.error);
            format!(
                "{} job {} ({}, {}) {}{stops}{because}",
                event.at, event.job, event.kind, event.name, event.state
            )
        }
        Event::Task(event) => {
            let on = event.worker.as_ref().map(|worker| format!(" on {worker}"));
            let on = on.unwrap_or_default();
            format!(
                "{} job {} task {} ({}) {}, attempt {}{on}{}",
                event.at,
                event.job,
                event.task,
                event.label,
                event.state,
                event.attempt,
                because(&event.error)
            )
        }
        Event::Metrics(event) => {
            format!(
                "{} job {} run {} has metrics up to step {}",
                event.at, event.job, event.run, event.step
            )
        }
        Event::Checkpoint(event) => {
            format!(
                "{} job {} run {} wrote checkpoint {} at step {}",
                event.at, event.job, event.run, event.checkpoint, event.step
            )
        }
        Event::Deletion(event) => {
            let DeletionEvent { at, job, item, item_id, change, .. } = event;
            match item {
                ItemKind::Job => format!("{at} job {job} {change}"),
                _ => format!("{at} job {job} {item} {item_id} {change}"),
            }
        }
        Event::Progress(event) => {
            let progress = &event.progress;
            let (done, total) = (measure::count(progress.done), measure::count(progress.total));
            let waits = event.waits_for.as_ref().map(|what| format!(", waits: {what}"));
            format!(
                "job {} {}, {done} of {total} {}{}",
                event.job,
                event.state,
                progress.unit,
                waits.unwrap_or_default()
            )
        }
        Event::Gap(event) => {
            format!("events after {} up to {} are not kept", event.after, event.id)
        }
        Event::End(event) => format!("job {} {}{}", event.job, event.state, because(&event.error)),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn an_event_is_a_line() {
        let line = |event| line(&serde_json::from_value(event).unwrap());
        let job = json!({
            "event": "job", "id": 3, "at": "2026-11-24T10:00:00.000Z", "job": 7, "kind": "train",
            "name": "small", "state": "running", "error": null, "cancel_requested": true,
        });
        assert_eq!(
            line(job),
            "2026-11-24T10:00:00.000Z job 7 (train, small) running, to be cancelled"
        );
        let task = json!({
            "event": "task", "id": 4, "at": "2026-11-24T10:00:00.000Z", "job": 7, "task": 9,
            "label": "training", "state": "failed", "attempt": 3, "worker": "w1", "error": "no room",
        });
        assert_eq!(
            line(task),
            "2026-11-24T10:00:00.000Z job 7 task 9 (training) failed, attempt 3 on w1: no room"
        );
        let deletion = |item, change| {
            line(json!({
                "event": "deletion", "id": 5, "at": "2026-11-24T10:00:00.000Z", "job": 7,
                "item": item, "item_id": 7, "change": change,
            }))
        };
        assert_eq!(deletion("job", "purged"), "2026-11-24T10:00:00.000Z job 7 purged");
        assert_eq!(deletion("run", "restored"), "2026-11-24T10:00:00.000Z job 7 run 7 restored");
        let gap = json!({"event": "gap", "id": 40, "after": 20});
        assert_eq!(line(gap), "events after 20 up to 40 are not kept");
    }
}
