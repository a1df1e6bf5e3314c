//! Identification: an arm's parameters from recordings of it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::KindSpec;
use crate::omitted::is_zero;
use crate::{
    DataSource, DataSources, DataSpec, Execution, Gravity, Reference, RobotModel, SpecError,
};

/// Identifies an arm: finds the masses, centres of mass, inertias, friction, rotor inertias, torque
/// offsets and gains with which it explains recordings.
///
/// Each trajectory of a dataset is a recording. Its torques are all that the motors do, the weight
/// of the arm included. Longer trajectories say more, and 2.66 s at least are needed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentifySpec {
    /// The recordings that the arm is fitted to: a dataset, or a list of at most 50. All datasets of
    /// the job have the same rate.
    pub data: DataSources,
    /// The described arm, from which the search begins. Default: the arm that the first dataset of
    /// `data` names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<IdentifyRobot>,
    /// Recordings that the fit does not see. The identified arm is tried on them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation: Option<DataSources>,
    /// Recordings with a load in the hand. Its mass and centre are identified after the arm. Each
    /// dataset has a load of its own, which is the same in all of the dataset's recordings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<DataSources>,
    /// The first trajectories of each dataset that are used, 1 to 1000. Default: all, at most 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trajectories: Option<u32>,
    /// The edge of the low-pass for positions and torques, Hz. It has no delay.
    #[serde(default = "defaults::low_pass_hz")]
    pub low_pass_hz: f64,
    /// The most steps on simulated motions, 0 to 100. 0 fits torques only.
    #[serde(default = "defaults::motion_steps")]
    pub motion_steps: u32,
    /// Standard deviation of the torques' gains around 1, 0 to 1. Motor currents times a nominal
    /// constant need about 0.15, because only the described masses tell a gain.
    #[serde(default)]
    pub gain_deviation: f64,
    /// Torques may be recorded late or early against positions by at most this, 0 to 0.1 s, and the
    /// delay is identified. Default: 0, and none is sought.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub most_delay_s: f64,
    /// How the job is executed. It is not part of the digest.
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// The described arm of an identification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentifyRobot {
    /// The name of a built-in arm, or a description.
    pub model: RobotModel,
}

mod defaults {
    pub(super) const fn low_pass_hz() -> f64 {
        8.0
    }

    pub(super) const fn motion_steps() -> u32 {
        8
    }
}

impl IdentifySpec {
    /// The most datasets of a list.
    pub const MOST_DATASETS: usize = 50;

    /// The most of `most_delay_s`, s.
    pub const MOST_DELAY_S: f64 = 0.1;

    /// The most trajectories of a dataset that are used.
    pub const MOST_TRAJECTORIES: u32 = 1000;

    /// The least duration of a trajectory, s: two of the longest horizon.
    pub const LEAST_S: f64 = 2.66;

    /// All recordings are used together, so their samples are limited. 1000 s at 250 Hz.
    pub const MOST_SAMPLES: u64 = 250_000;

    /// The number of trajectories that are used of a dataset with `count`.
    pub fn used(&self, count: u64) -> u64 {
        count.min(self.trajectories.unwrap_or(Self::MOST_TRAJECTORIES).into())
    }

    /// All datasets with their fields, in the order of the references.
    pub fn sources(&self) -> Vec<(String, &DataSource)> {
        self.lists().flat_map(|(field, sources)| sources.in_field(field)).collect()
    }

    /// The fields that name datasets.
    fn lists(&self) -> impl Iterator<Item = (&'static str, &DataSources)> {
        let others = [("validation", &self.validation), ("load", &self.load)];
        let others =
            others.into_iter().filter_map(|(field, sources)| Some((field, sources.as_ref()?)));
        std::iter::once(("data", &self.data)).chain(others)
    }

    /// Compares the spec with the data that its references were resolved to, in the order of
    /// [`IdentifySpec::sources`].
    ///
    /// # Errors
    /// Names each field that does not fit the robot or the first of the data, with both numbers.
    pub fn check_inputs(&self, found: &[&DataSpec]) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        let Some(robot) = &self.robot else {
            let allowed = "{\"model\": ...}, because the data name no arm";
            return Err(SpecError::one("robot", "missing", allowed));
        };
        let joints = robot.model.description().joints.len();
        let fields: Vec<String> = self.sources().into_iter().map(|(field, _)| field).collect();
        let (Some(first), Some(rate_hz)) =
            (fields.first(), found.first().map(|data| data.rate_hz()))
        else {
            return Err(SpecError::one("data", "[]", "at least one dataset"));
        };
        for (field, data) in fields.iter().zip(found) {
            let found = data.joints();
            if found != joints {
                let allowed = format!("{joints}, as the robot has");
                violations.add(field, format!("recordings of {found} joints"), allowed);
            }
            if (data.rate_hz() - rate_hz).abs() > f64::EPSILON {
                let found = format!("{} Hz", data.rate_hz());
                violations.add(field, found, format!("{rate_hz} Hz, as {first} has"));
            }
            let seconds = f64::from(data.samples()) / data.rate_hz();
            if seconds < Self::LEAST_S {
                let found = format!("trajectories of {seconds:.2} s");
                violations.add(field, found, format!("at least {} s", Self::LEAST_S));
            }
            if let Some(simulation) = data.simulation()
                && simulation.robot.gravity != Gravity::On
            {
                let found = "a simulation whose torques lack the arm's weight";
                violations.add(field, found, "one with robot.gravity \"on\"");
            }
        }
        self.check_once(&mut violations);
        let nyquist_hz = 0.5 * rate_hz;
        if self.low_pass_hz >= nyquist_hz {
            let allowed = format!("below {nyquist_hz} Hz, half the rate of the data");
            violations.add("low_pass_hz", self.low_pass_hz, allowed);
        }
        violations.finish()
    }

    /// Refuses a dataset that a list has twice.
    fn check_once(&self, violations: &mut Violations) {
        for (field, sources) in self.lists() {
            let sources = sources.each();
            for (at, source) in sources.iter().enumerate() {
                if sources[..at].contains(source) {
                    let value = serde_json::to_string(source).unwrap_or_default();
                    violations.add(&format!("{field}[{at}]"), value, "each dataset once");
                }
            }
        }
    }
}

