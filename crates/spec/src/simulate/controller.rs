//! The controller that makes the arm of a simulation follow a reference.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use super::control_law::{ControlLaw, check_task};
use super::integrator::{Integrator, MAX_SUBSTEPS};
use super::robot_spec::Gravity;
use super::spec::SimulateSpec;
use crate::check::{Check, Violations};

/// A controller in discrete time. It measures positions, with the noise and the resolution of
/// `observations`, and its torques follow a reference of `excitation`.
///
/// It knows the nominal arm without a payload, and never the drawn robot. Its gains are drawn for
/// each robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// The control law.
    pub law: ControlLaw,
    /// Half-width of each joint's gains, as a fraction, around those that the robot draws.
    #[serde(default = "defaults::gain_fraction")]
    pub gain_fraction: f64,
    /// Whether the controller adds the nominal arm's gravity torque at the measured positions.
    #[serde(default = "defaults::yes")]
    pub gravity_compensation: bool,
    /// Control periods per second: a multiple of the sampling rate. Default: the multiple nearest
    /// to 1000.
    #[serde(default = "defaults::rate_hz")]
    pub rate_hz: f64,
    /// Interval of the number of control periods between a measurement and its torque.
    #[serde(default)]
    #[schema(min_items = 2, max_items = 2)]
    pub delay_periods: [u32; 2],
    /// Cut-off of the first-order low-pass that smooths the differences of measured positions to
    /// velocities, Hz.
    #[serde(default = "defaults::velocity_cutoff_hz")]
    pub velocity_cutoff_hz: f64,
    /// Limit of each joint's torque, as a share of `torque_nm` in the robot's description.
    #[serde(default = "defaults::torque_share")]
    pub torque_share: f64,
    /// The fastest change of a torque, N·m/s; `null` for no limit.
    #[serde(default)]
    pub torque_rate_nm_s: Option<f64>,
    /// Time between the start of the motion and the first sample, s. The arm starts on the
    /// reference, and needs a moment to take its load.
    #[serde(default = "defaults::settle_s")]
    pub settle_s: f64,
}

/// The longest delay of a controller.
pub const MAX_DELAY_PERIODS: u32 = 3;

/// The fastest controller, Hz.
const MAX_RATE_HZ: f64 = 10_000.0;

impl Check for Controller {
    fn check(&self, violations: &mut Violations) {
        violations.part("law", &self.law);
        violations.within("gain_fraction", self.gain_fraction, 0.0..=0.9);
        violations.within("rate_hz", self.rate_hz, 1.0..=MAX_RATE_HZ);
        let [least, most] = self.delay_periods;
        violations.within("delay_periods[0]", least, 0..=MAX_DELAY_PERIODS);
        violations.within("delay_periods[1]", most, 0..=MAX_DELAY_PERIODS);
        if least > most {
            let allowed = "[min, max] with min not above max";
            violations.add("delay_periods", format!("[{least}, {most}]"), allowed);
        }
        violations.within("velocity_cutoff_hz", self.velocity_cutoff_hz, 0.1..=MAX_RATE_HZ);
        violations.within("torque_share", self.torque_share, 0.01..=1.0);
        if let Some(rate) = self.torque_rate_nm_s {
            violations.within("torque_rate_nm_s", rate, 1.0..=1e7);
        }
        violations.within("settle_s", self.settle_s, 0.0..=10.0);
    }
}

impl Controller {
    /// The control periods of a sampling period at `rate_hz`.
    pub fn periods(&self, rate_hz: f64) -> usize {
        whole(self.rate_hz / rate_hz).max(1)
    }

    /// The samples from the start of the motion to the first one that is recorded.
    pub fn settling_samples(&self, rate_hz: f64) -> usize {
        whole((self.settle_s * rate_hz).ceil())
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checks bound both rates and the time to settle"
)]
fn whole(number: f64) -> usize {
    number.round() as usize
}

impl SimulateSpec {
    /// The steps per second that start with a new torque.
    pub fn torque_rate_hz(&self) -> f64 {
        self.controller.as_ref().map_or(self.rate_hz, |controller| controller.rate_hz)
    }

