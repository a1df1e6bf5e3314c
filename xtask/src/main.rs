//! Developer commands: `cargo xtask test`, `cargo xtask bench NAME`, `cargo xtask peers`, `cargo xtask dist`.

mod bench;
mod dist;
mod machine;
mod peers;
mod places;
mod process;
mod product;
mod python;
mod test;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Developer commands of torqued.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Install what tests need, check and test everything, and end with one line of counts
    Test(test::Arguments),
    /// Measure, show a table, and say which goals are met
    Bench(bench::Arguments),
    /// Rebuild simulated robots in MuJoCo and Pinocchio and compare their motions with ours
    Peers(peers::Arguments),
    /// Make packages of the program in `dist/`: a wheel and a .deb
    Dist(dist::Arguments),
}

fn main() -> ExitCode {
    let result = bench::instead_of_rustc().and_then(|done| done.map_or_else(developer_command, Ok));
    match result {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn developer_command() -> anyhow::Result<ExitCode> {
    match Cli::parse().command {
        Command::Test(arguments) => test::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Peers(arguments) => peers::run(&arguments),
        Command::Dist(arguments) => dist::run(&arguments),
    }
}
