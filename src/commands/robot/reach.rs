//! How far the hand of an arm gets.

use std::f64::consts::TAU;

use dynamics::{Joints, Kinematics};
use spec::Range;

/// The largest distance of the hand's frame from a point `from` of the world within the limits of
/// the joints, m.
///
/// The square of the distance is a sinusoid of every joint's position, so its largest value along
/// one joint is known. From each of many postures, one joint after the other moves there until no
/// joint gains any more.
pub fn reach(kinematics: &Kinematics, limits: &[Range], from: [f64; 3]) -> f64 {
    const POSTURES: u32 = 64;
    const SWEEPS: u32 = 100;
    const LEAST_GAIN_M2: f64 = 1e-12;

    let distance_squared = |q: &Joints<f64>| {
        let position = kinematics.end_effector_pose(*q).position_m;
        position.iter().zip(from).map(|(at, from)| (at - from).powi(2)).sum::<f64>()
    };
    let mut farthest: f64 = 0.0;
    for posture in 0..POSTURES {
        let mut q: Joints<f64> = limits
            .iter()
            .zip(0_u32..)
            .map(|(range, joint)| range.at(spread(posture, joint)))
            .collect();
        let mut reached = distance_squared(&q);
        for _ in 0..SWEEPS {
            let before = reached;
            for joint in 0..q.len() {
                let start = q[joint];
                let mut turned = |by: f64| {
                    q[joint] = start + by;
                    distance_squared(&q)
                };
                let best = highest([turned(0.0), turned(TAU / 3.0), turned(-TAU / 3.0)]);
                let Range { min, max } = limits[joint];
                // The same angle in the first turn above the lower limit.
                let inside = min + (start + best - min).rem_euclid(TAU);
                q[joint] = start;
                for candidate in [inside.min(max), min, max] {
                    let kept = std::mem::replace(&mut q[joint], candidate);
                    let distance = distance_squared(&q);
                    if distance > reached {
                        reached = distance;
                    } else {
                        q[joint] = kept;
                    }
                }
            }
            if reached - before < LEAST_GAIN_M2 {
                break;
            }
        }
        farthest = farthest.max(reached);
    }
    farthest.sqrt()
}

/// The angle at which a sinusoid of period 2π is highest, from its values at 0 and at a third of a
/// turn to either side.
fn highest([middle, after, before]: [f64; 3]) -> f64 {
    let mean = (middle + after + before) / 3.0;
    ((after - before) / 3.0_f64.sqrt()).atan2(middle - mean)
}

/// A number from 0 to 1; those of many postures lie evenly for every joint (a Kronecker sequence).
fn spread(posture: u32, joint: u32) -> f64 {
    const ROOTS_OF: [f64; 8] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];

    (f64::from(posture) * ROOTS_OF[joint as usize % ROOTS_OF.len()].sqrt()).fract()
}

#[cfg(test)]
mod tests {
    use dynamics::{Base, Robot, Row};
    use spec::RobotModel;

    use super::*;

    #[test]
    fn an_arm_in_a_plane_reaches_as_far_as_it_is_long_unless_a_limit_keeps_it_bent() {
        let row = |a_m| Row { a_m, ..Row::default() };
        let kinematics = Kinematics {
            base: Base::new([1.0, 2.0, 3.0], [30.0, 0.0, 0.0]),
            joints: [row(0.0), row(0.5)].into(),
            hand: row(0.3),
        };
        let limits = |bend| [Range::new(-1.0, 1.0), Range::new(bend, 2.0)];
        assert!((reach(&kinematics, &limits(-1.0), [1.0, 2.0, 3.0]) - 0.8).abs() < 1e-9);
        let bent = (0.25_f64 + 0.09 + 2.0 * 0.15 * 1.0_f64.cos()).sqrt();
        assert!((reach(&kinematics, &limits(1.0), [1.0, 2.0, 3.0]) - bent).abs() < 1e-9);
    }

    #[test]
    fn no_posture_of_a_panda_is_farther_away() {
        let model = RobotModel::panda();
        let limits = model.description().per_joint(|joint| joint.position_rad);
        let kinematics = Robot::panda().kinematics;
        let shoulder = [0.0, 0.0, 0.333];
        let farthest = reach(&kinematics, &limits, shoulder);
        // Franka's data sheet says 855 mm to the flange's axis; the hand's frame is 107 mm beyond.
        assert!((0.855..0.975).contains(&farthest), "{farthest}");
        for posture in 0..2000 {
            let q: Joints<f64> = limits
                .iter()
                .zip(0..)
                .map(|(range, joint)| range.at(spread(posture + 1000, joint)))
                .collect();
            let [x, y, z] = kinematics.end_effector_pose(q).position_m;
            let distance = (x * x + y * y + (z - 0.333).powi(2)).sqrt();
            assert!(distance <= farthest + 1e-9, "{distance} > {farthest}");
        }
    }
}
