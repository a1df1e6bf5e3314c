//! The Franka Emika Panda with hand and fingers: nominal parameters and their sources.

use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::LazyLock;

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::{Joints, Kinematics, RigidBody};

/// Rotation about x from a joint's frame to its parent's, the α of its modified DH row.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Twist {
    None,
    /// +90°.
    Quarter,
    /// −90°.
    MinusQuarter,
}

/// Of each joint, from the link before it.
pub(crate) const TWISTS: Joints<Twist> = [
    Twist::None,
    Twist::MinusQuarter,
    Twist::Quarter,
    Twist::Quarter,
    Twist::MinusQuarter,
    Twist::Quarter,
    Twist::Quarter,
];

/// Modified DH rows (a, α, d): (0, 0, .333), (0, −90°, 0), (0, 90°, .316), (.0825, 90°, 0),
/// (−.0825, −90°, .384), (0, 90°, 0), (.088, 90°, 0); the flange is .107 beyond the last.
///
/// Source: Gaz et al. 2019; the same numbers are in frankarobotics/franka_description,
/// robots/fer/kinematics.yaml.
pub(crate) const KINEMATICS: Kinematics = Kinematics {
    a_m: [0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088],
    d_m: [0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0],
    flange_m: 0.107,
};

/// The moving bodies before anything is welded, each in its own frame.
#[derive(Clone, Debug)]
pub(crate) struct Bodies {
    pub(crate) links: Joints<RigidBody>,
    pub(crate) hand: RigidBody,
    pub(crate) left_finger: RigidBody,
    pub(crate) right_finger: RigidBody,
}

impl Bodies {
    /// Links: Gaz, Cognetti, Oliva, Robuffo Giordano and De Luca 2019, "Dynamic identification of
    /// the Franka Emika Panda robot with retrieval of feasible parameters", tables VIII and IX. The
    /// z of link 1's centre is that of the paper's simulator (GunesCaginAydin/dynamical-metalearning);
    /// it cannot matter on an upright, fixed base.
    ///
    /// Hand and fingers: the paper's simulator. The hand's tensor as published there,
    /// diag(.002462, .000492, .000691), breaks the triangle inequality, so that no body has it; it is
    /// projected onto the nearest one that exists, which adds .00064 kg·m² about the flange's axis.
    pub(crate) fn nominal() -> Self {
        static NOMINAL: LazyLock<Bodies> = LazyLock::new(|| Bodies {
            links: LINKS,
            hand: HAND.projected(),
            left_finger: LEFT_FINGER,
            right_finger: RIGHT_FINGER,
        });
        NOMINAL.clone()
    }

    /// In a fixed order, which the randomization relies on.
    pub(crate) fn each_mut(&mut self) -> impl Iterator<Item = &mut RigidBody> {
        let gripper = [&mut self.hand, &mut self.left_finger, &mut self.right_finger];
        self.links.iter_mut().chain(gripper)
    }

    /// The seven links with hand and fingers, opened to 0.04 m each, and what the hand holds (in the
    /// hand's frame) welded to the last.
    pub(crate) fn welded(&self, flange_m: f64, held: Option<&RigidBody>) -> Joints<RigidBody> {
        let hand_in_link7 = Vector3::new(0.0, 0.0, flange_m);
        let finger_in_hand =
            |side: f64| Vector3::new(0.0, side * FINGER_OPENING_M, FINGER_HEIGHT_M);
        let unturned = Rotation3::identity();

        let mut hand = self
            .hand
            .welded_to(&self.left_finger.seen_from(&unturned, &finger_in_hand(1.0)))
            .welded_to(&self.right_finger.seen_from(&unturned, &finger_in_hand(-1.0)));
        if let Some(held) = held {
            hand = hand.welded_to(held);
        }
        let mut links = self.links;
        links[6] = links[6].welded_to(&hand.seen_from(&hand_yaw(), &hand_in_link7));
        links
    }
}

/// From the hand's frame to the fingers', along z.
const FINGER_HEIGHT_M: f64 = 0.0584;
/// How far each finger stands from the middle, as in the paper's simulator.
const FINGER_OPENING_M: f64 = 0.04;

/// The hand is mounted at −45° about the flange's axis.
fn hand_yaw() -> Rotation3<f64> {
    let (sin, cos) = (-FRAC_1_SQRT_2, FRAC_1_SQRT_2);
    Rotation3::from_matrix_unchecked(Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0))
}

const LINKS: Joints<RigidBody> = [
    RigidBody::new(
        4.970684,
        [0.003875, 0.002081, -0.175],
        [0.70337, -0.000139, 0.006772, 0.70661, 0.019169, 0.009117],
    ),
    RigidBody::new(
        0.646926,
        [-0.003141, -0.02872, 0.003495],
        [0.007962, -0.003925, 0.010254, 0.02811, 0.000704, 0.025995],
    ),
    RigidBody::new(
        3.228604,
        [0.027518, 0.039252, -0.066502],
        [0.037242, -0.004761, -0.011396, 0.036155, -0.012805, 0.01083],
    ),
    RigidBody::new(
        3.587895,
        [-0.05317, 0.104419, 0.027454],
        [0.025853, 0.007796, -0.001332, 0.019552, 0.008641, 0.028323],
    ),
    RigidBody::new(
        1.225946,
        [-0.011953, 0.041065, -0.038437],
        [0.035549, -0.002117, -0.004037, 0.029474, 0.000229, 0.008627],
    ),
    RigidBody::new(
        1.666555,
        [0.060149, -0.014117, -0.010517],
        [0.001964, 0.000109, -0.001158, 0.004354, 0.000341, 0.005433],
    ),
    RigidBody::new(
        0.735522,
        [0.010517, -0.004252, 0.061597],
        [0.012516, -0.000428, -0.001196, 0.010027, -0.000741, 0.004815],
    ),
];

const HAND: RigidBody = RigidBody::new(
    0.717156708240509,
    [4.3e-5, -0.00093, 0.024119],
    [0.002462, -2e-6, -1e-6, 0.000492, -1.5e-5, 0.000691],
);

const LEFT_FINGER: RigidBody = RigidBody::new(
    0.021579869091510773,
    [1.7e-5, 0.011958, 0.023777],
    [6e-6, -1e-7, 1e-7, 5e-6, 1e-6, 2e-6],
);

/// In a frame parallel to the hand's, as in the Isaac Gym URDF: the mirror image of the left one.
const RIGHT_FINGER: RigidBody = RigidBody::new(
    0.021579869091510773,
    [-1.7e-5, -0.011958, 0.023777],
    [6e-6, -1e-7, -1e-7, 5e-6, -1e-6, 2e-6],
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_nominal_body_is_physical_except_the_published_hand() {
        for (index, body) in Bodies::nominal().each_mut().enumerate() {
            assert!(body.is_physical(), "body {index}");
        }
        assert!(!HAND.is_physical());
    }

    #[test]
    fn the_projected_hand_turns_as_published_about_its_wide_axis() {
        let hand = Bodies::nominal().hand;
        assert!((hand.inertia[0][0] - HAND.inertia[0][0]).abs() < 1e-6);
        assert!((hand.inertia[2][2] - HAND.inertia[2][2] - 0.00064).abs() < 1e-5);
    }

    #[test]
    fn welding_keeps_the_mass() {
        let bodies = Bodies::nominal();
        let welded: f64 =
            bodies.welded(KINEMATICS.flange_m, None).iter().map(|link| link.mass).sum();
        let mut bodies = bodies;
        let apart: f64 = bodies.each_mut().map(|body| body.mass).sum();
        assert!((welded - apart).abs() < 1e-14);
    }
}
