//! `"samples": "all"` of a mapping: each recording is one trajectory, however long it is.

use anyhow::{bail, ensure};
use recordings::Lengths;
use serde_json::{Value, json};
use spec::{ImportSpec, Split};

use super::local::LocalImport;
use crate::client::{Client, RecordedFile};

/// Replaces `"samples": "all"` by the number of samples that the recordings have. A spec has a
/// number, because trajectories of a dataset have the same length. Returns the number if it replaced
/// the word.
pub(super) async fn count(
    client: &Client,
    files: &[RecordedFile],
    spec: &mut Value,
) -> anyhow::Result<Option<u64>> {
    if spec.get("samples") != Some(&json!("all")) {
        return Ok(None);
    }
    if spec.get("split").is_some_and(|split| split["kind"] != "whole") {
        bail!("samples is \"all\", allowed with windows: a number of samples");
    }
    // The shortest trajectories that any recording has.
    let mut counting = spec.clone();
    counting["samples"] = json!(2);
    counting["split"] = json!({"kind": "windows", "stride": 1_000_000});
    let LocalImport { decoder, files, spec: counting } =
        LocalImport::open(client, files, counting).await?;
    let lengths =
        tokio::task::spawn_blocking(move || worker::recording_lengths(&decoder, files, &counting));
    let samples = common(&lengths.await??)?;
    spec["samples"] = json!(samples);
    Ok(Some(samples))
}

/// The number of samples that all recordings have.
fn common(lengths: &Lengths) -> anyhow::Result<u64> {
    const MOST: u32 = ImportSpec::MOST_SAMPLES;

    let Lengths { fewest_samples, most_samples, .. } = *lengths;
    ensure!(
        fewest_samples == most_samples,
        "samples is \"all\", and the recordings have {fewest_samples} to {most_samples} samples, allowed: \
         recordings of one length; import each file alone, or cut them into windows"
    );
    ensure!(
        most_samples <= MOST.into(),
        "samples is \"all\", and the recording has {most_samples} samples, allowed: at most {MOST}; \
         \"samples\": {MOST}, {} cuts it",
        Split::in_a_row(MOST)
    );
    Ok(most_samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_samples_are_those_of_recordings_of_one_length() {
        let common = |fewest_samples: u64, most_samples: u64| {
            common(&Lengths { recordings: Vec::new(), fewest_samples, most_samples })
        };
        assert_eq!(common(7000, 7000).unwrap(), 7000);
        let unlike = common(6000, 7000).unwrap_err().to_string();
        assert!(
            unlike.contains("6000 to 7000 samples, allowed: recordings of one length"),
            "{unlike}"
        );
        let long = common(10_001, 10_001).unwrap_err().to_string();
        assert!(long.contains("at most 10000; \"samples\": 10000, \"split\""), "{long}");
    }
}
