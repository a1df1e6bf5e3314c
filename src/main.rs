//! `torqued`: the command line, and the composition of server and workers into one program.

#[macro_use]
mod output;

mod allocator;
mod arguments;
mod bags;
mod cli;
mod client;
mod commands;
mod configuration;
mod device;
mod exit;
mod help;
mod kept_robot;
mod lists;
mod logging;
mod offers;
mod process;
mod progress;
mod resource;
mod robots;
mod server;

use std::io::Write;
use std::process::ExitCode;

use simd::InstructionSet;

use crate::cli::Command;
use crate::client::{ClientError, JobEnded};
use crate::commands::export::MlflowError;
use crate::commands::worker::decode_recording;
use crate::logging::Program;

fn main() -> ExitCode {
    let cli = match configuration::parse() {
        Ok(cli) => cli,
        Err(error) => {
            fail(&error);
            return ExitCode::from(exit::USAGE);
        }
    };
    // It decodes a stranger's file and confines itself, which only a process with one thread can.
    if let Command::DecodeRecording(arguments) = &cli.command {
        return decode_recording(arguments).unwrap_or_else(|error| fail(&error));
    }
    let program = match cli.command {
        Command::Serve(_) => Program::Server,
        Command::Worker(_) => Program::Worker,
        _ => Program::Command,
    };
    let log = logging::start(program, cli.log.as_deref(), cli.log_format);
    if let Err(error) = InstructionSet::chosen() {
        return fail(&anyhow::Error::new(error).context(simd::VARIABLE));
    }
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return fail(&anyhow::Error::new(error).context("cannot start threads")),
    };
    let code = match runtime.block_on(commands::run(cli.command, &log)) {
        Ok(code) => code,
        Err(error) => fail(&error),
    };
    // A running blocking read or computation must not keep the process alive.
    runtime.shutdown_background();
    code
}

/// Prints the error and its causes in one line.
fn fail(error: &anyhow::Error) -> ExitCode {
    // An error is ignored, because stderr is closed then.
    let _ = writeln!(std::io::stderr(), "error: {}", exit::message(error));
    code(error)
}

/// The code of an error that ended a command.
fn code(error: &anyhow::Error) -> ExitCode {
    let of = |cause: &(dyn std::error::Error + 'static)| match cause.downcast_ref::<ClientError>() {
        Some(error) if error.is_unreachable() => Some(exit::UNREACHABLE),
        _ if matches!(cause.downcast_ref(), Some(MlflowError::Unreachable { .. })) => {
            Some(exit::UNREACHABLE)
        }
        _ => cause.is::<JobEnded>().then_some(exit::JOB_FAILED),
    };
    error.chain().find_map(of).map_or(ExitCode::FAILURE, ExitCode::from)
}
