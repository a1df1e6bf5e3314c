//! Recordings of arms whose parameters are known.
//!
//! A log is made without a simulator: a Fourier motion, and the torques that it needs by the
//! regressor of the equation of motion, with the noise of sensors.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::ops::ControlFlow;

use dynamics::{Joints, LINK_PARAMETERS, Robot, torque_regressor};
use identification::{
    Identification, IdentificationError, Progress, Recording, Settings, identify, identify_load,
};
use nalgebra::{Matrix3, Vector3};
use random::{keyed, normal, unit};
use spec::{Gravity, JointFriction, RobotDescription, RobotModel, RobotSpec};

const RATE_HZ: u32 = 125;

/// A search that nobody follows.
fn unheard() -> Progress<'static> {
    Box::leak(Box::new(|| ControlFlow::Continue(())))
}

/// The first three joints of a Panda, with the friction and rotors of a real arm.
fn described() -> RobotDescription {
    let mut description = RobotModel::panda().description().clone();
    description.joints.truncate(3);
    description.initial_state.center_rad.truncate(3);
    for (joint, (coulomb, viscous, rotor)) in
        description.joints.iter_mut().zip([(1.0, 2.0, 0.6), (1.5, 3.0, 0.8), (0.8, 1.5, 0.3)])
    {
        joint.damping_nm_s_rad = viscous;
        joint.armature_kg_m2 = rotor;
        joint.friction =
            Some(JointFriction { phi1_nm: 2.0 * coulomb, phi2_s_rad: 50.0, phi3_rad_s: 0.0 });
    }
    description
}

/// An arm that differs from `described`: 10 % in masses, 30 % in moments of inertia and friction, 50 %
/// in the bends of Coulomb friction, 4 cm in centres of mass.
fn drawn(described: &RobotDescription, seed: u64) -> RobotDescription {
    let mut generator = keyed::<rand_chacha::ChaCha8Rng>([seed, 0, 0, 0]);
    let mut drawn = described.clone();
    for joint in &mut drawn.joints {
        let mut factor = |deviation: f64| (deviation * normal(&mut generator)).exp();
        joint.link.mass_kg *= factor(0.1);
        let stretch = factor(0.3);
        joint.link.inertia_kg_m2 = joint.link.inertia_kg_m2.map(|entry| entry * stretch);
        joint.damping_nm_s_rad *= factor(0.3);
        joint.armature_kg_m2 *= factor(0.3);
        if let Some(friction) = &mut joint.friction {
            friction.phi1_nm *= factor(0.3);
            friction.phi2_s_rad *= factor(0.5);
        }
        for coordinate in &mut joint.link.center_m {
            *coordinate += 0.04 * normal(&mut generator);
        }
    }
    drawn
}

fn robot(description: &RobotDescription) -> Robot {
    let model = RobotModel::Described(Box::new(description.clone()));
    Robot::nominal(&RobotSpec { gravity: Gravity::On, ..RobotSpec::of(model) })
}

