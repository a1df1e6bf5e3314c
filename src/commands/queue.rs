//! The queue and its workers: shows, pauses and drains.

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use wire::WorkersTask;

use crate::arguments::{AskArguments, worker_name};
use crate::output::write_json;
use crate::progress::measure;

/// Pause between two looks at running tasks.
const LOOK_EVERY: Duration = Duration::from_secs(1);

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    ask: AskArguments,
}

pub async fn run(Arguments { ask }: Arguments) -> anyhow::Result<ExitCode> {
    let queue = ask.client()?.queue().await?;
    ask.print(&queue, |queue| {
        let state = match (queue.paused, &queue.paused_at) {
            (false, _) => "running".to_owned(),
            (true, None) => "paused".to_owned(),
            (true, Some(since)) => format!("paused {}", measure::ago(since)),
        };
        format!("{state}; {} tasks wait, {} run", queue.queued, queue.running)
    })
}

#[derive(Debug, Args)]
pub struct PauseArguments {
    /// Wait until no worker has a task
    #[arg(long)]
    wait: bool,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn pause(PauseArguments { wait, ask }: PauseArguments) -> anyhow::Result<ExitCode> {
    let client = ask.client()?;
    let mut queue = client.pause_queue().await?;
    if !ask.output.json {
        println!("paused; {} tasks wait, {} still run", queue.queued, queue.running);
    }
    while wait && queue.running > 0 {
        tokio::time::sleep(LOOK_EVERY).await;
        queue = client.queue().await?;
    }
    if ask.output.json {
        write_json(&queue)?;
    } else if wait {
        println!("no task is running; `torqued resume` resumes the queue");
    }
    Ok(ExitCode::SUCCESS)
}

pub async fn resume(Arguments { ask }: Arguments) -> anyhow::Result<ExitCode> {
    let queue = ask.client()?.resume_queue().await?;
    ask.print(&queue, |queue| {
        format!("resumed; {} tasks wait, {} run", queue.queued, queue.running)
    })
}

#[derive(Debug, Args)]
pub struct DrainArguments {
    /// The worker's name; `torqued workers` lists them
    #[arg(value_name = "WORKER", value_parser = worker_name)]
    worker: String,

    /// Wait until it has no task
    #[arg(long)]
    wait: bool,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn drain(arguments: DrainArguments) -> anyhow::Result<ExitCode> {
    let DrainArguments { worker: name, wait, ask } = arguments;
    let client = ask.client()?;
    let mut worker = client.drain_worker(&name).await?;
    match &worker.task {
        _ if ask.output.json => {}
        Some(WorkersTask { job, label, .. }) if worker.alive => {
            println!("drained; {name} ends {label} of job {job} and begins no other task");
        }
        _ => println!("drained; {name} begins no task"),
    }
    while wait && worker.alive && worker.task.is_some() {
        tokio::time::sleep(LOOK_EVERY).await;
        let workers = client.workers("/v1/workers").await?.workers;
        // A worker that left the list has ended.
        let Some(found) = workers.into_iter().find(|worker| worker.name == name) else { break };
        worker = found;
    }
    if ask.output.json {
        write_json(&worker)?;
    } else if wait {
        println!("{name} has no task; `torqued undrain {name}` undrains it");
    }
    Ok(ExitCode::SUCCESS)
}

#[derive(Debug, Args)]
pub struct UndrainArguments {
    /// The worker's name; `torqued workers` lists them
    #[arg(value_name = "WORKER", value_parser = worker_name)]
    worker: String,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn undrain(arguments: UndrainArguments) -> anyhow::Result<ExitCode> {
    let UndrainArguments { worker, ask } = arguments;
    let worker = ask.client()?.undrain_worker(&worker).await?;
    ask.print(&worker, |worker| format!("{} begins tasks again", worker.name))
}
