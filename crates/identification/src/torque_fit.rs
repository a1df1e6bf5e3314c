//! The arm that explains measured torques best, and how late they are recorded.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};
use wire::ParameterEstimate;

use crate::IdentificationError;
use crate::arm::{Arm, LEAST_BEND_RAD_S, Prior};
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
    /// Fits an arm to the torques of motions. The search begins with bends of Coulomb friction at
    /// these speeds.
    ///
    /// # Errors
    /// See [`minimize`].
    pub(crate) fn new(
        prior: Prior,
        bends_rad_s: &[f64],
        motions: &[Motion],
    ) -> Result<Self, IdentificationError> {
        /// In each round, weights and bends are those of the last.
        const ROUNDS: usize = 6;
        const STEPS: usize = 40;
        /// In one round, the speed of a bend changes by at most this factor.
        const MOST_BENT: f64 = 1.5;
        /// Torques are linear in bends that change by less.
        const LINEAR: f64 = 1.01;

        let mut arm = prior.arm.bent_at(bends_rad_s);
        let mut torques = Torques::new(&arm, motions);
        for _ in 0..ROUNDS {
            if torques.bent_by(&arm) > LINEAR {
                torques = torques.about(&arm, motions);
            }
            torques.weigh(&arm);
            let before_rad_s = arm.bends_rad_s();
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
            let kept = before_rad_s.into_iter().zip(arm.bends_rad_s());
            let kept = kept.map(|(before, bend)| {
                bend.clamp(before / MOST_BENT, before * MOST_BENT).max(LEAST_BEND_RAD_S)
            });
            arm = arm.bent_at(&kept.collect::<Vec<f64>>());
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

/// The regression that leaves the least torque, of those that begin with each of these bends. Joints
/// have different gears: where another beginning explains a joint clearly better, the last trial begins
/// with its bend of this joint.
///
/// # Errors
/// [`IdentificationError::NoRecordings`] without a beginning, [`IdentificationError::Stopped`] when
/// `progress` breaks.
pub(crate) fn best_of(
    prior: &Prior,
    beginnings_rad_s: &[Vec<f64>],
    motions: &[Motion],
    progress: Progress<'_>,
) -> Result<TorqueFit, IdentificationError> {
    /// The least gain in the logarithm of the likelihood of a joint's torques. Smaller ones are
    /// chance.
    const CLEARLY: f64 = 2.0;

    let mut try_bends = |bends_rad_s: &[f64]| {
        let fit = TorqueFit::new(prior.clone(), bends_rad_s, motions)?;
        if progress().is_break() {
            return Err(IdentificationError::Stopped);
        }
        Ok(fit)
    };
    let each = beginnings_rad_s.iter().map(|bends_rad_s| try_bends(bends_rad_s));
    let fits = each.collect::<Result<Vec<_>, _>>()?;
    let best = fits.iter().min_by(|a, b| a.misfit.total_cmp(&b.misfit));
    let best = best.ok_or(IdentificationError::NoRecordings)?;
    let left = |fit: &TorqueFit| fit.torques.residuals_nm(&fit.arm);
    let (left_of_best, samples) = (left(best), best.torques.independent_samples());
    let left_of_each: Vec<Vec<f64>> = fits.iter().map(left).collect();
    let of_best = best.arm.bends_rad_s();
    let mut bends_rad_s = of_best.clone();
    for (joint, bend) in bends_rad_s.iter_mut().enumerate() {
        let mut least = left_of_best[joint] * (-CLEARLY / samples[joint]).exp();
        for (fit, left) in fits.iter().zip(&left_of_each) {
            if left[joint] < least {
                (least, *bend) = (left[joint], fit.arm.bends_rad_s()[joint]);
            }
        }
    }
    let mixed = match bends_rad_s == of_best {
        true => None,
        false => Some(try_bends(&bends_rad_s)?),
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
    // Friction of torques that are late looks smooth.
    let bends_rad_s = prior.arm.bends_rad_s();
    let mut try_delay = |delay_s: f64| {
        let fit = TorqueFit::new(prior.late_by(delay_s), &bends_rad_s, motions)?;
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
        // Without a bottom between the three, downhill.
        let away_s = if curvature > 0.0 { -slope / curvature } else { -slope.signum() * step_s };
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
