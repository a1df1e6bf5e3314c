//! Draws robots around the nominal one.

use spec::{InertiaScheme, RobotSpec};

use crate::draws::{Draws, Purpose};
use crate::robot::{Hand, Nominal, Parts};
use crate::{Friction, Joints, Kinematics, Payload, RigidBody, Robot};

/// Draws one robot. `draws` has the sequence of random numbers of each purpose.
///
/// Bodies are drawn before the hand is welded to the last link, as in the paper's simulator, which
/// randomizes each body of the articulation. Quantities that the paper does not draw have a
/// sequence of their own, so that they leave everything else of every robot as it was.
pub(crate) fn draw_robot(
    spec: &RobotSpec,
    nominal: &Nominal,
    draws: impl Fn(Purpose) -> Draws,
) -> Robot {
    let mut body_draws = draws(Purpose::Robot);
    let links = nominal.links.map(|link| draw_body(spec, &link, &mut body_draws));
    let mut hand = Hand::default();
    for (body, position_m) in &nominal.attached {
        hand = hand.with(&draw_body(spec, body, &mut body_draws), *position_m);
    }
    let damping = Joints::from(spec.damping_nm_s_rad.as_slice())
        .map(|nominal| nominal * body_draws.factor(spec.damping_fraction));

    let armature = scaled(&spec.armature_kg_m2, spec.armature_fraction, &draws, Purpose::Armature);
    let kinematics = match spec.geometry_fraction {
        0.0 => nominal.kinematics,
        fraction => draw_kinematics(&nominal.kinematics, fraction, &mut draws(Purpose::Geometry)),
    };
    let friction = spec.friction.as_ref().map(|friction| Friction {
        phi1_nm: scaled(&friction.phi1_nm, friction.phi1_fraction, &draws, Purpose::Friction),
        ..Friction::nominal(friction)
    });
    let payload =
        spec.payload.as_ref().map(|payload| draw_payload(payload, &mut draws(Purpose::Payload)));
    Parts { links, hand, damping, armature, kinematics, friction, payload }.assembled(spec.gravity)
}

/// Multiplies each value by a factor of its own.
fn scaled(
    nominal: &[f64],
    fraction: f64,
    draws: impl Fn(Purpose) -> Draws,
    purpose: Purpose,
) -> Joints<f64> {
    let nominal = Joints::from(nominal);
    if fraction == 0.0 {
        return nominal;
    }
    let mut draws = draws(purpose);
    nominal.map(|value| value * draws.factor(fraction))
}

/// Multiplies every length that is not zero by a factor of its own.
fn draw_kinematics(nominal: &Kinematics, fraction: f64, draws: &mut Draws) -> Kinematics {
    let mut kinematics = *nominal;
    kinematics.for_each_length(|length| *length *= draws.factor(fraction));
    kinematics
}

fn draw_payload(spec: &spec::Payload, draws: &mut Draws) -> Payload {
    Payload {
        mass_kg: draws.uniform(spec.mass_kg),
        center_m: spec.center_m.map(|range| draws.uniform(range)),
        radius_m: draws.uniform(spec.radius_m),
    }
}

fn draw_body(spec: &RobotSpec, nominal: &RigidBody, draws: &mut Draws) -> RigidBody {
    let body = RigidBody {
        mass: nominal.mass * draws.factor(spec.mass_fraction),
        com: nominal.com.map(|coordinate| coordinate * draws.factor(spec.com_fraction)),
        inertia: nominal.inertia,
    };
    match spec.inertia_scheme {
        InertiaScheme::PseudoInertia => {
            body.stretched(std::array::from_fn(|_| draws.factor(spec.inertia_fraction)))
        }
        InertiaScheme::PerEntry => per_entry(&body, spec.inertia_fraction, draws),
    }
}

