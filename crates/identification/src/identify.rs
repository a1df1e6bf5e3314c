//! The steps from recordings to an arm.

use nalgebra::{DMatrix, DVector};
use spec::RobotDescription;
use wire::{ArmReport, HorizonErrors, TorqueResidual};

use crate::IdentificationError;
use crate::arm::{Arm, Prior, described_bends};
use crate::arx::Arx;
use crate::check::{Purpose, doubts_before_fit};
use crate::doubts::doubts;
use crate::estimates::{Estimates, IDENTIFIED};
use crate::figure::Curves;
use crate::horizons::HORIZONS_S;
use crate::motion::{Motion, Recording};
use crate::normal_equations::minimize;
use crate::rollouts::{RolloutFit, Windows};
use crate::torque_fit::{self, Progress, TorqueFit};
use crate::torques::Torques;
use crate::wording::rounded;

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
    /// Torques may be late or early against positions by at most this, s, and the delay is
    /// identified. With 0 none is sought: the regression takes torques and positions as those of one
    /// moment, and simulations hold each torque until the next sample.
    pub most_delay_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { low_pass_hz: 8.0, motion_steps: 8, gain_deviation: 0.0, most_delay_s: 0.0 }
    }
}

/// An identified arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// The arm.
    pub arm: Arm,
    /// Residuals, errors and parameters.
    pub report: ArmReport,
    /// Torques and motions beside a recording.
    pub curves: Curves,
}

impl Settings {
    /// The most steps of [`identify`].
    pub fn steps(&self) -> u64 {
        let delays = if self.most_delay_s > 0.0 { torque_fit::DELAYS } else { 0 };
        self.load_steps() + delays as u64
    }

    /// The most steps of [`identify_load`], which looks for no delay.
    pub fn load_steps(&self) -> u64 {
        (BENDS_RAD_S.len() + 2 + self.motion_steps) as u64
    }
}

/// Seconds from one window of the fit to the next, unless there would be too many.
const EVERY_S: f64 = 0.67;
/// Seconds from one window of a report to the next.
const REPORTED_EVERY_S: f64 = 1.0;

/// The speed at which the bend of Coulomb friction is expected where the description has none, rad/s.
const BEND_RAD_S: f64 = 0.04;

/// Searches for the bends begin at these speeds, rad/s.
const BENDS_RAD_S: [f64; 5] = [0.01, 0.02, 0.04, 0.08, 0.16];

