//! Vectors and inertias of the recursion, moved between the frames of neighbouring links.
//!
//! A child's frame is the parent's, shifted by the joint's origin, turned by its twist about x and
//! by its angle about z. Functions with a `J` are for the structure of [`crate::compiled`]. Its
//! origins differ from robot to robot, but their zero coordinates and the twists do not. So zeros
//! and quarter turns cost nothing.

use simd::Lanes;

use crate::angle::Angle;
use crate::compiled::{TWISTS, Twist, shifted};

pub(crate) type Vector<L> = [L; 3];
/// Entries xx, xy, xz, yy, yz, zz of a symmetric matrix.
pub(crate) type Symmetric<L> = [L; 6];

/// Sine and cosine of a joint's angle.
#[derive(Clone, Copy)]
pub(crate) struct Turn<L> {
    pub(crate) sin: L,
    pub(crate) cos: L,
}

impl<L: Lanes> Turn<L> {
    #[inline(always)]
    pub(crate) fn none() -> Self {
        Self { sin: L::splat(0.0), cos: L::splat(1.0) }
    }

    #[inline(always)]
    pub(crate) fn by(angle: L) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { sin, cos }
    }

    /// This turn and then one by `angle`, which should be small: see [`Lanes::small_sin_cos`].
    #[inline(always)]
    pub(crate) fn followed_by(self, angle: L) -> Self {
        let (sin, cos_less_1) = angle.small_sin_cos();
        Self {
            sin: self.cos.mul_add(sin, self.sin.mul_add(cos_less_1, self.sin)),
            cos: self.sin.neg_mul_add(sin, self.cos.mul_add(cos_less_1, self.cos)),
        }
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, lane: usize, angle: Angle) {
        self.sin.set_lane(lane, angle.sin);
        self.cos.set_lane(lane, angle.cos);
    }

    /// The turn by half of a constant angle.
    #[inline(always)]
    pub(crate) fn half(angle: Angle) -> Self {
        Self { sin: L::splat(angle.half_sin), cos: L::splat(angle.half_cos) }
    }

    /// Both turns about the same axis.
    #[inline(always)]
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            sin: self.cos.mul_add(other.sin, self.sin * other.cos),
            cos: self.sin.neg_mul_add(other.sin, self.cos * other.cos),
        }
    }

    /// A vector of the given length along the parent's z, in the axes of the link of joint `J`.
    #[inline(always)]
    pub(crate) fn axis_to_child<const J: usize>(self, length: L) -> Vector<L> {
        let zero = L::splat(0.0);
        match const { TWISTS[J] } {
            Twist::None => [zero, zero, length],
            Twist::Quarter => [self.sin * length, self.cos * length, zero],
            Twist::MinusQuarter => [-(self.sin * length), -(self.cos * length), zero],
        }
    }

    /// Turns a vector from the axes of the link of joint `J` to the parent's axes.
    #[inline(always)]
    pub(crate) fn to_parent<const J: usize>(self, [x, y, z]: Vector<L>) -> Vector<L> {
        let turned_x = self.sin.neg_mul_add(y, self.cos * x);
        let turned_y = self.sin.mul_add(x, self.cos * y);
        match const { TWISTS[J] } {
            Twist::None => [turned_x, turned_y, z],
            Twist::Quarter => [turned_x, -z, turned_y],
            Twist::MinusQuarter => [turned_x, z, -turned_y],
        }
    }

    /// Turns a vector from the parent's axes to the axes of the link of joint `J`.
    #[inline(always)]
    pub(crate) fn to_child<const J: usize>(self, [x, y, z]: Vector<L>) -> Vector<L> {
        let (y, z) = match const { TWISTS[J] } {
            Twist::None => (y, z),
            Twist::Quarter => (z, -y),
            Twist::MinusQuarter => (-z, y),
        };
        [self.sin.mul_add(y, self.cos * x), self.sin.neg_mul_add(x, self.cos * y), z]
    }

    /// Turns a symmetric matrix from the axes of the link of joint `J` to the parent's axes: R A
    /// Rᵀ.
    #[inline(always)]
    pub(crate) fn symmetric_to_parent<const J: usize>(self, a: Symmetric<L>) -> Symmetric<L> {
        let Self { sin, cos } = self;
        let [xx, xy, xz, yy, yz, zz] = a;
        let half_x = sin.neg_mul_add(xy, cos * xx);
        let half_y = sin.neg_mul_add(yy, cos * xy);
        let turned_xx = sin.neg_mul_add(half_y, cos * half_x);
        let turned_xy = cos.mul_add(half_y, sin * half_x);
        // The trace of the turned block is that of the block.
        let turned_yy = (xx + yy) - turned_xx;
        let turned_xz = sin.neg_mul_add(yz, cos * xz);
        let turned_yz = cos.mul_add(yz, sin * xz);
        match const { TWISTS[J] } {
            Twist::None => [turned_xx, turned_xy, turned_xz, turned_yy, turned_yz, zz],
            Twist::Quarter => [turned_xx, -turned_xz, turned_xy, zz, -turned_yz, turned_yy],
            Twist::MinusQuarter => [turned_xx, turned_xz, -turned_xy, zz, -turned_yz, turned_yy],
        }
    }
}

