//! The report of a motion: the parameters that it shows, beside random motions.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use series::median;
use spec::RobotDescription;

use super::error::ExcitationError;
use super::limits::Limits;
use super::search::Candidate;
use crate::arm::{NUMBERS, Parameter, Prior};
use crate::estimates::named;
use crate::fourier::MotionState;

/// How a joint uses its limits. Limits are the description's, without the margin.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointExcitation {
    /// The joint's name.
    pub name: String,
    /// Where the motion begins and ends, rad.
    pub start_rad: f64,
    /// The lowest and the highest position, rad.
    pub position_rad: [f64; 2],
    /// Their limits, rad.
    pub position_limit_rad: [f64; 2],
    /// The highest speed, rad/s.
    pub velocity_rad_s: f64,
    /// Its limit, rad/s.
    pub velocity_limit_rad_s: f64,
    /// The largest acceleration, rad/s².
    pub acceleration_rad_s2: f64,
    /// Its limit, rad/s².
    pub acceleration_limit_rad_s2: f64,
    /// The largest torque of the described arm, friction included, N·m.
    pub torque_nm: f64,
    /// Its limit, N·m.
    pub torque_limit_nm: f64,
    /// Standard deviation of the torque that parameters cannot explain, N·m.
    pub noise_nm: f64,
}

/// The predicted uncertainty of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterPrediction {
    /// `mass`, `center_x`, `inertia_xx`, `coulomb`, `viscous`, `offset`, `rotor` or `gain`, as an
    /// identification names it.
    pub name: String,
    /// The unit.
    pub unit: &'static str,
    /// The joint and its link, from 1.
    pub joint: usize,
    /// The description's value, or a usual one.
    pub value: f64,
    /// The standard deviation before any recording.
    pub prior_deviation: f64,
    /// The standard deviation after a recording of the motion.
    pub deviation: f64,
    /// The share of the prior's variance that the recording removes, 0 to 1. `None` where nothing is
    /// unknown.
    pub seen: Option<f64>,
}

/// Random motions within the same limits, beside the motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RandomMotions {
    /// The number of random motions.
    pub count: usize,
    /// The highest log det of the information.
    pub best_log_det: f64,
    /// The median log det.
    pub median_log_det: f64,
    /// The motion's standard deviations in those of the best random motion: the median over
    /// parameters of which the motion removes half of the variance or more. `None` if there are none.
    pub deviation_to_best: Option<f64>,
    /// The same, to the random motion in the middle.
    pub deviation_to_median: Option<f64>,
}

/// The report of a motion: the parameters that it shows, and its use of the limits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExcitationReport {
    /// The length of the motion, s.
    pub seconds: f64,
    /// One over its period, Hz.
    pub base_frequency_hz: f64,
    /// Sines and cosines of each joint.
    pub harmonics: usize,
    /// The share of every limit that stays free.
    pub margin: f64,
    /// The table's height, m.
    pub table_z_m: Option<f64>,
    /// The height of the lowest origin of the joints from the third on and the hand, if there is a
    /// table, m.
    pub lowest_m: Option<f64>,
    /// Numbers of the arm that are not known.
    pub unknown_numbers: usize,
    /// Combinations of them that some motion shows.
    pub base_parameters: usize,
    /// log det(1 + W), with the information W of the base parameters in standard deviations of the
    /// prior: twice what a recording tells, in nats.
    pub log_det: f64,
    /// Random motions, for comparison.
    pub random: RandomMotions,
    /// From the base outwards.
    pub joints: Vec<JointExcitation>,
    /// The parameters of all links and joints.
    pub parameters: Vec<ParameterPrediction>,
    /// The assumptions in place of settings that were not given, one sentence each.
    pub assumptions: Vec<String>,
}

