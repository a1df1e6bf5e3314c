//! Arms for tests of baselines.

use series::{Series, Shape};

use super::rollout::to_f32;
use crate::{Predictor, rmse_deg};

/// Joints of the Panda.
const JOINTS: usize = 7;

/// One robot whose joints obey v' = a·v + g·u exactly.
pub(crate) fn first_order_robot(a: f64, g: f64) -> Series {
    let (samples, rate_hz) = (400, 60.0);
    let (mut u, mut y) = (Vec::new(), Vec::new());
    let mut position = [0.5; JOINTS];
    let mut velocity = [0.0; JOINTS];
    for k in 0..samples {
        for joint in 0..JOINTS {
            let torque = (0.07 * (k as f64) * (1.0 + 0.3 * joint as f64)).sin();
            u.push(to_f32(torque));
            y.push(to_f32(position[joint]));
            velocity[joint] = a * velocity[joint] + g * f64::from(to_f32(torque));
            position[joint] += velocity[joint] / rate_hz;
        }
    }
    Series::new(Shape { robots: 1, samples, joints: JOINTS }, rate_hz, u, y).unwrap()
}

/// The error after a context of 320 samples.
pub(crate) fn error_of(predictor: &dyn Predictor, scenarios: &Series) -> f64 {
    let predicted = predictor.predict(&scenarios.observed(320)).unwrap();
    rmse_deg(&scenarios.view(), 320, &predicted)[0]
}
