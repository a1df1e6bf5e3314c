//! The command line.

use clap::{Parser, Subcommand};

use crate::commands::{
    attempts, audit, backup, cancel, decode_recording, devices, drain, import, jobs, logs, migrate,
    pause, presets, quickstart, restore, resume, retry, serve, simulate, study, submit, token,
    undrain, verify, watch, worker, workers,
};

/// In-context identification of robot dynamics as a service: simulate, train, evaluate.
#[derive(Debug, Parser)]
#[command(name = "torqued", version, about, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,

    /// What to log to stderr: error, warn, info, debug, or a filter such as `warn,worker=debug`
    #[arg(long, global = true, env = "TORQUED_LOG", value_name = "FILTER")]
    pub log: Option<String>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the server and its workers
    Serve(serve::Arguments),
    /// Run one worker; `serve` starts its own
    Worker(worker::Arguments),
    /// List what models can be computed on, and try each
    Devices(devices::Arguments),
    /// Simulate, train and evaluate a small model, and show the result
    Quickstart(quickstart::Arguments),
    /// Run the paper's whole study, and write its report
    Study(study::Arguments),
    /// Simulate a dataset into a folder, without a server
    Simulate(simulate::Arguments),
    /// Make a dataset again, and compare every byte
    Verify(verify::Arguments),
    /// Submit a job
    Submit(submit::Arguments),
    /// Send recordings of one's own and make them a dataset
    Import(import::Arguments),
    /// List workers, and what each does
    Workers(workers::Arguments),
    /// List jobs, newest first
    Jobs(jobs::Arguments),
    /// List every time that a worker had a task of a job, and how it ended
    Attempts(attempts::Arguments),
    /// Print what the tasks of a job logged
    Logs(logs::Arguments),
    /// Follow a job until it ends
    Watch(watch::Arguments),
    /// Cancel a job
    Cancel(cancel::Arguments),
    /// Try a job again that failed; what succeeded is kept
    Retry(retry::Arguments),
    /// Have no more tasks begun; those that run go on
    Pause(pause::Arguments),
    /// Have tasks begun again after a pause
    Resume(resume::Arguments),
    /// Have a worker begin no more tasks; the one that it has goes on
    Drain(drain::Arguments),
    /// Have a worker that was drained begin tasks again
    Undrain(undrain::Arguments),
    /// Make, list and revoke the tokens that let people in
    Token(token::Arguments),
    /// List who changed what, newest first
    Audit(audit::Arguments),
    /// Copy everything into a new data folder while servers and workers go on
    Backup(backup::Arguments),
    /// Copy a backup to a new place
    Restore(restore::Arguments),
    /// Move a data folder to PostgreSQL and a bucket, or back
    Migrate(migrate::Arguments),
    /// List the presets, or show one
    Presets(presets::Arguments),
    /// Decode the recording on standard input; a worker starts this for itself
    #[command(hide = true)]
    DecodeRecording(decode_recording::Arguments),
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_and_flag_explains_itself() {
        for command in Cli::command().get_subcommands() {
            assert!(command.get_about().is_some(), "{} has no description", command.get_name());
            for argument in command.get_arguments() {
                let name = argument.get_id();
                assert!(argument.get_help().is_some(), "{} {name} has no help", command.get_name());
            }
        }
    }
}
