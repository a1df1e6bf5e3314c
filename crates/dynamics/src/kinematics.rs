//! The positions of joints and hand.

use std::f64::consts::FRAC_1_SQRT_2;

use simd::{F64Array, Lanes, MAX_LANES};
use spec::MAX_JOINTS;

use crate::Joints;
use crate::spatial::{Turn, Vector};

/// An arm's modified Denavit-Hartenberg table (Craig's), and its hand's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// Distance along x of the frame before the joint, m.
    pub a_m: Joints<f64>,
    /// Distance along the joint's own axis, m.
    pub d_m: Joints<f64>,
    /// Twist α about x of the frame before the joint.
    pub twists: Joints<Angle>,
    /// Distance from the last link's frame to the hand's along their z, m.
    pub flange_m: f64,
    /// Rotation of the hand's frame about its z.
    pub hand_yaw: Angle,
}

/// Position and orientation of a frame in the base's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// m.
    pub position_m: [f64; 3],
    /// x, y, z, w, of unit length.
    pub quaternion_xyzw: [f64; 4],
}

/// Numbers per pose as they are recorded: x, y, z, qx, qy, qz, qw.
pub(crate) const POSE: usize = 7;

impl Kinematics {
    /// Origin of a joint's frame in the frame of the link before it (the base for the first), m:
    /// (a, −d sin α, d cos α).
    pub(crate) fn joint_origin(&self, joint: usize) -> [f64; 3] {
        let (a, d, twist) = (self.a_m[joint], self.d_m[joint], self.twists[joint]);
        [a, -d * twist.sin, d * twist.cos]
    }

    /// Pose of the hand's frame in the base's at positions `q` (rad), with qw not negative.
    ///
    /// The hand's z points from the flange to the fingers, its y along their motion.
    pub fn end_effector_pose(&self, q: impl Into<Joints<f64>>) -> Pose {
        let q = q.into();
        let mut angles = [F64Array::<1>::splat(0.0); MAX_JOINTS];
        for (angle, &q) in angles.iter_mut().zip(&q) {
            *angle = Lanes::splat(q);
        }
        let pose = HandPose::new(self, &angles);
        let position_m = pose.position.map(|coordinate| coordinate.lane(0));
        let quaternion_xyzw = pose.quaternion.map(|component| component.lane(0));
        let sign = if quaternion_xyzw[3] < 0.0 { -1.0 } else { 1.0 };
        Pose { position_m, quaternion_xyzw: quaternion_xyzw.map(|component| sign * component) }
    }

