//! The baseline that predicts no motion.

use series::{JointMotion, Observed};

use super::rollout::rollout;
use crate::predictor::Answer;
use crate::{EvaluationError, Predictor};

/// Holds the last position of the context, and its last torque.
#[derive(Clone, Copy, Debug)]
pub struct HoldLast;

impl Predictor for HoldLast {
    fn name(&self) -> &'static str {
        "hold-last"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |_, _| |_, _| 0.0))
    }

    /// The last torque of the context, whatever the motion.
    fn torques(
        &self,
        observed: &Observed<'_>,
        _: &Answer,
        motions: &[JointMotion],
    ) -> Result<Option<Vec<Vec<f64>>>, EvaluationError> {
        let held = motions.iter().enumerate().map(|(robot, motion)| {
            let last = &observed.u(robot)[observed.context() - 1];
            last.iter().copied().map(f64::from).collect::<Vec<_>>().repeat(motion.instants())
        });
        Ok(Some(held.collect()))
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
        let motion = JointMotion::measured(&predicted, JOINTS, observed.rate_hz());
        let said = HoldLast.torques(&observed, &Answer::default(), &[motion]).unwrap().unwrap();
        let last = observed.u(0)[319].to_vec();
        assert_eq!(said[0].len(), 78 * JOINTS);
        assert!(
            said[0]
                .chunks(JOINTS)
                .all(|u| u.iter().zip(&last).all(|(u, last)| *u == f64::from(*last)))
        );
    }
}
