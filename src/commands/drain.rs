use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use wire::WorkersTask;

use crate::arguments::{OutputArguments, ServerArguments, worker_name};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The worker's name; `torqued workers` lists them
    #[arg(value_name = "WORKER", value_parser = worker_name)]
    worker: String,

    /// Wait until it has no task
    #[arg(long)]
    wait: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// Pause between two looks at the worker's task.
const LOOK_EVERY: Duration = Duration::from_secs(1);

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { worker: name, wait, output, server } = arguments;
    let client = server.client()?;
    let mut worker = client.drain_worker(&name).await?;
    match &worker.task {
        _ if output.json => {}
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
    if output.json {
        write_json(&worker)?;
    } else if wait {
        println!("{name} has no task; `torqued undrain {name}` undrains it");
    }
    Ok(ExitCode::SUCCESS)
}
