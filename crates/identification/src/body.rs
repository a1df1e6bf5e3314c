//! Bodies that can exist, as ten numbers without bounds.
//!
//! The pseudo-inertia of a body is the 4 × 4 matrix of its second moments Σ = ∫ r rᵀ dm, its first
//! moment and its mass. A body can exist exactly when it is positive definite, so it is U Uᵀ with
//!
//! ```text
//!         | e^d1  s12   s13   t1 |
//! U = e^α |       e^d2  s23   t2 |
//!         |             e^d3  t3 |
//!         |                   1  |
//! ```
//!
//! (Rucker and Wensing 2022, equation 19). The mass is e^2α, and t is the centre of mass.

use dynamics::{LINK_PARAMETERS, RigidBody};
use nalgebra::{Matrix4, SMatrix};

/// The numbers α, d1, d2, d3, s12, s23, s13, t1, t2, t3 of a body.
pub(crate) type LogCholesky = [f64; LINK_PARAMETERS];

/// Standard deviations of a body's numbers around those of a description: 10 % of the mass, a
/// factor of 1.5 of each principal second moment, and shifts of the mass by a fraction of the body's
/// size.
pub(crate) fn prior_deviations(numbers: &LogCholesky) -> LogCholesky {
    let [_, d1, d2, d3, ..] = *numbers;
    let size_m = (d1.exp().powi(2) + d2.exp().powi(2) + d3.exp().powi(2)).sqrt();
    let shift_m = (0.3 * size_m).max(0.01);
    [0.05, 0.2, 0.2, 0.2, shift_m, shift_m, shift_m, shift_m, shift_m, shift_m]
}

/// Where a load is expected: some kilograms, the size of a hand, within a hand's width of
/// `center_m`. Returns its numbers and their standard deviations.
pub(crate) fn load(center_m: [f64; 3]) -> (LogCholesky, LogCholesky) {
    const MASS_KG: f64 = 1.0;
    const SIZE_M: f64 = 0.04;

    let [x, y, z] = center_m;
    let numbers =
        [0.5 * MASS_KG.ln(), SIZE_M.ln(), SIZE_M.ln(), SIZE_M.ln(), 0.0, 0.0, 0.0, x, y, z];
    (numbers, [0.75, 0.5, 0.5, 0.5, 0.02, 0.02, 0.02, 0.1, 0.1, 0.1])
}

/// The numbers of a body. `None` if it cannot exist.
pub(crate) fn log_cholesky(body: &RigidBody) -> Option<LogCholesky> {
    let [mass, hx, hy, hz, xx, xy, xz, yy, yz, zz] = body.parameters();
    let half_trace = 0.5 * (xx + yy + zz);
    let pseudo_inertia = Matrix4::new(
        half_trace - xx,
        -xy,
        -xz,
        hx, //
        -xy,
        half_trace - yy,
        -yz,
        hy, //
        -xz,
        -yz,
        half_trace - zz,
        hz, //
        hx,
        hy,
        hz,
        mass,
    );
    // With rows and columns in reverse order, the upper factor is a lower one.
    let reversed =
        |matrix: Matrix4<f64>| Matrix4::from_fn(|row, column| matrix[(3 - row, 3 - column)]);
    let upper = reversed(reversed(pseudo_inertia).cholesky()?.l());
    let scale = upper[(3, 3)];
    let at = |row: usize, column: usize| upper[(row, column)] / scale;
    Some([
        scale.ln(),
        at(0, 0).ln(),
        at(1, 1).ln(),
        at(2, 2).ln(),
        at(0, 1),
        at(1, 2),
        at(0, 2),
        at(0, 3),
        at(1, 3),
        at(2, 3),
    ])
}

/// The parameters of the body with these numbers, in which torques are linear.
pub(crate) fn parameters(numbers: &LogCholesky) -> [f64; LINK_PARAMETERS] {
    let upper = factor(numbers);
    of_pseudo_inertia(&(upper * upper.transpose()))
}

/// The derivatives of [`parameters`], `[parameter, number]`.
pub(crate) fn derivatives(numbers: &LogCholesky) -> SMatrix<f64, LINK_PARAMETERS, LINK_PARAMETERS> {
    let upper = factor(numbers);
    let scale = numbers[0].exp();
    SMatrix::from_columns(&std::array::from_fn::<_, LINK_PARAMETERS, _>(|number| {
        let mut change = Matrix4::zeros();
        match number {
            0 => change = upper,
            1..=3 => change[(number - 1, number - 1)] = upper[(number - 1, number - 1)],
            4 => change[(0, 1)] = scale,
            5 => change[(1, 2)] = scale,
            6 => change[(0, 2)] = scale,
            _ => change[(number - 7, 3)] = scale,
        }
        let half = change * upper.transpose();
        of_pseudo_inertia(&(half + half.transpose())).into()
    }))
}

fn factor([alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3]: &LogCholesky) -> Matrix4<f64> {
    Matrix4::new(
        d1.exp(),
        *s12,
        *s13,
        *t1, //
        0.0,
        d2.exp(),
        *s23,
        *t2, //
        0.0,
        0.0,
        d3.exp(),
        *t3, //
        0.0,
        0.0,
        0.0,
        1.0,
    ) * alpha.exp()
}

fn of_pseudo_inertia(j: &Matrix4<f64>) -> [f64; LINK_PARAMETERS] {
    let [x, y, z] = [j[(0, 0)], j[(1, 1)], j[(2, 2)]];
    let [xy, xz, yz] = [-j[(0, 1)], -j[(0, 2)], -j[(1, 2)]];
    [j[(3, 3)], j[(0, 3)], j[(1, 3)], j[(2, 3)], y + z, xy, xz, x + z, yz, x + y]
}

#[cfg(test)]
mod tests {
    use dynamics::Robot;

    use super::*;

    #[test]
    fn a_body_is_its_numbers_and_slopes_are_those_of_differences() {
        for body in Robot::panda().links.iter() {
            let numbers = log_cholesky(body).unwrap();
            for (ours, expected) in parameters(&numbers).iter().zip(body.parameters()) {
                assert!((ours - expected).abs() < 1e-12, "{ours} {expected}");
            }
            let slopes = derivatives(&numbers);
            for number in 0..LINK_PARAMETERS {
                let moved = |by: f64| {
                    let mut moved = numbers;
                    moved[number] += by;
                    parameters(&moved)
                };
                let (below, above) = (moved(-1e-6), moved(1e-6));
                for row in 0..LINK_PARAMETERS {
                    let slope = (above[row] - below[row]) / 2e-6;
                    assert!((slopes[(row, number)] - slope).abs() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn a_body_that_cannot_exist_has_no_numbers() {
        let panda = Robot::panda().links[0];
        let needle =
            RigidBody { inertia: [[1.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], ..panda };
        assert_eq!(log_cholesky(&needle), None);
    }
}
