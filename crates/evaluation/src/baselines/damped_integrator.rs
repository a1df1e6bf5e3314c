//! A baseline of dampings alone, which are known.

use series::Observed;

use super::rollout::rollout;
use crate::{EvaluationError, Predictor};

/// q̇ = u / D: every joint is a damper, from the last position of the context on.
#[derive(Clone, Debug)]
pub struct DampedIntegrator {
    /// The nominal damping, which is not each robot's own. A joint without damping is held.
    pub damping_nm_s_rad: Vec<f64>,
}

impl Predictor for DampedIntegrator {
    fn name(&self) -> &'static str {
        "damped-integrator"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |_, joint| {
            let damping = self.damping_nm_s_rad[joint];
            let gain = if damping > 0.0 { 1.0 / damping } else { 0.0 };
            move |_, torque| gain * torque
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baselines::fixture::{error_of, first_order_robot};

    #[test]
    fn the_damped_integrator_is_exact_for_a_massless_arm_of_that_damping() {
        let predictor = DampedIntegrator { damping_nm_s_rad: vec![10.0; 7] };
        assert!(error_of(&predictor, &first_order_robot(0.0, 0.1)) < 1e-4);
        assert!(error_of(&predictor, &first_order_robot(0.0, 0.2)) > 0.1);
    }
}