    /// The integrator of the simulation, with steps of the same length, for torques that are held
    /// for a whole sampling period. Controllers have shorter periods.
    pub fn sample_integrator(&self) -> Integrator {
        let periods = self.controller.as_ref().map_or(1, |it| it.periods(self.rate_hz));
        let times = |substeps: u32| {
            u32::try_from(periods)
                .unwrap_or(MAX_SUBSTEPS)
                .saturating_mul(substeps)
                .min(MAX_SUBSTEPS)
        };
        match self.integrator {
            integrator if self.controller.is_none() => integrator,
            Integrator::Extrapolated { order, substeps } => {
                Integrator::Extrapolated { order, substeps: times(substeps) }
            }
            Integrator::Rk4 { substeps } => Integrator::Rk4 { substeps: times(substeps) },
            Integrator::Midpoint { substeps } => Integrator::Midpoint { substeps: times(substeps) },
            Integrator::Reference => Integrator::Reference,
        }
    }

    /// Checks the controller against the rate, the robot and the observations.
    pub(super) fn check_controller(&self, violations: &mut Violations) {
        let Some(controller) = &self.controller else { return };
        violations.part("controller", controller.as_ref());
        let ratio = controller.rate_hz / self.rate_hz;
        if ratio < 0.999 || (ratio - ratio.round()).abs() > 1e-9 * ratio {
            let [below, above] =
                [ratio.floor().max(1.0), ratio.ceil().max(1.0)].map(|ratio| ratio * self.rate_hz);
            let allowed =
                format!("a multiple of rate_hz, which is {}: {below} or {above}", self.rate_hz);
            violations.add("controller.rate_hz", controller.rate_hz, allowed);
        }
        for (name, gains) in controller.law.explicit_gains() {
            if let Some(gains) = gains {
                let field = format!("controller.law.joint-pd.{name}");
                violations.one_per_joint(&field, gains, self.joints());
            }
        }
        if let Some((law, asked)) = controller.law.asked_orientation() {
            let field = format!("controller.law.{law}");
            check_task(&field, asked, self.joints(), violations);
        }
        if let Some(paths) = &self.excitation.hand_paths {
            check_task("excitation.hand_paths", paths.orientation, self.joints(), violations);
        }
        if self.robot.gravity == Gravity::Compensated {
            violations.add(
                "robot.gravity",
                "compensated",
                "on or off with a controller, whose gravity_compensation knows the nominal arm only",
            );
        }
        let center = &self.initial_state.center_rad;
        for (joint, (described, center)) in
            self.robot.description().joints.iter().zip(center).enumerate()
        {
            let limits = described.position_rad;
            if !(limits.min < *center && *center < limits.max) {
                violations.add(
                    &format!("initial_state.center_rad[{joint}]"),
                    center,
                    format!(
                        "between the limits {} and {} of joint {}, because references lie about it",
                        limits.min,
                        limits.max,
                        joint + 1
                    ),
                );
            }
        }
    }
}

/// Completes the fields of a simulation with a controller, whose defaults differ from those of an
/// arm that torques drive: gravity acts, and steps are as short as control periods.
pub(super) fn complete(fields: &mut Map<String, Value>) {
    if !fields.get("controller").is_some_and(Value::is_object) {
        return;
    }
    let rate_hz = fields.get("rate_hz").map_or(Some(60.0), Value::as_f64);
    if let Some(rate_hz) = rate_hz.filter(|rate| *rate > 0.0)
        && let Some(Value::Object(controller)) = fields.get_mut("controller")
    {
        let nearest = (defaults::rate_hz() / rate_hz).round().max(1.0) * rate_hz;
        controller.entry("rate_hz").or_insert_with(|| nearest.into());
    }
    let short_steps = json!({"scheme": "midpoint", "substeps": 1});
    fields.entry("integrator").or_insert(short_steps);
    let robot = fields.entry("robot").or_insert_with(|| Map::new().into());
    if let Value::Object(robot) = robot {
        robot.entry("gravity").or_insert_with(|| "on".into());
    }
}

