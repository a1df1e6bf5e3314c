//! Warnings about the data behind a report or a prediction.

use serde::{Deserialize, Serialize};
use spec::Range;
use utoipa::ToSchema;

/// Data outside a checkpoint's training data, a context without information, or a prediction, motion
/// or torque beyond the joints' limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Warning {
    /// The kind of doubt.
    pub kind: WarningKind,
    /// The predictor or controller. Missing if the warning concerns all of them, or if there is
    /// only one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predictor: Option<String>,
    /// The joint's number, from 1. Missing if the warning concerns the whole robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<u32>,
    /// The value furthest outside: N·m, rad or rad/s. For a short context, its number of samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reached: Option<f64>,
    /// The range that the value lies outside of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<Range>,
    /// Number of scenarios with this warning; in closed loop, number of robots.
    pub scenarios: u64,
    /// The warning as a sentence.
    pub message: String,
}

/// The kinds of warnings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WarningKind {
    /// Torques are outside the range of the training data.
    TorqueRange,
    /// References of a controller are outside the range of the training data.
    ReferenceRange,
    /// Positions are outside the range of the training data.
    PositionRange,
    /// Rates of positions are outside the range of the training data.
    RateRange,
    /// No joint moves during the context.
    NoMotion,
    /// The context has too few samples to identify anything.
    ShortContext,
    /// The prediction exceeds the limits of a joint.
    JointLimits,
    /// A motion whose torques are asked for has positions beyond the limits of a joint.
    PositionLimits,
    /// A motion whose torques are asked for is faster than a joint may be.
    VelocityLimits,
    /// A motion takes more torque than a joint has.
    TorqueLimits,
    /// A checkpoint is asked about data that it was trained on.
    TrainingData,
    /// A predictor holds the last position, because its simulation is not finite.
    Held,
}

impl WarningKind {
    /// The quantity and its unit.
    const fn quantity(self) -> (&'static str, &'static str) {
        match self {
            Self::TorqueRange => ("u", "N·m"),
            Self::ReferenceRange => ("the reference", "rad"),
            Self::PositionRange
            | Self::NoMotion
            | Self::ShortContext
            | Self::TrainingData
            | Self::Held => ("q", "rad"),
            Self::RateRange => ("the rate of q", "rad/s"),
            Self::JointLimits => ("the predicted q", "rad"),
            Self::PositionLimits => ("the wanted q", "rad"),
            Self::VelocityLimits => ("the wanted qd", "rad/s"),
            Self::TorqueLimits => ("the torque", "N·m"),
        }
    }
}

impl Warning {
    /// A warning that a value of joint `joint`, from 1, is outside `range` in `scenarios`
    /// scenarios.
    pub fn outside(
        kind: WarningKind,
        joint: u32,
        reached: f64,
        range: Range,
        scenarios: u64,
    ) -> Self {
        let (quantity, unit) = kind.quantity();
        let bounds = match kind {
            WarningKind::JointLimits
            | WarningKind::PositionLimits
            | WarningKind::VelocityLimits
            | WarningKind::TorqueLimits => "its limits are",
            _ => "the checkpoint was trained on",
        };
        let (low, high) = (number(range.min), number(range.max));
        Self {
            kind,
            predictor: None,
            joint: Some(joint),
            reached: Some(reached),
            range: Some(range),
            scenarios,
            message: format!(
                "{quantity} of joint {joint} reaches {} {unit}; {bounds} {low} to {high} {unit}",
                number(reached)
            ),
        }
    }

    /// A warning that no joint moves by more than `least_rad` during the context.
    pub fn no_motion(least_rad: f64, scenarios: u64) -> Self {
        Self::of_context(
            WarningKind::NoMotion,
            None,
            scenarios,
            format!(
                "no joint moves by more than {least_rad} rad during the context, so nothing about \
                 the robot can be identified"
            ),
        )
    }

    /// A warning that the context has `samples` samples, fewer than `fewest`.
    pub fn short_context(samples: u32, fewest: u32, scenarios: u64) -> Self {
        Self::of_context(
            WarningKind::ShortContext,
            Some(f64::from(samples)),
            scenarios,
            format!(
                "the context has {samples} samples; with fewer than {fewest}, little about the \
                 robot can be identified"
            ),
        )
    }

    /// A warning that a checkpoint was trained on the data of the question.
    pub fn training_data(scenarios: u64) -> Self {
        Self::of_context(
            WarningKind::TrainingData,
            None,
            scenarios,
            "the checkpoint was trained on this data, so its error here says little about robots \
             that it has not seen"
                .to_owned(),
        )
    }

    /// A warning that a predictor has no finite simulation and holds the last position.
    pub fn held(scenarios: u64) -> Self {
        Self::of_context(
            WarningKind::Held,
            None,
            scenarios,
            "its simulation is not finite, and the last position stands for it; an arm without \
             damping or rotors may be the cause"
                .to_owned(),
        )
    }

    fn of_context(
        kind: WarningKind,
        reached: Option<f64>,
        scenarios: u64,
        message: String,
    ) -> Self {
        Self { kind, predictor: None, joint: None, reached, range: None, scenarios, message }
    }

    /// The same warning about one predictor.
    #[must_use]
    pub fn of(self, predictor: &str) -> Self {
        Self { predictor: Some(predictor.to_owned()), ..self }
    }

    /// The distance to its range, in widths of the range.
    fn excess(&self) -> f64 {
        let (Some(reached), Some(Range { min, max })) = (self.reached, self.range) else {
            return 0.0;
        };
        (min - reached).max(reached - max) / (max - min).max(f64::MIN_POSITIVE)
    }

