//! The baseline that trusts the controller.

use series::Observed;

use crate::{EvaluationError, Predictor};

/// Follows the reference, as far away from it as at the last sample of the context.
#[derive(Clone, Copy, Debug)]
pub struct FollowReference;

impl Predictor for FollowReference {
    fn name(&self) -> &'static str {
        "follow-reference"
    }

    /// The series `u` of `observed` has references, rad.
    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let (samples, context, joints) =
            (observed.samples(), observed.context(), observed.joints());
        let mut predicted = Vec::with_capacity(observed.robots() * observed.horizon() * joints);
        for scenario in 0..observed.robots() {
            let (reference, positions) = (observed.u(scenario), observed.y(scenario));
            let last = context - 1;
            for sample in context..samples {
                let moved = (0..joints).map(|joint| {
                    positions[last][joint] + (reference[sample][joint] - reference[last][joint])
                });
                predicted.extend(moved);
            }
        }
        Ok(predicted)
    }
}

#[cfg(test)]
mod tests {
    use series::{Series, Shape};

    use super::*;

    #[test]
    fn it_keeps_the_distance_at_the_end_of_the_context() {
        let shape = Shape { robots: 1, samples: 4, joints: 2 };
        let reference = vec![0.0, 1.0, 0.5, 1.0, 0.75, 2.0, 1.0, 3.0];
        let y = vec![0.0, 0.0, 0.25, 0.5, 9.0, 9.0, 9.0, 9.0];
        let series = Series::new(shape, 60.0, reference, y).unwrap();
        let predicted = FollowReference.predict(&series.observed(2)).unwrap();
        assert_eq!(predicted, [0.5, 1.5, 0.75, 2.5]);
    }
}
