use std::time::{Duration, SystemTime};

use nix::sys::resource::{Resource, getrlimit};
use recordings::Mechanism;
use worker::DeviceKind;

use super::Findings;
use crate::device;

/// A clock with an earlier time than this is wrong: 2026-01-01T00:00:00Z.
const EARLIEST: Duration = Duration::from_secs(1_767_225_600);

/// A server uses at most one connection per this many files that it may open.
const FILES_PER_CONNECTION: u64 = 4;

pub async fn look(report: &mut Findings) -> anyhow::Result<()> {
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
