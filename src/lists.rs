//! The flags that all lists of a server share, and their last line.

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};

/// Which part of a list is wanted.
#[derive(Debug, Args)]
pub struct ListArguments {
    /// At most so many
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=500))]
    limit: u32,

    /// Only those with a smaller id, which are older
    #[arg(long, value_name = "ID")]
    before: Option<i64>,

    #[command(flatten)]
    pub output: OutputArguments,

    #[command(flatten)]
    pub server: ServerArguments,
}

impl ListArguments {
    /// The address of that part of the list at `path`.
    pub fn path(&self, path: &str) -> String {
        let before = self.before.map(|id| format!("&before={id}")).unwrap_or_default();
        format!("{path}?limit={}{before}", self.limit)
    }
}

/// Says how the list goes on, if it does.
pub fn print_next(command: &str, next: Option<i64>) {
    if let Some(next) = next {
        println!("older ones: torqued {command} --before {next}");
    }
}
