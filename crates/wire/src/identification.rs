//! The report of an identification: the parameters of an arm, and how well they explain recordings.
//!
//! The task of an identify job writes it as `report.json`.

use serde::{Deserialize, Serialize};
use spec::Digest;
use utoipa::ToSchema;

/// The result of an identification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct IdentificationReport {
    /// The digest of the description that was found. A server keeps the robot, and a spec names it
    /// by this: `"robot": {"model": {"digest": HEX}}`.
    pub robot: Digest,
    /// The arm.
    pub arm: ArmReport,
    /// The load in its hand, if recordings with one were given; the first of several. Its
    /// parameters are those of the arm and then the load's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<ArmReport>,
    /// Every load.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loads: Vec<LoadReport>,
}

/// A load in the hand, in the hand's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LoadReport {
    /// The recordings with this load.
    pub recordings: String,
    /// Its mass, kg.
    pub mass_kg: f64,
    /// Standard deviation of the mass, kg.
    pub mass_deviation_kg: f64,
    /// Its centre of mass, m.
    pub center_m: [f64; 3],
    /// Standard deviations of the centre, m.
    pub center_deviation_m: [f64; 3],
    /// Errors of predictors on its recordings.
    pub errors: Vec<HorizonErrors>,
    /// Reasons to doubt the load, one sentence each.
    pub warnings: Vec<String>,
}

/// An arm's parameters and how well they explain recordings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ArmReport {
    /// The parameters of all links and joints.
    pub parameters: Vec<ParameterEstimate>,
    /// Directions in the space of parameters.
    #[serde(default)]
    pub directions: Directions,
    /// Pairs of parameters that the recordings tell apart badly, the worst first, at most 10.
    #[serde(default)]
    pub correlated: Vec<Correlation>,
    /// Residual torques on the recordings of the fit.
    pub torques: Vec<TorqueResidual>,
    /// Residual torques on the recordings of the validation, if there are any.
    pub validation_torques: Vec<TorqueResidual>,
    /// How far ahead motions are predicted, s.
    pub horizons_s: Vec<f64>,
    /// Errors of predictors on the recordings of the fit.
    pub errors: Vec<HorizonErrors>,
    /// Errors of predictors on the recordings of the validation, if there are any.
    pub validation_errors: Vec<HorizonErrors>,
    /// Reasons to doubt the results, one sentence each.
    pub warnings: Vec<String>,
}

/// A parameter's values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ParameterEstimate {
    /// `mass`, `center_x`, `inertia_xx`, `coulomb`, `viscous`, `offset`, `rotor`, `gain`, ..; those
    /// of a load begin with `load_`.
    pub name: String,
    /// The unit.
    pub unit: String,
    /// The joint and its link, from 1; `None` for a load in the hand, whose frame is the hand's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<u32>,
    /// The description's value. A number that it lacks has the value at which the search began.
    pub described: f64,
    /// The identified value.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// The share of the prior's variance that the data removed, 0 to 1. A parameter near 0 is not
    /// seen in these motions. `None` where nothing was unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<f64>,
}

/// How many independent combinations of the parameters the recordings determine, and how evenly.
/// Parameters are measured in standard deviations of the prior.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Directions {
    /// Combinations that are not known beforehand.
    pub unknown: u32,
    /// Combinations about which the recordings say more than the prior.
    pub determined: u32,
    /// The largest standard deviation of a determined combination over the smallest: the condition
    /// number of the weighted regressor.
    pub condition: f64,
}

/// Two parameters whose errors go together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Correlation {
    /// The parameter with its joint, such as `mass 3`.
    pub a: String,
    /// The other one.
    pub b: String,
    /// Their coefficient of correlation, -1 to 1.
    pub coefficient: f64,
}

/// A joint's torque less that of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TorqueResidual {
    /// From 1.
    pub joint: u32,
    /// Standard deviation of the measured torque, N·m.
    pub deviation_nm: f64,
    /// Root mean square of what the description leaves, N·m.
    pub described_nm: f64,
    /// Root mean square of what the identified arm leaves, N·m.
    pub identified_nm: f64,
}

/// The errors of a predictor over each horizon: the root mean square over the horizon, averaged over
/// joints and windows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HorizonErrors {
    /// `hold`, `constant velocity`, `ARX`, `description` or `identified`; with a load, `load of 1 kg`
    /// in place of `description`. ARX is a linear law that is fitted to the same recordings.
    pub predictor: String,
    /// In the order of the report's `horizons_s`, degrees. `None` for a simulation that diverged.
    pub rmse_deg: Vec<Option<f64>>,
}
