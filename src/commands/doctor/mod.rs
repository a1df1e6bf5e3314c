//! Checks this machine, a data folder and a server.

mod store;

use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use clap::Args;
use nix::sys::resource::{Resource, getrlimit};
use recordings::Mechanism;
use serde::Serialize;
use wire::Health;
use worker::DeviceKind;

use crate::arguments::{ConfigArguments, OutputArguments, ServerArguments, StoreArguments};
use crate::client::{Client, ClientError};
use crate::device;
use crate::output::write_json;
use crate::progress::measure;

/// Checks without changing anything; it can run beside a server. The exit code is 1 if something is
/// wrong.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    store: StoreArguments,

    /// Read every file and compare its SHA-256 digest; this takes as long as reading all data
    #[arg(long)]
    bytes: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let mut report = Findings { output: arguments.output, wrong: 0, doubtful: 0 };
    let client = arguments.server.client()?;
    look_at_machine(&mut report).await?;
    store::look(&arguments.store.location(), arguments.bytes, &mut report).await?;
    look_at_server(&client, &mut report).await?;
    if !arguments.output.json {
        println!("{} wrong, {} notes", report.wrong, report.doubtful);
    }
    Ok(if report.wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// A clock with an earlier time than this is wrong: 2026-01-01T00:00:00Z.
const EARLIEST: Duration = Duration::from_secs(1_767_225_600);

/// A server uses at most one connection per this many files that it may open.
const FILES_PER_CONNECTION: u64 = 4;

async fn look_at_machine(report: &mut Findings) -> anyhow::Result<()> {
    clock(report)?;
    files(report)?;
    isolation(report)?;
    for kind in DeviceKind::ALL.into_iter().filter(|kind| kind.is_built()) {
        match device::probe(kind).await {
            Ok(probed) => {
                let adapter = probed.device.adapter.unwrap_or("this processor".to_owned());
                report.good("device", format!("{kind}: {adapter}, {:.2} s", probed.seconds))?;
            }
            Err(error) => {
                let remedy = "see torqued devices; serve and worker take another --device";
                report.wrong("device", format!("{kind}: {error}"), remedy)?;
            }
        }
    }
    Ok(())
}

fn clock(report: &mut Findings) -> anyhow::Result<()> {
    let now = SystemTime::now();
    let shown = humantime::format_rfc3339_seconds(now);
    match now.duration_since(SystemTime::UNIX_EPOCH) {
        Ok(since) if since >= EARLIEST => report.good("clock", shown.to_string()),
        _ => report.wrong("clock", shown.to_string(), "set it, with NTP if possible"),
    }
}

/// Checks the limit of open files. A server raises its own limit as far as it may.
fn files(report: &mut Findings) -> anyhow::Result<()> {
    let (_, most) = getrlimit(Resource::RLIMIT_NOFILE)?;
    let needed = FILES_PER_CONNECTION * api::limits::CONNECTIONS as u64;
    let found = format!("a process may open {most}");
    if most >= needed {
        return report.good("files", found);
    }
    let found = format!("{found}, which allows {} connections", most / FILES_PER_CONNECTION);
    report.note("files", found, "raise ulimit -Hn, or LimitNOFILE= of the systemd unit")
}

/// Checks whether a process that decodes an uploaded file can be kept from other files.
fn isolation(report: &mut Findings) -> anyhow::Result<()> {
    let missing = recordings::missing_mechanisms();
    let names: Vec<String> = missing.iter().map(ToString::to_string).collect();
    if missing.contains(&Mechanism::Seccomp) {
        let found = format!("uploads are decoded without {}", names.join(" and without "));
        let remedy = "whoever sends a file could read those of the worker if a decoder has a hole; \
                      use Linux, and a container that allows seccomp";
        return report.note("isolation", found, remedy);
    }
    let without = if missing.is_empty() { "and Landlock" } else { "alone" };
    report.good("isolation", format!("uploads are decoded behind seccomp {without}"))
}

async fn look_at_server(client: &Client, report: &mut Findings) -> anyhow::Result<()> {
    let url = client.url("");
    let health: Health = match client.get("/healthz").await {
        Ok(health) => health,
        Err(ClientError::Unreachable { .. }) => {
            let remedy = "torqued serve starts one; --server names another";
            return report.note("server", format!("none answers at {url}"), remedy);
        }
        Err(error) => {
            return report.wrong("server", error.to_string(), "its log has the details");
        }
    };
    let own = env!("CARGO_PKG_VERSION");
    if health.version == own {
        let workers = measure::counted(health.workers, "worker");
        report.good("server", format!("torqued {own} at {url}, {workers}"))?;
    } else {
        let found = format!("torqued {} at {url}, and this is {own}", health.version);
        report.note("server", found, "install the same version for both")?;
    }
    for reason in &health.reasons {
        report.wrong("server", reason, "tasks wait until this is fixed")?;
    }
    match client.queue().await {
        Ok(queue) if queue.paused => report.note("queue", "paused", "torqued resume resumes it"),
        Ok(queue) => {
            let found = format!("{} tasks wait, {} run", queue.queued, queue.running);
            report.good("queue", found)
        }
        Err(error) => report.wrong("queue", error.to_string(), "is TORQUED_TOKEN right?"),
    }
}

/// Prints findings and counts them.
struct Findings {
    output: OutputArguments,
    wrong: usize,
    doubtful: usize,
}

/// A finding about one thing.
#[derive(Debug, Serialize)]
struct Finding<'a> {
    thing: &'a str,
    state: State,
    found: String,
    /// The remedy.
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<&'a str>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum State {
    Ok,
    /// Not a problem, but worth knowing.
    Note,
    Wrong,
}

impl Findings {
    fn good(&mut self, thing: &str, found: impl Into<String>) -> anyhow::Result<()> {
        self.add(&Finding { thing, state: State::Ok, found: found.into(), remedy: None })
    }

    fn note(&mut self, thing: &str, found: impl Into<String>, remedy: &str) -> anyhow::Result<()> {
        self.doubtful += 1;
        let (found, remedy) = (found.into(), Some(remedy));
        self.add(&Finding { thing, state: State::Note, found, remedy })
    }

    fn wrong(&mut self, thing: &str, found: impl Into<String>, remedy: &str) -> anyhow::Result<()> {
        self.wrong += 1;
        let (found, remedy) = (found.into(), Some(remedy));
        self.add(&Finding { thing, state: State::Wrong, found, remedy })
    }

    fn add(&self, finding: &Finding<'_>) -> anyhow::Result<()> {
        if self.output.json {
            write_json(finding)?;
            return Ok(());
        }
        let Finding { thing, state, found, remedy } = finding;
        let state = match state {
            State::Ok => "ok",
            State::Note => "note",
            State::Wrong => "WRONG",
        };
        let remedy = remedy.map(|remedy| format!("; {remedy}")).unwrap_or_default();
        println!("{state:5}  {thing:11}  {found}{remedy}");
        Ok(())
    }
}
