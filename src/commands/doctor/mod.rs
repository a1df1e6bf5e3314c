//! Checks this machine, a data folder and a server.

mod machine;
mod server;
mod store;

use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use crate::arguments::{ConfigArguments, OutputArguments, ServerArguments, StoreArguments};
use crate::output::write_json;

/// Checks without changing anything; it can run beside a server. The exit code is 1 if something is
/// wrong.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    store: StoreArguments,

    /// Read every file and compare its SHA-256 digest; this takes as long as reading all data
    #[arg(long)]
    bytes: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let mut report = Findings { output: arguments.output, wrong: 0, doubtful: 0 };
    let client = arguments.server.client()?;
    machine::look(&mut report).await?;
    store::look(&arguments.store.location(), arguments.bytes, &mut report).await?;
    server::look(&client, &mut report).await?;
    if !arguments.output.json {
        println!("{} wrong, {} notes", report.wrong, report.doubtful);
    }
    Ok(if report.wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Prints findings and counts them.
struct Findings {
    output: OutputArguments,
    wrong: usize,
    doubtful: usize,
}

/// A finding about one thing.
#[derive(Debug, Serialize)]
struct Finding<'a> {
    thing: &'a str,
    state: State,
    found: String,
    /// The remedy.
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<&'a str>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum State {
    Ok,
    /// Not a problem, but worth knowing.
    Note,
    Wrong,
}

impl Findings {
    fn good(&mut self, thing: &str, found: impl Into<String>) -> anyhow::Result<()> {
        self.add(&Finding { thing, state: State::Ok, found: found.into(), remedy: None })
    }

    fn note(&mut self, thing: &str, found: impl Into<String>, remedy: &str) -> anyhow::Result<()> {
        self.doubtful += 1;
        let (found, remedy) = (found.into(), Some(remedy));
        self.add(&Finding { thing, state: State::Note, found, remedy })
    }

    fn wrong(&mut self, thing: &str, found: impl Into<String>, remedy: &str) -> anyhow::Result<()> {
        self.wrong += 1;
        let (found, remedy) = (found.into(), Some(remedy));
        self.add(&Finding { thing, state: State::Wrong, found, remedy })
    }

    fn add(&self, finding: &Finding<'_>) -> anyhow::Result<()> {
        if self.output.json {
            write_json(finding)?;
            return Ok(());
        }
        let Finding { thing, state, found, remedy } = finding;
        let state = match state {
            State::Ok => "ok",
            State::Note => "note",
            State::Wrong => "WRONG",
        };
        let remedy = remedy.map(|remedy| format!("; {remedy}")).unwrap_or_default();
        println!("{state:5}  {thing:11}  {found}{remedy}");
        Ok(())
    }
}
