//! Shared by commands that start a server of their own.

use std::process::ExitCode;

use crate::exit::INTERRUPTED;
use crate::logging::Logging;
use crate::server::{Interrupts, Options, Server};

/// Does `work` with a server. Then serves until Ctrl-C, unless `exit` is set or the work failed.
pub async fn work_and_serve(
    options: &Options,
    log: &Logging,
    exit: bool,
    work: impl AsyncFnOnce(&Server) -> anyhow::Result<()>,
) -> anyhow::Result<ExitCode> {
    let mut interrupts = Interrupts::new()?;
    let server = Server::start(options, log).await?;
    let result = tokio::select! {
        result = work(&server) => result,
        () = interrupts.next() => {
            eprintln!("stopping; run the command again to continue");
            server.stop(&mut interrupts).await;
            return Ok(ExitCode::from(INTERRUPTED));
        }
    };
    if result.is_err() || exit {
        server.stop(&mut interrupts).await;
        return result.map(|()| ExitCode::SUCCESS);
    }
    eprintln!("serving until Ctrl-C");
    server.run_until_interrupted(&mut interrupts).await?;
    Ok(ExitCode::SUCCESS)
}
