//! Tests a device in a separate process. Drivers crash and hang, and burn panics when a computation
//! fails. None of that may end a server or a worker.

use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use models::{Device, DeviceDescription, DeviceError, DeviceKind};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::process::Command;

/// Time limit for the first result of a device. Drivers compile kernels at their first use: Mesa's
/// software Vulkan needed 73 s for a training step in one of its releases.
pub const PROBE_LIMIT: Duration = Duration::from_secs(120);

/// Number of bytes kept from the end of a child's output.
const KEPT_BYTES: usize = 16 * 1024;

/// The longest reason that is reported, in characters.
const LONGEST_REASON: usize = 400;

/// The exit code of a program that prints `error: ` and a reason.
const FAILURE: i32 = 1;

/// A device that computed a correct result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probed {
    /// Its name and its properties, as the driver reports them.
    pub device: DeviceDescription,
    /// Seconds from opening it to its first results.
    pub seconds: f64,
}

/// Why a device cannot be used, in one line.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum ProbeError {
    #[error("device `{kind}` cannot be tested: no process could be started")]
    Spawn { kind: DeviceKind, source: std::io::Error },
    /// The child reported this reason itself.
    #[error("{0}")]
    Refused(String),
    #[error("device `{kind}` cannot be used: its first computation panicked: {message}")]
    Panicked { kind: DeviceKind, message: String },
    #[error("device `{kind}` cannot be used: the process that tested it ended by {status}")]
    Died { kind: DeviceKind, status: String },
    #[error("device `{kind}` cannot be used: it had no result after {} s", .limit.as_secs_f32())]
    Hung { kind: DeviceKind, limit: Duration },
    #[error("device `{kind}` cannot be tested: the process that tested it printed {said:?}")]
    Unreadable { kind: DeviceKind, said: String },
}

/// Opens a device and lets it compute, in this process.
///
/// # Errors
/// When the device is not built in, cannot be opened or computes wrong results. It may also panic,
/// crash or hang.
pub fn try_device(kind: DeviceKind) -> Result<Probed, DeviceError> {
    let started = Instant::now();
    let device = Device::open(kind)?;
    device.check()?;
    let seconds = started.elapsed().as_secs_f64();
    Ok(Probed { device: device.description().clone(), seconds })
}

/// Runs `child`, which prints the JSON of [`try_device`]'s result. Kills it after `limit`.
///
/// # Errors
/// When the child does anything else.
pub async fn probe(
    kind: DeviceKind,
    mut child: Command,
    limit: Duration,
) -> Result<Probed, ProbeError> {
    let mut process = child
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .env("RUST_BACKTRACE", "0")
        .kill_on_drop(true)
        .spawn()
        .map_err(|source| ProbeError::Spawn { kind, source })?;
    let (stdout, stderr) = (process.stdout.take(), process.stderr.take());
    let end = async { tokio::join!(process.wait(), end_of(stdout), end_of(stderr)) };
    match tokio::time::timeout(limit, end).await {
        Ok((Ok(status), stdout, stderr)) => judge(kind, &Output { status, stdout, stderr }),
        Ok((Err(source), ..)) => Err(ProbeError::Spawn { kind, source }),
        Err(_) => Err(ProbeError::Hung { kind, limit }),
    }
}

/// Reads a stream to its end, and keeps the last bytes.
async fn end_of(stream: Option<impl AsyncRead + Unpin>) -> Vec<u8> {
    let mut kept = Vec::new();
    let Some(mut stream) = stream else { return kept };
    while stream.read_buf(&mut kept).await.is_ok_and(|count| count > 0) {
        let superfluous = kept.len().saturating_sub(KEPT_BYTES);
        kept.drain(..superfluous);
    }
    kept
}

fn judge(kind: DeviceKind, output: &Output) -> Result<Probed, ProbeError> {
    let status = output.status;
    if status.success() {
        return serde_json::from_slice(&output.stdout).map_err(|_| {
            let said = one_line(&String::from_utf8_lossy(&output.stdout));
            ProbeError::Unreadable { kind, said }
        });
    }
    let said = String::from_utf8_lossy(&output.stderr);
    if let Some(message) = panic_message(&said) {
        return Err(ProbeError::Panicked { kind, message });
    }
    // Libraries under a driver print lines like ours. The last such line is ours only if the
    // program failed by itself.
    let own = said.lines().rev().find_map(|line| line.strip_prefix("error: "));
    match own {
        Some(message) if status.code() == Some(FAILURE) => {
            Err(ProbeError::Refused(one_line(message)))
        }
        _ => Err(ProbeError::Died { kind, status: status.to_string() }),
    }
}

