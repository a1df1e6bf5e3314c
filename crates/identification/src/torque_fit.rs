//! The arm that explains measured torques best, and how late they are recorded.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};
use wire::ParameterEstimate;

use crate::IdentificationError;
use crate::arm::{Arm, Prior};
use crate::motion::Motion;
use crate::normal_equations::{inverse, minimize};
use crate::torques::Torques;

/// Hears of every step of a search, of which there are at most [`crate::Settings::steps`]. The search
/// ends with [`IdentificationError::Stopped`] when it breaks.
pub type Progress<'a> = &'a mut dyn FnMut() -> ControlFlow<()>;

/// A regression on torques with its result.
pub(crate) struct TorqueFit {
    pub(crate) prior: Prior,
    pub(crate) arm: Arm,
    pub(crate) torques: Torques,
    /// The covariance of the arm's numbers.
    pub(crate) covariance: DMatrix<f64>,
    /// Σ over joints of the logarithm of the residual torque.
    pub(crate) misfit: f64,
}

impl TorqueFit {
    /// Fits an arm to the torques of motions.
    ///
    /// # Errors
    /// See [`minimize`].
    pub(crate) fn new(prior: Prior, motions: &[Motion]) -> Result<Self, IdentificationError> {
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
            let cost =
                |numbers: &DVector<f64>| torques.cost(&of(numbers)) + prior.distance(numbers);
            let no_progress = || ControlFlow::Continue(());
            arm = of(&minimize(arm.numbers.clone(), STEPS, at, cost, no_progress)?);
        }
        let mut equations = torques.normal_equations(&arm);
        equations.add_prior(&arm.numbers, &prior.arm.numbers, &prior.deviations);
        let covariance = inverse(equations.curvature);
        let misfit = torques.residuals_nm(&arm).iter().map(|residual| residual.ln()).sum();
        Ok(Self { prior, arm, torques, covariance, misfit })
    }

    /// Minus the logarithm of the likelihood of the torques, with weights of another fit.
    fn negative_log_likelihood(&self, weights: &[f64]) -> f64 {
        let residuals = self.torques.residuals_nm(&self.arm);
        residuals.iter().zip(weights).map(|(residual, weight)| weight * residual.ln()).sum()
    }
}

/// The prior whose regression leaves the least torque. Joints have different gears: where another
/// prior explains a joint clearly better, the last trial has its friction speed for this joint.
///
/// # Errors
/// [`IdentificationError::NoRecordings`] without a prior, [`IdentificationError::Stopped`] when
/// `progress` breaks.
pub(crate) fn best_of(
    priors: Vec<Prior>,
    motions: &[Motion],
    progress: Progress<'_>,
) -> Result<TorqueFit, IdentificationError> {
    /// The least gain in the logarithm of the likelihood of a joint's torques. Smaller ones are
    /// chance.
    const CLEARLY: f64 = 2.0;

    let mut try_prior = |prior: Prior| {
        let fit = TorqueFit::new(prior, motions)?;
        if progress().is_break() {
            return Err(IdentificationError::Stopped);
        }
        Ok(fit)
    };
    let fits = priors.into_iter().map(&mut try_prior).collect::<Result<Vec<_>, _>>()?;
    let best = fits.iter().min_by(|a, b| a.misfit.total_cmp(&b.misfit));
    let best = best.ok_or(IdentificationError::NoRecordings)?;
    let left = |fit: &TorqueFit| fit.torques.residuals_nm(&fit.arm);
    let (left_of_best, samples) = (left(best), best.torques.independent_samples());
    let left_of_each: Vec<Vec<f64>> = fits.iter().map(left).collect();
    let mut speeds = best.arm.friction_speeds_rad_s.clone();
    for (joint, speed) in speeds.iter_mut().enumerate() {
        let mut least = left_of_best[joint] * (-CLEARLY / samples[joint]).exp();
        for (fit, left) in fits.iter().zip(&left_of_each) {
            if left[joint] < least {
                (least, *speed) = (left[joint], fit.arm.friction_speeds_rad_s[joint]);
            }
        }
    }
    let mixed = match speeds == best.arm.friction_speeds_rad_s {
        true => None,
        false => Some(try_prior(best.prior.with_friction_speeds(speeds))?),
    };
    let all = fits.into_iter().chain(mixed);
    all.min_by(|a, b| a.misfit.total_cmp(&b.misfit)).ok_or(IdentificationError::NoRecordings)
}