    /// Computes the poses of the hand at recorded positions `q`, [sample, joint] in rad, and writes
    /// them to `poses`, [sample, 7]. In the first pose qw is not negative, and the signs of the
    /// others do not jump.
    #[inline(always)]
    pub(crate) fn record_poses<D: Lanes>(&self, q: &[f32], poses: &mut [f32]) {
        let joints = self.a_m.len();
        let mut sign = None;
        let chunks = q.chunks(D::LANES * joints).zip(poses.chunks_mut(D::LANES * POSE));
        for (samples, poses) in chunks {
            let mut by_joint = [[0.0; MAX_LANES]; MAX_JOINTS];
            for (lane, sample) in samples.chunks_exact(joints).enumerate() {
                for joint in 0..joints {
                    by_joint[joint][lane] = sample[joint];
                }
            }
            let mut angles = [D::splat(0.0); MAX_JOINTS];
            for joint in 0..joints {
                angles[joint] = D::load(&by_joint[joint]);
            }

            let hand = HandPose::<D>::new(self, &angles);
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
    /// The quaternion is a product of rotations by half of each joint's angle, which is smooth in
    /// the angles. Along a motion it never jumps to the other of the two quaternions of an
    /// orientation.
    quaternion: [L; 4],
}

impl<L: Lanes> HandPose<L> {
    #[inline(always)]
    fn new(arm: &Kinematics, q: &[L; MAX_JOINTS]) -> Self {
        let zero = L::splat(0.0);
        let one = L::splat(1.0);
        let Angle { half_sin, half_cos, .. } = arm.hand_yaw;
        let mut position = [zero, zero, L::splat(arm.flange_m)];
        let mut quaternion = [zero, zero, L::splat(half_sin), L::splat(half_cos)];
        for joint in (0..arm.a_m.len()).rev() {
            let twist = arm.twists[joint];
            let half = Turn::by(q[joint] * L::splat(0.5));
            let twice_sin = half.sin + half.sin;
            let turn =
                Turn { sin: twice_sin * half.cos, cos: twice_sin.neg_mul_add(half.sin, one) };
            position = position_to_parent(twist, turn, position);
            let origin = arm.joint_origin(joint);
            for axis in 0..3 {
                if origin[axis] != 0.0 {
                    position[axis] = L::splat(origin[axis]) + position[axis];
                }
            }
            quaternion = quaternion_to_parent(twist, half, quaternion);
        }
        Self { position, quaternion }
    }
}

/// A point in the frame of a joint's link, in the axes of the link before it.
#[inline(always)]
fn position_to_parent<L: Lanes>(twist: Angle, turn: Turn<L>, [x, y, z]: Vector<L>) -> Vector<L> {
    let turned_x = turn.sin.neg_mul_add(y, turn.cos * x);
    let turned_y = turn.sin.mul_add(x, turn.cos * y);
    match (twist.sin, twist.cos) {
        (0.0, 1.0) => [turned_x, turned_y, z],
        (1.0, 0.0) => [turned_x, -z, turned_y],
        (-1.0, 0.0) => [turned_x, z, -turned_y],
        (sin, cos) => {
            let (sin, cos) = (L::splat(sin), L::splat(cos));
            [turned_x, sin.neg_mul_add(z, cos * turned_y), sin.mul_add(turned_y, cos * z)]
        }
    }
}

/// An orientation in a joint's link, seen from the link before it. `half` has half the joint's
/// angle.
#[inline(always)]
fn quaternion_to_parent<L: Lanes>(twist: Angle, half: Turn<L>, [x, y, z, w]: [L; 4]) -> [L; 4] {
    let Turn { sin, cos } = half;
    let turned = [
        sin.neg_mul_add(y, cos * x),
        sin.mul_add(x, cos * y),
        sin.mul_add(w, cos * z),
        sin.neg_mul_add(z, cos * w),
    ];
    let [x, y, z, w] = turned;
    // A quarter turn about x is the quaternion (√½, 0, 0, √½).
    let root = L::splat(FRAC_1_SQRT_2);
    match (twist.sin, twist.cos) {
        (0.0, 1.0) => turned,
        (1.0, 0.0) => [(x + w) * root, (y - z) * root, (z + y) * root, (w - x) * root],
        (-1.0, 0.0) => [(x - w) * root, (y + z) * root, (z - y) * root, (w + x) * root],
        _ => {
            let (sin, cos) = (L::splat(twist.half_sin), L::splat(twist.half_cos));
            [
                sin.mul_add(w, cos * x),
                sin.neg_mul_add(z, cos * y),
                sin.mul_add(y, cos * z),
                sin.neg_mul_add(x, cos * w),
            ]
        }
    }
}

/// Sine and cosine of an angle and of its half. Multiples of 45° are exact within f64, so that
/// parallel and perpendicular axes stay so.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Angle {
    /// Sine.
    pub sin: f64,
    /// Cosine.
    pub cos: f64,
    /// Sine of the half.
    pub half_sin: f64,
    /// Cosine of the half.
    pub half_cos: f64,
}

impl Angle {
    /// The angle of so many degrees.
    pub fn degrees(degrees: f64) -> Self {
        let [(sin, cos), (half_sin, half_cos)] = [sin_cos(degrees), sin_cos(0.5 * degrees)];
        Self { sin, cos, half_sin, half_cos }
    }
}

fn sin_cos(degrees: f64) -> (f64, f64) {
    /// sin and cos of 22.5°.
    const SIN_PI_8: f64 = 0.382_683_432_365_089_8;
    const COS_PI_8: f64 = 0.923_879_532_511_286_7;

    let around = degrees.rem_euclid(360.0);
    let quarter = (around / 90.0).floor();
    let rest = around - 90.0 * quarter;
    let (sin, cos) = match rest {
        0.0 => (0.0, 1.0),
        22.5 => (SIN_PI_8, COS_PI_8),
        45.0 => (FRAC_1_SQRT_2, FRAC_1_SQRT_2),
        67.5 => (COS_PI_8, SIN_PI_8),
        rest => rest.to_radians().sin_cos(),
    };
    match quarter {
        1.0 => (cos, -sin),
        2.0 => (-sin, -cos),
        3.0 => (-cos, sin),
        _ => (sin, cos),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::Robot;

    const JOINTS: usize = 7;

    fn rounded(value: f64) -> f32 {
        let mut stored = [0.0; MAX_LANES];
        F64Array::<1>::splat(value).store(&mut stored);
        stored[0]
    }

    /// The hand's pose from the modified DH table, with rotations and translations multiplied out.
    fn multiplied_out(kinematics: &Kinematics, alpha: &[f64], q: &[f64]) -> Isometry3<f64> {
        let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        let shift = |x: f64, z: f64| Translation3::new(x, 0.0, z);
        let mut pose = Isometry3::identity();
        for joint in 0..q.len() {
            pose *= turn(Vector3::x(), alpha[joint].to_radians());
            pose *= shift(kinematics.a_m[joint], kinematics.d_m[joint]);
            pose *= turn(Vector3::z(), q[joint]);
        }
        pose * shift(0.0, kinematics.flange_m)
            * turn(Vector3::z(), kinematics.hand_yaw.sin.atan2(kinematics.hand_yaw.cos))
    }

    /// Arms of 1 to 8 joints with twists in degrees, among them those with an exact sine and
    /// cosine.
    fn arms() -> impl Strategy<Value = (Kinematics, Vec<f64>, Vec<f64>)> {
        let twist = prop_oneof![
            prop::sample::select(vec![-180.0, -90.0, -45.0, 0.0, 45.0, 90.0, 180.0]),
            -180.0..180.0f64,
        ];
        let row = (-0.5..0.5f64, twist, -0.5..0.5f64, -3.0..3.0f64);
        let rows = prop::collection::vec(row, 1..=MAX_JOINTS);
        (rows, 0.0..0.3f64, -180.0..180.0f64).prop_map(|(rows, flange_m, yaw)| {
            let alpha: Vec<f64> = rows.iter().map(|row| row.1).collect();
            let kinematics = Kinematics {
                a_m: rows.iter().map(|row| row.0).collect(),
                d_m: rows.iter().map(|row| row.2).collect(),
                twists: alpha.iter().map(|alpha| Angle::degrees(*alpha)).collect(),
                flange_m,
                hand_yaw: Angle::degrees(yaw),
            };
            (kinematics, alpha, rows.iter().map(|row| row.3).collect())
        })
    }

    proptest! {
        #[test]
        fn the_hand_is_where_the_table_of_lengths_and_twists_says((kinematics, alpha, q) in arms()) {
            let pose = kinematics.end_effector_pose(q.as_slice());
            let expected = multiplied_out(&kinematics, &alpha, &q);
            let position = Vector3::from(pose.position_m);
            prop_assert!((position - expected.translation.vector).norm() < 5e-15);
            let [x, y, z, w] = pose.quaternion_xyzw;
            prop_assert!(w >= 0.0);
            let length = (x * x + y * y + z * z + w * w).sqrt();
            prop_assert!((length - 1.0).abs() < 5e-15);
            let expected = expected.rotation.coords;
            let along: f64 = expected.iter().zip([x, y, z, w]).map(|(a, b)| a * b).sum();
            prop_assert!((along.abs() - 1.0).abs() < 5e-15);
        }
    }

    #[test]
    fn recorded_poses_turn_without_jumps_through_several_revolutions() {
        let panda = Robot::panda().kinematics;
        let samples = 1000;
        let angle = |k: usize, joint: usize| (k as f64 * 0.02 - 10.0) * (1.0 + 0.1 * joint as f64);
        let q: Vec<f32> =
            (0..samples * JOINTS).map(|at| rounded(angle(at / JOINTS, at % JOINTS))).collect();
        let mut poses = vec![0.0; samples * POSE];
        panda.record_poses::<F64Array<4>>(&q, &mut poses);
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
                panda.end_effector_pose(Joints::from_fn(JOINTS, |joint| sample[joint].into()));
            for (recorded, exact) in recorded.iter().zip(pose.position_m) {
                assert_eq!(*recorded, rounded(exact));
            }
        }
    }
}

#[cfg(test)]
mod angle_tests {
    use super::*;

    #[test]
    fn sines_and_cosines_are_those_of_the_angle() {
        for step in -1440..=1440 {
            let degrees = f64::from(step) * 0.5;
            let angle = Angle::degrees(degrees);
            let radians = degrees.to_radians();
            assert!((angle.sin - radians.sin()).abs() < 5e-15, "{degrees}");
            assert!((angle.cos - radians.cos()).abs() < 5e-15, "{degrees}");
            // The half is that of this angle, not of the angle plus one turn.
            let half = (0.5 * radians).sin_cos();
            assert!((angle.half_sin - half.0).abs() < 5e-15, "{degrees}");
            assert!((angle.half_cos - half.1).abs() < 5e-15, "{degrees}");
        }
    }

    #[test]
    fn quarter_turns_have_no_rounding() {
        assert_eq!((Angle::degrees(90.0).sin, Angle::degrees(90.0).cos), (1.0, 0.0));
        assert_eq!((Angle::degrees(-90.0).sin, Angle::degrees(-90.0).cos), (-1.0, 0.0));
        assert_eq!((Angle::degrees(180.0).sin, Angle::degrees(180.0).cos), (0.0, -1.0));
        assert_eq!(Angle::degrees(-45.0).sin, -FRAC_1_SQRT_2);
    }
}
