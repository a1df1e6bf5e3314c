//! Where joints and hand are.

use std::f64::consts::FRAC_1_SQRT_2;

use simd::{F64Array, Lanes, MAX_LANES};
use spec::JOINTS;

use crate::Joints;
use crate::panda::{TWISTS, Twist};
use crate::spatial::{Turn, Vector, add_scaled_origin};

/// Lengths of an arm's modified Denavit-Hartenberg table; twists are the Panda's.
///
/// Lengths that are zero in the Panda's table are zero in every arm's: only a4, a5, a7, d1, d3, d5 and
/// the flange's are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// Along x of the frame before the joint, m.
    pub a_m: Joints<f64>,
    /// Along the joint's own axis, m.
    pub d_m: Joints<f64>,
    /// From the frame of link 7 to the hand's, along their z, m.
    pub flange_m: f64,
}

/// Position and orientation of a frame in the base's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// m.
    pub position_m: [f64; 3],
    /// x, y, z, w; of unit length.
    pub quaternion_xyzw: [f64; 4],
}

/// Numbers per pose as they are recorded: x, y, z, qx, qy, qz, qw.
pub(crate) const POSE: usize = 7;

impl Kinematics {
    /// Origin of each joint's frame in the frame of the link before it (the base for the first), m.
    pub fn joint_origins(&self) -> Joints<[f64; 3]> {
        std::array::from_fn(|joint| self.joint_origin(joint))
    }

    /// (a, −d sin α, d cos α).
    pub(crate) const fn joint_origin(&self, joint: usize) -> [f64; 3] {
        let (a, d) = (self.a_m[joint], self.d_m[joint]);
        match TWISTS[joint] {
            Twist::None => [a, 0.0, d],
            Twist::Quarter => [a, -d, 0.0],
            Twist::MinusQuarter => [a, d, 0.0],
        }
    }

    /// Pose of the hand's frame in the base's at positions `q` (rad), with qw not negative.
    ///
    /// The hand's z points from the flange to the fingers, its y along their motion.
    pub fn end_effector_pose(&self, q: Joints<f64>) -> Pose {
        let pose = HandPose::<F64Array<1>>::new(&self.lanes(), &q.map(Lanes::splat));
        let position_m = pose.position.map(|coordinate| coordinate.lane(0));
        let quaternion_xyzw = pose.quaternion.map(|component| component.lane(0));
        let sign = if quaternion_xyzw[3] < 0.0 { -1.0 } else { 1.0 };
        Pose { position_m, quaternion_xyzw: quaternion_xyzw.map(|component| sign * component) }
    }

    #[inline(always)]
    fn lanes<L: Lanes>(&self) -> (Joints<Vector<L>>, L) {
        let mut origins = [[L::splat(0.0); 3]; JOINTS];
        for joint in 0..JOINTS {
            for axis in 0..3 {
                origins[joint][axis] = L::splat(self.joint_origin(joint)[axis]);
            }
        }
        (origins, L::splat(self.flange_m))
    }

    /// Poses of the hand at recorded positions `q`, [sample, joint] in rad, into `poses`,
    /// [sample, 7]: the first with qw not negative, the others without jumps of sign.
    #[inline(always)]
    pub(crate) fn record_poses<D: Lanes>(&self, q: &[f32], poses: &mut [f32]) {
        let arm = self.lanes::<D>();
        let mut sign = None;
        let chunks = q.chunks(D::LANES * JOINTS).zip(poses.chunks_mut(D::LANES * POSE));
        for (samples, poses) in chunks {
            let mut by_joint = [[0.0; MAX_LANES]; JOINTS];
            for (lane, sample) in samples.chunks_exact(JOINTS).enumerate() {
                for joint in 0..JOINTS {
                    by_joint[joint][lane] = sample[joint];
                }
            }
            let mut angles = [D::splat(0.0); JOINTS];
            for joint in 0..JOINTS {
                angles[joint] = D::load(&by_joint[joint]);
            }

            let hand = HandPose::<D>::new(&arm, &angles);
            let mut components = [[0.0; MAX_LANES]; POSE];
            for axis in 0..3 {
                hand.position[axis].store(&mut components[axis]);
            }
            for part in 0..4 {
                hand.quaternion[part].store(&mut components[3 + part]);
            }
            let sign = *sign.get_or_insert(if components[POSE - 1][0] < 0.0 { -1.0 } else { 1.0 });
            for (lane, pose) in poses.chunks_exact_mut(POSE).enumerate() {
                for part in 0..POSE {
                    pose[part] = components[part][lane];
                }
                for part in 3..POSE {
                    pose[part] *= sign;
                }
            }
        }
    }
}

/// Pose of the hand, one per lane.
struct HandPose<L> {
    position: Vector<L>,
    /// x, y, z, w.
    ///
    /// A product of rotations by half of each joint's angle, which is smooth in the angles: along
    /// a motion it never jumps to the other of the two quaternions of an orientation.
    quaternion: [L; 4],
}

impl<L: Lanes> HandPose<L> {
    #[inline(always)]
    fn new((origins, flange): &(Joints<Vector<L>>, L), q: &Joints<L>) -> Self {
        let zero = L::splat(0.0);
        let one = L::splat(1.0);
        let mut position = [zero, zero, *flange];
        // Of the hand in link 7: a turn by −45° about z, halved.
        let mut quaternion = [zero, zero, L::splat(-SIN_PI_8), L::splat(COS_PI_8)];
        macro_rules! inwards {
            ($($joint:literal)*) => {$(
                let half = Turn::by(q[$joint] * L::splat(0.5));
                let twice_sin = half.sin + half.sin;
                let turn = Turn {
                    sin: twice_sin * half.cos,
                    cos: twice_sin.neg_mul_add(half.sin, one),
                };
                let turned = turn.to_parent::<$joint>(position);
                position = add_scaled_origin::<L, $joint>(one, &origins[$joint], turned);
                quaternion = half.quaternion_to_parent::<$joint>(quaternion);
            )*};
        }
        inwards!(6 5 4 3 2 1 0);
        Self { position, quaternion }
    }
}

