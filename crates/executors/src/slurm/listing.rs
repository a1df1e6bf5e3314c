//! Reads Slurm's lists of jobs.

use spec::Resources;

use super::NOTICE;
use crate::local::GAVE_UP;
use crate::resources::{read, written};
use crate::{Cause, End, EngineError, Phase, PlacedWorker};

/// The fields that `squeue` prints for a job. The comment may hold anything, so it comes last.
pub const FORMAT: &str = "--Format=JobID:|,Name:|,State:|,Reason:|,NodeList:|,exit_code:|,PreemptTime:|,TimeLeft:|,Comment:";

/// Completes "worker NAME ..." for a worker whose place another job takes.
pub const PREEMPTED: &str = "was preempted by Slurm";

/// The mark in the comment of a worker that keeps running when it finds no task.
const STAYS: &str = ";stays";

/// The comment of a worker's job.
pub fn comment(resources: &Resources, stays: bool) -> String {
    format!("{}{}", written(resources), if stays { STAYS } else { "" })
}

/// The workers among the jobs that `squeue` printed. Jobs with other names are not ours.
///
/// # Errors
/// When a worker's line does not have the requested fields.
pub fn workers(printed: &str, prefix: &str) -> Result<Vec<PlacedWorker>, EngineError> {
    let lines = printed
        .lines()
        .filter(|line| line.split('|').nth(1).is_some_and(|name| name.trim().starts_with(prefix)));
    let unreadable =
        |line: &str| EngineError::Unreadable { program: "squeue", line: line.to_owned() };
    lines.map(|line| worker(line).ok_or_else(|| unreadable(line))).collect()
}

fn worker(line: &str) -> Option<PlacedWorker> {
    let mut fields = line.splitn(9, '|').map(str::trim);
    let mut next = || fields.next();
    let (identifier, name, state) = (next()?, next()?, next()?);
    let (reason, node, exit) = (next()?, next()?, next()?);
    let (preempted_at, time_left, comment) = (next()?, next()?, next()?);
    let (resources, stays) = match comment.strip_suffix(STAYS) {
        Some(resources) => (resources, true),
        None => (comment, false),
    };
    Some(PlacedWorker {
        name: name.to_owned(),
        identifier: identifier.to_owned(),
        resources: read(resources)?,
        stays,
        node: Some(node).filter(|node| !node.is_empty()).map(str::to_owned),
        phase: match phase(state, reason, exit, seconds(time_left)) {
            // A worker that was told in time ends normally.
            Phase::Ended(End { cause: Cause::Finished, .. }) if is_moment(preempted_at) => {
                Phase::Ended(End { cause: Cause::Interrupted, how: PREEMPTED.to_owned() })
            }
            Phase::Running if is_moment(preempted_at) => Phase::Ending(Some(PREEMPTED.to_owned())),
            phase => phase,
        },
    })
}

/// The phase of a state from `man squeue`. A worker in an unknown state counts as present.
fn phase(state: &str, reason: &str, exit: &str, seconds_left: Option<u64>) -> Phase {
    let reason = Some(reason).filter(|reason| !["", "None"].contains(reason)).map(str::to_owned);
    match state {
        "PENDING" | "CONFIGURING" | "REQUEUED" | "REQUEUE_FED" | "REQUEUE_HOLD"
        | "RESV_DEL_HOLD" | "SPECIAL_EXIT" => Phase::Pending(reason),
        "COMPLETING" => Phase::Ending(None),
        // A worker that was told in time ends normally.
        "COMPLETED" if seconds_left.is_some_and(|left| left <= NOTICE.as_secs()) => {
            let how = "came to the end of Slurm's time limit".to_owned();
            Phase::Ended(End { cause: Cause::Interrupted, how })
        }
        _ => match end(state, reason.as_deref(), exit) {
            Some(end) => Phase::Ended(end),
            None => Phase::Running,
        },
    }
}

