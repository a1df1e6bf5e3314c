//! Commands about robots. Those that look at one need no server, unless it keeps the robot.

mod check;
mod dynamics;
mod keep;
mod reach;
mod show;
mod survey;

use std::process::ExitCode;

use clap::{Args, Subcommand};

use crate::lists;

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
    /// Send an arm to a server, which keeps it for specs, and print its id and doubts
    Add(keep::AddArguments),
    /// List the robots of a server, newest first
    List(lists::Arguments<wire::Robot>),
    /// Delete robots from a server; jobs keep their copies
    Remove(keep::RemoveArguments),
    /// Compute accelerations, torques of gravity, mass matrix and hand of an arm at given states
    Dynamics(dynamics::Arguments),
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    match arguments.command {
        Command::Show(arguments) => show::run(arguments).await,
        Command::Check(arguments) => check::run(arguments).await,
        Command::Dynamics(arguments) => dynamics::run(&arguments).await,
        Command::Add(arguments) => keep::add(arguments).await,
        Command::List(arguments) => lists::run(arguments).await,
        Command::Remove(arguments) => keep::remove(arguments).await,
    }
}