/// A log of `seconds` of an arm, with a load in its hand: mass (kg) and centre (m).
fn log(
    description: &RobotDescription,
    load: Option<(f64, [f64; 3])>,
    seconds: u32,
    seed: u64,
) -> Recording {
    const HARMONICS: usize = 6;
    const BASE_HZ: f64 = 0.1;
    const ENCODER_RAD: f64 = 2e-5;
    const SENSOR_NM: f64 = 0.1;

    let mut generator = keyed::<rand_chacha::ChaCha8Rng>([seed, 1, 0, 0]);
    let robot = robot(description);
    let joints = robot.joints();
    let mut links: Vec<[f64; LINK_PARAMETERS]> =
        robot.links.iter().map(dynamics::RigidBody::parameters).collect();
    if let Some((mass, center)) = load {
        let hand = robot.kinematics.hand;
        let center = hand.turn(0.0) * Vector3::from(center) + Vector3::from(hand.origin());
        let about_origin =
            (Matrix3::identity() * center.norm_squared() - center * center.transpose()) * mass
                + Matrix3::identity() * (0.4 * mass * 0.05 * 0.05);
        let [x, y, z] = (center * mass).into();
        let i = about_origin;
        let added = [mass, x, y, z, i.m11, i.m12, i.m13, i.m22, i.m23, i.m33];
        for (value, added) in links[joints - 1].iter_mut().zip(added) {
            *value += added;
        }
    }
    let waves: Vec<Vec<(f64, f64)>> = (0..joints)
        .map(|_| {
            let wave = |n: usize| {
                let amplitude = 0.5 / n as f64 * (0.5 + unit(&mut generator));
                (amplitude, std::f64::consts::TAU * unit(&mut generator))
            };
            (1..=HARMONICS).map(wave).collect()
        })
        .collect();
    let mut recording = Recording {
        name: format!("{seed}"),
        rate_hz: RATE_HZ.into(),
        q: Vec::new(),
        u: Vec::new(),
    };
    let friction = robot.friction.clone();
    for sample in 0..seconds * RATE_HZ {
        let t = f64::from(sample) / f64::from(RATE_HZ);
        let derivative = |order: i32| {
            Joints::from_fn(joints, |joint| {
                (1..).zip(&waves[joint]).fold(0.0, |sum, (n, (amplitude, phase))| {
                    let w = std::f64::consts::TAU * BASE_HZ * f64::from(n);
                    let turned = w * t + phase + f64::from(order) * std::f64::consts::FRAC_PI_2;
                    sum + amplitude * w.powi(order) * turned.sin()
                })
            })
        };
        let [q, qd, qdd] = [0, 1, 2].map(derivative);
        let mut regressor = vec![0.0; joints * joints * LINK_PARAMETERS];
        torque_regressor(&robot.kinematics, robot.gravity, &q, &qd, &qdd, &mut regressor);
        let parameters: Vec<f64> = links.iter().flatten().copied().collect();
        let torque = |joint: usize| {
            let row = &regressor[joint * parameters.len()..][..parameters.len()];
            let of_links: f64 = row.iter().zip(&parameters).map(|(y, value)| y * value).sum();
            let described = description.joints[joint].friction.unwrap();
            let coulomb = 0.5 * described.phi1_nm * (0.5 * described.phi2_s_rad * qd[joint]).tanh();
            of_links
                + robot.armature[joint] * qdd[joint]
                + robot.damping[joint] * qd[joint]
                + coulomb
        };
        assert!(friction.is_none());
        let u: Vec<f64> =
            (0..joints).map(|j| torque(j) + SENSOR_NM * normal(&mut generator)).collect();
        recording.u.push(u);
        recording.q.push(q.iter().map(|q| q + ENCODER_RAD * normal(&mut generator)).collect());
    }
    recording
}

fn torques_only() -> Settings {
    Settings { motion_steps: 0, ..Settings::default() }
}

/// The truth in the order of a report's parameters.
fn truth(description: &RobotDescription) -> Vec<f64> {
    let robot = robot(description);
    let of = |joint: usize| {
        let body = robot.links[joint];
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = body.inertia;
        let friction = description.joints[joint].friction.unwrap();
        let (coulomb, bend) = (0.5 * friction.phi1_nm, 2.0 / friction.phi2_s_rad);
        let link = [body.mass, body.com[0], body.com[1], body.com[2], xx, xy, xz, yy, yz, zz];
        let own = [coulomb, robot.damping[joint], 0.0, robot.armature[joint], 1.0, bend];
        link.into_iter().chain(own).collect::<Vec<f64>>()
    };
    (0..robot.joints()).flat_map(of).collect()
}

