use std::process::ExitCode;

use clap::Args;
use wire::Trash;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::lists;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Largest number of things to list
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=500))]
    limit: u32,

    /// Only things after this position, which the previous list printed at its end
    #[arg(long, value_name = "PLACE")]
    before: Option<String>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let before = arguments.before.map(|place| format!("&before={place}")).unwrap_or_default();
    let path = format!("/v1/trash?limit={}{before}", arguments.limit);
    if arguments.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let Trash { items, next } = client.get(&path).await?;
    print!("{}", lists::table(&items));
    if let Some(next) = next {
        println!("deleted before: torqued trash --before {next}");
    }
    Ok(ExitCode::SUCCESS)
}
