use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};

use crate::arguments::{OutputArguments, ServerArguments};

/// Lists requests that changed something or were refused: who sent them, from where, and how they
/// were answered. It needs a token of scope admin.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Only actions with the token of this name
    #[arg(long, value_name = "NAME", value_parser = crate::arguments::token_name)]
    actor: Option<String>,

    /// Largest number of entries, 1 to 500
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=500))]
    limit: u32,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let actor = arguments.actor.map(|name| format!("&actor={name}")).unwrap_or_default();
    let path = format!("/v1/audit?limit={}{actor}", arguments.limit);
    if arguments.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let audit = client.audit(&path).await?;
    let mut table = Table::new([
        ("when", Align::Left),
        ("who", Align::Left),
        ("from", Align::Left),
        ("did", Align::Left),
        ("answer", Align::Right),
        ("made", Align::Left),
    ]);
    for entry in audit.entries {
        table.push(vec![
            entry.at,
            entry.actor,
            entry.address,
            format!("{} {}", entry.method, entry.path),
            entry.status.to_string(),
            entry.made.unwrap_or_default(),
        ]);
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}
