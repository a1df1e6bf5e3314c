//! The structure that kernels are specialized for: which twists and which lengths of its table are zero.
//!
//! It is that of the Franka Emika Panda, and of every other arm with the same twists and with the
//! same lengths that are zero. Zeros and quarter turns cost nothing there.

use crate::Kinematics;

/// Rotation about x from a joint's frame to its parent's, the α of its modified DH row.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Twist {
    None,
    /// +90°.
    Quarter,
    /// −90°.
    MinusQuarter,
}

pub(crate) const JOINTS: usize = 7;

/// The twist of each joint, from the link before it.
pub(crate) const TWISTS: [Twist; JOINTS] = [
    Twist::None,
    Twist::MinusQuarter,
    Twist::Quarter,
    Twist::Quarter,
    Twist::MinusQuarter,
    Twist::Quarter,
    Twist::Quarter,
];

/// Whether the lengths (a, d) of each joint's row are not zero.
const LENGTHS: [(bool, bool); JOINTS] = [
    (false, true),
    (false, false),
    (false, true),
    (true, false),
    (true, true),
    (false, false),
    (true, false),
];

/// An arm of this structure.
#[derive(Clone, Copy)]
pub(crate) struct Compiled;

/// Whether an arm has this structure.
pub(crate) fn fits(kinematics: &Kinematics) -> bool {
    let twist = |joint: usize| {
        let (sin, cos) = (kinematics.twists[joint].sin, kinematics.twists[joint].cos);
        (sin, cos)
            == match TWISTS[joint] {
                Twist::None => (0.0, 1.0),
                Twist::Quarter => (1.0, 0.0),
                Twist::MinusQuarter => (-1.0, 0.0),
            }
    };
    let lengths = |joint: usize| {
        let (a, d) = LENGTHS[joint];
        (a || kinematics.a_m[joint] == 0.0) && (d || kinematics.d_m[joint] == 0.0)
    };
    kinematics.a_m.len() == JOINTS && (0..JOINTS).all(|joint| twist(joint) && lengths(joint))
}

/// Whether the origin of joint `J` is shifted along `axis` of the frame before it: (a, −d sin α, d cos α).
pub(crate) const fn shifted<const J: usize>(axis: usize) -> bool {
    let (a, d) = LENGTHS[J];
    match (axis, TWISTS[J]) {
        (0, _) => a,
        (1, Twist::None) => false,
        (1, _) => d,
        (_, Twist::None) => d,
        (_, _) => false,
    }
}
