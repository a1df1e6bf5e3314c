//! The parameters with their uncertainty, and what a report says about them.

use dynamics::{LINK_PARAMETERS, RigidBody};
use nalgebra::{DMatrix, DVector};
use wire::{Correlation, Directions, ParameterEstimate};

use crate::arm::{Arm, JointParameter, Parameter, Prior};
use crate::normal_equations::inverse;
use crate::torques::Torques;

/// The identified arm's name in reports.
pub(crate) const IDENTIFIED: &str = "identified";

/// The parameters of an arm, as functions of its numbers.
struct Parameters {
    names: Vec<(String, &'static str, Option<u32>)>,
    described: DVector<f64>,
    values: DVector<f64>,
    /// Derivatives, `[parameter, number]`.
    slopes: DMatrix<f64>,
}

impl Parameters {
    fn of(prior: &Prior, arm: &Arm) -> Self {
        const STEP: f64 = 1e-5;

        let names = names(arm);
        let values = values(arm);
        let mut slopes = DMatrix::zeros(values.len(), arm.numbers.len());
        for number in 0..arm.numbers.len() {
            let moved = |by: f64| {
                let mut numbers = arm.numbers.clone();
                numbers[number] += by;
                self::values(&arm.with_numbers(numbers))
            };
            slopes.set_column(number, &((moved(STEP) - moved(-STEP)) / (2.0 * STEP)));
        }
        Self { names, described: self::values(&prior.arm), values, slopes }
    }
}

/// Values, standard deviations, directions and correlations.
pub(crate) struct Estimates {
    pub(crate) parameters: Vec<ParameterEstimate>,
    pub(crate) directions: Directions,
    pub(crate) correlated: Vec<Correlation>,
}

impl Estimates {
    /// The uncertainty of the regression on torques.
    pub(crate) fn new(prior: &Prior, arm: &Arm, torques: &Torques) -> Self {
        let parameters = Parameters::of(prior, arm);
        let of_data = torques.normal_equations(arm).curvature;
        let directions = directions(&of_data, &prior.deviations);
        let covariance = posterior(&of_data, &prior.deviations);
        let covariance = &parameters.slopes * covariance * parameters.slopes.transpose();
        let before = DMatrix::from_diagonal(&prior.deviations.map(|deviation| deviation.powi(2)));
        let of_prior = (&parameters.slopes * before * parameters.slopes.transpose()).diagonal();
        let estimate = |(k, (name, unit, joint)): (usize, &(String, &'static str, Option<u32>))| {
            let variance = covariance[(k, k)].max(0.0);
            // A number of another body may round a variance away from 0.
            let is_known = of_prior[k] <= 1e-18 * parameters.values[k].powi(2);
            ParameterEstimate {
                name: name.clone(),
                unit: (*unit).to_owned(),
                joint: *joint,
                described: parameters.described[k],
                value: parameters.values[k],
                deviation: if is_known { 0.0 } else { variance.sqrt() },
                seen: (!is_known).then(|| (1.0 - variance / of_prior[k]).clamp(0.0, 1.0)),
            }
        };
        let estimates: Vec<ParameterEstimate> =
            parameters.names.iter().enumerate().map(estimate).collect();
        let correlated = correlated(&estimates, &covariance);
        Self { parameters: estimates, directions, correlated }
    }
}

/// The covariance of the numbers after the data, whose second derivatives are `curvature`. Known
/// numbers have none.
pub(crate) fn posterior(curvature: &DMatrix<f64>, deviations: &DVector<f64>) -> DMatrix<f64> {
    let mut precision = whitened(curvature, deviations);
    for k in 0..precision.nrows() {
        precision[(k, k)] += 1.0;
    }
    whitened(&inverse(precision), deviations)
}

/// Rows and columns times the prior's standard deviations.
fn whitened(matrix: &DMatrix<f64>, deviations: &DVector<f64>) -> DMatrix<f64> {
    matrix.map_with_location(|row, column, value| value * deviations[row] * deviations[column])
}

fn directions(curvature: &DMatrix<f64>, deviations: &DVector<f64>) -> Directions {
    let unknown = deviations.iter().filter(|deviation| **deviation > 0.0).count();
    let eigenvalues = whitened(curvature, deviations).symmetric_eigenvalues();
    // Beyond 1, the data say more than the prior.
    let determined: Vec<f64> = eigenvalues.iter().copied().filter(|value| *value > 1.0).collect();
    let largest = determined.iter().copied().fold(1.0, f64::max);
    let smallest = determined.iter().copied().fold(largest, f64::min);
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    Directions {
        unknown: count(unknown),
        determined: count(determined.len()),
        condition: (largest / smallest).sqrt(),
    }
}

/// The pairs whose coefficient of correlation is above 0.9, the worst first. Parameters that the
/// data hardly show are left out, because they are as the prior has them.
fn correlated(estimates: &[ParameterEstimate], covariance: &DMatrix<f64>) -> Vec<Correlation> {
    const LEAST: f64 = 0.9;
    const MOST_PAIRS: usize = 10;
    const SEEN: f64 = 0.5;

    let full_name = |estimate: &ParameterEstimate| match estimate.joint {
        Some(joint) => format!("{} {joint}", estimate.name),
        None => estimate.name.clone(),
    };
    let shown: Vec<usize> = (0..estimates.len())
        .filter(|&k| estimates[k].seen.is_some_and(|seen| seen > SEEN))
        .collect();
    let mut pairs = Vec::new();
    for (at, &a) in shown.iter().enumerate() {
        for &b in &shown[at + 1..] {
            let scale = (covariance[(a, a)] * covariance[(b, b)]).sqrt();
            let coefficient = covariance[(a, b)] / scale;
            if coefficient.abs() > LEAST {
                let [a, b] = [a, b].map(|k| full_name(&estimates[k]));
                pairs.push(Correlation { a, b, coefficient });
            }
        }
    }
    pairs.sort_by(|a, b| b.coefficient.abs().total_cmp(&a.coefficient.abs()));
    pairs.truncate(MOST_PAIRS);
    pairs
}

/// The values of all parameters: those of each joint, then those of a load in the hand's frame.
fn values(arm: &Arm) -> DVector<f64> {
    let mut values: Vec<f64> = (0..arm.joints()).flat_map(|joint| arm.parameters(joint)).collect();
    if let Some(load) = arm.load_in_hand() {
        let RigidBody { mass, com: [x, y, z], inertia: [[xx, xy, xz], [_, yy, yz], [_, _, zz]] } =
            load;
        values.extend([mass, x, y, z, xx, xy, xz, yy, yz, zz]);
    }
    DVector::from_vec(values)
}

/// Name, unit and joint of each value, in the same order.
fn names(arm: &Arm) -> Vec<(String, &'static str, Option<u32>)> {
    let joints = u32::try_from(arm.joints()).unwrap_or(u32::MAX);
    let of_joint = |joint: u32| {
        Parameter::ALL.into_iter().map(move |parameter| {
            let (name, unit) = named(parameter);
            (name, unit, Some(joint))
        })
    };
    let mut names: Vec<_> = (1..=joints).flat_map(of_joint).collect();
    if arm.load_in_hand().is_some() {
        names.extend(Parameter::ALL[..LINK_PARAMETERS].iter().map(|parameter| {
            let (name, unit) = named(*parameter);
            (format!("load_{name}"), unit, None)
        }));
    }
    names
}

/// The name and the unit of a parameter.
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
        Parameter::Joint(JointParameter::Bend) => ("bend".to_owned(), "rad/s"),
    }
}
