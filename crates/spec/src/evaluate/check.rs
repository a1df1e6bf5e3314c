//! Checks the values of an evaluation.

use std::ops::RangeInclusive;

use super::spec::{Baseline, EvaluateSpec};
use crate::MAX_POSITION_NOISE_RAD;
use crate::check::{Check, Violations, first_repeated};
use crate::shorten::shorten;

/// Largest number of samples of one predictor per scenario.
const MAX_SAMPLES: u32 = 256;

/// Largest number of noise levels. Each repeats the whole evaluation.
const MAX_LEVELS: usize = 10;

/// Most parts of the horizon whose errors are measured.
const MAX_HORIZONS: usize = 10;

/// Lengths of these parts, s.
const HORIZON_S: RangeInclusive<f64> = 1e-3..=1e4;

impl Check for EvaluateSpec {
    fn check(&self, violations: &mut Violations) {
        violations.part("data", &self.data);
        if self.checkpoints.is_empty() && self.baselines.is_empty() && self.predictions.is_empty() {
            let allowed = "at least one checkpoint, baseline or file of predictions";
            violations.add("checkpoints", "[]", allowed);
        }
        violations.length("checkpoints", self.checkpoints.len(), 0..=50);
        violations.no_duplicates("checkpoints", &self.checkpoints);
        violations.no_duplicates("baselines", &self.baselines);
        let answering = Baseline::answering(self.given);
        for (i, baseline) in self.baselines.iter().enumerate() {
            if *baseline != Baseline::Oracle && !answering.contains(baseline) {
                let value = serde_json::to_value(baseline).unwrap_or_default();
                let allowed = format!("one that answers with {}", self.given);
                violations.add(&format!("baselines[{i}]"), shorten(&value), allowed);
            }
        }
        self.check_predictions(violations);
        violations.within("context", self.context, 1..=9_999);
        if let Some(horizon) = self.horizon {
            violations.within("horizon", horizon, 1..=9_999);
        }
        violations.length("horizons_s", self.horizons_s.len(), 0..=MAX_HORIZONS);
        violations.all_within("horizons_s", &self.horizons_s, &HORIZON_S);
        // Columns are named by whole milliseconds.
        let milliseconds = self.horizons_s.iter().map(|seconds| (1e3 * seconds).round().to_bits());
        let milliseconds: Vec<u64> = milliseconds.collect();
        if let Some(twice) = first_repeated(&milliseconds) {
            let twice = format!("{} ms twice", f64::from_bits(*twice));
            violations.add("horizons_s", twice, "lengths at least a millisecond apart");
        }
        if let Some(rounds) = self.rounds {
            violations.within("rounds", rounds, 0..=1000);
            if rounds == 0 && self.starts_shifted() {
                let allowed =
                    "1 to 1000 where a sampler starts shifted: its first window starts cold";
                violations.add("rounds", rounds, allowed);
            }
        }
        if let Some(scenarios) = self.scenarios {
            violations.within("scenarios", scenarios, 1..=10_000);
        }
        violations.length("samplers", self.samplers.len(), 0..=50);
        for (i, sampler) in self.samplers.iter().enumerate() {
            violations.part(&format!("samplers[{i}]"), sampler);
        }
        violations.within("samples", self.samples, 1..=MAX_SAMPLES);
        violations.length("position_noise_rad", self.position_noise_rad.len(), 1..=MAX_LEVELS);
        let allowed = 0.0..=MAX_POSITION_NOISE_RAD;
        violations.all_within("position_noise_rad", &self.position_noise_rad, &allowed);
        let levels = &self.position_noise_rad;
        // 0 and -0 are equal, but have other bits.
        let bits: Vec<u64> = levels.iter().map(|level| (level + 0.0).to_bits()).collect();
        if let Some(twice) = first_repeated(&bits) {
            let twice = f64::from_bits(*twice);
            violations.add("position_noise_rad", format!("{twice} twice"), "each once");
        }
        violations.seed("seed", self.seed);
        if let Some(latency) = &self.latency {
            violations.within("latency.repeats", latency.repeats, 20..=10_000);
        }
        violations.within("bootstrap.resamples", self.bootstrap.resamples, 100..=100_000);
        violations.seed("bootstrap.seed", self.bootstrap.seed);
        violations.part("execution", &self.execution);
    }
}
