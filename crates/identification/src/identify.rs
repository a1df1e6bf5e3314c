//! The steps from recordings to an arm.

use dynamics::{LINK_PARAMETERS, RigidBody};
use nalgebra::{DMatrix, DVector};
use spec::RobotDescription;

use crate::IdentificationError;
use crate::arm::{Arm, JointParameter, NUMBERS, Parameter, Prior, described_friction_speed};
use crate::motion::{Motion, Recording};
use crate::normal_equations::minimize;
use crate::report::{
    DESCRIBED, HorizonErrors, IDENTIFIED, ParameterEstimate, Report, TorqueResidual,
};
use crate::rollouts::{RolloutFit, Windows};
use crate::torques::Torques;

/// The settings of an identification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The edge of the low-pass for positions and torques, Hz.
    pub low_pass_hz: f64,
    /// The most steps on motions. Without any, only torques are fitted.
    pub motion_steps: usize,
    /// Standard deviation of the torques' gains around 1; 0 where the sensors are right. Currents
    /// times a nominal torque constant are often off by 10 %. Only the described masses tell a gain,
    /// so they should be right then.
    pub gain_deviation: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { low_pass_hz: 8.0, motion_steps: 8, gain_deviation: 0.0 }
    }
}

/// An identified arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// The arm.
    pub arm: Arm,
    /// Residuals, errors and parameters.
    pub report: Report,
}

/// Seconds from one window of the fit to the next.
const EVERY_S: f64 = 0.67;
/// Seconds from one window of a report to the next.
const REPORTED_EVERY_S: f64 = 1.0;

/// Speeds that are tried for the bend of Coulomb friction, rad/s.
const FRICTION_SPEEDS_RAD_S: [f64; 5] = [0.01, 0.02, 0.04, 0.08, 0.16];

/// Identifies the arm of a description from recordings. All have the same rate.
///
/// # Errors
/// See [`IdentificationError`].
pub fn identify(
    description: &RobotDescription,
    recordings: &[Recording],
    validation: &[Recording],
    settings: &Settings,
) -> Result<Identification, IdentificationError> {
    let mut speeds = FRICTION_SPEEDS_RAD_S.to_vec();
    speeds.extend(described_friction_speed(description));
    let priors = speeds
        .into_iter()
        .map(|speed| Prior::of(description, speed, settings.gain_deviation))
        .collect::<Result<Vec<_>, _>>()?;
    search(priors, recordings, validation, settings)
}

/// Identifies the load in the hand of an arm that [`identify`] found. All recordings have the same
/// load and the same rate. The report's last parameters are the load's, and its description is the
/// arm with a usual load.
///
/// # Errors
/// See [`IdentificationError`].
pub fn identify_load(
    arm: &Arm,
    recordings: &[Recording],
    validation: &[Recording],
    settings: &Settings,
) -> Result<Identification, IdentificationError> {
    search(vec![Prior::loaded(arm)], recordings, validation, settings)
}

/// The prior whose regression leaves the least torque, and the arm from there.
fn search(
    priors: Vec<Prior>,
    recordings: &[Recording],
    validation: &[Recording],
    settings: &Settings,
) -> Result<Identification, IdentificationError> {
    let joints = priors.first().map_or(0, |prior| prior.arm.joints());
    let motions = motions(recordings, joints, settings)?;
    let validation = self::motions(validation, joints, settings)?;
    check_together(motions.iter().chain(&validation))?;
    if motions.is_empty() {
        return Err(IdentificationError::NoRecordings);
    }
    let mut warnings = Vec::new();
    check_motion(&motions, joints, &mut warnings)?;

    let fits = priors.into_iter().map(|prior| fit_torques(prior, &motions));
    let best = fits.min_by(|a, b| a.misfit.total_cmp(&b.misfit));
    let Some(TorqueFit { prior, mut arm, torques, covariance, .. }) = best else {
        return Err(IdentificationError::NoRecordings);
    };
    if settings.motion_steps > 0 {
        arm = fit_motions(&motions, &prior, &arm, &torques, &covariance, settings.motion_steps);
    }
    let mut report = Report {
        parameters: parameters(&prior, &arm, &torques),
        torques: residuals(&torques, &prior, &arm),
        validation_torques: Vec::new(),
        errors: errors(&motions, &prior, &arm),
        validation_errors: Vec::new(),
        warnings,
    };
    if !validation.is_empty() {
        report.validation_torques = residuals(&Torques::new(&arm, &validation), &prior, &arm);
        report.validation_errors = errors(&validation, &prior, &arm);
    }
    report.warn();
    Ok(Identification { arm, report })
}

