//! Robots around the nominal one.

use nalgebra::Matrix3;
use spec::{InertiaScheme, RobotSpec};

use crate::panda::Bodies;
use crate::random::Draws;
use crate::{RigidBody, Robot};

/// Draws one robot: every body's mass, centre of mass and inertia, then every joint's damping.
///
/// Bodies are drawn before hand and fingers are welded to link 7, as in the paper's simulator,
/// which randomizes each body of the articulation.
pub(crate) fn draw_robot(spec: &RobotSpec, draws: &mut Draws) -> Robot {
    let mut bodies = Bodies::of(spec.model);
    for body in bodies.each_mut() {
        *body = draw_body(spec, body, draws);
    }
    let damping =
        spec.damping_nm_s_rad.map(|nominal| nominal * draws.factor(spec.damping_fraction));
    Robot::from_bodies(spec, &bodies, damping)
}

fn draw_body(spec: &RobotSpec, nominal: &RigidBody, draws: &mut Draws) -> RigidBody {
    let body = RigidBody {
        mass: nominal.mass * draws.factor(spec.mass_fraction),
        com: nominal.com.map(|coordinate| coordinate * draws.factor(spec.com_fraction)),
        inertia: nominal.inertia,
    };
    match spec.inertia_scheme {
        InertiaScheme::PseudoInertia => stretched(&body, spec.inertia_fraction, draws),
        InertiaScheme::PerEntry => per_entry(&body, spec.inertia_fraction, draws),
    }
}

/// Σ → A Σ Aᵀ with A = diag(√U(1 ± p)): stretches the body along its axes, so that diagonal
/// second moments vary by ±p and the result is always physical (Sylvester's law of inertia).
fn stretched(body: &RigidBody, fraction: f64, draws: &mut Draws) -> RigidBody {
    let mut stretch = || draws.factor(fraction).sqrt();
    let stretches = Matrix3::from_diagonal(&[stretch(), stretch(), stretch()].into());
    body.with_second_moments(&(stretches * body.second_moments() * stretches))
}

/// Every one of the nine entries on its own, symmetrized and projected: the paper's scheme, made
/// physical (as published, some draws have no body).
fn per_entry(body: &RigidBody, fraction: f64, draws: &mut Draws) -> RigidBody {
    let drawn = body.inertia.map(|row| row.map(|entry| entry * draws.factor(fraction)));
    let inertia = std::array::from_fn(|row| {
        std::array::from_fn(|column| 0.5 * (drawn[row][column] + drawn[column][row]))
    });
    RigidBody { inertia, ..*body }.projected()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::random::Purpose;

    fn bodies_of_a_draw(spec: &RobotSpec, seed: u64) -> Vec<RigidBody> {
        let mut draws = Draws::new(seed, 0, Purpose::Robot, 1);
        let mut bodies = Bodies::nominal();
        bodies.each_mut().map(|body| draw_body(spec, body, &mut draws)).collect()
    }

    proptest! {
        #[test]
        fn every_draw_is_physical_and_within_its_fractions(
            seed: u64,
            fraction in 0.0..0.5f64,
            per_entry: bool,
        ) {
            let spec = RobotSpec {
                mass_fraction: fraction,
                com_fraction: fraction,
                inertia_fraction: fraction,
                damping_fraction: fraction,
                inertia_scheme: if per_entry { InertiaScheme::PerEntry } else { InertiaScheme::PseudoInertia },
                ..RobotSpec::default()
            };
            let within = |value: f64, nominal: f64| {
                (value - nominal).abs() <= nominal.abs() * fraction * (1.0 + 1e-12) + 1e-15
            };
            let mut nominal = Bodies::nominal();
            for (body, nominal) in bodies_of_a_draw(&spec, seed).iter().zip(nominal.each_mut()) {
                // Rounding of a thin body's tensor may cost the last bits of its smallest moment.
                let slack = 1e-12 * body.second_moments().trace();
                prop_assert!(body.second_moments().symmetric_eigenvalues().min() >= -slack);
                prop_assert!(within(body.mass, nominal.mass));
                for axis in 0..3 {
                    prop_assert!(within(body.com[axis], nominal.com[axis]));
                    if !per_entry {
                        let (drawn, nominal) = (body.second_moments(), nominal.second_moments());
                        prop_assert!(within(drawn[(axis, axis)], nominal[(axis, axis)]));
                    }
                }
            }
            let robot = draw_robot(&spec, &mut Draws::new(seed, 0, Purpose::Robot, 1));
            prop_assert!(robot.links.iter().all(RigidBody::is_physical));
            prop_assert!(robot.damping.iter().all(|&damping| within(damping, 10.0)));
        }
    }

    #[test]
    fn without_fractions_every_robot_is_the_nominal_one() {
        let spec = RobotSpec {
            mass_fraction: 0.0,
            com_fraction: 0.0,
            inertia_fraction: 0.0,
            damping_fraction: 0.0,
            ..RobotSpec::default()
        };
        let robot = draw_robot(&spec, &mut Draws::new(7, 0, Purpose::Robot, 1));
        for (drawn, nominal) in robot.links.iter().zip(Robot::nominal(&spec).links) {
            assert_eq!((drawn.mass, drawn.com), (nominal.mass, nominal.com));
            for (drawn, nominal) in
                drawn.inertia.as_flattened().iter().zip(nominal.inertia.as_flattened())
            {
                assert!((drawn - nominal).abs() < 1e-16);
            }
        }
    }
}
