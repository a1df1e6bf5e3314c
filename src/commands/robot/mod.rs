//! Commands about one robot, without a server.

mod check;
mod drawing;
mod dynamics;
mod reach;
mod show;
mod survey;

use std::process::ExitCode;

use clap::{Args, Subcommand};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// List joints, links and doubts of an arm, or print its description
    Show(show::Arguments),
    /// Simulate an arm and say how many trajectories stay clear of its limits, and why not all do
    Check(check::Arguments),
    /// Compute accelerations, torques of gravity, mass matrix and hand of an arm at given states
    Dynamics(dynamics::Arguments),
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    match arguments.command {
        Command::Show(arguments) => show::run(&arguments),
        Command::Check(arguments) => check::run(arguments).await,
        Command::Dynamics(arguments) => dynamics::run(&arguments),
    }
}