#[test]
fn intervals_contain_the_truth_as_often_as_they_say() {
    const ARMS: u64 = 200;

    let described = described();
    // Most URDFs have no friction, and none has the bends of Coulomb friction.
    let mut without_friction = described.clone();
    for joint in &mut without_friction.joints {
        joint.friction = None;
    }
    let (mut inside, mut all, mut friction) = (0, 0, (0, 0));
    for seed in 0..ARMS {
        let arm = drawn(&described, seed);
        let logs = [log(&arm, None, 20, seed), log(&arm, None, 20, 1000 + seed)];
        let found = identify(&without_friction, &logs, &[], &torques_only(), unheard()).unwrap();
        for (estimate, truth) in found.report.parameters.iter().zip(truth(&arm)) {
            if estimate.seen.is_none_or(|seen| seen < 0.9) {
                continue;
            }
            let is_inside = (estimate.value - truth).abs() <= 1.96 * estimate.deviation;
            all += 1;
            inside += i32::from(is_inside);
            if ["coulomb", "viscous", "bend"].contains(&estimate.name.as_str()) {
                friction.0 += 1;
                friction.1 += i32::from(is_inside);
            }
        }
    }
    let share = f64::from(inside) / f64::from(all);
    let of_friction = f64::from(friction.1) / f64::from(friction.0);
    println!("{inside} of {all}: {share:.3}; of friction {friction:?}: {of_friction:.3}");
    assert!((0.92..=0.98).contains(&share), "{share}");
    assert!((0.92..=0.98).contains(&of_friction), "{of_friction}");
}

fn identified() -> (RobotDescription, RobotDescription, Identification) {
    let described = described();
    let arm = drawn(&described, 7);
    let logs = [log(&arm, None, 20, 7), log(&arm, None, 20, 8)];
    let validation = [log(&arm, None, 15, 9)];
    let settings = Settings::default();
    let found = identify(&described, &logs, &validation, &settings, unheard()).unwrap();
    (described, arm, found)
}

#[test]
fn an_identified_arm_moves_as_the_true_one_and_is_a_description() {
    let (described, _, found) = identified();
    for (joint, residual) in found.report.validation_torques.iter().enumerate() {
        assert!(residual.identified_nm < 0.08, "joint {}: {residual:?}", joint + 1);
        assert!(residual.described_nm > 3.0 * residual.identified_nm);
    }
    let of = |name: &str| {
        let errors = &found.report.validation_errors;
        let errors = errors.iter().find(|errors| errors.predictor == name).unwrap();
        errors.rmse_deg.iter().map(|error| error.unwrap()).collect::<Vec<f64>>()
    };
    for (identified, description) in of("identified").into_iter().zip(of("description")) {
        assert!(identified < 0.2 * description, "{identified} {description}");
    }
    assert!(found.report.warnings.iter().all(|warning| !warning.contains("validation")));
    let description = found.arm.description(&described);
    description.checked().unwrap();
    let robot = robot(&description);
    for (link, expected) in robot.links.iter().zip(&found.arm.robot().links) {
        assert!((link.mass - expected.mass).abs() < 1e-9);
    }
}

#[test]
fn a_report_says_what_the_recordings_determine() {
    let (_, _, found) = identified();
    let directions = found.report.directions;
    // Three joints with fifteen unknown numbers each. The base joint shows hardly more than its
    // inertia about the vertical.
    assert_eq!(directions.unknown, 45);
    assert!((12..36).contains(&directions.determined), "{directions:?}");
    assert!(directions.condition > 3.0 && directions.condition < 1e4, "{directions:?}");
    for pair in &found.report.correlated {
        assert!((0.9..=1.0).contains(&pair.coefficient.abs()) && pair.a != pair.b, "{pair:?}");
    }
}

