use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Worker, WorkersTask};

use crate::arguments::ServerArguments;
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Print the server's answer as it is
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    server: ServerArguments,
}

const PATH: &str = "/v1/workers";

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    if arguments.json {
        println!("{}", client.raw(PATH).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let workers = client.workers(PATH).await?.workers;
    if workers.is_empty() {
        println!("no worker; `torqued serve` starts its own, `torqued worker` another");
        return Ok(ExitCode::SUCCESS);
    }
    let mut table = Table::new([
        ("name", Align::Left),
        ("host", Align::Left),
        ("pid", Align::Right),
        ("version", Align::Left),
        ("device", Align::Left),
        ("offers", Align::Left),
        ("seen", Align::Right),
        ("does", Align::Left),
    ]);
    for worker in workers {
        table.push(row(worker));
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}

fn row(worker: Worker) -> Vec<String> {
    let seen = measure::since(&worker.seen_at, None);
    let (does, offers) = (does(&worker), worker.offers_in_words());
    vec![
        worker.name,
        worker.host,
        worker.pid.to_string(),
        worker.version,
        worker.device,
        offers,
        seen.map(|age| format!("{} ago", measure::duration(age))).unwrap_or_default(),
        does,
    ]
}

fn does(worker: &Worker) -> String {
    let is_drained = worker.drained_at.is_some();
    match (&worker.task, &worker.waits_for) {
        _ if !worker.alive => "nothing: it has died, or hangs".to_owned(),
        (Some(WorkersTask { job, label, .. }), _) if is_drained => {
            format!("{label} of job {job}, its last: it is drained")
        }
        (None, _) if is_drained => "nothing: it is drained".to_owned(),
        (Some(WorkersTask { job, label, .. }), _) => format!("{label} of job {job}"),
        (None, Some(reason)) => format!("waits: {reason}"),
        (None, None) => "waits for a task".to_owned(),
    }
}
