//! Angles of a table, whose sine and cosine are exact at multiples of 45 degrees.

use std::f64::consts::FRAC_1_SQRT_2;

/// Sine and cosine of an angle and of its half. Multiples of 45° are exact within f64, so that
/// parallel and perpendicular axes stay so.
#[derive(Clone, Copy, Debug, PartialEq)]
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

impl Default for Angle {
    /// No turn.
    fn default() -> Self {
        Self { sin: 0.0, cos: 1.0, half_sin: 0.0, half_cos: 1.0 }
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
