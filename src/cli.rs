//! The command line.

use clap::{Parser, Subcommand};

use crate::commands::{
    attempts, audit, backup, cancel, checkpoints, completions, datasets, decode_recording, delete,
    devices, doctor, download, drain, evaluations, events, export, gc, health, import, jobs, label,
    logs, man, metrics, migrate, open, pause, predict, presets, queue, quickstart, reindex,
    restore, resume, retry, runs, serve, show, simulate, stream, study, submit, summary, tasks,
    token, trajectory, trash, undelete, undrain, verify, watch, worker, workers,
};
use crate::exit;
use crate::logging::{LOG_FORMAT, LogFormat};

/// In-context identification of robot dynamics as a service: simulate, train, evaluate.
#[derive(Debug, Parser)]
#[command(name = "torqued", version, about, max_term_width = 100, after_help = exit::HELP)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,

    /// What to log to stderr: error, warn, info, debug, or a filter such as `warn,worker=debug`
    #[arg(long, global = true, env = "TORQUED_LOG", value_name = "FILTER")]
    pub log: Option<String>,

    /// How log lines are written: for people, or one JSON object each
    #[arg(long, global = true, env = LOG_FORMAT, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the server and its workers
    Serve(serve::Arguments),
    /// Run one worker; `serve` starts its own
    Worker(worker::Arguments),
    /// Look whether this machine, a data folder and a server are as they should be
    Doctor(doctor::Arguments),
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
    /// Ask a checkpoint where joints will be
    Predict(predict::Arguments),
    /// Ask a checkpoint at every sample: messages on standard input, answers on standard output
    Stream(stream::Arguments),
    /// Send recordings of one's own and make them a dataset
    Import(import::Arguments),
    /// List workers, and what each does
    Workers(workers::Arguments),
    /// Say whether the server works, and tasks are executed
    Health(health::Arguments),
    /// Say whether tasks are begun, and how many there are
    Queue(queue::Arguments),
    /// List jobs, newest first
    Jobs(jobs::Arguments),
    /// List datasets, newest first
    Datasets(datasets::Arguments),
    /// List runs, newest first: the records of trainings, evaluations and control jobs
    Runs(runs::Arguments),
    /// List checkpoints, newest first
    Checkpoints(checkpoints::Arguments),
    /// List evaluations, newest first
    Evaluations(evaluations::Arguments),
    /// Show a job, a dataset, a run, a checkpoint or an evaluation
    Show(show::Arguments),
    /// Bring the files of a dataset, a checkpoint, a run or an evaluation into a folder
    Download(download::Arguments),
    /// Write a dataset for LeRobot, a checkpoint for the Hugging Face hub, or runs to an MLflow server
    Export(export::Arguments),
    /// Print the metrics of a run as CSV
    Metrics(metrics::Arguments),
    /// Show what the trajectories of a dataset are like
    Summary(summary::Arguments),
    /// Print a trajectory of a dataset
    Trajectory(trajectory::Arguments),
    /// Open the page in a browser, and print its address
    Open(open::Arguments),
    /// List the tasks of a job, in the order in which they run
    Tasks(tasks::Arguments),
    /// List every time that a worker had a task of a job, and how it ended
    Attempts(attempts::Arguments),
    /// Print what the tasks of a job logged
    Logs(logs::Arguments),
    /// Follow a job until it ends
    Watch(watch::Arguments),
    /// Name a job, a run, a dataset or a checkpoint, tag it, and note something on it
    Label(label::Arguments),
    /// Print what happens to jobs, as it happens
    Events(events::Arguments),
    /// Cancel a job
    Cancel(cancel::Arguments),
    /// Try a job again that failed; what succeeded is kept
    Retry(retry::Arguments),
    /// Move jobs, runs, datasets or checkpoints into the trash
    Delete(delete::Arguments),
    /// Take things out of the trash
    Undelete(undelete::Arguments),
    /// List what is in the trash, and until when
    Trash(trash::Arguments),
    /// Empty the trash of what has had its time, and delete files that nothing refers to
    Gc(gc::Arguments),
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
    /// Make a lost database again from datasets and checkpoints
    Reindex(reindex::Arguments),
    /// Move a data folder to PostgreSQL and a bucket, or back
    Migrate(migrate::Arguments),
    /// List the presets, or show one
    Presets(presets::Arguments),
    /// Print what completes commands and flags in a shell
    Completions(completions::Arguments),
    /// Print the manual
    Man(man::Arguments),
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
    fn every_command_that_asks_a_server_can_answer_in_json() {
        // A stream is JSON on both sides, and `open` shows a page.
        let other = |name: &str| ["open", "stream"].contains(&name);
        for command in Cli::command().get_subcommands().filter(|it| !other(it.get_name())) {
            let has = |flag| command.get_arguments().any(|it| it.get_long() == Some(flag));
            assert!(!has("server") || has("json"), "{}", command.get_name());
        }
    }

    /// The operations of the API and the command that does each.
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
        ("get /v1/checkpoints/{id}/stream", "stream"),
        ("get /v1/evaluations", "evaluations"),
        ("get /v1/evaluations/{id}", "show"),
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