/// How a job ended; `None` for a state in which it has not ended.
fn end(state: &str, reason: Option<&str>, exit: &str) -> Option<End> {
    let end = |cause, how: String| Some(End { cause, how });
    match state {
        "COMPLETED" => end(Cause::Finished, "ended".to_owned()),
        "PREEMPTED" => end(Cause::Interrupted, PREEMPTED.to_owned()),
        "CANCELLED" | "REVOKED" => {
            end(Cause::Interrupted, "was cancelled in Slurm (scancel)".to_owned())
        }
        "OUT_OF_MEMORY" => end(Cause::Died, "ran out of the memory that Slurm gave it".to_owned()),
        "TIMEOUT" | "DEADLINE" => end(
            Cause::Died,
            "did not end within Slurm's time limit; ask for more with --slurm-option=--time="
                .to_owned(),
        ),
        "NODE_FAIL" | "BOOT_FAIL" => {
            let why = reason.map(|reason| format!(" ({reason})")).unwrap_or_default();
            end(Cause::Died, format!("lost its node{why}"))
        }
        // Its attempt was ended before.
        "FAILED" if exit_of(exit) == (u32::from(GAVE_UP), 0) => {
            end(Cause::Finished, "ended because its task did not".to_owned())
        }
        "FAILED" | "LAUNCH_FAILED" => {
            let why = reason.map(|reason| format!(" ({reason})")).unwrap_or_default();
            end(Cause::Died, format!("died: {}{why}", exit_text(exit)))
        }
        _ => None,
    }
}

/// Whether a text is a time such as `2026-11-24T07:08:33`. Slurm prints `N/A` for no time.
fn is_moment(text: &str) -> bool {
    text.starts_with(|first: char| first.is_ascii_digit())
}

/// Reads `[[DAYS-]HOURS:]MINUTES:SECONDS`; `None` without a limit.
fn seconds(time: &str) -> Option<u64> {
    let (days, clock) = time.split_once('-').unwrap_or(("0", time));
    let mut seconds = days.parse::<u64>().ok()?.checked_mul(24)?;
    let parts: Vec<&str> = clock.split(':').collect();
    let padded = ["0"; 3].into_iter().skip(parts.len()).chain(parts);
    for (index, part) in padded.enumerate() {
        let scaled = if index == 0 { seconds } else { seconds.checked_mul(60)? };
        seconds = scaled.checked_add(part.parse().ok()?)?;
    }
    Some(seconds)
}

/// Reads code and signal. `squeue` prints the status that `wait` returns, and `sacct` prints
/// `CODE:SIGNAL`.
fn exit_of(exit: &str) -> (u32, u32) {
    match exit.split_once(':') {
        Some((code, signal)) => (code.parse().unwrap_or(0), signal.parse().unwrap_or(0)),
        None => {
            let status: u32 = exit.parse().unwrap_or(0);
            (status >> 8, status & 0x7f)
        }
    }
}

fn exit_text(exit: &str) -> String {
    let (code, signal) = exit_of(exit);
    match (code, signal) {
        (_, signal) if signal > 0 => format!("signal {signal}"),
        // The exit codes of a shell for a program that it cannot find or run.
        (126 | 127, _) => format!("exit code {code}, as when the node does not have the program"),
        _ => format!("exit code {code}"),
    }
}

