//! The recordings of a file of predictions: which trajectory, and which sample, each one answers.

use std::collections::BTreeMap;
use std::ops::Range;

/// Samples of a trajectory, at most, as in a spec.
const MAX_SAMPLES: u32 = 256;

/// A value that is refused, and what is allowed.
pub(super) type Refused = (String, String);

/// The places in the file, counted from 0, of the answers to one trajectory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct TrajectoryPredictions {
    /// The recording that is named by the trajectory alone.
    prediction: Option<u64>,
    /// Those named by trajectory and sample, by sample.
    samples: BTreeMap<u32, u64>,
}

/// The predictions in a file, by trajectory. `trajectories` is the number of trajectories in the
/// evaluation's data.
///
/// # Errors
/// Names a recording whose name is no trajectory, or that occurs twice.
pub(super) fn answers_of(
    recordings: &[String],
    trajectories: Option<u64>,
) -> Result<BTreeMap<u64, TrajectoryPredictions>, Refused> {
    let mut found: BTreeMap<u64, TrajectoryPredictions> = BTreeMap::new();
    for (place, name) in (0..).zip(recordings) {
        let refused = |allowed: String| (format!("recording {name:?}"), allowed);
        let (trajectory, sample) = parse(name).ok_or_else(|| {
            refused("a trajectory, such as \"7\", or trajectory and sample, \"7/0\"".to_owned())
        })?;
        if let Some(count) = trajectories.filter(|count| trajectory >= *count) {
            let last = count.saturating_sub(1);
            return Err(refused(format!("trajectories 0 to {last} of the evaluation's data")));
        }
        let answers = found.entry(trajectory).or_default();
        let before = match sample {
            None => answers.prediction.replace(place),
            Some(sample) if sample < MAX_SAMPLES => answers.samples.insert(sample, place),
            Some(_) => return Err(refused(format!("samples 0 to {}", MAX_SAMPLES - 1))),
        };
        if before.is_some() {
            return Err((format!("recording {name:?} twice"), "each once".to_owned()));
        }
    }
    for (trajectory, answers) in &found {
        let missing = (0..).zip(answers.samples.keys()).find(|(k, sample)| *k != **sample);
        if let Some((missing, sample)) = missing {
            let value =
                format!("recording \"{trajectory}/{sample}\" without \"{trajectory}/{missing}\"");
            return Err((value, "samples that are counted from 0 without a gap".to_owned()));
        }
    }
    Ok(found)
}

fn parse(name: &str) -> Option<(u64, Option<u32>)> {
    let (trajectory, sample) = match name.split_once('/') {
        Some((trajectory, sample)) => (trajectory, Some(sample)),
        None => (name, None),
    };
    let sample = sample.map(str::parse).transpose().ok()?;
    Some((trajectory.parse().ok()?, sample))
}

/// The places of the answers to scenarios that follow each other, in their order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Answers {
    /// The prediction of each scenario: the recording that is named by the trajectory alone, or else its first sample.
    pub predictions: Vec<u64>,
    /// The recording of each sample and scenario. Empty if no samples are asked for, or if the file has one answer to each.
    pub samples: Vec<Vec<u64>>,
}

impl Answers {
    /// The answers to the trajectories `wanted`, with `samples` of each if that is 2 or more.
    ///
    /// # Errors
    /// Names a trajectory without a prediction, or with fewer samples.
    pub fn of_scenarios(
        found: &BTreeMap<u64, TrajectoryPredictions>,
        wanted: Range<u64>,
        samples: usize,
    ) -> Result<Self, Refused> {
        let lacking: Vec<u64> =
            wanted.clone().filter(|trajectory| !found.contains_key(trajectory)).collect();
        if let Some(first) = lacking.first() {
            let value = format!("a file without a prediction of trajectory {first}");
            let allowed = format!(
                "a prediction of each trajectory of the cell, {} to {}; {} missing",
                wanted.start,
                wanted.end.saturating_sub(1),
                lacking.len()
            );
            return Err((value, allowed));
        }
        let each: Vec<&TrajectoryPredictions> =
            found.range(wanted.clone()).map(|(_, predictions)| predictions).collect();
        let first_sample =
            |predictions: &TrajectoryPredictions| predictions.samples.get(&0).copied();
        let prediction = |predictions: &&TrajectoryPredictions| {
            predictions.prediction.or_else(|| first_sample(predictions))
        };
        let predictions = each.iter().filter_map(prediction).collect();
        if samples < 2 || each.iter().all(|predictions| predictions.samples.len() < 2) {
            return Ok(Self { predictions, samples: Vec::new() });
        }
        if let Some((trajectory, few)) =
            wanted.zip(&each).find(|(_, predictions)| predictions.samples.len() < samples)
        {
            let value = format!("{} samples of trajectory {trajectory}", few.samples.len());
            let allowed = format!(
                "{samples} or more of each trajectory, as `samples` asks for, or one prediction of each"
            );
            return Err((value, allowed));
        }
        let sample = |k: u32| {
            each.iter().filter_map(|predictions| predictions.samples.get(&k).copied()).collect()
        };
        let samples = (0..u32::try_from(samples).unwrap_or(MAX_SAMPLES)).map(sample).collect();
        Ok(Self { predictions, samples })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answers(names: &[&str]) -> Result<BTreeMap<u64, TrajectoryPredictions>, Refused> {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        answers_of(&names, Some(10))
    }

    fn refusal(names: &[&str]) -> String {
        let (value, allowed) = answers(names).unwrap_err();
        format!("{value}: {allowed}")
    }

    #[test]
    fn a_recording_is_named_by_its_trajectory_and_its_sample() {
        let found = answers(&["3", "2/1", "2/0", "3/0", "3/1"]).unwrap();
        let asked = |samples| Answers::of_scenarios(&found, 2..4, samples).unwrap();
        assert_eq!(asked(1), Answers { predictions: vec![2, 0], samples: Vec::new() });
        assert_eq!(
            asked(2),
            Answers { predictions: vec![2, 0], samples: vec![vec![2, 3], vec![1, 4]] }
        );
    }

    #[test]
    fn other_names_are_refused() {
        for name in ["arm 3", "", "-1", "1.5", "3/", "3/x", "3/1/2"] {
            assert!(refusal(&[name]).contains("or trajectory and sample"), "{name}");
        }
        assert_eq!(
            refusal(&["10"]),
            "recording \"10\": trajectories 0 to 9 of the evaluation's data"
        );
        assert_eq!(refusal(&["3/256"]), "recording \"3/256\": samples 0 to 255");
        assert_eq!(refusal(&["3", "3"]), "recording \"3\" twice: each once");
        assert!(refusal(&["3/0", "3/2"]).starts_with("recording \"3/2\" without \"3/1\""));
    }

    #[test]
    fn scenarios_that_lack_an_answer_are_named() {
        let found = answers(&["0", "3", "4/0", "4/1", "5/0", "5/1", "5/2"]).unwrap();
        let refusal = |wanted, samples| {
            let (value, allowed) = Answers::of_scenarios(&found, wanted, samples).unwrap_err();
            format!("{value}: {allowed}")
        };
        let missing = refusal(0..4, 1);
        assert!(
            missing.contains("of trajectory 1: ") && missing.contains("0 to 3; 2 missing"),
            "{missing}"
        );
        assert!(refusal(4..6, 3).starts_with("2 samples of trajectory 4: 3 or more"));
        assert!(refusal(3..6, 2).starts_with("0 samples of trajectory 3: 2 or more"));
        assert_eq!(Answers::of_scenarios(&found, 3..4, 20).unwrap().predictions, [1]);
    }
}