/// The paper's scheme, made physical: every one of the nine entries is drawn on its own, then the
/// tensor is symmetrized and projected. As published, some draws belong to no physical body.
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

    use spec::Range;

    use super::*;

    fn draw(spec: &RobotSpec, seed: u64) -> Robot {
        draw_robot(spec, &Nominal::of(spec.description()), |purpose| {
            Draws::new(seed, 0, purpose, 1)
        })
    }

    fn bodies_of_a_draw(spec: &RobotSpec, seed: u64) -> Vec<RigidBody> {
        let mut draws = Draws::new(seed, 0, Purpose::Robot, 1);
        nominal_bodies().iter().map(|body| draw_body(spec, body, &mut draws)).collect()
    }

    fn nominal_bodies() -> Vec<RigidBody> {
        let nominal = Nominal::of(RobotSpec::default().description());
        let attached = nominal.attached.iter().map(|(body, _)| *body);
        nominal.links.iter().copied().chain(attached).collect()
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
            for (body, nominal) in bodies_of_a_draw(&spec, seed).iter().zip(nominal_bodies()) {
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
            let robot = draw(&spec, seed);
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
        let robot = draw(&spec, 7);
        for (drawn, nominal) in robot.links.iter().zip(&Robot::nominal(&spec).links) {
            assert_eq!((drawn.mass, drawn.com), (nominal.mass, nominal.com));
            for (drawn, nominal) in
                drawn.inertia.as_flattened().iter().zip(nominal.inertia.as_flattened())
            {
                assert!((drawn - nominal).abs() < 1e-16);
            }
        }
    }

    #[test]
    fn asking_for_more_leaves_the_rest_of_every_robot_as_it_was() {
        let paper = RobotSpec::default();
        let payload = spec::Payload {
            mass_kg: Range::new(0.5, 2.0),
            center_m: [Range::new(-0.01, 0.01), Range::new(-0.01, 0.01), Range::new(0.1, 0.12)],
            radius_m: Range::new(0.02, 0.05),
        };
        let more = RobotSpec {
            armature_fraction: 0.2,
            geometry_fraction: 0.1,
            friction: Some(spec::Friction::default()),
            payload: Some(payload),
            ..RobotSpec::default()
        };
        let only_payload = RobotSpec { payload: more.payload.clone(), ..RobotSpec::default() };
        for seed in 0..50 {
            let (plain, all) = (draw(&paper, seed), draw(&more, seed));
            assert_eq!(plain.links[..6], all.links[..6]);
            assert_eq!(plain.damping, all.damping);
            assert_eq!(plain.armature, Joints::splat(7, 0.01));
            assert_eq!(plain.kinematics, Robot::panda().kinematics);
            assert_eq!((&plain.friction, plain.payload), (&None, None));

            assert_eq!(draw(&only_payload, seed).payload, all.payload);
            let held = all.payload.unwrap();
            assert!((0.5..2.0).contains(&held.mass_kg));
            assert!((0.1..0.12).contains(&held.center_m[2]));
            assert!((all.links[6].mass - plain.links[6].mass - held.mass_kg).abs() < 1e-12);

            let friction = all.friction.unwrap();
            let nominal = spec::Friction::default();
            assert_eq!(*friction.phi2_s_rad, *nominal.phi2_s_rad);
            for (phi1, nominal) in friction.phi1_nm.iter().zip(&nominal.phi1_nm) {
                assert!((phi1 / nominal - 1.0).abs() <= 0.1 && phi1 != nominal);
            }
            assert!(all.armature.iter().all(|a| (a / 0.01 - 1.0).abs() <= 0.2 && *a != 0.01));
        }
    }

    #[test]
    fn every_length_is_drawn_on_its_own_and_zeros_stay() {
        let spec = RobotSpec { geometry_fraction: 0.1, ..RobotSpec::default() };
        let kinematics = draw(&spec, 3).kinematics;
        let lengths = |k: Kinematics| -> Vec<f64> {
            k.joints.iter().chain([&k.hand]).flat_map(|row| [row.a_m, row.d_m]).collect()
        };
        let mut factors = Vec::new();
        for (drawn, nominal) in
            lengths(kinematics).into_iter().zip(lengths(Robot::panda().kinematics))
        {
            if nominal == 0.0 {
                assert_eq!(drawn, 0.0);
            } else {
                factors.push(drawn / nominal);
            }
        }
        assert_eq!(factors.len(), 7);
        assert!(factors.iter().all(|factor| (factor - 1.0).abs() <= 0.1));
        factors.sort_by(f64::total_cmp);
        assert!(factors.windows(2).all(|pair| pair[1] - pair[0] > 1e-6));
    }

    #[test]
    fn a_payload_hangs_in_the_frame_of_the_hand_of_this_very_robot() {
        let fixed = |value: f64| Range::new(value, value);
        let payload = spec::Payload {
            mass_kg: fixed(1.5),
            center_m: [fixed(0.02), fixed(-0.01), fixed(0.1034)],
            radius_m: fixed(0.05),
        };
        let spec = RobotSpec { geometry_fraction: 0.3, ..RobotSpec::default() };
        let loaded = RobotSpec { payload: Some(payload), ..spec.clone() };
        let (bare, loaded) = (draw(&spec, 5), draw(&loaded, 5));
        // The hand is turned by −45° about the flange's axis.
        let (c, s) = (std::f64::consts::FRAC_1_SQRT_2, -std::f64::consts::FRAC_1_SQRT_2);
        let center =
            [c * 0.02 - s * -0.01, s * 0.02 + c * -0.01, loaded.kinematics.hand.d_m + 0.1034];
        for axis in 0..3 {
            let moment = |robot: &Robot| robot.links[6].mass * robot.links[6].com[axis];
            let added = moment(&loaded) - moment(&bare);
            assert!((added - 1.5 * center[axis]).abs() < 1e-15, "axis {axis}");
        }
        // A solid sphere has 2/5 m r² about any axis through its centre, and m d² more about an
        // axis at distance d.
        let about_z = |robot: &Robot| robot.links[6].inertia_about_origin()[5];
        let distance_squared = center[0] * center[0] + center[1] * center[1];
        let expected = 1.5 * (0.4 * 0.05 * 0.05 + distance_squared);
        assert!((about_z(&loaded) - about_z(&bare) - expected).abs() < 1e-15);
    }
}