/// How a job ended, as `sacct` remembers it: `STATE|CODE:SIGNAL`. The state may be `CANCELLED by
/// 1000`. The last line is the latest.
pub fn remembered(printed: &str) -> Option<End> {
    let (state, exit) = printed.lines().last()?.split_once('|')?;
    end(state.split_whitespace().next()?, None, exit)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RESOURCES: &str = "cpus=2;gpus=0;memory_mb=500;tags=";

    fn phase_of(line: &str) -> Phase {
        let line = format!("{line}|N/A|12:00|{RESOURCES}\n");
        let workers = workers(&line, "torqued-ab-").unwrap();
        assert_eq!(workers.len(), 1, "{line}");
        workers[0].phase.clone()
    }

    /// Lines that `squeue` of Slurm 22.05 printed.
    #[test]
    fn every_state_of_a_job_is_understood() {
        let pending = |why: &str| Phase::Pending(Some(why.to_owned()));
        let ended = |cause, how: &str| Phase::Ended(End { cause, how: how.to_owned() });
        for (line, expected) in [
            ("6|torqued-ab-1|PENDING|Resources||0", pending("Resources")),
            (
                "13|torqued-ab-1|PENDING|Nodes required for job are DOWN, DRAINED or reserved for jobs in higher \
                 priority partitions||0",
                pending(
                    "Nodes required for job are DOWN, DRAINED or reserved for jobs in higher priority partitions",
                ),
            ),
            ("1|torqued-ab-1|RUNNING|None|n1|0", Phase::Running),
            ("1|torqued-ab-1|COMPLETING|None|n1|0", Phase::Ending(None)),
            ("10|torqued-ab-1|COMPLETED|None|n1|0", ended(Cause::Finished, "ended")),
            (
                "1|torqued-ab-1|PREEMPTED|None|n1|9",
                ended(Cause::Interrupted, "was preempted by Slurm"),
            ),
            (
                "1|torqued-ab-1|CANCELLED|None|n1|0",
                ended(Cause::Interrupted, "was cancelled in Slurm (scancel)"),
            ),
            (
                "2|torqued-ab-1|NODE_FAIL|NodeDown|n1|15",
                ended(Cause::Died, "lost its node (NodeDown)"),
            ),
            (
                "2|torqued-ab-1|FAILED|NonZeroExitCode|n1|768",
                ended(Cause::Died, "died: exit code 3 (NonZeroExitCode)"),
            ),
            (
                "2|torqued-ab-1|FAILED|NonZeroExitCode|n1|19200",
                ended(Cause::Finished, "ended because its task did not"),
            ),
            (
                "3|torqued-ab-1|FAILED|JobLaunchFailure|n1|9",
                ended(Cause::Died, "died: signal 9 (JobLaunchFailure)"),
            ),
            (
                "4|torqued-ab-1|FAILED|NonZeroExitCode|n1|32512",
                ended(
                    Cause::Died,
                    "died: exit code 127, as when the node does not have the program (NonZeroExitCode)",
                ),
            ),
            ("1|torqued-ab-1|A_STATE_TO_COME|None|n1|0", Phase::Running),
        ] {
            assert_eq!(phase_of(line), expected, "{line}");
        }
        let of_memory = phase_of("1|torqued-ab-1|OUT_OF_MEMORY|OutOfMemory|n1|125");
        assert!(matches!(of_memory, Phase::Ended(End { cause: Cause::Died, .. })));
    }

    #[test]
    fn a_line_says_which_worker_it_is_where_and_with_what() {
        let comment = comment(&read(RESOURCES).unwrap(), true);
        let printed = format!(
            "7|torqued-ab-9f|RUNNING|None|n1|0|N/A|UNLIMITED|{comment}\n8|torqued-cd-1|RUNNING|None|n1|0|N/A|1:00|(null)\n9|\n"
        );
        let workers = workers(&printed, "torqued-ab-").unwrap();
        let expected = PlacedWorker {
            name: "torqued-ab-9f".to_owned(),
            identifier: "7".to_owned(),
            resources: read(RESOURCES).unwrap(),
            stays: true,
            node: Some("n1".to_owned()),
            phase: Phase::Running,
        };
        assert_eq!(workers, [expected]);
    }

    #[test]
    fn a_worker_that_cannot_be_read_is_an_error() {
        for line in
            ["7|torqued-ab-1|RUNNING", "7|torqued-ab-1|RUNNING|None|n1|0|N/A|1:00|a comment"]
        {
            assert!(workers(line, "torqued-ab-").is_err(), "{line}");
        }
    }

    #[test]
    fn the_time_that_is_left_is_read() {
        let read = ["0:07", "12:00", "1:00:00", "2-00:00:01", "UNLIMITED", "INVALID", "NOT_SET"];
        let expected = [Some(7), Some(720), Some(3600), Some(172_801), None, None, None];
        assert_eq!(read.map(seconds), expected);
        let line = format!("1|torqued-ab-1|COMPLETED|None|n1|0|N/A|0:58|{RESOURCES}");
        let workers = workers(&line, "torqued-ab-").unwrap();
        assert!(
            matches!(&workers[0].phase, Phase::Ended(End { cause: Cause::Interrupted, .. })),
            "{workers:?}"
        );
    }

    #[test]
    fn a_preemption_is_known_from_its_beginning_and_whoever_ends_in_time_was_preempted() {
        let phase = |state: &str| {
            let line =
                format!("3|torqued-ab-1|{state}|None|n1|0|2026-11-24T07:08:33|29:57|{RESOURCES}");
            workers(&line, "torqued-ab-").unwrap()[0].phase.clone()
        };
        assert_eq!(phase("RUNNING"), Phase::Ending(Some(PREEMPTED.to_owned())));
        let end = End { cause: Cause::Interrupted, how: PREEMPTED.to_owned() };
        assert_eq!(phase("COMPLETED"), Phase::Ended(end.clone()));
        assert_eq!(phase("PREEMPTED"), Phase::Ended(end));
    }

    /// The format of `man sacct`. The test cluster has no accounting.
    #[test]
    fn accounting_remembers_how_a_job_ended() {
        let cause = |printed: &str| remembered(printed).map(|end| end.cause);
        assert_eq!(cause("COMPLETED|0:0\n"), Some(Cause::Finished));
        assert_eq!(cause("CANCELLED by 1000|0:15\n"), Some(Cause::Interrupted));
        assert_eq!(cause("RUNNING|0:0\n"), None);
        assert_eq!(cause(""), None);
        assert_eq!(remembered("FAILED|3:0\n").unwrap().how, "died: exit code 3");
    }
}
