use std::process::ExitCode;

use clap::Args;

use crate::server::{Interrupts, Options, Server};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    server: Options,
}

pub async fn run(arguments: Arguments, log: &str) -> anyhow::Result<ExitCode> {
    let mut interrupts = Interrupts::new()?;
    let server = Server::start(&arguments.server, log).await?;
    println!("torqued {} at {}", env!("CARGO_PKG_VERSION"), server.url);
    server.run_until_interrupted(&mut interrupts).await?;
    Ok(ExitCode::SUCCESS)
}