mod defaults {
    pub const fn gain_fraction() -> f64 {
        0.1
    }
    pub const fn yes() -> bool {
        true
    }
    pub const fn rate_hz() -> f64 {
        1000.0
    }
    pub const fn velocity_cutoff_hz() -> f64 {
        50.0
    }
    pub const fn torque_share() -> f64 {
        1.0
    }
    pub const fn settle_s() -> f64 {
        0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{JobSpec, SpecError};

    fn parse(fields: &Value) -> Result<SimulateSpec, SpecError> {
        let mut spec = json!({
            "kind": "simulate", "trajectories": 2,
            "excitation": {"fourier": {"frequency_hz": {"fixed": 0.2}}},
            "controller": {"law": {"joint-pd": {}}},
        });
        if let (Some(spec), Some(fields)) = (spec.as_object_mut(), fields.as_object()) {
            spec.extend(fields.clone());
        }
        match crate::parse(spec.to_string().as_bytes())? {
            JobSpec::Simulate(spec) => Ok(spec),
            other => panic!("{other:?}"),
        }
    }

    fn refusal(fields: &Value) -> String {
        parse(fields).map_or_else(|error| error.to_string(), |spec| panic!("accepted: {spec:?}"))
    }

    #[test]
    fn a_controller_brings_gravity_short_steps_and_a_rate_near_1000() {
        let spec = parse(&json!({})).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(spec.robot.gravity, Gravity::On);
        assert_eq!(spec.integrator.to_string(), "midpoint, substeps 1");
        assert_eq!(spec.sample_integrator().to_string(), "midpoint, substeps 17");
        let rate = |rate_hz: f64| {
            let spec = parse(&json!({"rate_hz": rate_hz}));
            spec.ok().and_then(|spec| spec.controller).map(|controller| controller.rate_hz)
        };
        assert_eq!(
            [60.0, 100.0, 125.0, 1000.0].map(rate),
            [1020.0, 1000.0, 1000.0, 1000.0].map(Some)
        );
        let given = json!({"robot": {"gravity": "off"}, "integrator": {"scheme": "rk4"}});
        let spec = parse(&given).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(spec.robot.gravity, Gravity::Off);
        assert_eq!(spec.integrator.to_string(), "rk4, substeps 6");
    }

    #[test]
    fn what_a_controller_cannot_do_is_refused_with_field_value_and_remedy() {
        let law = |law: Value| json!({"controller": {"law": law}});
        let controller = |field: &str, value: Value| json!({"controller": {"law": {"joint-pd": {}}, field: value}});
        for (fields, parts) in [
            (json!({"controller": null}), ["excitation.fourier", "references need a controller"]),
            (
                json!({"excitation": {"chirp": {"frequency_hz": {"fixed": 1}}}}),
                ["excitation.chirp", "a controller follows references"],
            ),
            (controller("rate_hz", json!(1000)), ["controller.rate_hz", "960 or 1020"]),
            (controller("rate_hz", json!(30)), ["controller.rate_hz", "60"]),
            (controller("delay_periods", json!([2, 1])), ["delay_periods", "min not above max"]),
            (controller("delay_periods", json!([0, 4])), ["delay_periods[1]", "0 to 3"]),
            (controller("settle_s", json!(11)), ["controller.settle_s", "0 to 10"]),
            (
                law(json!({"joint-pd": {"stiffness_nm_rad": [1, 2]}})),
                ["stiffness_nm_rad", "7 numbers"],
            ),
            (
                law(json!({"computed-torque": {"damping_ratio": [1, 0]}})),
                ["controller.law.computed-torque.damping_ratio", "min not above max"],
            ),
            (law(json!({"admittance": {}})), ["controller.law", "joint-pd"]),
            (json!({"robot": {"gravity": "compensated"}}), ["robot.gravity", "nominal arm"]),
            (
                json!({"initial_state": {"center_rad": [0, 0, 0, 0.5, 0, 1.8, 0]}}),
                ["initial_state.center_rad[3]", "joint 4"],
            ),
            (
                json!({"excitation": {"fourier": {"frequency_hz": {"fixed": 7}}}}),
                ["excitation.fourier.frequency_hz", "30 Hz"],
            ),
            (
                json!({"excitation": {"via_points": {"frequency_hz": {"fixed": 16}}}}),
                ["excitation.via_points.frequency_hz", "15 Hz"],
            ),
            (
                json!({
                    "samples": 10_000,
                    "excitation": {"point_to_point": {"frequency_hz": {"fixed": 10}}},
                }),
                ["up to 1667 postures", "at most 1000 postures"],
            ),
        ] {
            let error = refusal(&fields);
            assert!(parts.iter().all(|part| error.contains(part)), "{parts:?}: {error}");
        }
    }
}