    /// Merges warnings from several places. Each predictor, kind and joint gets one warning with
    /// the value furthest outside, in the order of first appearance.
    pub fn merge(found: impl IntoIterator<Item = Self>) -> Vec<Self> {
        let mut merged: Vec<Self> = Vec::new();
        for warning in found {
            let same = |other: &&mut Self| {
                (other.kind, other.joint, &other.predictor)
                    == (warning.kind, warning.joint, &warning.predictor)
            };
            match merged.iter_mut().find(same) {
                Some(first) => {
                    let scenarios = first.scenarios + warning.scenarios;
                    if warning.excess() > first.excess() {
                        *first = warning;
                    }
                    first.scenarios = scenarios;
                }
                None => merged.push(warning),
            }
        }
        merged
    }

    /// One sentence for each kind and predictor. It names the joint that is furthest outside, and
    /// the others. Predictors with the same warning share a sentence. `all` is the number of
    /// scenarios, and `each` is the noun for them.
    pub fn sentences(warnings: &[Self], all: u64, each: &str) -> Vec<String> {
        let mut sentences: Vec<(Vec<&str>, String)> = Vec::new();
        for (k, warning) in warnings.iter().enumerate() {
            let is_alike = |other: &&Self| {
                (&other.predictor, other.kind) == (&warning.predictor, warning.kind)
            };
            if warnings[..k].iter().any(|other| is_alike(&other)) {
                continue;
            }
            let alike: Vec<&Self> = warnings[k..].iter().filter(is_alike).collect();
            let rest = Self::of_worst(&alike, all, each);
            let name = warning.predictor.as_deref();
            match sentences.iter_mut().find(|(_, sentence)| *sentence == rest) {
                Some((names, _)) => names.extend(name),
                None => sentences.push((name.into_iter().collect(), rest)),
            }
        }
        let told = |(names, rest): (Vec<&str>, String)| match names.as_slice() {
            [] => rest,
            names => format!("{}: {rest}", names.join(", ")),
        };
        sentences.into_iter().map(told).collect()
    }

    fn of_worst(alike: &[&Self], all: u64, each: &str) -> String {
        let worst = alike.iter().max_by(|a, b| a.excess().total_cmp(&b.excess()));
        let Some(worst) = worst else { return String::new() };
        let others =
            alike.iter().filter(|other| other.joint != worst.joint).filter_map(|other| other.joint);
        let mut others: Vec<u32> = others.collect();
        others.sort_unstable();
        let (message, scenarios) = (&worst.message, worst.scenarios);
        format!("{message}{} ({scenarios} of {all} {each})", joints(&others))
    }
}

fn joints(others: &[u32]) -> String {
    let numbers: Vec<String> = others.iter().map(u32::to_string).collect();
    match numbers.as_slice() {
        [] => String::new(),
        [only] => format!("; joint {only} lies outside as well"),
        [first @ .., last] => {
            format!("; joints {} and {last} lie outside as well", first.join(", "))
        }
    }
}

/// A number with three significant digits, and at most three decimals.
fn number(value: f64) -> String {
    let decimals = match value.abs() {
        100.0.. => 0,
        10.0.. => 1,
        1.0.. => 2,
        _ => 3,
    };
    let text = format!("{value:.decimals$}");
    if text.trim_start_matches('-').bytes().all(|digit| matches!(digit, b'0' | b'.')) {
        "0".to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn torque(joint: u32, reached: f64, scenarios: u64) -> Warning {
        let range = Range::new(-2.8, 2.8);
        Warning::outside(WarningKind::TorqueRange, joint, reached, range, scenarios).of("flow")
    }

    #[test]
    fn a_warning_says_both_numbers() {
        assert_eq!(
            torque(2, -30.1, 1).message,
            "u of joint 2 reaches -30.1 N·m; the checkpoint was trained on -2.80 to 2.80 N·m"
        );
        let limits = Range::new(-3.0718, -0.0698);
        let warning = Warning::outside(WarningKind::JointLimits, 4, 0.3, limits, 1);
        assert_eq!(
            warning.message,
            "the predicted q of joint 4 reaches 0.300 rad; its limits are -3.07 to -0.070 rad"
        );
        let rated = Range::new(-330.0, 330.0);
        let warning = Warning::outside(WarningKind::TorqueLimits, 2, 36_941.0, rated, 1);
        assert_eq!(
            warning.message,
            "the torque of joint 2 reaches 36941 N·m; its limits are -330 to 330 N·m"
        );
    }

    #[test]
    fn what_several_cells_found_is_told_once_by_the_value_furthest_outside() {
        let still = Warning::no_motion(1e-3, 2);
        let merged =
            Warning::merge([torque(2, -30.1, 4), still, torque(2, 31.0, 5), torque(4, 21.9, 5)]);
        let found: Vec<_> = merged
            .iter()
            .map(|warning| (warning.joint, warning.reached, warning.scenarios))
            .collect();
        let expected = [(Some(2), Some(31.0), 9), (None, None, 2), (Some(4), Some(21.9), 5)];
        assert_eq!(found, expected);
        let sentences = Warning::sentences(&merged, 10, "scenarios");
        assert_eq!(
            sentences[0],
            "flow: u of joint 2 reaches 31.0 N·m; the checkpoint was trained on -2.80 to 2.80 N·m; \
             joint 4 lies outside as well (9 of 10 scenarios)"
        );
        assert!(sentences[1].starts_with("no joint moves by more than 0.001 rad"), "{sentences:?}");
        assert_eq!(sentences.len(), 2);

        let both = [torque(3, 4.0, 1).of("arx"), torque(3, 4.0, 1)];
        let [sentence] = &Warning::sentences(&both, 10, "scenarios")[..] else {
            panic!("{both:?}")
        };
        assert!(sentence.starts_with("arx, flow: u of joint 3 reaches 4.00 N·m"), "{sentence}");
    }
}
