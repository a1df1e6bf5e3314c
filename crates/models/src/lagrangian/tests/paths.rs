//! Robots that reach poses outside of their context.

use simd::InstructionSet;

use super::{EXACT, JOINT, NOISE, RATE_HZ, predict, separate};
use crate::lagrangian::law::{JointLaw, Law, Places};
use crate::lagrangian::linear_algebra::Dense;
use crate::lagrangian::recorded::Recorded;
use crate::lagrangian::regression::Bounds;
use crate::lagrangian::rollout::Start;

const CONTEXT: usize = 30;
const HORIZON: usize = 60;

/// A joint whose particle has the Jacobian 2 sin q and, over robots, a mass of -0.5. The particle
/// reduces the joint's inertia by a hundredth at |q| = 0.05, and to nothing at |q| = 0.52.
fn law() -> Law {
    let joint = JointLaw { armature: 0.5, ..JOINT };
    let mut law = separate(&[0.5], joint, [3.0, 1e-3]);
    // The Jacobian's inputs are sine and cosine. The second and third direction do not move.
    let Places::Learned(network) = &mut law.places else { panic!("the arm is not told") };
    network.particles = Dense::new(&[2.0, 0.0, 0.0, 0.0, 0.0, 0.0], &[0.0; 3]);
    law.prior.mean[0] = -0.5;
    law
}

/// Torques of a robot that rests at 0 until its horizon begins, N·m.
fn torques(horizon: f32) -> Vec<f32> {
    let mut u = vec![0.0; CONTEXT - 1];
    u.resize(CONTEXT + HORIZON, horizon);
    u
}

#[test]
fn a_robot_that_comes_to_a_pose_of_too_little_inertia_has_no_negative_mass() {
    let law = law();
    let y = [0.0; CONTEXT];
    let (near, far) = (torques(0.1), torques(8.0));
    let [near, far] = [&near, &far].map(|u| Recorded { u, y: &y, joints: 1, rate_hz: RATE_HZ });
    // Nothing moves in the context, so it identifies nothing: robots have the mean numbers.
    let rollout = |robot: &Recorded<'_>, bounds| {
        let numbers = law.identify(InstructionSet::best(), robot, bounds).most_likely.numbers;
        let recorded = Recorded { u: &robot.u[CONTEXT - 2..], y: &y[..2], ..*robot };
        let start = Start { recorded, numbers: &numbers };
        (law.roll_out(InstructionSet::best(), &[start]), numbers[0])
    };
    let (free, mass) = rollout(&near, Bounds::Dissipation);
    assert!(free.enough_inertia[0] && (mass + 0.5).abs() < 1e-4, "{mass}");
    assert!(!rollout(&far, Bounds::Dissipation).0.enough_inertia[0]);
    let (without, mass) = rollout(&far, Bounds::DissipationAndMasses);
    assert!(without.enough_inertia[0] && mass == 0.0, "{mass}");
    assert!(without.positions.last().is_some_and(|q| *q > 1.0), "{:?}", without.positions);

    let expected = [&free.positions[..], &without.positions, &free.positions].concat();
    assert_eq!(predict(&law, &[near, far, near], EXACT), expected);
    for instructions in InstructionSet::available() {
        assert_eq!(law.predict(instructions, &[near, far, near], EXACT, &[], 0), expected);
    }
    // The same holds for a draw, and for the robot of the filter.
    let normals = vec![0.0; law.normals_per_draw()];
    let drawn = law.predict(InstructionSet::best(), &[near, far], EXACT, &[&normals, &normals], 0);
    assert_eq!(drawn, expected[..2 * HORIZON]);
    let filtered = predict(&law, &[near, far], NOISE);
    for (found, expected) in filtered.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    }
}
