use std::process::ExitCode;

use anyhow::bail;
use clap::Args;
use reports::{Align, Table};
use wire::Presets;

use crate::arguments::{OptionalServerArguments, OutputArguments};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Print the spec of this preset
    name: Option<String>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: OptionalServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let presets = match arguments.server.client()? {
        Some(client) => client.presets().await?.presets,
        None => spec::presets().to_vec(),
    };
    if arguments.output.json && arguments.name.is_none() {
        write_json(&Presets { presets })?;
        return Ok(ExitCode::SUCCESS);
    }
    let Some(name) = arguments.name else {
        let mut table = Table::new(["name", "of a", "about"].map(|name| (name, Align::Left)));
        for preset in presets {
            table.push(vec![preset.name, preset.place.to_string(), preset.about]);
        }
        print!("{}", table.render());
        return Ok(ExitCode::SUCCESS);
    };
    let Some(preset) = presets.iter().find(|preset| preset.name == name) else {
        let names: Vec<&str> = presets.iter().map(|preset| preset.name.as_str()).collect();
        bail!("there is no preset {name:?}, only {}", names.join(", "));
    };
    if arguments.output.json {
        write_json(preset)?;
    } else {
        println!("{}", serde_json::to_string_pretty(&preset.spec)?);
    }
    Ok(ExitCode::SUCCESS)
}