/// Checks that there are recordings, and that all have the same rate.
fn check_together<'a>(
    mut motions: impl Iterator<Item = &'a Motion>,
) -> Result<(), IdentificationError> {
    let first = motions.next().ok_or(IdentificationError::NoRecordings)?;
    match motions.find(|motion| motion.rate_hz != first.rate_hz) {
        None => Ok(()),
        Some(other) => Err(IdentificationError::Rates {
            recording: other.name.clone(),
            rate_hz: other.rate_hz,
            allowed_hz: first.rate_hz,
        }),
    }
}

fn motions(
    recordings: &[Recording],
    joints: usize,
    settings: &Settings,
) -> Result<Vec<Motion>, IdentificationError> {
    recordings
        .iter()
        .map(|recording| Motion::new(recording, joints, settings.low_pass_hz))
        .collect()
}

fn check_motion(
    motions: &[Motion],
    joints: usize,
    warnings: &mut Vec<String>,
) -> Result<(), IdentificationError> {
    const LEAST_RANGE_RAD: f64 = 1e-3;
    const SMALL_RANGE_RAD: f64 = 0.2;

    for joint in 0..joints {
        let positions = || motions.iter().flat_map(|motion| &motion.q).map(|row| row[joint]);
        let range_rad = positions().fold(f64::NEG_INFINITY, f64::max)
            - positions().fold(f64::INFINITY, f64::min);
        if range_rad < LEAST_RANGE_RAD {
            let (joint, least_rad) = (joint + 1, LEAST_RANGE_RAD);
            return Err(IdentificationError::Still { joint, range_rad, least_rad });
        }
        if range_rad < SMALL_RANGE_RAD {
            let (joint, range_deg) = (joint + 1, range_rad.to_degrees());
            warnings.push(format!(
                "joint {joint} moves by {range_deg:.1}° only: its friction and rotor are uncertain"
            ));
        }
    }
    Ok(())
}

/// A regression on torques with its result.
struct TorqueFit {
    prior: Prior,
    arm: Arm,
    torques: Torques,
    /// The covariance of the arm's numbers.
    covariance: DMatrix<f64>,
    /// Σ over joints of the logarithm of the residual torque.
    misfit: f64,
}

fn fit_torques(prior: Prior, motions: &[Motion]) -> TorqueFit {
    const ROUNDS: usize = 4;
    const STEPS: usize = 40;

    let mut arm = prior.arm.clone();
    let mut torques = Torques::new(&arm, motions);
    for _ in 0..ROUNDS {
        torques.weigh(&arm);
        let of = |numbers: &DVector<f64>| arm.with_numbers(numbers.clone());
        let at = |numbers: &DVector<f64>| {
            let mut equations = torques.normal_equations(&of(numbers));
            equations.add_prior(numbers, &prior.arm.numbers, &prior.deviations);
            equations
        };
        let cost = |numbers: &DVector<f64>| torques.cost(&of(numbers)) + distance(numbers, &prior);
        arm = of(&minimize(arm.numbers.clone(), STEPS, at, cost));
    }
    let mut equations = torques.normal_equations(&arm);
    equations.add_prior(&arm.numbers, &prior.arm.numbers, &prior.deviations);
    let covariance = inverse(equations.curvature);
    let misfit = torques.residuals_nm(&arm).iter().map(|residual| residual.ln()).sum();
    TorqueFit { prior, arm, torques, covariance, misfit }
}

