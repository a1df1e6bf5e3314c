use std::process::ExitCode;

use clap::Args;
use wire::Restored;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::commands::delete::in_words;
use crate::output::write_json;
use crate::resource::Deletable;

/// Restores things from the trash, with everything that was deleted together with them.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The kind of things
    #[arg(value_name = "KIND")]
    kind: Deletable,

    /// Their ids
    #[arg(value_name = "ID", required = true)]
    ids: Vec<i64>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    for id in arguments.ids {
        let path = format!("{}/restore", arguments.kind.api_path(id));
        let restored: Restored = client.post(&path).await?;
        if arguments.output.json {
            write_json(&restored)?;
        } else {
            println!("{} {id} is restored{}", restored.kind, in_words(&restored.along));
        }
    }
    Ok(ExitCode::SUCCESS)
}
