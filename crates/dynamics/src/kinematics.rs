//! The positions of joints and hand.

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Matrix3, Rotation3};
use simd::{F64Array, Lanes, MAX_LANES};
use spec::MAX_JOINTS;

use crate::Joints;
use crate::angle::Angle;
use crate::spatial::{Turn, Vector};

/// Where the base, the joints and the hand of an arm are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Kinematics {
    /// The frame before the first joint.
    pub base: Base,
    /// The frame of each joint, in the frame of the link before it.
    pub joints: Joints<Row>,
    /// The hand's frame, in the last link's. Its `d_m` is the flange's distance, its `offset` the
    /// hand's yaw.
    pub hand: Row,
}

/// A row of a modified Denavit-Hartenberg table (Craig's): the frame before, shifted by `a_m` along
/// x and by `shift_m`, turned by `twist` about x, shifted by `d_m` along z, and turned by the
/// joint's position plus `offset` about z.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Distance along x of the frame before, m.
    pub a_m: f64,
    /// Distance along the frame's own z, m.
    pub d_m: f64,
    /// Twist α about x of the frame before.
    pub twist: Angle,
    /// The angle about z at position 0.
    pub offset: Angle,
    /// A further shift in the axes of the frame before, m. Proper tables have none.
    pub shift_m: [f64; 3],
}

impl Row {
    /// The frame's origin in the frame before, m: (a, −d sin α, d cos α) plus the shift.
    pub fn origin(&self) -> [f64; 3] {
        let Self { a_m, d_m, twist, shift_m, .. } = *self;
        let table = [a_m, -d_m * twist.sin, d_m * twist.cos];
        if shift_m == [0.0; 3] {
            return table;
        }
        std::array::from_fn(|axis| table[axis] + shift_m[axis])
    }

    /// The turn of the frame's axes into those of the frame before, at position `q` (rad).
    pub fn turn(&self, q: f64) -> Rotation3<f64> {
        self.turn_by(q.sin_cos())
    }

    /// The turn at the position with this sine and cosine.
    pub(crate) fn turn_by(&self, (sin, cos): (f64, f64)) -> Rotation3<f64> {
        let Self { twist, offset, .. } = self;
        let (sin, cos) = (sin * offset.cos + cos * offset.sin, cos * offset.cos - sin * offset.sin);
        Rotation3::from_matrix_unchecked(Matrix3::new(
            cos,
            -sin,
            0.0,
            twist.cos * sin,
            twist.cos * cos,
            -twist.sin,
            twist.sin * sin,
            twist.sin * cos,
            twist.cos,
        ))
    }

    /// The frame's z in the frame before.
    pub(crate) const fn axis(&self) -> [f64; 3] {
        [0.0, -self.twist.sin, self.twist.cos]
    }
}

/// The pose of the frame before the first joint in the world, whose z axis points up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base {
    /// m.
    pub position_m: [f64; 3],
    /// Rows of the matrix that turns the frame's axes into the world's.
    pub rotation: [[f64; 3]; 3],
    /// The same turn, x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
}

impl Base {
    /// A base at `position_m`, turned by `rpy_deg` about the world's x, y and z, one after the
    /// other.
    pub fn new(position_m: [f64; 3], rpy_deg: [f64; 3]) -> Self {
        let [roll, pitch, yaw] = rpy_deg.map(Angle::degrees);
        let rotation = [
            [
                yaw.cos * pitch.cos,
                yaw.cos * pitch.sin * roll.sin - yaw.sin * roll.cos,
                yaw.cos * pitch.sin * roll.cos + yaw.sin * roll.sin,
            ],
            [
                yaw.sin * pitch.cos,
                yaw.sin * pitch.sin * roll.sin + yaw.cos * roll.cos,
                yaw.sin * pitch.sin * roll.cos - yaw.cos * roll.sin,
            ],
            [-pitch.sin, pitch.cos * roll.sin, pitch.cos * roll.cos],
        ];
        let [(sr, cr), (sp, cp), (sy, cy)] =
            [roll, pitch, yaw].map(|angle| (angle.half_sin, angle.half_cos));
        let quaternion_xyzw = [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ];
        Self { position_m, rotation, quaternion_xyzw }
    }

