//! The root mean square error.

use series::SeriesView;

/// RMSE of each scenario in degrees: sqrt(mean over the horizon of e²) per joint, then the mean
/// over joints (the paper's code).
///
/// `predicted` is `[robot, horizon, joint]` in rad. The horizon has all samples after `context`.
///
/// # Panics
/// If `predicted` has another length.
pub fn rmse_deg(scenarios: &SeriesView<'_>, context: usize, predicted: &[f32]) -> Vec<f64> {
    let truth = scenarios.window(context..scenarios.samples()).copy_true_y();
    assert_eq!(predicted.len(), truth.len(), "[robot, horizon, joint] values");
    let row = (truth.len() / scenarios.robots().max(1)).max(1);
    let each = truth.chunks_exact(row).zip(predicted.chunks_exact(row));
    each.map(|(truth, predicted)| {
        let of_joints = joint_rmse_deg(truth, predicted, scenarios.joints());
        of_joints.iter().sum::<f64>() / of_joints.len() as f64
    })
    .collect()
}

/// The RMSE of each joint of one scenario, degrees. Both inputs are `[horizon, joint]` in rad.
pub fn joint_rmse_deg(truth: &[f32], predicted: &[f32], joints: usize) -> Vec<f64> {
    let mut squares = vec![0.0; joints];
    let steps = truth.len() / joints;
    for (entry, square) in squares_deg2(truth, predicted).enumerate() {
        squares[entry % joints] += square;
    }
    squares.iter().map(|sum| (sum / steps as f64).sqrt()).collect()
}

/// Squared error of each value, degrees². Both inputs are in rad.
pub fn squares_deg2(truth: &[f32], predicted: &[f32]) -> impl Iterator<Item = f64> {
    truth
        .iter()
        .zip(predicted)
        .map(|(truth, predicted)| (f64::from(*predicted) - f64::from(*truth)).to_degrees().powi(2))
}

#[cfg(test)]
mod tests {
    use series::{Series, Shape};

    use super::*;

    const JOINTS: usize = 7;

    fn zeros(robots: usize, samples: usize) -> Series {
        let y = vec![0.0; robots * samples * JOINTS];
        Series::new(Shape { robots, samples, joints: JOINTS }, 60.0, y.clone(), y).unwrap()
    }

    #[test]
    fn a_constant_error_of_one_degree_on_one_joint_is_a_seventh_of_a_degree() {
        let mut predicted = vec![0.0; 2 * 2 * JOINTS];
        for step in 0..2 {
            predicted[step * JOINTS + 3] = 1.0_f32.to_radians();
        }
        let rmse = rmse_deg(&zeros(2, 5).view(), 3, &predicted);
        assert!((rmse[0] - 1.0 / 7.0).abs() < 1e-6, "{rmse:?}");
        assert!(rmse[1].abs() < 1e-12, "{rmse:?}");
    }

    #[test]
    fn errors_of_one_joint_are_averaged_as_squares_over_time() {
        let mut predicted = vec![0.0; 2 * JOINTS];
        predicted[0] = 3.0_f32.to_radians();
        predicted[JOINTS] = 4.0_f32.to_radians();
        let expected = 12.5_f64.sqrt() / 7.0;
        assert!((rmse_deg(&zeros(1, 4).view(), 2, &predicted)[0] - expected).abs() < 1e-6);
    }

    #[test]
    fn each_step_and_each_joint_has_its_own_error() {
        let mut predicted = vec![0.0; 3 * JOINTS];
        predicted[JOINTS + 2] = -2.0_f32.to_radians();
        let truth = vec![0.0; 3 * JOINTS];
        let squares: Vec<f64> = squares_deg2(&truth, &predicted).collect();
        assert!((squares[JOINTS + 2] - 4.0).abs() < 1e-6);
        assert!(squares.iter().sum::<f64>() - 4.0 < 1e-6);
        assert!(
            (joint_rmse_deg(&truth, &predicted, JOINTS)[2] - (4.0_f64 / 3.0).sqrt()).abs() < 1e-6
        );
    }
}
