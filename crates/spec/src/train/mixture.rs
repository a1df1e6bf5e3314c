//! Trainings on several datasets and streams: how many trajectories of a batch each of them gives.

use super::TrainSpec;
use crate::check::{Violations, first_repeated};
use crate::{DataSource, DataSpec};

impl TrainSpec {
    /// The most datasets and streams of a training.
    pub const MOST_SOURCES: usize = 16;

    /// Number of trajectories that each source gives to every batch, in the order of `data`. They
    /// are those of `data_weights`, rounded so that they add up to `batch_size` (the method of
    /// largest remainders).
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a batch is not negative and at most 4096"
    )]
    pub fn shares(&self) -> Vec<u32> {
        let sources = self.data.each().len();
        let weights = self.data_weights.clone().unwrap_or_else(|| vec![1.0; sources]);
        let total: f64 = weights.iter().sum();
        let exact = weights.iter().map(|weight| weight / total * f64::from(self.batch_size));
        let exact: Vec<f64> = exact.collect();
        let mut shares: Vec<u32> = exact.iter().map(|share| share.floor() as u32).collect();
        let mut by_remainder: Vec<usize> = (0..exact.len()).collect();
        // The sort is stable, so that equal remainders keep the order of `data`.
        by_remainder.sort_by(|&a, &b| exact[b].fract().total_cmp(&exact[a].fract()));
        let left = self.batch_size.saturating_sub(shares.iter().sum());
        for source in by_remainder.into_iter().take(left as usize) {
            shares[source] += 1;
        }
        shares
    }

    pub(super) fn check_mixture(&self, violations: &mut Violations) {
        let sources = self.data.each();
        violations.length("data", sources.len(), 1..=Self::MOST_SOURCES);
        for (field, source) in self.data.in_field("data").iter().take(Self::MOST_SOURCES) {
            violations.part(field, *source);
            if let DataSource::Stream(stream) = source
                && !stream.excitation.grid().is_empty()
            {
                violations.add(
                    &format!("{field}.stream.excitation"),
                    "a frequency grid",
                    "fixed or uniform frequencies, since a training stream has no last robot",
                );
            }
        }
        let texts = sources.iter().take(Self::MOST_SOURCES);
        let texts: Vec<String> =
            texts.map(|source| serde_json::to_string(source).unwrap_or_default()).collect();
        if first_repeated(&texts).is_some() {
            violations.add("data", "the same source twice", "each once, with a weight");
        }
        if let Some(weights) = &self.data_weights {
            let known = violations.count();
            violations.all_within("data_weights", weights, &(1e-6..=1e6));
            if weights.len() != sources.len() {
                let value = format!("{} numbers", weights.len());
                let allowed = format!("one for each source of data, which are {}", sources.len());
                violations.add("data_weights", value, allowed);
            }
            if violations.count() > known {
                return;
            }
        }
        if sources.is_empty() || sources.len() > Self::MOST_SOURCES {
            return;
        }
        if let Some(none) = self.shares().iter().position(|&share| share == 0) {
            let allowed = format!("one that gives data[{none}] a trajectory of every batch");
            match &self.data_weights {
                Some(weights) => {
                    let value = format!("{} of {}", weights[none], weights.iter().sum::<f64>());
                    let allowed =
                        format!("{allowed}, or a larger batch_size than {}", self.batch_size);
                    violations.add(&format!("data_weights[{none}]"), value, allowed);
                }
                None => violations.add("batch_size", self.batch_size, allowed),
            }
        }
    }

    /// Checks that trajectories of all sources can be in one batch.
    pub(super) fn check_alike(&self, data: &[&DataSpec], violations: &mut Violations) {
        let Some((first, others)) = data.split_first() else { return };
        // Only models that compute in N·m and rad are told the noise.
        let compared = if self.model.is_physical() { 4 } else { 3 };
        for (i, other) in (1..).zip(others) {
            let both = properties(first).into_iter().zip(properties(other)).take(compared);
            for ((name, expected), (_, found)) in both {
                if found != expected {
                    let value = format!("with {name} {found}");
                    let allowed = format!("{expected}, as data[0] has");
                    violations.add(&format!("data[{i}]"), value, allowed);
                }
            }
        }
    }
}

/// The properties that trajectories in one batch must have in common. The last is the noise.
fn properties(data: &DataSpec) -> [(&'static str, String); 4] {
    let noise = format!("{} rad and {} N·m", data.position_deviation_rad(), data.torque_noise_nm());
    [
        ("samples", data.samples().to_string()),
        ("joints", data.joints().to_string()),
        ("rate_hz", data.rate_hz().to_string()),
        ("measurement noise", noise),
    ]
}
