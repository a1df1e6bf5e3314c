use spec::JOINTS;

use crate::Scenarios;

/// RMSE of each scenario in degrees: sqrt(mean over the horizon of e²) per joint, then the mean
/// over joints (the paper's code).
///
/// `predicted` is `[size, horizon, 7]` in rad.
///
/// # Panics
/// When `predicted` has another length.
pub fn rmse_deg(scenarios: &Scenarios, context: usize, predicted: &[f32]) -> Vec<f64> {
    let horizon = scenarios.samples - context;
    assert_eq!(predicted.len(), scenarios.size * horizon * JOINTS, "[size, horizon, 7] values");
    let truths = scenarios.y.chunks_exact(scenarios.samples * JOINTS);
    truths
        .zip(predicted.chunks_exact(horizon * JOINTS))
        .map(|(truth, predicted)| scenario_rmse_deg(&truth[context * JOINTS..], predicted))
        .collect()
}

fn scenario_rmse_deg(truth: &[f32], predicted: &[f32]) -> f64 {
    let mut squares = [0.0; JOINTS];
    let truth = truth.as_chunks::<JOINTS>().0;
    let predicted = predicted.as_chunks::<JOINTS>().0;
    for (truth, predicted) in truth.iter().zip(predicted) {
        for joint in 0..JOINTS {
            let error = f64::from(predicted[joint]) - f64::from(truth[joint]);
            squares[joint] += error * error;
        }
    }
    let steps = truth.len() as f64;
    let mean = squares.iter().map(|sum| (sum / steps).sqrt()).sum::<f64>() / JOINTS as f64;
    mean.to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_error_of_one_degree_on_one_joint_is_a_seventh_of_a_degree() {
        let samples = 5;
        let y = vec![0.0; 2 * samples * JOINTS];
        let scenarios = Scenarios { size: 2, samples, rate_hz: 60.0, u: y.clone(), y };
        let mut predicted = vec![0.0; 2 * 2 * JOINTS];
        for step in 0..2 {
            predicted[step * JOINTS + 3] = 1.0_f32.to_radians();
        }
        let rmse = rmse_deg(&scenarios, 3, &predicted);
        assert!((rmse[0] - 1.0 / 7.0).abs() < 1e-6, "{rmse:?}");
        assert!(rmse[1].abs() < 1e-12, "{rmse:?}");
    }

    #[test]
    fn errors_of_one_joint_are_averaged_as_squares_over_time() {
        let samples = 4;
        let y = vec![0.0; samples * JOINTS];
        let scenarios = Scenarios { size: 1, samples, rate_hz: 60.0, u: y.clone(), y };
        let mut predicted = vec![0.0; 2 * JOINTS];
        predicted[0] = 3.0_f32.to_radians();
        predicted[JOINTS] = 4.0_f32.to_radians();
        let expected = 12.5_f64.sqrt() / 7.0;
        assert!((rmse_deg(&scenarios, 2, &predicted)[0] - expected).abs() < 1e-6);
    }
}
