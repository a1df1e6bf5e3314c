//! The baseline that predicts no motion.

use series::Observed;

use super::rollout::rollout;
use crate::{EvaluationError, Predictor};

/// Holds the last position of the context.
#[derive(Clone, Copy, Debug)]
pub struct HoldLast;

impl Predictor for HoldLast {
    fn name(&self) -> &'static str {
        "hold-last"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |_, _| |_, _| 0.0))
    }
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::baselines::fixture::first_order_robot;

    /// Joints of the Panda.
    const JOINTS: usize = 7;

    #[test]
    fn hold_last_repeats_the_last_context_position() {
        let robot = first_order_robot(0.0, 0.1);
        let observed = robot.observed(320);
        let predicted = HoldLast.predict(&observed).unwrap();
        assert_eq!(predicted.len(), 80 * JOINTS);
        assert!(predicted.chunks(JOINTS).all(|y| *y == observed.y(0)[319]));
    }
}
