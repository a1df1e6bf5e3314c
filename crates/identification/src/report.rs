//! The results of an identification.

use serde::Serialize;

/// Names of predictors.
pub(crate) const DESCRIBED: &str = "description";
pub(crate) const IDENTIFIED: &str = "identified";

/// The errors of a predictor over each horizon: the root mean square over the horizon, averaged over
/// joints and windows, degrees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HorizonErrors {
    /// The predictor.
    pub predictor: String,
    /// In the order of [`crate::HORIZONS_S`].
    pub rmse_deg: [f64; 3],
}

/// A joint's torque less that of the arm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TorqueResidual {
    /// From 1.
    pub joint: usize,
    /// Standard deviation of the measured torque, N·m.
    pub deviation_nm: f64,
    /// Root mean square of what the description leaves, N·m.
    pub nominal_nm: f64,
    /// Root mean square of what the identified arm leaves, N·m.
    pub identified_nm: f64,
}

/// A parameter's values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterEstimate {
    /// `mass`, `center_x`, `inertia_xx`, `coulomb`, `viscous`, `offset`, `rotor`, ..
    pub name: String,
    /// The unit.
    pub unit: &'static str,
    /// The joint and its link, from 1; `None` for a load in the hand, whose frame is the hand's.
    pub joint: Option<usize>,
    /// The description's value. A number that it lacks has the value at which the search began.
    pub nominal: f64,
    /// The identified value.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// The share of the prior's variance that the data removed, 0 to 1. A parameter near 0 is not
    /// seen in these motions. `None` where nothing was unknown.
    pub seen: Option<f64>,
}

/// The results of an identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The parameters of all links and joints.
    pub parameters: Vec<ParameterEstimate>,
    /// Residual torques on the recordings of the fit.
    pub torques: Vec<TorqueResidual>,
    /// Residual torques on the recordings of the validation, if there are any.
    pub validation_torques: Vec<TorqueResidual>,
    /// Errors of predictors on the recordings of the fit.
    pub errors: Vec<HorizonErrors>,
    /// Errors of predictors on the recordings of the validation, if there are any.
    pub validation_errors: Vec<HorizonErrors>,
    /// Reasons to doubt the results, one sentence each.
    pub warnings: Vec<String>,
}

impl Report {
    /// Adds what the numbers themselves give reason to doubt.
    pub(crate) fn warn(&mut self) {
        const UNSEEN: f64 = 0.1;

        let unknown = || self.parameters.iter().filter_map(|parameter| parameter.seen);
        let unseen = unknown().filter(|seen| *seen < UNSEEN).count();
        if unseen > 0 {
            self.warnings.push(format!(
                "{unseen} of {} parameters are hardly seen in these motions: they keep the description's values",
                unknown().count()
            ));
        }
        let of = |errors: &[HorizonErrors], name: &str| {
            errors.iter().find(|errors| errors.predictor == name).map(|errors| errors.rmse_deg)
        };
        let (identified, described) =
            (of(&self.validation_errors, IDENTIFIED), of(&self.validation_errors, DESCRIBED));
        if let (Some(identified), Some(described)) = (identified, described) {
            for ((horizon, identified), described) in
                crate::HORIZONS_S.iter().zip(identified).zip(described)
            {
                if identified.is_nan() || identified > described {
                    self.warnings.push(format!(
                        "over {horizon} s of the validation the identified arm is off by {identified:.3}°, \
                         the description by {described:.3}°"
                    ));
                }
            }
        }
    }
}
