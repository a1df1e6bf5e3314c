//! Arms for tests of baselines.

use std::ops::ControlFlow;

use serde_json::json;
use series::{Series, Shape};
use spec::JobSpec;

use super::NominalArm;
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

/// Arms of `panda-real` under their controller, 400 samples of each: hardly any damping, friction and
/// an unknown load.
pub(crate) fn light_arms(count: u64) -> (NominalArm, Series) {
    let text = json!({"preset": "panda-real", "trajectories": count, "samples": 400}).to_string();
    let JobSpec::Simulate(spec) = spec::parse(text.as_bytes()).unwrap() else {
        panic!("not a simulation")
    };
    let go_on = |_| ControlFlow::Continue(());
    let simulated = dynamics::simulate(&spec, 0..count, &go_on).unwrap();
    (NominalArm::of_simulation(&spec), simulated.series)
}

/// The error after a context of 320 samples.
pub(crate) fn error_of(predictor: &dyn Predictor, scenarios: &Series) -> f64 {
    let predicted = predictor.predict(&scenarios.observed(320)).unwrap();
    rmse_deg(&scenarios.view(), 320, &predicted)[0]
}

/// The mean error over robots and joints after a context of 320 samples.
pub(crate) fn mean_error_of(predictor: &dyn Predictor, scenarios: &Series) -> f64 {
    let predicted = predictor.predict(&scenarios.observed(320)).unwrap();
    let errors = rmse_deg(&scenarios.view(), 320, &predicted);
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// Contexts from which nothing can be learned about an arm: short ones, a robot that stands still, and
/// positions that have nothing to do with the torques.
pub(crate) fn check_finite_answers(predictor: &dyn Predictor) {
    let (_, arms) = light_arms(1);
    let mut still = arms.clone();
    still.u_mut().fill(0.0);
    still.y_mut().fill(0.3);
    let mut unrelated = arms.clone();
    for (k, y) in unrelated.y_mut().iter_mut().enumerate() {
        *y = to_f32((12.9898 * k as f64).sin());
    }
    for (scenarios, context) in
        [(&arms, 1), (&arms, 2), (&arms, 3), (&arms, 10), (&still, 320), (&unrelated, 320)]
    {
        let observed = scenarios.observed(context);
        let answer = predictor.answer(&observed, 1).unwrap();
        assert_eq!(answer.positions.len(), observed.horizon() * JOINTS, "{context}");
        assert!(answer.positions.iter().all(|q| q.is_finite()), "{context}");
        assert_eq!(answer.arms.map(|arms| arms.len()), Some(1));
    }
}
