//! `torqued import --check`: reads files as their import would, on this machine.

use std::process::ExitCode;

use recordings::RecordingLength;
use serde_json::Value;
use worker::Rehearsal;

use super::local::LocalImport;
use crate::arguments::OutputArguments;
use crate::client::{Client, RecordedFile};
use crate::output::write_json;

/// Prints what the import of files would give.
pub(super) async fn run(
    client: &Client,
    files: &[RecordedFile],
    spec: Value,
    output: OutputArguments,
) -> anyhow::Result<ExitCode> {
    let LocalImport { decoder, files, spec } = LocalImport::open(client, files, spec).await?;
    let found = tokio::task::spawn_blocking(move || worker::rehearse(&decoder, files, &spec));
    let found = found.await??;
    if output.json {
        write_json(&found)?;
    } else {
        print(&found);
    }
    Ok(ExitCode::SUCCESS)
}

/// The largest number of recordings whose lengths are printed.
const SHOWN_RECORDINGS: usize = 20;

/// The length and the rate of a recording.
fn length(recording: &RecordingLength) -> String {
    let RecordingLength { name, seconds, median_rate_hz, samples, .. } = recording;
    let name = if name.is_empty() { String::new() } else { format!(" {name:?}") };
    let rounded = |value: f64| (1e3 * value).round() / 1e3;
    let rate = median_rate_hz
        .map_or_else(String::new, |rate| format!(", median rate {} Hz", rounded(rate)));
    format!("recording{name}: {} s{rate}, {samples} samples", rounded(*seconds))
}

fn print(Rehearsal { import, lengths, check }: &Rehearsal) {
    println!(
        "recordings: {}, rows: {}, trajectories: {}",
        import.recordings, import.rows, import.trajectories
    );
    for recording in lengths.recordings.iter().take(SHOWN_RECORDINGS) {
        println!("{}", length(recording));
    }
    match import.recordings.saturating_sub(SHOWN_RECORDINGS as u64) {
        0 => {}
        more => println!("and {more} more"),
    }
    match check {
        None => println!("The spec names no robot, so torques are compared with nothing."),
        Some(check) if check.seconds == 0.0 => {
            println!("No recording is long enough to compare its torques with the robot's.");
        }
        Some(check) => print!("\n{}", reports::log_check::table(check).with_title()),
    }
    let doubts = check.iter().flat_map(|check| &check.doubts);
    for warning in import.warnings.iter().chain(doubts) {
        println!("warning: {warning}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_shown_with_its_length_and_its_rate() {
        let mut recording = RecordingLength {
            name: "monday".to_owned(),
            rows: 7001,
            seconds: 56.000_02,
            median_rate_hz: Some(124.999_96),
            samples: 7001,
        };
        assert_eq!(
            length(&recording),
            "recording \"monday\": 56 s, median rate 125 Hz, 7001 samples"
        );
        (recording.name, recording.median_rate_hz) = (String::new(), None);
        assert_eq!(length(&recording), "recording: 56 s, 7001 samples");
    }
}
