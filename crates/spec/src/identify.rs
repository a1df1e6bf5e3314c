//! Identification: an arm's parameters from recordings of it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::KindSpec;
use crate::{DataSource, DataSpec, Execution, Gravity, Reference, RobotModel, SpecError};

/// Identifies an arm: finds the masses, centres of mass, inertias, friction, rotor inertias, torque
/// offsets and gains with which it explains recordings.
///
/// Each trajectory of a dataset is a recording. Its torques are all that the motors do, the weight
/// of the arm included. Longer trajectories say more, and two seconds at least are needed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentifySpec {
    /// The recordings that the arm is fitted to.
    pub data: DataSource,
    /// The described arm, from which the search begins. Default: the arm that the data name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<IdentifyRobot>,
    /// Recordings that the fit does not see. The identified arm is tried on them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation: Option<DataSource>,
    /// Recordings with a load in the hand, the same in all of them. Its mass and centre are
    /// identified after the arm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<DataSource>,
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

    /// Compares the spec with the data that its references were resolved to.
    ///
    /// # Errors
    /// Names each field that does not fit the data, with both numbers.
    pub fn check_inputs(
        &self,
        data: &DataSpec,
        others: &[(&'static str, &DataSpec)],
    ) -> Result<(), SpecError> {
        let mut violations = Violations::default();
        let Some(robot) = &self.robot else {
            let allowed = "{\"model\": ...}, because the data name no arm";
            return Err(SpecError::one("robot", "missing", allowed));
        };
        let joints = robot.model.description().joints.len();
        for &(field, of_field) in std::iter::once(&("data", data)).chain(others) {
            let found = of_field.joints();
            if found != joints {
                let allowed = format!("{joints}, as the robot has");
                violations.add(field, format!("recordings of {found} joints"), allowed);
            }
            let rate_hz = data.rate_hz();
            if (of_field.rate_hz() - rate_hz).abs() > f64::EPSILON {
                let found = format!("{} Hz", of_field.rate_hz());
                violations.add(field, found, format!("{rate_hz} Hz, as data has"));
            }
            let seconds = f64::from(of_field.samples()) / of_field.rate_hz();
            if seconds < Self::LEAST_S {
                let found = format!("trajectories of {seconds:.2} s");
                violations.add(field, found, format!("at least {} s", Self::LEAST_S));
            }
            if let Some(simulation) = of_field.simulation()
                && simulation.robot.gravity != Gravity::On
            {
                let found = "a simulation whose torques lack the arm's weight";
                violations.add(field, found, "one with robot.gravity \"on\"");
            }
        }
        let nyquist_hz = 0.5 * data.rate_hz();
        if self.low_pass_hz >= nyquist_hz {
            let allowed = format!("below {nyquist_hz} Hz, half the rate of the data");
            violations.add("low_pass_hz", self.low_pass_hz, allowed);
        }
        violations.finish()
    }
}

impl KindSpec for IdentifySpec {
    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        let named = [("validation", &mut self.validation), ("load", &mut self.load)];
        let others = named.into_iter().filter_map(|(field, source)| {
            Some(Reference { field: field.to_owned(), ..Reference::data(source.as_mut()?) })
        });
        std::iter::once(Reference::data(&mut self.data)).chain(others).collect()
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
        let sources = [
            ("data", Some(&self.data)),
            ("validation", self.validation.as_ref()),
            ("load", self.load.as_ref()),
        ];
        for (field, source) in sources {
            if let Some(DataSource::Stream(_)) = source {
                violations.add(field, "a stream", r#"{"dataset": ID} or {"digest": HEX}"#);
            }
        }
        if let Some(robot) = &self.robot {
            violations.part("robot", robot);
        }
        if let Some(trajectories) = self.trajectories {
            violations.within("trajectories", trajectories, 1..=Self::MOST_TRAJECTORIES);
        }
        violations.within("low_pass_hz", self.low_pass_hz, 0.1..=500.0);
        violations.within("motion_steps", self.motion_steps, 0..=100);
        violations.within("gain_deviation", self.gain_deviation, 0.0..=1.0);
        violations.part("execution", &self.execution);
    }
}

impl Check for IdentifyRobot {
    fn check(&self, violations: &mut Violations) {
        if let RobotModel::Described(description) = &self.model {
            violations.part("model", description.as_ref());
        }
    }
}
