//! The command line.

use clap::{Parser, Subcommand};

use crate::commands::{
    access, attempts, compare, copies, delete, doctor, documents, download, events, excite, export,
    gc, health, identify, import, label, logs, metrics, open, predict, presets, queue, reindex,
    robot, serve, show, simulate, study, submit, summary, tasks, trajectory, trash, undelete,
    verify, watch, worker, workers,
};
use crate::logging::{LOG_FORMAT, LogFormat};
use crate::{exit, lists};

/// In-context identification of robot dynamics as a service: simulate, train, evaluate.
#[derive(Debug, Parser)]
#[command(name = "torqued", version, about, max_term_width = 100, after_help = exit::HELP)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,

    /// Log filter for stderr: error, warn, info, debug, or a filter such as `warn,worker=debug`
    #[arg(long, global = true, env = "TORQUED_LOG", value_name = "FILTER")]
    pub log: Option<String>,

    /// Format of log lines: text for people, or one JSON object per line
    #[arg(long, global = true, env = LOG_FORMAT, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the server and its workers
    Serve(serve::Arguments),
    /// Run one worker; `serve` starts its own
    Worker(worker::Arguments),
    /// Check this machine, a data folder and a server
    Doctor(doctor::Arguments),
    /// List the devices that can compute models, and test each
    Devices(worker::DevicesArguments),
    /// Simulate, train and evaluate a small model, and show the result
    Quickstart(serve::QuickstartArguments),
    /// Run a whole study and write its report
    Study(study::Arguments),
    /// Simulate a dataset into a folder, without a server
    Simulate(simulate::Arguments),
    /// Make a dataset again and compare every byte
    Verify(verify::Arguments),
    /// Submit a job
    Submit(submit::Arguments),
    /// Predict joint positions with a checkpoint
    Predict(predict::Arguments),
    /// Predict at every sample, from standard input to standard output
    Stream(predict::StreamArguments),
    /// Upload your own recordings and turn them into a dataset
    Import(import::Arguments),
    /// Identify an arm from its URDF and logs, on this machine
    Identify(Box<identify::Arguments>),
    /// Design a motion that shows the parameters of an arm
    Excite(Box<excite::Arguments>),
    /// List workers with their tasks
    Workers(workers::Arguments),
    /// Show whether the server works and tasks are executed
    Health(health::Arguments),
    /// Show whether the queue is paused, and how many tasks it has
    Queue(queue::Arguments),
    /// List jobs, newest first
    Jobs(lists::Arguments<wire::Job>),
    /// List datasets, newest first
    Datasets(lists::Arguments<wire::Dataset>),
    /// List runs of trainings, evaluations and control jobs
    Runs(lists::Arguments<wire::Run>),
    /// List checkpoints, newest first
    Checkpoints(lists::Arguments<wire::Checkpoint>),
    /// List evaluations, newest first
    Evaluations(lists::Arguments<wire::Evaluation>),
    /// Show a job, a dataset, a run, a checkpoint or an evaluation
    Show(show::Arguments),
    /// Download files of a dataset, a checkpoint, a run or an evaluation
    Download(download::Arguments),
    /// Write data for LeRobot, a model for Hugging Face, runs for MLflow
    Export(export::Arguments),
    /// Print the metrics of a run as CSV
    Metrics(metrics::Arguments),
    /// Show what runs have set differently, and what came out
    Compare(compare::Arguments),
    /// Show the channels, the arms and the spectra of a dataset
    Summary(summary::Arguments),
    /// Print a trajectory of a dataset
    Trajectory(trajectory::Arguments),
    /// Open the page in a browser and print its address
    Open(open::Arguments),
    /// List the tasks of a job, in the order in which they run
    Tasks(tasks::Arguments),
    /// List the attempts at a job's tasks, and how they ended
    Attempts(attempts::Arguments),
    /// Print the logs of a job's tasks
    Logs(logs::Arguments),
    /// Follow a job until it ends
    Watch(watch::Arguments),
    /// Give something a name, tags, a note or an alias
    Label(label::Arguments),
    /// Print events of jobs as they happen
    Events(events::Arguments),
    /// Cancel a job
    Cancel(submit::CancelArguments),
    /// Run a failed or cancelled job again; completed parts are kept
    Retry(submit::RetryArguments),
    /// Move jobs, runs, datasets or checkpoints into the trash
    Delete(delete::Arguments),
    /// Restore things from the trash
    Undelete(undelete::Arguments),
    /// List the trash, and until when things can be restored
    Trash(trash::Arguments),
    /// Delete what expired in the trash, and files without a use
    Gc(gc::Arguments),
    /// Pause the queue: no more tasks begin, and running tasks go on
    Pause(queue::PauseArguments),
    /// Resume the queue after a pause
    Resume(queue::Arguments),
    /// Drain a worker: it begins no more tasks and ends its own
    Drain(queue::DrainArguments),
    /// Undrain a worker: it begins tasks again
    Undrain(queue::UndrainArguments),
    /// Create, list and revoke access tokens
    Token(access::Arguments),
    /// List changes and who made them, newest first
    Audit(access::AuditArguments),
    /// Copy everything into a new data folder while servers run
    Backup(copies::BackupArguments),
    /// Copy a backup to a new place
    Restore(copies::RestoreArguments),
    /// Rebuild a lost database from datasets and checkpoints
    Reindex(reindex::Arguments),
    /// Move a data folder to PostgreSQL and a bucket, or back
    Migrate(copies::MigrateArguments),
    /// Show, check or compute an arm, and keep it on a server
    Robot(robot::Arguments),
    /// List the presets, or show one
    Presets(presets::Arguments),
    /// Print a script that completes commands and flags in a shell
    Completions(documents::CompletionsArguments),
    /// Print the manual pages
    Man(documents::ManArguments),
    /// Decode the recording on standard input; workers start this themselves
    #[command(hide = true)]
    DecodeRecording(worker::DecodeArguments),
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
    fn every_command_that_asks_a_server_can_answer_in_json() {
        // A stream is JSON in both directions, and `open` shows a page.
        let other = |name: &str| ["open", "stream"].contains(&name);
        for command in
            Cli::command().get_subcommands().filter(|subcommand| !other(subcommand.get_name()))
        {
            let has =
                |flag| command.get_arguments().any(|argument| argument.get_long() == Some(flag));
            assert!(!has("server") || has("json"), "{}", command.get_name());
        }
    }

    /// The operations of the API, with their commands.
    const COMMANDS: &[(&str, &str)] = &[
        ("get /healthz", "health"),
        ("get /readyz", "health"),
        ("get /metrics", "health"),
        ("get /v1/presets", "presets"),
        ("get /v1/jobs", "jobs"),
        ("post /v1/jobs", "submit"),
        ("get /v1/jobs/{id}", "show"),
        ("patch /v1/jobs/{id}", "label"),
        ("patch /v1/runs/{id}", "label"),
        ("patch /v1/datasets/{id}", "label"),
        ("patch /v1/checkpoints/{id}", "label"),
        ("post /v1/jobs/{id}/cancel", "cancel"),
        ("post /v1/jobs/{id}/retry", "retry"),
        ("get /v1/jobs/{id}/tasks", "tasks"),
        ("get /v1/jobs/{id}/attempts", "attempts"),
        ("get /v1/jobs/{id}/logs", "logs"),
        ("get /v1/attempts/{id}/log", "logs"),
        ("get /v1/datasets", "datasets"),
        ("post /v1/datasets", "import"),
        ("get /v1/datasets/{id}", "show"),
        ("get /v1/datasets/{id}/files/{name}", "download"),
        ("get /v1/datasets/{id}/tar", "download"),
        ("post /v1/datasets/{id}/verify", "verify"),
        ("get /v1/datasets/{id}/trajectories/{index}", "trajectory"),
        ("get /v1/datasets/{id}/trajectories/{index}/figure.svg", "trajectory"),
        ("get /v1/datasets/{id}/trajectories/{index}/figure.csv", "trajectory"),
        ("get /v1/datasets/{id}/trajectories/{index}/predictions", "predict"),
        ("get /v1/datasets/{id}/summary", "summary"),
        ("get /v1/datasets/{id}/spectrum.svg", "summary"),
        ("get /v1/datasets/{id}/spectrum.csv", "summary"),
        ("get /v1/runs", "runs"),
        ("get /v1/runs/{id}", "show"),
        ("get /v1/runs/{id}/metrics/{key}", "metrics"),
        ("get /v1/runs/{id}/metrics/{group}/{name}", "metrics"),
        ("get /v1/runs/{id}/artifacts/{name}", "download"),
        ("get /v1/runs/{id}/figures/{name}", "metrics"),
        ("get /v1/checkpoints", "checkpoints"),
        ("get /v1/checkpoints/{id}", "show"),
        ("get /v1/checkpoints/{id}/files/{name}", "download"),
        ("get /v1/checkpoints/{id}/tar", "download"),
        ("post /v1/checkpoints/{id}/predict", "predict"),
        ("post /v1/checkpoints/{id}/torque", "predict"),
        ("get /v1/checkpoints/{id}/stream", "stream"),
        ("get /v1/evaluations", "evaluations"),
        ("get /v1/evaluations/{id}", "show"),
        ("get /v1/robots", "robot"),
        ("post /v1/robots", "robot"),
        ("get /v1/robots/{id}", "robot"),
        ("get /v1/robots/{id}/{name}", "robot"),
        ("delete /v1/robots/{id}", "robot"),
        ("get /v1/workers", "workers"),
        ("post /v1/workers/{name}/drain", "drain"),
        ("post /v1/workers/{name}/undrain", "undrain"),
        ("get /v1/queue", "queue"),
        ("post /v1/queue/pause", "pause"),
        ("post /v1/queue/resume", "resume"),
        ("get /v1/tokens", "token"),
        ("post /v1/tokens", "token"),
        ("delete /v1/tokens/{id}", "token"),
        ("get /v1/audit", "audit"),
        ("delete /v1/jobs/{id}", "delete"),
        ("get /v1/jobs/{id}/dependents", "delete"),
        ("post /v1/jobs/{id}/restore", "undelete"),
        ("delete /v1/runs/{id}", "delete"),
        ("get /v1/runs/{id}/dependents", "delete"),
        ("post /v1/runs/{id}/restore", "undelete"),
        ("delete /v1/datasets/{id}", "delete"),
        ("get /v1/datasets/{id}/dependents", "delete"),
        ("post /v1/datasets/{id}/restore", "undelete"),
        ("delete /v1/checkpoints/{id}", "delete"),
        ("get /v1/checkpoints/{id}/dependents", "delete"),
        ("post /v1/checkpoints/{id}/restore", "undelete"),
        ("get /v1/trash", "trash"),
        ("get /v1/events", "events"),
        ("get /v1/jobs/{id}/events", "watch"),
        ("get /v1/runs/{id}/events", "events"),
    ];

    #[test]
    fn everything_that_the_api_does_has_a_command() {
        let document = serde_json::to_value(api::openapi()).unwrap();
        let paths = document["paths"].as_object().unwrap();
        let methods = |path: &str| paths[path].as_object().unwrap().keys().cloned();
        let operations = paths.keys().flat_map(|path| {
            methods(path).map(move |method| format!("{method} {path}")).collect::<Vec<_>>()
        });
        let cli = Cli::command();
        for operation in operations {
            let found = COMMANDS.iter().find(|(known, _)| *known == operation);
            let (_, command) = found.unwrap_or_else(|| panic!("no command does {operation}"));
            assert!(cli.find_subcommand(command).is_some(), "{command}");
        }
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