    /// The world's z in the base's axes.
    pub const fn up(&self) -> [f64; 3] {
        self.rotation[2]
    }
}

impl Default for Base {
    /// The world.
    fn default() -> Self {
        Self::new([0.0; 3], [0.0; 3])
    }
}

/// Position and orientation of a frame in the world.
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
    /// Changes every length that is not zero: along x and z of all joints, of the hand, and further
    /// shifts. The order is always the same.
    pub fn for_each_length(&mut self, mut change: impl FnMut(&mut f64)) {
        let mut if_any = |length: &mut f64| {
            if *length != 0.0 {
                change(length);
            }
        };
        let Self { joints, hand, .. } = self;
        joints.iter_mut().for_each(|row| if_any(&mut row.a_m));
        joints.iter_mut().for_each(|row| if_any(&mut row.d_m));
        if_any(&mut hand.d_m);
        if_any(&mut hand.a_m);
        for row in joints.iter_mut().chain([hand]) {
            row.shift_m.iter_mut().for_each(&mut if_any);
        }
    }

    /// Pose of the hand's frame in the world at positions `q` (rad), with qw not negative.
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
        let joints = self.joints.len();
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
        let [zero, one] = [0.0, 1.0].map(L::splat);
        let identity = [zero, zero, zero, one];
        let mut position = arm.hand.origin().map(L::splat);
        let mut quaternion =
            quaternion_to_parent(arm.hand.twist, Turn::half(arm.hand.offset), identity);
        for joint in (0..arm.joints.len()).rev() {
            let row = &arm.joints[joint];
            let mut half = Turn::by(q[joint] * L::splat(0.5));
            if row.offset != Angle::default() {
                half = half.and(Turn::half(row.offset));
            }
            let twice_sin = half.sin + half.sin;
            let turn =
                Turn { sin: twice_sin * half.cos, cos: twice_sin.neg_mul_add(half.sin, one) };
            position = position_to_parent(row.twist, turn, position);
            let origin = row.origin();
            for axis in 0..3 {
                if origin[axis] != 0.0 {
                    position[axis] = L::splat(origin[axis]) + position[axis];
                }
            }
            quaternion = quaternion_to_parent(row.twist, half, quaternion);
        }
        if arm.base != Base::default() {
            position = on_base(&arm.base, position);
            quaternion = product(arm.base.quaternion_xyzw, quaternion);
        }
        Self { position, quaternion }
    }
}

/// A point of the frame before the first joint, in the world.
#[inline(always)]
fn on_base<L: Lanes>(base: &Base, point: Vector<L>) -> Vector<L> {
    let mut moved = base.position_m.map(L::splat);
    for row in 0..3 {
        for axis in 0..3 {
            moved[row] = L::splat(base.rotation[row][axis]).mul_add(point[axis], moved[row]);
        }
    }
    moved
}

