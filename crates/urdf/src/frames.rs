//! Rotations from angles and back, exact where the angles are.

use std::f64::consts::FRAC_PI_2;

use dynamics::Angle;
use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Unit, Vector3};
use spec::BaseDescription;

/// Rz(yaw) Ry(pitch) Rx(roll), from sine and cosine of each.
pub(crate) fn turned([roll, pitch, yaw]: [(f64, f64); 3]) -> Rotation3<f64> {
    about_z(yaw) * about_y(pitch) * about_x(roll)
}

pub(crate) fn about_x((sin, cos): (f64, f64)) -> Rotation3<f64> {
    rotation(Matrix3::new(1.0, 0.0, 0.0, 0.0, cos, -sin, 0.0, sin, cos))
}

fn about_y((sin, cos): (f64, f64)) -> Rotation3<f64> {
    rotation(Matrix3::new(cos, 0.0, sin, 0.0, 1.0, 0.0, -sin, 0.0, cos))
}

pub(crate) fn about_z((sin, cos): (f64, f64)) -> Rotation3<f64> {
    rotation(Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0))
}

fn rotation(matrix: Matrix3<f64>) -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(matrix)
}

/// Sine and cosine of an angle in degrees, as the simulation takes them: multiples of 45 are exact.
pub(crate) fn sin_cos_deg(degrees: f64) -> (f64, f64) {
    let Angle { sin, cos, .. } = Angle::degrees(degrees);
    (sin, cos)
}

/// Roll, pitch and yaw of a rotation, rad. If the pitch is a right angle, the yaw is 0.
pub(crate) fn roll_pitch_yaw(rotation: &Rotation3<f64>) -> [f64; 3] {
    /// Below this cosine of the pitch, roll and yaw turn about the same axis within rounding.
    const LOCKED: f64 = 1e-12;

    let matrix = rotation.matrix();
    let cos_pitch = matrix.m11.hypot(matrix.m21);
    let [pitch, yaw] = if cos_pitch < LOCKED {
        [FRAC_PI_2.copysign(-matrix.m31), 0.0]
    } else {
        [(-matrix.m31).atan2(cos_pitch), matrix.m21.atan2(matrix.m11)]
    };
    // The roll is what is left, so it makes up for the rounding of pitch and yaw.
    let rest = about_y((-pitch).sin_cos()) * about_z((-yaw).sin_cos()) * rotation;
    [rest.matrix().m32.atan2(rest.matrix().m33), pitch, yaw]
}

/// The pose that a description gives the base.
pub(crate) fn base_pose(base: &BaseDescription) -> IsometryMatrix3<f64> {
    let translation = Translation3::from(Vector3::from(base.position_m));
    IsometryMatrix3::from_parts(translation, turned(base.rpy_deg.map(sin_cos_deg)))
}

/// A rotation that turns z into `axis`. It permutes the axes if `axis` is one of them.
pub(crate) fn with_z_along(axis: &Unit<Vector3<f64>>) -> Rotation3<f64> {
    let least = axis.map(f64::abs).imin();
    let mut x = Vector3::zeros();
    x[least] = 1.0;
    let x = (x - axis.as_ref() * axis[least]).normalize();
    rotation(Matrix3::from_columns(&[x, axis.cross(&x), axis.into_inner()]))
}

/// An angle in degrees within (-180, 180]. Within 1e-12 rad of a multiple of 45 it is that multiple.
pub(crate) fn to_degrees(angle: f64) -> f64 {
    const ROUNDING_RAD: f64 = 1e-12;

    let degrees = angle.to_degrees();
    let nearest = 45.0 * (degrees / 45.0).round();
    let degrees =
        if (degrees - nearest).abs() <= ROUNDING_RAD.to_degrees() { nearest } else { degrees };
    let around = degrees - 360.0 * (degrees / 360.0).round();
    // Without the sign of zero.
    (if around <= -180.0 { around + 360.0 } else { around }) + 0.0
}

/// A length in m, or 0 if it is rounding.
pub(crate) fn to_length(length: f64) -> f64 {
    const ROUNDING_M: f64 = 1e-13;

    if length.abs() < ROUNDING_M { 0.0 } else { length }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn roll_pitch_and_yaw_give_the_rotation_back(
            roll in -3.2..3.2, pitch in -3.2..3.2, yaw in -3.2..3.2,
        ) {
            let rotation = turned([roll, pitch, yaw].map(f64::sin_cos));
            let back = turned(roll_pitch_yaw(&rotation).map(f64::sin_cos));
            prop_assert!((back.matrix() - rotation.matrix()).amax() < 1e-15);
        }

        #[test]
        fn a_frame_along_an_axis_is_a_rotation(
            x in -1.0..1.0, y in -1.0..1.0, z in -1.0..1.0,
        ) {
            let axis = Unit::new_normalize(Vector3::new(x, y, z));
            let frame = with_z_along(&axis);
            prop_assert!((frame * Vector3::z() - axis.into_inner()).amax() < 1e-15);
            let square = frame.matrix() * frame.matrix().transpose();
            prop_assert!((square - Matrix3::identity()).amax() < 1e-15);
        }
    }

    #[test]
    fn a_pitch_near_a_right_angle_is_as_accurate() {
        for nearly in [0.0, 1e-17, 1e-14, 1e-13, 1e-9, 1e-5] {
            for pitch in [FRAC_PI_2 - nearly, nearly - FRAC_PI_2] {
                let rotation = turned([0.3, pitch, -2.0].map(f64::sin_cos));
                let back = turned(roll_pitch_yaw(&rotation).map(f64::sin_cos));
                let error = (back.matrix() - rotation.matrix()).amax();
                assert!(error < 2e-12, "{pitch}: {error:e}");
            }
        }
    }

    #[test]
    fn frames_along_the_axes_permute_them() {
        assert_eq!(*with_z_along(&Vector3::z_axis()).matrix(), Matrix3::identity());
        for axis in [Vector3::x_axis(), -Vector3::x_axis(), Vector3::y_axis(), -Vector3::z_axis()] {
            let frame = with_z_along(&axis);
            assert!(frame.matrix().iter().all(|entry| [0.0, 1.0, -1.0].contains(entry)), "{frame}");
        }
    }

    #[test]
    fn angles_are_normalized_and_multiples_of_45_are_exact() {
        let cases = [
            (std::f64::consts::PI, 180.0),
            (-std::f64::consts::PI, 180.0),
            (-FRAC_PI_2, -90.0),
            (7.0 * std::f64::consts::FRAC_PI_4, -45.0),
            (-0.0, 0.0),
            (1e-13, 0.0),
        ];
        for (angle, degrees) in cases {
            assert_eq!(to_degrees(angle).to_bits(), f64::to_bits(degrees), "{angle}");
        }
        assert!((to_degrees(1e-9) - 1e-9_f64.to_degrees()).abs() < 1e-20);
    }
}