/// ½ Σ ((numbers − the prior's) / deviations)².
fn distance(numbers: &DVector<f64>, prior: &Prior) -> f64 {
    let distances =
        (numbers - &prior.arm.numbers).zip_map(&prior.deviations, |distance, deviation| {
            if deviation == 0.0 { 0.0 } else { distance / deviation }
        });
    0.5 * distances.norm_squared()
}

fn inverse(curvature: DMatrix<f64>) -> DMatrix<f64> {
    let size = curvature.nrows();
    curvature.cholesky().map_or_else(|| DMatrix::zeros(size, size), |factor| factor.inverse())
}

/// Moves the arm until its simulations follow the motions. The regression on torques goes on to
/// count.
fn fit_motions(
    motions: &[Motion],
    prior: &Prior,
    arm: &Arm,
    torques: &Torques,
    covariance: &DMatrix<f64>,
    steps: usize,
) -> Arm {
    let windows = Windows::new(motions, EVERY_S);
    let step = |variance: f64, deviation: f64| {
        if deviation == 0.0 { 0.0 } else { (0.1 * variance.sqrt()).clamp(1e-4, 0.02) }
    };
    let changes = covariance.diagonal().zip_map(&prior.deviations, step);
    let fit = RolloutFit::new(&windows, arm, changes);
    let of = |numbers: &DVector<f64>| arm.with_numbers(numbers.clone());
    let at = |numbers: &DVector<f64>| {
        let arm = of(numbers);
        let mut equations = fit.normal_equations(&arm);
        let of_torques = torques.normal_equations(&arm);
        equations.cost += of_torques.cost;
        equations.gradient += of_torques.gradient;
        equations.curvature += of_torques.curvature;
        equations.add_prior(numbers, &prior.arm.numbers, &prior.deviations);
        equations
    };
    let cost = |numbers: &DVector<f64>| {
        let arm = of(numbers);
        fit.cost(&arm) + torques.cost(&arm) + distance(numbers, prior)
    };
    of(&minimize(arm.numbers.clone(), steps, at, cost))
}

fn residuals(torques: &Torques, prior: &Prior, arm: &Arm) -> Vec<TorqueResidual> {
    let deviations = torques.deviations_nm();
    let both = torques.residuals_nm(&prior.arm).into_iter().zip(torques.residuals_nm(arm));
    (1..)
        .zip(deviations.into_iter().zip(both))
        .map(|(joint, (deviation_nm, (nominal_nm, identified_nm)))| TorqueResidual {
            joint,
            deviation_nm,
            nominal_nm,
            identified_nm,
        })
        .collect()
}

fn errors(motions: &[Motion], prior: &Prior, arm: &Arm) -> Vec<HorizonErrors> {
    let windows = Windows::new(motions, REPORTED_EVERY_S);
    let all = [
        ("hold", windows.errors_of_holding()),
        ("constant velocity", windows.errors_of_constant_velocity()),
        (DESCRIBED, windows.errors(&prior.arm)),
        (IDENTIFIED, windows.errors(arm)),
    ];
    all.map(|(predictor, rmse)| HorizonErrors {
        predictor: predictor.to_owned(),
        rmse_deg: rmse.map(f64::to_degrees),
    })
    .into()
}

