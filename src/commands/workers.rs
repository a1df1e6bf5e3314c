use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Placement, Worker, Workers, WorkersTask};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

const PATH: &str = "/v1/workers";

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    if arguments.output.json {
        println!("{}", client.raw(PATH).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let Workers { workers, placements } = client.workers(PATH).await?;
    if workers.is_empty() && placements.is_empty() {
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
    for placement in placements {
        table.push(asked_for(placement));
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

/// The row of a worker that was requested from an engine and has not reported yet.
fn asked_for(placement: Placement) -> Vec<String> {
    let changed = measure::since(&placement.changed_at, None);
    let place = [Some(placement.engine), placement.identifier, placement.node];
    let reason = placement.reason.map(|reason| format!(": {reason}")).unwrap_or_default();
    let mut row = vec![String::new(); 8];
    row[0] = placement.worker;
    row[1] = place.into_iter().flatten().collect::<Vec<_>>().join(" ");
    row[6] = changed.map(|age| format!("{} ago", measure::duration(age))).unwrap_or_default();
    row[7] = format!("{}{reason}", placement.state);
    row
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