impl JointExcitation {
    pub(crate) fn of(
        index: usize,
        description: &RobotDescription,
        limits: &Limits,
        states: &[MotionState],
        noise_nm: f64,
        torque: impl Fn(&MotionState) -> f64,
    ) -> Self {
        let joint = &description.joints[index];
        let largest = |value: &dyn Fn(&MotionState) -> f64| {
            states.iter().map(|state| value(state).abs()).fold(0.0, f64::max)
        };
        let positions = || states.iter().map(|state| state.q[index]);
        let kept = limits.velocity[index] / joint.velocity_rad_s;
        Self {
            name: joint.name.clone(),
            start_rad: states[0].q[index],
            position_rad: [
                positions().fold(f64::INFINITY, f64::min),
                positions().fold(f64::NEG_INFINITY, f64::max),
            ],
            position_limit_rad: joint.position_rad.into(),
            velocity_rad_s: largest(&|state| state.qd[index]),
            velocity_limit_rad_s: joint.velocity_rad_s,
            acceleration_rad_s2: largest(&|state| state.qdd[index]),
            acceleration_limit_rad_s2: limits.acceleration[index] / kept,
            torque_nm: largest(&torque),
            torque_limit_nm: joint.torque_nm,
            noise_nm,
        }
    }
}

impl RandomMotions {
    /// `random` is in falling order, and not empty.
    /// `of_random` predicts the parameters of one of them.
    ///
    /// # Errors
    /// Those of `of_random`.
    pub(crate) fn beside(
        random: &[Candidate],
        of_random: impl Fn(&Candidate) -> Result<Vec<ParameterPrediction>, ExcitationError>,
        parameters: &[ParameterPrediction],
    ) -> Result<Self, ExcitationError> {
        const SEEN: f64 = 0.5;

        let middle = &random[random.len() / 2];
        let ratio_to = |candidate: &Candidate| {
            let others = of_random(candidate)?;
            let ratios = parameters
                .iter()
                .zip(&others)
                .filter(|(parameter, _)| parameter.seen.is_some_and(|seen| seen >= SEEN))
                .map(|(parameter, other)| parameter.deviation / other.deviation);
            let ratios: Vec<f64> = ratios.collect();
            Ok::<_, ExcitationError>((!ratios.is_empty()).then(|| median(ratios)))
        };
        Ok(Self {
            count: random.len(),
            best_log_det: random[0].information,
            median_log_det: middle.information,
            deviation_to_best: ratio_to(&random[0])?,
            deviation_to_median: ratio_to(middle)?,
        })
    }
}

/// Standard deviations of all parameters at the prior's arm, from the covariance of its numbers.
pub(crate) fn deviations(prior: &Prior, covariance: &DMatrix<f64>) -> Vec<ParameterPrediction> {
    const STEP: f64 = 1e-5;

    let arm = &prior.arm;
    let before = DMatrix::from_diagonal(&prior.deviations.map(|deviation| deviation.powi(2)));
    let of_joint = |joint: usize| {
        let slopes: Vec<DVector<f64>> = (0..NUMBERS)
            .map(|number| {
                let moved = |by: f64| {
                    let mut numbers = arm.numbers.clone();
                    numbers[joint * NUMBERS + number] += by;
                    DVector::from_row_slice(&arm.with_numbers(numbers).parameters(joint))
                };
                (moved(STEP) - moved(-STEP)) / (2.0 * STEP)
            })
            .collect();
        let slopes = DMatrix::from_columns(&slopes);
        let own = (joint * NUMBERS, joint * NUMBERS);
        let variances = |covariance: &DMatrix<f64>| {
            let covariance = covariance.view(own, (NUMBERS, NUMBERS));
            (&slopes * covariance * slopes.transpose()).diagonal()
        };
        let (of_prior, variances) = (variances(&before), variances(covariance));
        let values = arm.parameters(joint);
        let prediction = move |(k, parameter): (usize, &Parameter)| {
            let (name, unit) = named(*parameter);
            let variance = variances[k].max(0.0);
            ParameterPrediction {
                name,
                unit,
                joint: joint + 1,
                value: values[k],
                prior_deviation: of_prior[k].sqrt(),
                deviation: variance.sqrt(),
                seen: (of_prior[k] > 0.0).then(|| (1.0 - variance / of_prior[k]).clamp(0.0, 1.0)),
            }
        };
        Parameter::ALL.iter().enumerate().map(prediction).collect::<Vec<_>>()
    };
    (0..arm.joints()).flat_map(of_joint).collect()
}
