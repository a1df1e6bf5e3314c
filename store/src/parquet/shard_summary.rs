//! Summaries of shards: a few numbers that can be added up over shards.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::boxed;
use crate::{DatasetId, Store, StoreError};

/// Counts, ranges and spectra of one shard, or of several.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShardSummary {
    /// Number of trajectories.
    pub trajectories: u64,
    /// Number of samples of all trajectories together.
    pub samples: u64,
    /// Number of draws that were refused.
    pub rejected: u64,
    /// The channels of the trajectories, in the order of their columns.
    pub channels: Vec<ChannelSummary>,
    /// The spectra of the channels.
    pub spectra: Vec<Spectrum>,
    /// Columns of the table of robots, over the trajectories.
    #[serde(default)]
    pub arms: Vec<ChannelSummary>,
}

/// Statistics of all rows of a column.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelSummary {
    /// The name of the channel, which is its column.
    pub name: String,
    /// The smallest value, in the unit of the channel.
    pub min: f64,
    /// The largest value, in the unit of the channel.
    pub max: f64,
    /// The mean of all values, in the unit of the channel.
    pub mean: f64,
    /// Standard deviation of these samples; it is not corrected for an estimate.
    pub std: f64,
}

/// Mean one-sided power spectral density of a signal over its joints, or of one of them, and several
/// trajectories. Each has its mean removed and a Hann window. The integral is the mean variance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spectrum {
    /// `u` or `q`.
    pub signal: String,
    /// The joint, from 1; `None` for the mean over all joints.
    #[serde(default)]
    pub joint: Option<u32>,
    /// Number of trajectories that the spectrum averages.
    pub trajectories: u64,
    /// Distance between frequencies in Hz. The first is 0 Hz.
    pub step_hz: f64,
    /// In the signal's unit squared per Hz.
    pub density: Vec<f32>,
}

impl ShardSummary {
    /// The field of a task's result that has the summary of its shard.
    pub const KEY: &str = "summary";

    /// The result of a task that made a shard. [`Store::dataset_summary`] reads it, and a task may
    /// add fields of its own.
    pub fn to_result(&self) -> Value {
        json!({ Self::KEY: self })
    }

    /// Adds the summary of another shard of the same dataset.
    pub fn merge(&mut self, other: &Self) {
        if self.samples == 0 {
            let Self { rejected, .. } = *self;
            *self = Self { rejected: rejected + other.rejected, ..other.clone() };
            return;
        }
        for (mine, theirs) in self.channels.iter_mut().zip(&other.channels) {
            mine.merge(self.samples, theirs, other.samples);
        }
        for (mine, theirs) in self.arms.iter_mut().zip(&other.arms) {
            mine.merge(self.trajectories, theirs, other.trajectories);
        }
        // Only some shards have spectra of single joints.
        for theirs in &other.spectra {
            let is_same =
                |mine: &&mut Spectrum| mine.signal == theirs.signal && mine.joint == theirs.joint;
            match self.spectra.iter_mut().find(is_same) {
                Some(mine) => mine.merge(theirs),
                None => self.spectra.push(theirs.clone()),
            }
        }
        self.trajectories += other.trajectories;
        self.samples += other.samples;
        self.rejected += other.rejected;
    }
}

impl ChannelSummary {
    /// Merges the summary of `added` rows into that of `count` rows.
    #[expect(clippy::cast_precision_loss, reason = "weights")]
    fn merge(&mut self, count: u64, other: &Self, added: u64) {
        let share = added as f64 / (count + added) as f64;
        let distance = other.mean - self.mean;
        let (mine, theirs) = (self.std * self.std, other.std * other.std);
        let variance = mine + share * (theirs - mine) + share * (1.0 - share) * distance * distance;
        self.mean += share * distance;
        self.std = variance.max(0.0).sqrt();
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }
}

impl Spectrum {
    #[expect(clippy::cast_precision_loss, reason = "weights")]
    #[expect(clippy::cast_possible_truncation, reason = "f32 is enough to draw it")]
    fn merge(&mut self, other: &Self) {
        let all = self.trajectories + other.trajectories;
        if all == 0 {
            return;
        }
        let share = other.trajectories as f64 / all as f64;
        for (mine, theirs) in self.density.iter_mut().zip(&other.density) {
            *mine = (f64::from(*mine) + share * (f64::from(*theirs) - f64::from(*mine))) as f32;
        }
        self.trajectories = all;
    }
}

impl Store {
    /// The merged summary of all shards of a dataset that have one; `None` if none has.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn dataset_summary(
        &self,
        dataset: DatasetId,
    ) -> Result<Option<ShardSummary>, StoreError> {
        const OPERATION: &str = "reading what a dataset holds";
        let results = self.read(OPERATION).shard_results(dataset).await?;
        let mut all: Option<ShardSummary> = None;
        for summary in results.iter().filter_map(|result| summary_of(result)) {
            match &mut all {
                Some(all) => all.merge(&summary),
                None => all = Some(summary),
            }
        }
        Ok(all)
    }
}

/// `None` for results of other versions.
fn summary_of(result: &str) -> Option<ShardSummary> {
    let mut result: Value = serde_json::from_str(result).ok()?;
    serde_json::from_value(result.get_mut(ShardSummary::KEY)?.take()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(values: &[f64]) -> ShardSummary {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        ShardSummary {
            trajectories: 1,
            samples: values.len() as u64,
            rejected: 2,
            channels: vec![ChannelSummary {
                name: "q1".to_owned(),
                min: values.iter().copied().fold(f64::INFINITY, f64::min),
                max: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                mean,
                std: variance.sqrt(),
            }],
            spectra: vec![Spectrum {
                signal: "q".to_owned(),
                joint: None,
                trajectories: values.len() as u64,
                step_hz: 1.0,
                density: vec![1.0 + values.len() as f32],
            }],
            arms: Vec::new(),
        }
    }

    #[test]
    fn the_summary_of_two_shards_is_that_of_all_their_samples() {
        let values = [3.0, -1.0, 4.0, 1.0, 5.0, 9.0, 2.0];
        let whole = summary(&values);
        let mut parts = summary(&values[..2]);
        parts.merge(&summary(&values[2..]));
        let (whole, parts) = (&whole.channels[0], (&parts, &parts.channels[0]));
        assert_eq!((parts.0.samples, parts.0.trajectories, parts.0.rejected), (7, 2, 4));
        assert_eq!((parts.1.min, parts.1.max), (whole.min, whole.max));
        assert!((parts.1.mean - whole.mean).abs() < 1e-12);
        assert!((parts.1.std - whole.std).abs() < 1e-12);
        let density = f64::from(parts.0.spectra[0].density[0]);
        assert!((density - (2.0 * 3.0 + 5.0 * 6.0) / 7.0).abs() < 1e-6);
    }

    #[test]
    fn spectra_of_single_joints_come_from_the_shards_that_have_them() {
        let mut first = summary(&[1.0]);
        first.spectra.push(Spectrum { joint: Some(1), ..first.spectra[0].clone() });
        for (mut all, other) in [(first.clone(), summary(&[2.0])), (summary(&[2.0]), first)] {
            all.merge(&other);
            let spectra: Vec<_> =
                all.spectra.iter().map(|it| (it.joint, it.trajectories)).collect();
            assert_eq!(spectra, [(None, 2), (Some(1), 1)]);
        }
    }
}