/// Values, and standard deviations through the slopes of each parameter in the arm's numbers.
fn parameters(prior: &Prior, arm: &Arm, torques: &Torques) -> Vec<ParameterEstimate> {
    const STEP: f64 = 1e-5;

    let mut equations = torques.normal_equations(arm);
    equations.add_prior(&arm.numbers, &prior.arm.numbers, &prior.deviations);
    let covariance = inverse(equations.curvature);
    let estimates =
        |begin: usize, of: &dyn Fn(&Arm) -> Vec<f64>, named: &[(String, &'static str)]| {
            let (nominal, values) = (of(&prior.arm), of(arm));
            let slopes: Vec<DVector<f64>> = (0..values.len())
                .map(|number| {
                    let moved = |by: f64| {
                        let mut numbers = arm.numbers.clone();
                        numbers[begin + number] += by;
                        DVector::from_vec(of(&arm.with_numbers(numbers)))
                    };
                    (moved(STEP) - moved(-STEP)) / (2.0 * STEP)
                })
                .collect();
            let slopes = DMatrix::from_columns(&slopes);
            let count = values.len();
            let own = prior.deviations.rows(begin, count);
            // A number that is known has no variance.
            let known = own.map(|deviation| if deviation == 0.0 { 0.0 } else { 1.0 });
            let mask = DMatrix::from_diagonal(&known);
            let after = &mask * covariance.view((begin, begin), (count, count)) * &mask;
            let before = DMatrix::from_diagonal(&own.map(|deviation| deviation * deviation));
            let variances = (&slopes * after * slopes.transpose()).diagonal();
            let of_prior = (&slopes * before * slopes.transpose()).diagonal();
            let estimate = |k: usize| ParameterEstimate {
                name: named[k].0.clone(),
                unit: named[k].1,
                joint: None,
                nominal: nominal[k],
                value: values[k],
                deviation: variances[k].max(0.0).sqrt(),
                seen: if of_prior[k] == 0.0 {
                    None
                } else {
                    Some((1.0 - variances[k] / of_prior[k]).clamp(0.0, 1.0))
                },
            };
            (0..count).map(estimate).collect::<Vec<_>>()
        };
    let names: Vec<(String, &'static str)> = Parameter::ALL.into_iter().map(named).collect();
    let of_joints = (0..arm.joints()).flat_map(|joint| {
        let of = move |arm: &Arm| arm.parameters(joint).to_vec();
        estimates(joint * NUMBERS, &of, &names)
            .into_iter()
            .map(move |estimate| ParameterEstimate { joint: Some(joint + 1), ..estimate })
    });
    let mut all: Vec<ParameterEstimate> = of_joints.collect();
    if arm.load_in_hand().is_some() {
        let names: Vec<(String, &'static str)> = Parameter::ALL[..LINK_PARAMETERS]
            .iter()
            .map(|parameter| named(*parameter))
            .map(|(name, unit)| (format!("load_{name}"), unit))
            .collect();
        let of = |arm: &Arm| arm.load_in_hand().map_or_else(Vec::new, |load| body_values(&load));
        all.extend(estimates(arm.joints() * NUMBERS, &of, &names));
    }
    all
}

/// Mass, centre and inertia about it, in the order of [`Parameter::ALL`].
fn body_values(body: &RigidBody) -> Vec<f64> {
    let RigidBody { mass, com: [x, y, z], inertia: [[xx, xy, xz], [_, yy, yz], [_, _, zz]] } =
        *body;
    vec![mass, x, y, z, xx, xy, xz, yy, yz, zz]
}

pub(crate) fn named(parameter: Parameter) -> (String, &'static str) {
    const AXES: [&str; 3] = ["x", "y", "z"];
    const ENTRIES: [&str; 6] = ["xx", "xy", "xz", "yy", "yz", "zz"];

    match parameter {
        Parameter::Mass => ("mass".to_owned(), "kg"),
        Parameter::Center(axis) => (format!("center_{}", AXES[axis]), "m"),
        Parameter::Inertia(entry) => (format!("inertia_{}", ENTRIES[entry]), "kg·m²"),
        Parameter::Joint(JointParameter::Coulomb) => ("coulomb".to_owned(), "N·m"),
        Parameter::Joint(JointParameter::Viscous) => ("viscous".to_owned(), "N·m·s/rad"),
        Parameter::Joint(JointParameter::Offset) => ("offset".to_owned(), "N·m"),
        Parameter::Joint(JointParameter::Rotor) => ("rotor".to_owned(), "kg·m²"),
        Parameter::Joint(JointParameter::Gain) => ("gain".to_owned(), "1"),
    }
}
