//! Ridge regression of groups of equations, each with a noise of its own.

use nalgebra::{Cholesky, DMatrix, DVector};

/// Fits. Each takes the noise of a group from what the one before leaves unexplained.
const PASSES: usize = 4;
/// Least noise of a group, as a share of its values.
const LEAST_NOISE: f64 = 1e-4;
/// Least variance of a group: a torque of 1e-6 N·m, squared.
const LEAST_SQUARE: f64 = 1e-12;

/// The equations of one group with the same noise. Unknowns are steps in their standard deviations a
/// priori.
pub(super) struct Equations {
    /// Products of the regressors, `[unknown, unknown]`.
    pub normal: DMatrix<f64>,
    /// Products of regressors and values, `[unknown]`.
    pub right: DVector<f64>,
    /// Sum of the squares that steps of 0 leave unexplained.
    pub squares: f64,
    /// Mean square of the values.
    pub power: f64,
    /// Number of equations.
    pub count: f64,
    /// The share of them that is independent of the others after the low-pass.
    pub independent: f64,
}

/// The most likely steps, standard normal a priori, each at its `least` or above. `None` if the
/// equations have no solution.
pub(super) fn ridge(groups: &[Equations], least: &[Option<f64>]) -> Option<DVector<f64>> {
    let mut steps = DVector::zeros(least.len());
    for _ in 0..PASSES {
        let mut normal = DMatrix::identity(least.len(), least.len());
        let mut right = DVector::zeros(least.len());
        for group in groups {
            let weight = group.weight(&steps);
            normal += &group.normal * weight;
            right += &group.right * weight;
        }
        steps = bounded_solution(&normal, &right, least)?;
    }
    Some(steps)
}

impl Equations {
    /// The weight of an equation, given what these steps leave unexplained.
    fn weight(&self, steps: &DVector<f64>) -> f64 {
        self.independent / self.unexplained(steps)
    }

    /// The mean square that these steps leave unexplained.
    fn unexplained(&self, steps: &DVector<f64>) -> f64 {
        let explained = 2.0 * self.right.dot(steps) - steps.dot(&(&self.normal * steps));
        let unexplained = (self.squares - explained) / self.count;
        unexplained.max(LEAST_NOISE * LEAST_NOISE * self.power).max(LEAST_SQUARE)
    }

    /// The logarithm of the likelihood of the independent values, with the noise that these steps leave.
    pub fn log_likelihood(&self, steps: &DVector<f64>) -> f64 {
        -0.5 * self.independent * self.count * self.unexplained(steps).ln()
    }
}

/// The solution of the normal equations with every step at its `least` or above. Steps that come out
/// below are set to it, and the others are solved again. `None` if the equations have no solution.
fn bounded_solution(
    normal: &DMatrix<f64>,
    right: &DVector<f64>,
    least: &[Option<f64>],
) -> Option<DVector<f64>> {
    /// More than enough; usually there are one or two.
    const ROUNDS: usize = 8;

    let mut held = vec![None; least.len()];
    let mut solution = Cholesky::new(normal.clone())?.solve(right);
    for _ in 0..ROUNDS {
        let mut is_new = false;
        for place in 0..least.len() {
            if let Some(bound) = least[place]
                && solution[place] < bound
                && held[place].is_none()
            {
                (held[place], is_new) = (Some(bound), true);
            }
        }
        if !is_new {
            break;
        }
        let (mut bounded, mut target) = (normal.clone(), right.clone());
        for (place, bound) in held.iter().enumerate() {
            let Some(bound) = bound else { continue };
            target -= normal.column(place) * *bound;
        }
        for (place, bound) in held.iter().enumerate() {
            let Some(bound) = bound else { continue };
            bounded.column_mut(place).fill(0.0);
            bounded.row_mut(place).fill(0.0);
            bounded[(place, place)] = 1.0;
            target[place] = *bound;
        }
        solution = Cholesky::new(bounded)?.solve(&target);
    }
    Some(solution)
}
