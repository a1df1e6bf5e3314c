//! Documents about the command line: scripts of shells, and manual pages.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::{Args, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man;

use crate::cli::Cli;
use crate::output::write_bytes;

#[derive(Debug, Args)]
pub struct CompletionsArguments {
    /// The shell
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

pub fn completions(arguments: &CompletionsArguments) -> anyhow::Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "torqued", &mut script);
    write_bytes(&script)?;
    Ok(ExitCode::SUCCESS)
}

#[derive(Debug, Args)]
pub struct ManArguments {
    /// Write one page per command into this folder, instead of the first page to standard output;
    /// created if missing
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
}

pub fn man(arguments: &ManArguments) -> anyhow::Result<ExitCode> {
    match &arguments.dir {
        None => {
            let mut page = Vec::new();
            Man::new(Cli::command()).render(&mut page).context("cannot write the manual")?;
            write_bytes(&page)?;
        }
        Some(dir) => {
            std::fs::create_dir_all(dir)
                .with_context(|| format!("cannot create {}", dir.display()))?;
            clap_mangen::generate_to(Cli::command(), dir)
                .with_context(|| format!("cannot write into {}", dir.display()))?;
            println!("{}", dir.join("torqued.1").display());
        }
    }
    Ok(ExitCode::SUCCESS)
}
