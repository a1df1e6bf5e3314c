//! Least squares by Gauss-Newton steps with damping (Levenberg and Marquardt).

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};

use crate::IdentificationError;

/// A sum of squares around some numbers: its half value, its gradient and its approximate second
/// derivatives.
pub(crate) struct NormalEquations {
    pub(crate) cost: f64,
    pub(crate) gradient: DVector<f64>,
    pub(crate) curvature: DMatrix<f64>,
}

impl NormalEquations {
    /// Adds ½ Σ ((numbers − center) / deviations)². Numbers with a deviation of 0 stay where they are.
    pub(crate) fn add_prior(
        &mut self,
        numbers: &DVector<f64>,
        center: &DVector<f64>,
        deviations: &DVector<f64>,
    ) {
        for k in 0..numbers.len() {
            if deviations[k] == 0.0 {
                self.curvature.row_mut(k).fill(0.0);
                self.curvature.column_mut(k).fill(0.0);
                self.curvature[(k, k)] = 1.0;
                self.gradient[k] = 0.0;
                continue;
            }
            let weight = deviations[k].powi(-2);
            let distance = numbers[k] - center[k];
            self.cost += 0.5 * weight * distance * distance;
            self.gradient[k] += weight * distance;
            self.curvature[(k, k)] += weight;
        }
    }

    /// The step to the minimum of the quadratic, with its diagonal raised by `damping`. `None` if
    /// rounding has made the curvature indefinite.
    pub(crate) fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let mut curvature = self.curvature.clone();
        for k in 0..curvature.nrows() {
            curvature[(k, k)] *= 1.0 + damping;
        }
        Some(-curvature.cholesky()?.solve(&self.gradient))
    }
}

/// Moves `numbers` to a minimum. `at` evaluates the sum of squares with derivatives, `cost` without.
///
/// It ends after `steps`, or when a step lowers the cost by less than a part in 10⁵. It tells
/// `progress` of every step.
///
/// # Errors
/// [`IdentificationError::Stopped`] when `progress` breaks.
pub(crate) fn minimize(
    mut numbers: DVector<f64>,
    steps: usize,
    mut at: impl FnMut(&DVector<f64>) -> NormalEquations,
    mut cost: impl FnMut(&DVector<f64>) -> f64,
    mut progress: impl FnMut() -> ControlFlow<()>,
) -> Result<DVector<f64>, IdentificationError> {
    const LEAST_GAIN: f64 = 1e-5;
    const LARGEST_DAMPING: f64 = 1e8;

    let mut damping = 1e-4;
    for _ in 0..steps {
        let equations = at(&numbers);
        let lowered = loop {
            let moved = equations.step(damping).map(|step| &numbers + step);
            let lower = moved.map(|moved| (cost(&moved), moved));
            match lower {
                Some((cost, moved)) if cost < equations.cost => break Some((cost, moved)),
                _ if damping > LARGEST_DAMPING => break None,
                _ => damping *= 10.0,
            }
        };
        let Some((cost, moved)) = lowered else { return Ok(numbers) };
        numbers = moved;
        if progress().is_break() {
            return Err(IdentificationError::Stopped);
        }
        damping = (damping * 0.1).max(1e-9);
        if equations.cost - cost < LEAST_GAIN * equations.cost {
            return Ok(numbers);
        }
    }
    Ok(numbers)
}

/// The inverse of second derivatives; 0 if rounding has made them indefinite.
pub(crate) fn inverse(curvature: DMatrix<f64>) -> DMatrix<f64> {
    let size = curvature.nrows();
    curvature.cholesky().map_or_else(|| DMatrix::zeros(size, size), |factor| factor.inverse())
}