/// Trials of a golden section, which leave a tenth of the interval or less.
const SECTIONS: usize = 7;

/// Steps of the parabolas after them, as shares of the interval that is left.
const PARABOLAS: [f64; 3] = [1.0, 0.25, 0.1];

/// Delays that [`fit_delay`] tries.
pub(crate) const DELAYS: usize = SECTIONS + 3 * PARABOLAS.len();

/// Finds how late the torques of `fit` were recorded, within ± `most_s`: a golden section to a tenth
/// of that, then the bottom of parabolas through three delays, which come closer to each other. Gives
/// the fit with this delay, and the delay with the standard deviation that the last parabola's curvature
/// says, s.
///
/// # Errors
/// [`IdentificationError::Stopped`] when `progress` breaks.
pub(crate) fn fit_delay(
    fit: TorqueFit,
    motions: &[Motion],
    most_s: f64,
    progress: Progress<'_>,
) -> Result<(TorqueFit, ParameterEstimate), IdentificationError> {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;

    let weights = fit.torques.independent_samples();
    let prior = fit.prior;
    let mut try_delay = |delay_s: f64| {
        let fit = TorqueFit::new(prior.late_by(delay_s), motions)?;
        if progress().is_break() {
            return Err(IdentificationError::Stopped);
        }
        let cost = fit.negative_log_likelihood(&weights);
        Ok((delay_s, cost, fit))
    };
    let (mut low_s, mut high_s) = (-most_s, most_s);
    let mut early = try_delay(high_s - GOLDEN * (high_s - low_s))?;
    let mut late = try_delay(low_s + GOLDEN * (high_s - low_s))?;
    for _ in 2..SECTIONS {
        if early.1 < late.1 {
            high_s = late.0;
            late = early;
            early = try_delay(high_s - GOLDEN * (high_s - low_s))?;
        } else {
            low_s = early.0;
            early = late;
            late = try_delay(low_s + GOLDEN * (high_s - low_s))?;
        }
    }
    let mut center = if early.1 < late.1 { early } else { late };
    let widest_s = (high_s - low_s).max(1.0 / motions[0].rate_hz);
    let mut curvature = 0.0;
    // Beside Coulomb friction the logarithm of the torque that is left is a parabola near its bottom
    // only. Through delays 9 ms apart it gave bottoms that were off by 0.4 ms and said 0.15 ms.
    for step_s in PARABOLAS.map(|share| share * widest_s) {
        let (center_s, at_center, _) = center;
        let before = try_delay(center_s - step_s)?.1;
        let after = try_delay(center_s + step_s)?.1;
        curvature = (before - 2.0 * at_center + after) / (step_s * step_s);
        let slope = (after - before) / (2.0 * step_s);
        let away_s = if curvature > 0.0 { -slope / curvature } else { 0.0 };
        let bottom_s = center_s + away_s.clamp(-step_s, step_s);
        center = try_delay(bottom_s.clamp(-most_s, most_s))?;
    }
    let (delay_s, _, fit) = center;

    // The prior is as wide as the interval.
    let before = (2.0 * most_s).powi(2) / 12.0;
    let variance = 1.0 / (curvature.max(0.0) + 1.0 / before);
    let delay = ParameterEstimate {
        name: "delay".to_owned(),
        unit: "s".to_owned(),
        joint: None,
        described: 0.0,
        value: delay_s,
        deviation: variance.sqrt(),
        seen: Some(1.0 - variance / before),
    };
    Ok((fit, delay))
}
