//! One file per command.

pub mod access;
pub mod attempts;
pub mod compare;
pub mod copies;
pub mod delete;
pub mod doctor;
pub mod documents;
pub mod download;
pub mod events;
pub mod excite;
pub mod export;
pub mod gc;
pub mod health;
pub mod identify;
pub mod import;
pub mod label;
pub mod logs;
pub mod metrics;
pub mod open;
pub mod predict;
pub mod presets;
pub mod queue;
pub mod reindex;
pub mod result_folder;
pub mod robot;
pub mod serve;
pub mod show;
pub mod simulate;
pub mod study;
pub mod submit;
pub mod summary;
pub mod tasks;
pub mod trajectory;
pub mod trash;
pub mod undelete;
pub mod verify;
pub mod watch;
pub mod worker;
pub mod workers;

use std::process::ExitCode;

use crate::cli::Command;
use crate::lists;
use crate::logging::Logging;

/// Runs a command.
pub async fn run(command: Command, log: &Logging) -> anyhow::Result<ExitCode> {
    match command {
        Command::Serve(arguments) => serve::run(arguments, log).await,
        Command::Worker(arguments) => worker::run(arguments, &log.attempt).await,
        Command::Devices(arguments) => worker::devices(&arguments).await,
        Command::Quickstart(arguments) => serve::quickstart(arguments, log).await,
        Command::Study(arguments) => study::run(arguments, log).await,
        Command::Simulate(arguments) => simulate::run(arguments).await,
        Command::Verify(arguments) => verify::run(arguments).await,
        Command::Submit(arguments) => submit::run(arguments).await,
        Command::Identify(arguments) => identify::run(&arguments).await,
        Command::Excite(arguments) => excite::run(&arguments).await,
        Command::Import(arguments) => import::run(arguments).await,
        Command::Workers(arguments) => workers::run(arguments).await,
        Command::Jobs(arguments) => lists::run(arguments).await,
        Command::Attempts(arguments) => attempts::run(arguments).await,
        Command::Logs(arguments) => logs::run(arguments).await,
        Command::Label(arguments) => label::run(arguments).await,
        Command::Watch(arguments) => watch::run(arguments).await,
        Command::Events(arguments) => events::run(arguments).await,
        Command::Cancel(arguments) => submit::cancel(arguments).await,
        Command::Retry(arguments) => submit::retry(arguments).await,
        Command::Delete(arguments) => delete::run(arguments).await,
        Command::Undelete(arguments) => undelete::run(arguments).await,
        Command::Trash(arguments) => trash::run(arguments).await,
        Command::Gc(arguments) => gc::run(arguments).await,
        Command::Pause(arguments) => queue::pause(arguments).await,
        Command::Resume(arguments) => queue::resume(arguments).await,
        Command::Drain(arguments) => queue::drain(arguments).await,
        Command::Undrain(arguments) => queue::undrain(arguments).await,
        Command::Token(arguments) => access::run(arguments).await,
        Command::Audit(arguments) => access::audit(arguments).await,
        Command::Backup(arguments) => copies::backup(arguments).await,
        Command::Reindex(arguments) => reindex::run(arguments).await,
        Command::Robot(arguments) => robot::run(arguments).await,
        Command::Restore(arguments) => copies::restore(arguments).await,
        Command::Migrate(arguments) => copies::migrate(arguments).await,
        Command::Presets(arguments) => presets::run(arguments).await,
        Command::Checkpoints(arguments) => lists::run(arguments).await,
        Command::Completions(arguments) => documents::completions(&arguments),
        Command::Datasets(arguments) => lists::run(arguments).await,
        Command::Doctor(arguments) => doctor::run(arguments).await,
        Command::Download(arguments) => download::run(arguments).await,
        Command::Export(arguments) => export::run(arguments).await,
        Command::Evaluations(arguments) => lists::run(arguments).await,
        Command::Health(arguments) => health::run(arguments).await,
        Command::Man(arguments) => documents::man(&arguments),
        Command::Metrics(arguments) => metrics::run(arguments).await,
        Command::Compare(arguments) => compare::run(arguments).await,
        Command::Open(arguments) => open::run(arguments).await,
        Command::Predict(arguments) => predict::run(arguments).await,
        Command::Queue(arguments) => queue::run(arguments).await,
        Command::Runs(arguments) => lists::run(arguments).await,
        Command::Show(arguments) => show::run(arguments).await,
        Command::Stream(arguments) => predict::stream(arguments).await,
        Command::Summary(arguments) => summary::run(arguments).await,
        Command::Tasks(arguments) => tasks::run(arguments).await,
        Command::Trajectory(arguments) => trajectory::run(arguments).await,
        // `main` has done so, without threads.
        Command::DecodeRecording(arguments) => worker::decode_recording(&arguments),
    }
}