impl KindSpec for IdentifySpec {
    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        let others = [("validation", &mut self.validation), ("load", &mut self.load)];
        let others =
            others.into_iter().filter_map(|(field, sources)| Some((field, sources.as_mut()?)));
        std::iter::once(("data", &mut self.data))
            .chain(others)
            .flat_map(|(field, sources)| sources.references(field))
            .collect()
    }

    /// Takes the arm that the data name, if the spec names none.
    fn fit_to_data(&mut self, data: &DataSpec) {
        let named = match data {
            DataSpec::Simulation(spec) => Some(&spec.robot),
            DataSpec::Import(spec) => spec.robot.as_ref(),
        };
        if let (None, Some(robot)) = (&self.robot, named) {
            self.robot = Some(IdentifyRobot { model: robot.model.clone() });
        }
    }
}

impl Check for IdentifySpec {
    fn check(&self, violations: &mut Violations) {
        for (field, sources) in self.lists() {
            violations.length(field, sources.each().len(), 1..=Self::MOST_DATASETS);
        }
        for (field, source) in self.sources() {
            if let DataSource::Stream(_) = source {
                violations.add(&field, "a stream", r#"{"dataset": ID} or {"digest": HEX}"#);
            }
        }
        self.check_once(violations);
        if let Some(robot) = &self.robot {
            violations.part("robot", robot);
        }
        if let Some(trajectories) = self.trajectories {
            violations.within("trajectories", trajectories, 1..=Self::MOST_TRAJECTORIES);
        }
        violations.within("low_pass_hz", self.low_pass_hz, 0.1..=500.0);
        violations.within("motion_steps", self.motion_steps, 0..=100);
        violations.within("gain_deviation", self.gain_deviation, 0.0..=1.0);
        violations.within("most_delay_s", self.most_delay_s, 0.0..=Self::MOST_DELAY_S);
        violations.part("execution", &self.execution);
    }
}

impl Check for IdentifyRobot {
    fn check(&self, violations: &mut Violations) {
        violations.part("model", &self.model);
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn parse(spec: &Value) -> Result<crate::JobSpec, SpecError> {
        crate::parse(spec.to_string().as_bytes())
    }

    #[test]
    fn a_list_of_datasets_is_a_reference_per_dataset() {
        let spec = json!({
            "kind": "identify", "data": [{"dataset": 1}, {"dataset": 4}], "load": {"dataset": 5},
        });
        let mut spec = parse(&spec).unwrap();
        let fields: Vec<String> =
            spec.references().into_iter().map(|reference| reference.field).collect();
        assert_eq!(fields, ["data[0]", "data[1]", "load"]);
        let stored = serde_json::to_value(&spec).unwrap();
        assert_eq!(stored["data"], json!([{"dataset": 1}, {"dataset": 4}]));
        assert_eq!(stored["load"], json!({"dataset": 5}));
    }

    #[test]
    fn a_list_has_datasets_each_once() {
        let refused = |data: Value| {
            parse(&json!({"kind": "identify", "data": data})).unwrap_err().to_string()
        };
        let twice = refused(json!([{"dataset": 1}, {"dataset": 4}, {"dataset": 1}]));
        assert!(twice.contains("data[2]") && twice.contains("each dataset once"), "{twice}");
        assert!(refused(json!([])).contains("data is 0, allowed: 1 to 50"));
        let stream = json!({
            "trajectories": 1, "excitation": {"chirp": {"frequency_hz": {"fixed": 0.2}}},
        });
        let stream = refused(json!([{"dataset": 1}, {"stream": stream}]));
        assert!(stream.contains("data[1] is a stream"), "{stream}");
        let unknown = refused(json!([{"data": 1}]));
        assert!(unknown.contains("data[0]"), "{unknown}");
    }
}