/// sin and cos of π/8.
const SIN_PI_8: f64 = 0.382_683_432_365_089_8;
const COS_PI_8: f64 = 0.923_879_532_511_286_7;

impl<L: Lanes> Turn<L> {
    /// An orientation in joint `J`'s link, in the link before it; `self` holds half the joint's angle.
    #[inline(always)]
    fn quaternion_to_parent<const J: usize>(self, [x, y, z, w]: [L; 4]) -> [L; 4] {
        let Self { sin, cos } = self;
        let turned = [
            sin.neg_mul_add(y, cos * x),
            sin.mul_add(x, cos * y),
            sin.mul_add(w, cos * z),
            sin.neg_mul_add(z, cos * w),
        ];
        let [x, y, z, w] = turned;
        // A quarter turn about x is the quaternion (√½, 0, 0, √½).
        let half = L::splat(FRAC_1_SQRT_2);
        match const { TWISTS[J] } {
            Twist::None => turned,
            Twist::Quarter => [(x + w) * half, (y - z) * half, (z + y) * half, (w - x) * half],
            Twist::MinusQuarter => [(x - w) * half, (y + z) * half, (z - y) * half, (w + x) * half],
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::panda::KINEMATICS;

    fn rounded(value: f64) -> f32 {
        let mut stored = [0.0; MAX_LANES];
        F64Array::<1>::splat(value).store(&mut stored);
        stored[0]
    }

    /// The hand's pose from the modified DH table, with rotations and translations multiplied out.
    fn multiplied_out(kinematics: &Kinematics, q: Joints<f64>) -> Isometry3<f64> {
        let alpha = [0.0, -90.0, 90.0, 90.0, -90.0, 90.0, 90.0_f64];
        let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        let shift = |x: f64, z: f64| Translation3::new(x, 0.0, z);
        let mut pose = Isometry3::identity();
        for joint in 0..JOINTS {
            pose *= turn(Vector3::x(), alpha[joint].to_radians());
            pose *= shift(kinematics.a_m[joint], kinematics.d_m[joint]);
            pose *= turn(Vector3::z(), q[joint]);
        }
        pose * shift(0.0, kinematics.flange_m) * turn(Vector3::z(), -45f64.to_radians())
    }

    fn lengths() -> impl Strategy<Value = Kinematics> {
        prop::array::uniform7(0.5..1.5f64).prop_map(|factors| {
            let [a4, a5, a7, d1, d3, d5, flange] = factors;
            let mut kinematics = KINEMATICS;
            for (length, factor) in [(3, a4), (4, a5), (6, a7)] {
                kinematics.a_m[length] *= factor;
            }
            for (length, factor) in [(0, d1), (2, d3), (4, d5)] {
                kinematics.d_m[length] *= factor;
            }
            kinematics.flange_m *= flange;
            kinematics
        })
    }

    proptest! {
        #[test]
        fn the_hand_is_where_the_table_of_lengths_and_twists_says(
            kinematics in lengths(),
            q in prop::array::uniform7(-3.0..3.0f64),
        ) {
            let pose = kinematics.end_effector_pose(q);
            let expected = multiplied_out(&kinematics, q);
            let position = Vector3::from(pose.position_m);
            prop_assert!((position - expected.translation.vector).norm() < 2e-15);
            let [x, y, z, w] = pose.quaternion_xyzw;
            prop_assert!(w >= 0.0);
            let length = (x * x + y * y + z * z + w * w).sqrt();
            prop_assert!((length - 1.0).abs() < 3e-15);
            let expected = expected.rotation.coords;
            let along: f64 = expected.iter().zip([x, y, z, w]).map(|(a, b)| a * b).sum();
            prop_assert!((along.abs() - 1.0).abs() < 3e-15);
        }
    }

    #[test]
    fn recorded_poses_turn_without_jumps_through_several_revolutions() {
        let samples = 1000;
        let angle = |k: usize, joint: usize| (k as f64 * 0.02 - 10.0) * (1.0 + 0.1 * joint as f64);
        let q: Vec<f32> =
            (0..samples * JOINTS).map(|at| rounded(angle(at / JOINTS, at % JOINTS))).collect();
        let mut poses = vec![0.0; samples * POSE];
        KINEMATICS.record_poses::<F64Array<4>>(&q, &mut poses);
        assert!(poses[POSE - 1] >= 0.0);
        let mut negative = 0;
        for (k, pair) in poses.windows(2 * POSE).step_by(POSE).enumerate() {
            let dot: f32 = (3..POSE).map(|part| pair[part] * pair[POSE + part]).sum();
            assert!(dot > 0.9, "jump after sample {k}");
            negative += usize::from(pair[POSE - 1] < 0.0);
        }
        assert!(negative > 100, "the motion never left the hemisphere it began in");
        for (sample, recorded) in q.chunks_exact(JOINTS).zip(poses.chunks_exact(POSE)) {
            let pose =
                KINEMATICS.end_effector_pose(std::array::from_fn(|joint| sample[joint].into()));
            for (recorded, exact) in recorded.iter().zip(pose.position_m) {
                assert_eq!(*recorded, rounded(exact));
            }
        }
    }
}
