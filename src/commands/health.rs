use std::process::ExitCode;

use clap::Args;
use wire::Health;

use crate::arguments::AskArguments;
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Only ask whether the server accepts requests, as load balancers do
    #[arg(long, conflicts_with = "metrics")]
    ready: bool,

    /// Print the server's metrics in Prometheus' format
    #[arg(long, conflicts_with = "json")]
    metrics: bool,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.ask.client()?;
    if arguments.metrics {
        print!("{}", client.raw("/metrics").await?);
        return Ok(ExitCode::SUCCESS);
    }
    let path = if arguments.ready { "/readyz" } else { "/healthz" };
    let answer = client.raw(path).await?;
    if arguments.ask.output.json {
        println!("{answer}");
    }
    if arguments.ready {
        if !arguments.ask.output.json {
            println!("ready");
        }
        return Ok(ExitCode::SUCCESS);
    }
    let health: Health = serde_json::from_str(&answer)?;
    if !arguments.ask.output.json {
        let Health { status, version, workers, free_bytes, .. } = &health;
        let free = measure::size(*free_bytes);
        println!(
            "{status}: torqued {version}, {}, {free} free",
            measure::counted(*workers, "worker")
        );
        for reason in &health.reasons {
            println!("  {reason}");
        }
    }
    Ok(if health.status == "ok" { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
