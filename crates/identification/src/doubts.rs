//! Sentences about reasons to doubt an identified arm.

use wire::{ArmReport, HorizonErrors, TorqueResidual};

use crate::arm::DESCRIBED;
use crate::estimates::IDENTIFIED;
use crate::horizons::HORIZONS_S;
use crate::wording::{digits, joints};

/// The most of a joint's torque that a fit may leave, as a share of its standard deviation. Real
/// arms leave up to 0.3.
const MOST_LEFT: f64 = 0.5;

/// A joint whose fit leaves less torque has hardly more than noise, as a share of the largest
/// standard deviation of a joint's torque.
const NOISE: f64 = 0.01;

/// The doubts that follow from the numbers of a report.
pub(crate) fn doubts(report: &ArmReport) -> Vec<String> {
    let mut doubts = Vec::new();
    of_torques(report, &mut doubts);
    of_simulations(report, &mut doubts);
    of_unseen_parameters(report, &mut doubts);
    of_the_description(report, &mut doubts);
    doubts
}

/// Whether recordings fit the arm that was identified from them: it explains most of their torques, and
/// its simulations are better than holding the position.
pub fn fits(report: &ArmReport) -> bool {
    let mut doubts = Vec::new();
    of_torques(report, &mut doubts);
    of_simulations(report, &mut doubts);
    doubts.is_empty()
}

/// Joints whose torques the arm does not explain.
fn of_torques(report: &ArmReport, doubts: &mut Vec<String>) {
    let mut unexplained: Vec<u32> = Vec::new();
    for (residuals, place) in
        [(&report.torques, ""), (&report.validation_torques, " of the validation")]
    {
        for residual in unexplained_torques(residuals) {
            let TorqueResidual { joint, deviation_nm, identified_nm, .. } = *residual;
            if unexplained.contains(&joint) {
                continue;
            }
            unexplained.push(joint);
            let [measured, left] = [deviation_nm, identified_nm].map(digits);
            doubts.push(format!(
                "the identified arm leaves {left} N·m of the torque of joint {joint}{place}, whose standard deviation \
                 is {measured} N·m"
            ));
        }
    }
    unexplained.sort_unstable();
    if let Some(joints) = joints(unexplained.into_iter().map(|joint| joint as usize)) {
        doubts.push(format!(
            "the recordings do not fit the arm: look at columns, signs, units, gains and zero positions of {joints}, \
             which `torqued import --check` compares with the robot"
        ));
    }
}

fn unexplained_torques(residuals: &[TorqueResidual]) -> impl Iterator<Item = &TorqueResidual> {
    let largest = residuals.iter().map(|residual| residual.deviation_nm).fold(0.0, f64::max);
    residuals.iter().filter(move |residual| {
        let least = (MOST_LEFT * residual.deviation_nm).max(NOISE * largest);
        residual.identified_nm > least
    })
}

/// Simulations that are worse than holding the position. The longest horizon does not count, because
/// small errors of an arm without friction grow fast.
fn of_simulations(report: &ArmReport, doubts: &mut Vec<String>) {
    for (errors, place) in [(&report.errors, ""), (&report.validation_errors, " on the validation")]
    {
        let horizons = HORIZONS_S.iter().take(HORIZONS_S.len() - 1).enumerate();
        let mut worse = horizons.filter_map(|(at, horizon)| {
            let hold = of(errors, "hold")?.get(at).copied().flatten()?;
            let identified = of(errors, IDENTIFIED)?.get(at).copied()?;
            (identified.unwrap_or(f64::INFINITY) > hold).then_some((horizon, identified, hold))
        });
        if let Some((horizon, identified, hold)) = worse.next_back() {
            let found = identified
                .map_or_else(|| "diverge".to_owned(), |error| format!("are off by {error:.3}°"));
            doubts.push(format!(
                "over {horizon} s{place} simulations of the identified arm {found}, holding the position is off by {hold:.3}°"
            ));
        }
    }
}

fn of_unseen_parameters(report: &ArmReport, doubts: &mut Vec<String>) {
    const UNSEEN: f64 = 0.1;

    let unknown = || report.parameters.iter().filter_map(|parameter| parameter.seen);
    let unseen = unknown().filter(|seen| *seen < UNSEEN).count();
    if unseen > 0 {
        doubts.push(format!(
            "{unseen} of {} parameters are hardly seen in these motions: they keep the description's values",
            unknown().count()
        ));
    }
}

/// A description that predicts the validation better than the identified arm.
fn of_the_description(report: &ArmReport, doubts: &mut Vec<String>) {
    let errors = &report.validation_errors;
    if let (Some(identified), Some(described)) = (of(errors, IDENTIFIED), of(errors, DESCRIBED)) {
        for ((horizon, identified), described) in HORIZONS_S.iter().zip(identified).zip(described) {
            let (Some(described), error) = (described, identified.unwrap_or(f64::INFINITY)) else {
                continue;
            };
            if error > *described {
                doubts.push(format!(
                    "over {horizon} s of the validation the identified arm is off by {error:.3}°, the description by {described:.3}°"
                ));
            }
        }
    }
}

/// The errors of a predictor over each horizon.
fn of<'a>(errors: &'a [HorizonErrors], predictor: &str) -> Option<&'a [Option<f64>]> {
    let found = errors.iter().find(|errors| errors.predictor == predictor)?;
    Some(&found.rmse_deg)
}