#[test]
fn curves_show_the_validation_beside_both_arms() {
    let (_, _, found) = identified();
    let curves = &found.curves;
    assert_eq!((curves.torques.len(), curves.positions.len()), (3, 3));
    let rms = |a: &[f64], b: &[f64]| {
        let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
        (squares / a.len() as f64).sqrt()
    };
    for trace in curves.torques.iter().chain(&curves.positions) {
        let of = |values: &[f64]| rms(values, &trace.measured);
        assert!(of(&trace.identified) < 0.5 * of(&trace.described));
        assert_eq!(trace.times_s.len(), trace.measured.len());
    }
    assert!(curves.torques_svg().unwrap().starts_with("<svg"));
    assert!(curves.positions_svg().unwrap().contains("Joint 3"));
    let rows = curves.to_csv().lines().count();
    let points: usize =
        curves.torques.iter().chain(&curves.positions).map(|trace| trace.times_s.len()).sum();
    assert_eq!(rows, points + 1);
}

#[test]
fn a_search_tells_of_its_steps_and_ends_when_it_is_asked_to() {
    let described = described();
    let logs = [log(&drawn(&described, 7), None, 20, 7)];
    let settings = Settings { motion_steps: 2, ..Settings::default() };
    let mut steps = 0;
    let mut count = || {
        steps += 1;
        ControlFlow::Continue(())
    };
    identify(&described, &logs, &[], &settings, &mut count).unwrap();
    assert!((5..=settings.steps()).contains(&steps), "{steps}");
    let mut left = steps - 1;
    let mut stop = || {
        left -= 1;
        if left == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let stopped = identify(&described, &logs, &[], &settings, &mut stop).unwrap_err();
    assert_eq!(stopped, IdentificationError::Stopped);
}

#[test]
fn the_same_recordings_give_the_same_bits() {
    let [(_, _, first), (_, _, second)] = [identified(), identified()];
    assert_eq!(first, second);
}

#[test]
fn a_load_is_found_in_the_hand_of_an_identified_arm() {
    let (described, arm, found) = identified();
    let loaded = [log(&arm, Some((1.5, [0.05, 0.0, 0.1])), 20, 10)];
    let settings = Settings::default();
    let load = identify_load(&described, &found.arm, &loaded, &[], &settings, unheard()).unwrap();
    let of = |name: &str| {
        let parameters = &load.report.parameters;
        parameters.iter().find(|estimate| estimate.name == name).unwrap()
    };
    assert!((of("load_mass").value - 1.5).abs() < 0.1, "{:?}", of("load_mass"));
    assert!((of("load_center_x").value - 0.05).abs() < 0.02, "{:?}", of("load_center_x"));
}

#[test]
fn gains_follow_from_the_described_masses() {
    let described = described();
    let mut recording = log(&described, None, 30, 3);
    for row in &mut recording.u {
        row[1] *= 1.2;
    }
    let settings = Settings { gain_deviation: 0.15, ..torques_only() };
    let found = identify(&described, &[recording], &[], &settings, unheard()).unwrap();
    let gains = found.arm.gains();
    assert!((gains[1] - 1.2).abs() < 0.1, "{gains:?}");
}

/// The recording as if its torques had been written down `lag` and a `share` of a sample later.
fn late(recording: &Recording, lag: usize, share: f64) -> Recording {
    let last = recording.u.len() - 1;
    let row = |k: usize| {
        let now = &recording.u[k.saturating_sub(lag).min(last)];
        let before = &recording.u[k.saturating_sub(lag + 1).min(last)];
        now.iter().zip(before).map(|(now, before)| now + share * (before - now)).collect()
    };
    Recording { u: (0..recording.u.len()).map(row).collect(), ..recording.clone() }
}

#[test]
fn torques_that_are_recorded_late_are_found_to_be() {
    let described = described();
    let settings = Settings { most_delay_s: 0.05, ..torques_only() };
    for (seed, lag, share) in [(3, 0_u32, 0.0), (4, 0, 0.3), (5, 1, 0.5), (6, 4, 0.0)] {
        let recording = log(&drawn(&described, seed), None, 30, seed);
        let recording = late(&recording, lag as usize, share);
        let found = identify(&described, &[recording], &[], &settings, unheard()).unwrap();
        let delay = found.report.parameters.last().unwrap();
        let truth = (f64::from(lag) + share) / f64::from(RATE_HZ);
        println!("{truth}: {delay:?}");
        assert_eq!((delay.name.as_str(), delay.joint), ("delay", None));
        assert!((delay.value - truth).abs() < 3.0 * delay.deviation, "{truth} s: {delay:?}");
        assert!(delay.deviation < 0.001, "{delay:?}");
        assert!(found.report.warnings.iter().all(|warning| !warning.contains("delay")));
    }
    let recording = late(&log(&described, None, 30, 3), 8, 0.0);
    let found = identify(&described, &[recording], &[], &settings, unheard()).unwrap();
    let said = found
        .report
        .warnings
        .iter()
        .any(|warning| warning.contains("the delay of the torques, 50.0 ms"));
    assert!(said, "{:?} {:?}", found.report.warnings, found.report.parameters.last());
}

#[test]
fn joints_whose_friction_bends_at_different_speeds_are_told_apart() {
    const BENDS_RAD_S: [f64; 3] = [0.2, 0.014, 0.055];

    let described = described();
    let mut truth = drawn(&described, 8);
    for (joint, bend) in truth.joints.iter_mut().zip(BENDS_RAD_S) {
        joint.friction.as_mut().unwrap().phi2_s_rad = 2.0 / bend;
    }
    let recording = log(&truth, None, 60, 8);
    let found = identify(&described, &[recording], &[], &torques_only(), unheard()).unwrap();
    let bends = found.report.parameters.iter().filter(|estimate| estimate.name == "bend");
    for (bend, truth) in bends.zip(BENDS_RAD_S) {
        // The low-pass leaves a sharp bend a little wider.
        let most = (3.0 * bend.deviation).max(0.15 * truth);
        assert!((bend.value - truth).abs() < most, "{truth}: {bend:?}");
        assert!(bend.deviation < 0.2 * truth, "{truth}: {bend:?}");
    }
    let found = found.arm.description(&described);
    for (found, truth) in found.joints.iter().zip(&truth.joints) {
        let [found, truth] = [found, truth].map(|joint| joint.friction.unwrap().phi1_nm);
        assert!((found / truth - 1.0).abs() < 0.1, "{found} N·m, {truth} N·m");
    }
}

#[test]
fn recordings_that_say_nothing_are_refused() {
    let described = described();
    let refused = |change: &dyn Fn(&mut Recording)| {
        let mut recording = log(&described, None, 10, 1);
        change(&mut recording);
        identify(&described, &[recording], &[], &torques_only(), unheard()).unwrap_err()
    };
    let still = refused(&|recording| recording.q.iter_mut().for_each(|row| row[2] = 0.3));
    assert!(matches!(still, IdentificationError::Still { joint: 3, .. }), "{still}");
    let way_out =
        "lock a joint that stands still: `torqued robot add ARM.urdf --lock panda_joint3=0.3`";
    assert!(still.to_string().contains(way_out), "{still}");
    let short = refused(&|recording| {
        recording.q.truncate(200);
        recording.u.truncate(200);
    });
    assert!(matches!(short, IdentificationError::Short { .. }), "{short}");
    let uneven = refused(&|recording| recording.u.truncate(1000));
    assert!(matches!(uneven, IdentificationError::Lengths { q: 1250, u: 1000, .. }), "{uneven}");
    let nan = refused(&|recording| recording.u[5][1] = f64::NAN);
    assert!(
        matches!(nan, IdentificationError::NotFinite { column: "u", joint: 2, sample: 5, .. }),
        "{nan}"
    );
    let narrow = refused(&|recording| recording.q.iter_mut().for_each(|row| row.truncate(2)));
    assert!(matches!(narrow, IdentificationError::Joints { found: 2, allowed: 3, .. }), "{narrow}");
    let none = identify(&described, &[], &[], &torques_only(), unheard()).unwrap_err();
    assert_eq!(none, IdentificationError::NoRecordings);
}