/// The message of the first panic, which causes the later ones.
fn panic_message(said: &str) -> Option<String> {
    let begins = |line: &str| line.starts_with("thread '") && line.contains(" panicked at ");
    let mut lines = said.lines().skip_while(|line| !begins(line));
    lines.next()?;
    let message: Vec<&str> =
        lines.take_while(|line| !line.starts_with("note: ") && !begins(line)).collect();
    Some(one_line(&message.join(" ")))
}

/// The words of a text in one line, cut to a readable length.
fn one_line(text: &str) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match words.char_indices().nth(LONGEST_REASON) {
        Some((end, _)) => format!("{} ...", &words[..end]),
        None => words,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: DeviceKind = DeviceKind::Cpu;
    const SOON: Duration = Duration::from_secs(60);

    async fn probe_script(script: &str, limit: Duration) -> Result<Probed, ProbeError> {
        let mut child = Command::new("sh");
        child.args(["-c", script]);
        probe(KIND, child, limit).await
    }

    /// Checks that the script's child is refused with a line that has these words.
    async fn check_refused(script: &str, limit: Duration, expected: &[&str]) {
        let message = probe_script(script, limit).await.unwrap_err().to_string();
        assert_eq!(message.lines().count(), 1, "{message}");
        for words in expected {
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn the_processor_is_tried_and_described() {
        let probed = try_device(KIND).unwrap();
        assert_eq!(probed.device.name, "cpu");
        assert!(probed.seconds > 0.0);
    }

    #[tokio::test]
    async fn what_a_child_found_out_is_passed_on_whatever_a_driver_says_beside_it() {
        let expected = try_device(KIND).unwrap();
        let json = serde_json::to_string(&expected).unwrap();
        let script = format!("echo 'WARNING: not a conformant driver' >&2; echo '{json}'");
        assert_eq!(probe_script(&script, SOON).await.unwrap(), expected);
    }

    #[tokio::test]
    async fn a_child_that_refuses_the_device_is_quoted() {
        let script = "echo 'error: device `gpu` has no driver' >&2; echo bye >&2; exit 1";
        check_refused(script, SOON, &["device `gpu` has no driver"]).await;
    }

    #[tokio::test]
    async fn a_child_that_panics_is_quoted_by_its_first_panic() {
        let panic = r#"
            echo "thread 'main' (7) panicked at driver.rs:1:2:"; echo "no such"; echo "kernel"
            echo "note: run with \`RUST_BACKTRACE=1\`"
            echo "thread 'other' (8) panicked at driver.rs:3:4:"; echo "poisoned"
            echo "error: poisoned"; exit 101"#;
        let script = format!("exec >&2; {panic}");
        check_refused(&script, SOON, &["device `cpu`", "panicked: no such kernel"]).await;
        let message = probe_script(&script, SOON).await.unwrap_err().to_string();
        assert!(message.ends_with("kernel"), "{message}");
    }

    #[tokio::test]
    async fn a_child_that_a_signal_ends_is_named_by_it() {
        let script = "echo 'error: no runtime directory' >&2; kill -SEGV $$";
        check_refused(script, SOON, &["device `cpu`", "SIGSEGV"]).await;
    }

    #[tokio::test]
    async fn a_child_that_hangs_is_killed_and_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let pid_file = folder.path().join("pid");
        let script = format!("echo $$ > {}; exec sleep 600", pid_file.display());
        check_refused(&script, Duration::from_millis(500), &["device `cpu`", "0.5 s"]).await;
        let pid = std::fs::read_to_string(&pid_file).unwrap();
        let process = std::path::PathBuf::from(format!("/proc/{}/stat", pid.trim()));
        let is_alive = || {
            let state = std::fs::read_to_string(&process).unwrap_or_default();
            !state.is_empty() && !state.contains(") Z ")
        };
        for _ in 0..200 {
            if !is_alive() {
                return;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        panic!("the child is still there");
    }

    #[tokio::test]
    async fn a_child_that_floods_or_says_nothing_is_refused() {
        check_refused("yes | head -c 3000000", SOON, &["printed", "y y y", "..."]).await;
        check_refused("true", SOON, &["printed \"\""]).await;
        check_refused("exit 3", SOON, &["exit status: 3"]).await;
    }

    #[tokio::test]
    async fn a_child_that_cannot_be_started_is_an_error() {
        let child = Command::new("/no/such/program");
        let error = probe(KIND, child, SOON).await.unwrap_err();
        assert!(matches!(error, ProbeError::Spawn { .. }), "{error}");
    }
}