/// Identifies the arm of a description from recordings. All have the same rate.
///
/// # Errors
/// See [`IdentificationError`].
pub fn identify(
    description: &RobotDescription,
    recordings: &[Recording],
    validation: &[Recording],
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Identification, IdentificationError> {
    let joints = description.joints.len();
    let described = described_bends(description);
    let mut beginnings_rad_s = BENDS_RAD_S.map(|bend| vec![bend; joints]).to_vec();
    beginnings_rad_s.extend(described.clone());
    let expected_rad_s = described.unwrap_or_else(|| vec![BEND_RAD_S; joints]);
    let prior = Prior::of(description, &expected_rad_s, settings.gain_deviation)?;
    let start = Start { description, prior, beginnings_rad_s };
    let mut found = search(start, recordings, validation, settings, progress)?;
    let Settings { gain_deviation, most_delay_s, .. } = *settings;
    let purpose = Purpose::Identification { gain_deviation, most_delay_s };
    let all = [recordings, validation].concat();
    let doubts = doubts_before_fit(description, &all, purpose)?;
    found.report.warnings.splice(0..0, doubts);
    if let Err(error) = found.arm.description(description).checked() {
        found.report.warnings.push(format!("no job can take the identified arm: {error}"));
    }
    Ok(found)
}

/// Identifies the load in the hand of an arm that [`identify`] found for a description. All recordings
/// have the same load and the same rate. The report's last parameters are the load's, and beside it
/// stands the arm with a usual load.
///
/// # Errors
/// See [`IdentificationError`].
pub fn identify_load(
    description: &RobotDescription,
    arm: &Arm,
    recordings: &[Recording],
    validation: &[Recording],
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Identification, IdentificationError> {
    let Settings { gain_deviation, most_delay_s, .. } = *settings;
    // The delay is that of the arm.
    let settings = Settings { most_delay_s: 0.0, ..*settings };
    let beginnings_rad_s = vec![arm.bends_rad_s()];
    let start = Start { description, prior: Prior::loaded(arm), beginnings_rad_s };
    let mut found = search(start, recordings, validation, &settings, progress)?;
    let purpose = Purpose::Load { gain_deviation, most_delay_s };
    let all = [recordings, validation].concat();
    let doubts = doubts_before_fit(&arm.description(description), &all, purpose)?;
    found.report.warnings.splice(0..0, doubts);
    Ok(found)
}

/// The beginning of a search.
struct Start<'a> {
    description: &'a RobotDescription,
    prior: Prior,
    /// The bends, rad/s, with which a regression begins each.
    beginnings_rad_s: Vec<Vec<f64>>,
}

/// The best regression of those that begin with each of these bends, and the arm from there.
fn search(
    start: Start<'_>,
    recordings: &[Recording],
    validation: &[Recording],
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Identification, IdentificationError> {
    let Start { description, prior, beginnings_rad_s } = start;
    let joints = prior.arm.joints();
    let motions = motions(recordings, description, settings)?;
    let validation = self::motions(validation, description, settings)?;
    check_together(motions.iter().chain(&validation))?;
    if motions.is_empty() {
        return Err(IdentificationError::NoRecordings);
    }
    let mut warnings = Vec::new();
    check_motion(&motions, description, &mut warnings)?;
    warnings.extend((0..joints).filter_map(|joint| about_cuts(&motions, joint)));

    let mut best = torque_fit::best_of(&prior, &beginnings_rad_s, &motions, progress)?;
    let mut delay = None;
    let most_delay_s = settings.most_delay_s;
    if most_delay_s > 0.0 {
        let (fit, found) = torque_fit::fit_delay(best, &motions, most_delay_s, progress)?;
        if found.value.abs() > 0.95 * most_delay_s {
            warnings.push(format!(
                "the delay of the torques, {:.1} ms, is at the edge of what most_delay_s allows, ± {:.1} ms",
                1e3 * found.value,
                1e3 * most_delay_s
            ));
        }
        (best, delay) = (fit, Some(found));
    }
    let TorqueFit { prior, mut arm, mut torques, covariance, .. } = best;
    let windows = Windows::new(&motions, EVERY_S).without_cuts();
    if settings.motion_steps > 0 && windows.count() == 0 {
        let longest_s = HORIZONS_S[HORIZONS_S.len() - 1];
        warnings.push(format!(
            "the motions are not fitted: no {longest_s} s of the recordings are free of torques that are cut off"
        ));
    } else if settings.motion_steps > 0 {
        let steps = settings.motion_steps;
        arm = fit_motions(&windows, &prior, &arm, &torques, &covariance, steps, progress)?;
        torques = torques.about(&arm, &motions);
    }
    let law = best_law(&motions);
    let Estimates { mut parameters, directions, correlated } =
        Estimates::new(&prior, &arm, &torques);
    parameters.extend(delay);
    let mut report = ArmReport {
        parameters,
        directions,
        correlated,
        torques: residuals(&motions, &prior, &arm),
        validation_torques: Vec::new(),
        horizons_s: HORIZONS_S.to_vec(),
        errors: errors(&motions, &prior, &arm, law.as_ref()),
        validation_errors: Vec::new(),
        warnings,
    };
    if !validation.is_empty() {
        report.validation_torques = residuals(&validation, &prior, &arm);
        report.validation_errors = errors(&validation, &prior, &arm, law.as_ref());
    }
    let doubts = doubts(&report);
    report.warnings.extend(doubts);
    let curves = Curves::new(validation.first().unwrap_or(&motions[0]), &prior, &arm);
    Ok(Identification { arm, report, curves })
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
    description: &RobotDescription,
    settings: &Settings,
) -> Result<Vec<Motion>, IdentificationError> {
    let limits_nm = description.per_joint(|joint| joint.torque_nm);
    recordings
        .iter()
        .map(|recording| Motion::new(recording, &limits_nm, settings.low_pass_hz))
        .collect()
}

fn check_motion(
    motions: &[Motion],
    description: &RobotDescription,
    warnings: &mut Vec<String>,
) -> Result<(), IdentificationError> {
    const LEAST_RANGE_RAD: f64 = 1e-3;
    const SMALL_RANGE_RAD: f64 = 0.2;

    for (joint, described) in description.joints.iter().enumerate() {
        let positions = || motions.iter().flat_map(|motion| &motion.q).map(|row| row[joint]);
        let highest_rad = positions().fold(f64::NEG_INFINITY, f64::max);
        let lowest_rad = positions().fold(f64::INFINITY, f64::min);
        let range_rad = highest_rad - lowest_rad;
        if range_rad < LEAST_RANGE_RAD {
            return Err(IdentificationError::Still {
                joint: joint + 1,
                name: described.name.clone(),
                position_rad: rounded(0.5 * (lowest_rad + highest_rad)),
                range_rad,
                least_rad: LEAST_RANGE_RAD,
            });
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

/// A warning with the samples of a joint that the fit leaves out.
fn about_cuts(motions: &[Motion], joint: usize) -> Option<String> {
    let near = |motion: &Motion| motion.near_cuts(joint).into_iter().filter(|near| *near).count();
    let left_out: usize = motions.iter().map(near).sum();
    let all: usize = motions.iter().map(Motion::samples).sum();
    (left_out > 0).then(|| {
        let joint = joint + 1;
        // Those that are left are at small speeds, which a low-pass leaves uncertain.
        let more = match 2 * left_out > all {
            true => ". Its friction and rotor are less certain than their intervals say",
            false => "",
        };
        format!(
            "the fit leaves out {left_out} of {all} samples of the torque of joint {joint}, because it is cut off there \
             or near{more}"
        )
    })
}

/// Moves the arm until its simulations follow the motions. The regression on torques goes on to
/// count.
fn fit_motions(
    windows: &Windows<'_>,
    prior: &Prior,
    arm: &Arm,
    torques: &Torques,
    covariance: &DMatrix<f64>,
    steps: usize,
    progress: Progress<'_>,
) -> Result<Arm, IdentificationError> {
    let step = |variance: f64, deviation: f64| {
        if deviation == 0.0 { 0.0 } else { (0.1 * variance.sqrt()).clamp(1e-4, 0.02) }
    };
    let changes = covariance.diagonal().zip_map(&prior.deviations, step);
    let fit = RolloutFit::new(windows, arm, changes);
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
        fit.cost(&arm) + torques.cost(&arm) + prior.distance(numbers)
    };
    Ok(of(&minimize(arm.numbers.clone(), steps, at, cost, progress)?))
}

fn residuals(motions: &[Motion], prior: &Prior, arm: &Arm) -> Vec<TorqueResidual> {
    let [described, identified] = [&prior.arm, arm].map(|arm| {
        let torques = Torques::new(arm, motions);
        (torques.deviations_nm(), torques.residuals_nm(arm))
    });
    let both = described.1.into_iter().zip(identified.1);
    (1..)
        .zip(identified.0.into_iter().zip(both))
        .map(|(joint, (deviation_nm, (described_nm, identified_nm)))| TorqueResidual {
            joint,
            deviation_nm,
            described_nm,
            identified_nm,
        })
        .collect()
}

/// The law that follows the motions best over the longest horizon.
fn best_law(motions: &[Motion]) -> Option<Arx> {
    let windows = Windows::new(motions, REPORTED_EVERY_S);
    let error = |law: &Arx| windows.errors_of_law(law)[HORIZONS_S.len() - 1];
    let laws = Arx::laws(motions).into_iter().map(|law| (error(&law), law));
    let followed = laws.filter(|(error, _)| error.is_finite());
    followed.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, law)| law)
}

fn errors(motions: &[Motion], prior: &Prior, arm: &Arm, law: Option<&Arx>) -> Vec<HorizonErrors> {
    let windows = Windows::new(motions, REPORTED_EVERY_S);
    let mut all = vec![
        ("hold", windows.errors_of_holding()),
        ("constant velocity", windows.errors_of_constant_velocity()),
    ];
    all.extend(law.map(|law| ("ARX", windows.errors_of_law(law))));
    all.push((prior.name, windows.errors(&prior.arm)));
    all.push((IDENTIFIED, windows.errors(arm)));
    let shown = |rmse: f64| Some(rmse.to_degrees()).filter(|rmse| rmse.is_finite());
    all.into_iter()
        .map(|(predictor, rmse)| HorizonErrors {
            predictor: predictor.to_owned(),
            rmse_deg: rmse.map(shown).into(),
        })
        .collect()
}
