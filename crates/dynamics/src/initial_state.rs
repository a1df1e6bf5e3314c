use spec::{InitialState, Range};

use crate::Joints;
use crate::draws::Draws;

/// Draws positions (rad) and velocities (rad/s) at t = 0 by the law of [`InitialState`]. `joint1`
/// has the limits of the first joint.
pub(crate) fn draw_initial_state(
    spec: &InitialState,
    joint1: Range,
    draws: &mut Draws,
) -> (Joints<f64>, Joints<f64>) {
    const UNIT: Range = Range::new(0.0, 1.0);

    let joints = spec.center_rad.len();
    let mut q = Joints::splat(joints, 0.0);
    q[0] = draws.uniform(spec.joint1_scale) * draws.sign() * draws.uniform(joint1);
    let sign = draws.sign();
    for (q, center) in q.iter_mut().zip(&spec.center_rad).skip(1) {
        *q = center + sign * spec.spread_rad * draws.uniform(UNIT);
    }

    let mut qd = Joints::splat(joints, 0.0);
    let scale = draws.uniform(spec.velocity_scale);
    qd[0] = scale * draws.sign() * spec.joint1_velocity_rad_s * draws.uniform(UNIT);
    let sign = draws.sign();
    for qd in qd.iter_mut().skip(1) {
        *qd = scale * sign * spec.velocity_rad_s * draws.uniform(UNIT);
    }
    (q, qd)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draws::Purpose;

    #[test]
    fn joints_2_to_7_leave_their_centers_to_the_same_side() {
        const LIMITS: Range = Range::new(-2.8973, 2.8973);
        let spec = InitialState::default();
        for trajectory in 0..200 {
            let (q, qd) = draw_initial_state(
                &spec,
                LIMITS,
                &mut Draws::new(0, trajectory, Purpose::InitialState, 1),
            );
            let sides: Vec<f64> =
                (1..7).map(|joint| (q[joint] - spec.center_rad[joint]).signum()).collect();
            assert!(sides.iter().all(|side| *side == sides[0]));
            assert!(
                (1..7).all(|joint| (q[joint] - spec.center_rad[joint]).abs() <= spec.spread_rad)
            );
            assert!(q[0].abs() <= 0.8 * 2.8973);
            assert!(qd[0].abs() <= 0.8 * 0.5);
            assert!(qd[1..].iter().all(|other| other.abs() <= 0.8 * 2.0));
            assert!(qd[1..].iter().all(|other| other.signum() == qd[1].signum()));
        }
    }
}
