//! The structure that kernels are specialized for: which twists and which lengths of its table are zero.
//!
//! It is that of the Franka Emika Panda, and of every other arm with the same twists and with the
//! same lengths that are zero. Zeros and quarter turns cost nothing there.

use crate::Kinematics;
use crate::angle::Angle;
use crate::kinematics::Row;

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

/// Whether an arm has this structure: the table is a proper one, and gravity acts along the first
/// joint's axis.
pub(crate) fn fits(kinematics: &Kinematics) -> bool {
    let Kinematics { base, joints, .. } = kinematics;
    let fits = |(joint, row): (usize, &Row)| {
        let twist = match TWISTS[joint] {
            Twist::None => (0.0, 1.0),
            Twist::Quarter => (1.0, 0.0),
            Twist::MinusQuarter => (-1.0, 0.0),
        };
        let (a, d) = LENGTHS[joint];
        (row.twist.sin, row.twist.cos) == twist
            && (a || row.a_m == 0.0)
            && (d || row.d_m == 0.0)
            && row.shift_m == [0.0; 3]
            && row.offset == Angle::default()
    };
    joints.len() == JOINTS && base.up() == [0.0, 0.0, 1.0] && joints.iter().enumerate().all(fits)
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