/// `sum + origin × v` with the origin of joint `J`.
#[inline(always)]
pub(crate) fn add_origin_cross<L: Lanes, const J: usize>(
    origin: &Vector<L>,
    v: Vector<L>,
    sum: Vector<L>,
) -> Vector<L> {
    let mut sum = sum;
    if const { shifted::<J>(0) } {
        sum[1] = origin[0].neg_mul_add(v[2], sum[1]);
        sum[2] = origin[0].mul_add(v[1], sum[2]);
    }
    if const { shifted::<J>(1) } {
        sum[0] = origin[1].mul_add(v[2], sum[0]);
        sum[2] = origin[1].neg_mul_add(v[0], sum[2]);
    }
    if const { shifted::<J>(2) } {
        sum[0] = origin[2].neg_mul_add(v[1], sum[0]);
        sum[1] = origin[2].mul_add(v[0], sum[1]);
    }
    sum
}

/// `sum + A · origin` with the origin of joint `J`, given the first two columns of A.
#[inline(always)]
pub(crate) fn add_matrix_origin<L: Lanes, const J: usize>(
    a: &[[L; 2]; 3],
    origin: &Vector<L>,
    sum: Vector<L>,
) -> Vector<L> {
    const { assert!(!shifted::<J>(2), "the third column is not known") };
    let mut sum = sum;
    for row in 0..3 {
        for axis in 0..2 {
            if shifted::<J>(axis) {
                sum[row] = a[row][axis].mul_add(origin[axis], sum[row]);
            }
        }
    }
    sum
}

/// Inertia of a massless body about the parent's origin, from that about the origin of joint `J`,
/// all in the parent's axes: I − [t][h] − [h][t] with t the joint's origin and h the first moment.
/// [t] is the matrix of t × ·.
#[inline(always)]
pub(crate) fn shifted_inertia<L: Lanes, const J: usize>(
    origin: &Vector<L>,
    first_moment: Vector<L>,
    inertia: Symmetric<L>,
) -> Symmetric<L> {
    /// The index of entry (row, column) in a [`Symmetric`].
    const ENTRY: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

    let mut moved = inertia;
    for axis in 0..3 {
        if shifted::<J>(axis) {
            let t = origin[axis];
            let twice_moment = first_moment[axis] + first_moment[axis];
            for other in 0..3 {
                if other != axis {
                    let (diagonal, mixed) = (ENTRY[other][other], ENTRY[axis][other]);
                    moved[diagonal] = t.mul_add(twice_moment, moved[diagonal]);
                    moved[mixed] = t.neg_mul_add(first_moment[other], moved[mixed]);
                }
            }
        }
    }
    moved
}

/// sum + a × b.
#[inline(always)]
pub(crate) fn add_cross<L: Lanes>(a: Vector<L>, b: Vector<L>, sum: Vector<L>) -> Vector<L> {
    [
        a[2].neg_mul_add(b[1], a[1].mul_add(b[2], sum[0])),
        a[0].neg_mul_add(b[2], a[2].mul_add(b[0], sum[1])),
        a[1].neg_mul_add(b[0], a[0].mul_add(b[1], sum[2])),
    ]
}

#[inline(always)]
pub(crate) fn sum<L: Lanes, const N: usize>(a: [L; N], b: [L; N]) -> [L; N] {
    let mut sum = a;
    for i in 0..N {
        sum[i] = a[i] + b[i];
    }
    sum
}
