use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::logging::Logging;
use crate::server::{Interrupts, Options, Server};

#[derive(Debug, Args)]
pub struct Arguments {
    /// TOML file with these flags as keys, such as `max_connections = 64`; flags and environment
    /// variables take precedence
    #[arg(long, env = "TORQUED_CONFIG", value_name = "FILE")]
    pub config: Option<PathBuf>,

    #[command(flatten)]
    server: Options,
}

pub async fn run(arguments: Arguments, log: &Logging) -> anyhow::Result<ExitCode> {
    let mut interrupts = Interrupts::new()?;
    let server = Server::start(&arguments.server, log).await?;
    println!("torqued {} at {}", env!("CARGO_PKG_VERSION"), server.url);
    server.run_until_interrupted(&mut interrupts).await?;
    Ok(ExitCode::SUCCESS)
}