/// The product of two quaternions: the turn `b` and then `a`.
#[inline(always)]
fn product<L: Lanes>(a: [f64; 4], [bx, by, bz, bw]: [L; 4]) -> [L; 4] {
    let [ax, ay, az, aw] = a.map(L::splat);
    [
        az.neg_mul_add(by, ay.mul_add(bz, ax.mul_add(bw, aw * bx))),
        ax.neg_mul_add(bz, az.mul_add(bx, ay.mul_add(bw, aw * by))),
        ay.neg_mul_add(bx, ax.mul_add(by, az.mul_add(bw, aw * bz))),
        az.neg_mul_add(bz, ay.neg_mul_add(by, ax.neg_mul_add(bx, aw * bw))),
    ]
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

    /// A row in numbers: shift, a, α, d and θ₀, lengths in m and angles in degrees.
    type Numbers = ([f64; 3], f64, f64, f64, f64);

    fn row_of((shift_m, a_m, alpha, d_m, offset): Numbers) -> Row {
        let [twist, offset] = [alpha, offset].map(Angle::degrees);
        Row { a_m, d_m, twist, offset, shift_m }
    }

    /// The hand's pose with rotations and translations multiplied out. The last row is the hand's.
    fn multiplied_out(base: ([f64; 3], [f64; 3]), rows: &[Numbers], q: &[f64]) -> Isometry3<f64> {
        let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        let shift = |vector: [f64; 3]| Translation3::from(vector);
        let [roll, pitch, yaw] = base.1.map(f64::to_radians);
        let mut pose = shift(base.0) * UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        for (joint, &(shift_m, a_m, alpha, d_m, offset)) in rows.iter().enumerate() {
            pose *= shift(shift_m) * shift([a_m, 0.0, 0.0]);
            pose *= turn(Vector3::x(), alpha.to_radians());
            pose *= shift([0.0, 0.0, d_m]);
            let position = q.get(joint).copied().unwrap_or(0.0);
            pose *= turn(Vector3::z(), position + offset.to_radians());
        }
        pose
    }

    fn angle() -> impl Strategy<Value = f64> {
        prop_oneof![
            prop::sample::select(vec![-180.0, -90.0, -45.0, 0.0, 45.0, 90.0, 180.0]),
            -180.0..180.0f64,
        ]
    }

    /// Position (m) and roll, pitch and yaw (degrees) of a base, the rows, and positions of the joints.
    type Arm = (([f64; 3], [f64; 3]), Vec<Numbers>, Vec<f64>);

    /// Arms of 1 to 8 joints and their hands, upright or not, with angles in degrees, among them
    /// those with an exact sine and cosine.
    fn arms() -> impl Strategy<Value = Arm> {
        let shift = prop_oneof![Just([0.0; 3]), prop::array::uniform3(-0.5..0.5f64)];
        let offset = prop_oneof![Just(0.0), angle()];
        let row = (shift, -0.5..0.5f64, angle(), -0.5..0.5f64, offset);
        let rows = prop::collection::vec(row, 2..=MAX_JOINTS + 1);
        let tilted = (prop::array::uniform3(-2.0..2.0f64), prop::array::uniform3(angle()));
        let base = prop_oneof![Just(([0.0; 3], [0.0; 3])), tilted];
        (base, rows, prop::collection::vec(-3.0..3.0f64, MAX_JOINTS)).prop_map(
            |(base, rows, mut q)| {
                q.truncate(rows.len() - 1);
                (base, rows, q)
            },
        )
    }

    proptest! {
        #[test]
        fn the_hand_is_where_the_table_of_lengths_and_twists_says((base, rows, q) in arms()) {
            let (&hand, joints) = rows.split_last().unwrap();
            let kinematics = Kinematics {
                base: Base::new(base.0, base.1),
                joints: joints.iter().copied().map(row_of).collect(),
                hand: row_of(hand),
            };
            let pose = kinematics.end_effector_pose(q.as_slice());
            let expected = multiplied_out(base, &rows, &q);
            let position = Vector3::from(pose.position_m);
            prop_assert!((position - expected.translation.vector).norm() < 1e-14);
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
    fn an_arm_on_the_ceiling_hangs_down() {
        let ceiling = Base::new([0.0, 0.0, 2.0], [180.0, 0.0, 0.0]);
        assert_eq!(ceiling.up(), [0.0, 0.0, -1.0]);
        let panda = Robot::panda().kinematics;
        let q = [0.1, -0.3, 0.2, -1.5, 0.4, 1.9, 0.8];
        let [x, y, z] = panda.end_effector_pose(q).position_m;
        let hanging = Kinematics { base: ceiling, ..panda }.end_effector_pose(q).position_m;
        assert_eq!(hanging, [x, -y, 2.0 - z]);
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
