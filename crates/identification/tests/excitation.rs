//! Exciting motions of generated arms and of a Panda.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};

use dynamics::{RigidBody, Robot, bias_forces, mass_matrix};
use identification::{
    Excitation, ExcitationError, ExcitationSettings, MotionState, Recording, Settings, identify,
};
use random::{ChaCha8Rng, keyed, normal, unit};
use spec::{Gravity, JointFriction, Range, RobotDescription, RobotModel, RobotSpec};

/// The first joints of a Panda with other masses, lengths, limits and friction.
fn generated(joints: usize, seed: u64) -> RobotDescription {
    let mut generator = keyed::<ChaCha8Rng>([seed, joints as u64, 0, 0]);
    let mut description = RobotModel::panda().description().clone();
    description.joints.truncate(joints);
    description.initial_state.center_rad.truncate(joints);
    for joint in &mut description.joints {
        let mut factor = |deviation: f64| (deviation * normal(&mut generator)).exp();
        joint.link.mass_kg *= factor(0.2);
        joint.d_m *= factor(0.2);
        joint.velocity_rad_s *= factor(0.4);
        joint.torque_nm *= factor(0.2);
        joint.damping_nm_s_rad = 0.01 * joint.torque_nm * factor(0.5);
        joint.armature_kg_m2 = 0.3 * factor(0.3);
        let phi1_nm = 0.03 * joint.torque_nm * factor(0.5);
        joint.friction = Some(JointFriction { phi1_nm, phi2_s_rad: 50.0, phi3_rad_s: 0.0 });
        let (low, high) = (unit(&mut generator), unit(&mut generator));
        joint.position_rad = Range::new(-0.5 - 2.0 * low, 0.5 + 2.0 * high);
    }
    description
}

/// A search that nobody follows.
fn excite(
    description: &RobotDescription,
    settings: &ExcitationSettings,
) -> Result<Excitation, ExcitationError> {
    identification::excite(description, settings, &|_| ControlFlow::Continue(()))
}

/// A short search.
fn quick() -> ExcitationSettings {
    ExcitationSettings {
        seconds: 10.0,
        harmonics: Some(5),
        random_motions: 16,
        ..ExcitationSettings::default()
    }
}

/// Checks limits and rest at `times` times.
fn check_limits(
    description: &RobotDescription,
    settings: &ExcitationSettings,
    found: &Excitation,
    times: u32,
) {
    let kept = 1.0 - settings.margin;
    let kinematics = robot(description).kinematics;
    for time in 0..times {
        let state = found.motion.at(settings.seconds * f64::from(time) / f64::from(times));
        let torques = found.torques(&state);
        for (index, joint) in description.joints.iter().enumerate() {
            let range = joint.position_rad;
            let half = 0.5 * (range.max - range.min);
            let from_middle = state.q[index] - 0.5 * (range.max + range.min);
            assert!(from_middle.abs() <= kept * half, "{time} {index}");
            assert!(state.qd[index].abs() <= kept * joint.velocity_rad_s, "{time} {index}");
            let limit = settings
                .accelerations_rad_s2
                .as_ref()
                .map_or(2.0 * joint.velocity_rad_s, |limits| limits[index]);
            assert!(state.qdd[index].abs() <= kept * limit, "{time} {index}");
            assert!(torques[index].abs() <= kept * joint.torque_nm, "{time} {index}");
        }
        if let Some(table_z_m) = settings.table_z_m {
            let [_, _, hand_m] = kinematics.end_effector_pose(state.q).position_m;
            assert!(hand_m >= table_z_m + settings.clearance_m, "{time}: {hand_m}");
        }
    }
    for time_s in [0.0, settings.seconds] {
        let MotionState { qd, qdd, .. } = found.motion.at(time_s);
        assert!(qd.iter().chain(&qdd).all(|value| value.abs() < 1e-9), "{qd:?} {qdd:?}");
    }
    let lowest_m = found.report.lowest_m;
    assert_eq!(lowest_m.is_some(), settings.table_z_m.is_some());
    assert!(
        settings
            .table_z_m
            .is_none_or(|table_z_m| lowest_m.unwrap() >= table_z_m + settings.clearance_m)
    );
}

fn robot(description: &RobotDescription) -> Robot {
    let model = RobotModel::Described(Box::new(description.clone()));
    Robot::nominal(&RobotSpec { gravity: Gravity::On, ..RobotSpec::of(model) })
}

#[test]
fn generated_arms_keep_their_limits_on_a_fine_grid_and_see_more_than_random_motions() {
    for (joints, seed, table_z_m) in [(2, 2, None), (3, 3, Some(0.1)), (4, 4, Some(-0.2))] {
        let description = generated(joints, seed);
        let accelerations_rad_s2 = (joints == 3).then(|| vec![2.0, 3.0, 4.0]);
        let settings = ExcitationSettings { table_z_m, accelerations_rad_s2, ..quick() };
        let found = excite(&description, &settings).unwrap();
        check_limits(&description, &settings, &found, 9973);
        let random = &found.report.random;
        assert_eq!(random.count, 16);
        assert!(found.report.log_det > random.best_log_det + 1.0, "{joints}: {:?}", found.report);
        assert!(random.best_log_det >= random.median_log_det);
        assert!(random.deviation_to_best.unwrap() < 0.95, "{joints}: {random:?}");
        assert!(random.deviation_to_median.unwrap() < 0.9, "{joints}: {random:?}");
    }
}

#[test]
fn the_same_arm_gives_the_same_bits_on_any_number_of_threads() {
    let on_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| excite(&generated(3, 5), &quick()).unwrap())
    };
    assert_eq!(on_threads(1), on_threads(3));
}

/// Gaz et al. 2019 count 43 base parameters of the Panda's links; the rotors of the first two joints
/// act as the inertias of their links, and all other numbers of joints are seen.
#[test]
fn a_panda_has_as_many_base_parameters_as_are_published_and_keeps_its_limits() {
    let description = RobotModel::panda().description().clone();
    let settings = ExcitationSettings { table_z_m: Some(0.0), ..quick() };
    let found = excite(&description, &settings).unwrap();
    assert_eq!(found.report.base_parameters, 43 + 4 * 7 + 5);
    assert_eq!(found.report.unknown_numbers, 7 * 15);
    check_limits(&description, &settings, &found, 9973);
    let report = &found.report;
    assert!(report.log_det > report.random.best_log_det + 10.0, "{:?}", report.random);
}

#[test]
fn noise_of_any_size_gives_a_motion() {
    let description = generated(2, 6);
    let with_noise = |noise_nm: f64| {
        let settings = ExcitationSettings { noise_nm: Some(vec![noise_nm; 2]), ..quick() };
        let found = excite(&description, &settings).unwrap();
        check_limits(&description, &settings, &found, 997);
        found.report
    };
    let loud = with_noise(1e5);
    assert!(loud.parameters.iter().all(|parameter| parameter.seen.is_none_or(|seen| seen < 0.1)));
    assert_eq!(loud.random.deviation_to_best, None);
    let silent = with_noise(1e-6);
    assert!(silent.log_det > loud.log_det + 100.0, "{} {}", silent.log_det, loud.log_det);
    let all = silent.parameters.iter().chain(&loud.parameters);
    assert!(all.into_iter().all(|parameter| parameter.deviation.is_finite()));
}

/// An arm that differs from `described` as a real one may: 10 % in masses, 20 % in moments of
/// inertia, 30 % in friction and rotors, some centimetres in centres of mass.
fn drawn(described: &RobotDescription, seed: u64) -> RobotDescription {
    let mut generator = keyed::<ChaCha8Rng>([seed, 8, 0, 0]);
    let mut drawn = described.clone();
    for joint in &mut drawn.joints {
        let mut factor = |deviation: f64| (deviation * normal(&mut generator)).exp();
        joint.link.mass_kg *= factor(0.1);
        let stretch = factor(0.2);
        joint.link.inertia_kg_m2 = joint.link.inertia_kg_m2.map(|entry| entry * stretch);
        joint.damping_nm_s_rad *= factor(0.3);
        joint.armature_kg_m2 *= factor(0.3);
        let friction = joint.friction.as_mut().unwrap();
        friction.phi1_nm *= factor(0.3);
        friction.phi2_s_rad *= factor(0.3);
        for coordinate in &mut joint.link.center_m {
            *coordinate += 0.03 * normal(&mut generator);
        }
    }
    drawn
}

/// The parameters of a joint as a report orders them.
fn truth(description: &RobotDescription, joint: usize) -> [f64; 16] {
    let robot = robot(description);
    let RigidBody { mass, com: [x, y, z], inertia: [[xx, xy, xz], [_, yy, yz], [_, _, zz]] } =
        robot.links[joint];
    let friction = description.joints[joint].friction.unwrap();
    let (coulomb, bend) = (0.5 * friction.phi1_nm, 2.0 / friction.phi2_s_rad);
    let (viscous, rotor) = (robot.damping[joint], robot.armature[joint]);
    [mass, x, y, z, xx, xy, xz, yy, yz, zz, coulomb, viscous, 0.0, rotor, 1.0, bend]
}

fn torques(description: &RobotDescription, robot: &Robot, state: &MotionState) -> Vec<f64> {
    let MotionState { q, qd, qdd } = *state;
    let (mass, bias) = (mass_matrix(robot, q), bias_forces(robot, q, qd));
    let torque = |joint: usize| {
        let of_mass: f64 = mass[joint].iter().zip(&qdd).map(|(mass, qdd)| mass * qdd).sum();
        let friction = description.joints[joint].friction.unwrap();
        let coulomb = 0.5 * friction.phi1_nm * (0.5 * friction.phi2_s_rad * qd[joint]).tanh();
        of_mass + bias[joint] + robot.damping[joint] * qd[joint] + coulomb
    };
    (0..robot.joints()).map(torque).collect()
}

/// Arms that are not as described move along one motion. Their identified parameters are off by the
/// standard deviations that were predicted before any of them had moved.
#[test]
fn identified_arms_are_off_by_what_was_predicted() {
    const ARMS: u64 = 60;
    const RATE_HZ: u32 = 125;
    const SENSOR_NM: f64 = 0.3;

    let described = generated(3, 7);
    // White noise at 125 Hz is worth less per sample than at the 25 Hz of the prediction.
    let noise_nm = SENSOR_NM * (25.0 / f64::from(RATE_HZ)).sqrt();
    let settings = ExcitationSettings { noise_nm: Some(vec![noise_nm; 3]), ..quick() };
    let excitation = excite(&described, &settings).unwrap();
    let predicted = &excitation.report.parameters;
    let states: Vec<MotionState> = (0..10 * RATE_HZ)
        .map(|sample| excitation.motion.at(f64::from(sample) / f64::from(RATE_HZ)))
        .collect();
    let (mut squares, mut reported) = (vec![0.0; predicted.len()], Vec::new());
    for seed in 0..ARMS {
        let arm = drawn(&described, seed);
        let robot = robot(&arm);
        let mut generator = keyed::<ChaCha8Rng>([seed, 9, 0, 0]);
        let mut noisy = |state: &MotionState| -> Vec<f64> {
            let torques = torques(&arm, &robot, state);
            torques.iter().map(|u| u + SENSOR_NM * normal(&mut generator)).collect()
        };
        let recording = Recording {
            name: format!("{seed}"),
            rate_hz: f64::from(RATE_HZ),
            q: states.iter().map(|state| state.q.to_vec()).collect(),
            u: states.iter().map(&mut noisy).collect(),
        };
        let settings = Settings { motion_steps: 0, ..Settings::default() };
        let unheard = &mut || ControlFlow::Continue(());
        let found = identify(&described, &[recording], &[], &settings, unheard).unwrap();
        for (k, estimate) in found.report.parameters.iter().enumerate() {
            let truth = truth(&arm, k / 16)[k % 16];
            if predicted[k].seen.is_some() {
                squares[k] += ((estimate.value - truth) / predicted[k].deviation).powi(2);
                reported.push(estimate.deviation / predicted[k].deviation);
            }
        }
    }
    let seen = |k: &usize| predicted[*k].seen.is_some_and(|seen| seen > 0.9);
    let errors: Vec<f64> =
        (0..squares.len()).filter(seen).map(|k| (squares[k] / ARMS as f64).sqrt()).collect();
    for (k, error) in (0..squares.len()).filter(seen).zip(&errors) {
        println!("{} {} {error:.3}", predicted[k].joint, predicted[k].name);
        assert!((0.3..2.5).contains(error), "{:?}: {error}", predicted[k]);
    }
    println!("{errors:?} {}", series::median(reported.clone()));
    assert!(errors.len() >= 12, "{errors:?}");
    let median_error = series::median(errors);
    assert!((0.75..1.35).contains(&median_error), "{median_error}");
    let median_reported = series::median(reported);
    assert!((0.8..1.25).contains(&median_reported), "{median_reported}");
}

#[test]
fn what_leaves_no_room_is_refused_with_its_value_and_what_is_allowed() {
    let description = generated(3, 1);
    let refused =
        |settings: ExcitationSettings| excite(&description, &settings).unwrap_err().to_string();
    let short = refused(ExcitationSettings { seconds: 2.0, ..quick() });
    assert_eq!(short, "--seconds is 2, allowed: 5 to 600 s");
    let nan = refused(ExcitationSettings { seconds: f64::NAN, ..quick() });
    assert_eq!(nan, "--seconds is NaN, allowed: 5 to 600 s");
    let uneven = refused(ExcitationSettings { base_frequency_hz: Some(0.13), ..quick() });
    assert!(uneven.starts_with(
        "--base-frequency is 0.13, allowed: a whole number of periods in 10 s, such as 0.1 Hz"
    ));
    let few = refused(ExcitationSettings { harmonics: Some(1), ..quick() });
    assert_eq!(few, "--harmonics is 1, allowed: 2 to 30");
    let margin = refused(ExcitationSettings { margin: 1.0, ..quick() });
    assert_eq!(margin, "--margin is 1, allowed: 0 to 0.9");
    let list = refused(ExcitationSettings { noise_nm: Some(vec![0.1; 2]), ..quick() });
    assert_eq!(list, "--noise-nm has 2 numbers, allowed: 3, one per joint");
    let zero =
        refused(ExcitationSettings { accelerations_rad_s2: Some(vec![1.0, 0.0, 1.0]), ..quick() });
    assert_eq!(zero, "--accelerations of joint 2 is 0, allowed: 0.000001 to 100000");
    let table = refused(ExcitationSettings { table_z_m: Some(5.0), ..quick() });
    assert!(
        table.starts_with("--table-z is 5 m, allowed with a clearance of 0.1 m: below "),
        "{table}"
    );

    let changed = |change: &dyn Fn(&mut RobotDescription)| {
        let mut description = generated(3, 1);
        change(&mut description);
        excite(&description, &quick()).unwrap_err()
    };
    let still = changed(&|arm| arm.joints[2].position_rad = Range::new(0.3, 0.301));
    assert!(
        matches!(&still, ExcitationError::Room { index: 2, .. })
            && still
                .to_string()
                .starts_with("joints[2].position_rad (panda_joint3) leaves 0.001 rad"),
        "{still}"
    );
    let weak = changed(&|arm| arm.joints[1].torque_nm = 2.0);
    assert!(
        matches!(
            weak,
            ExcitationError::Hold { index: 1, .. } | ExcitationError::Friction { index: 1, .. }
        ),
        "{weak}"
    );
    let stuck = changed(&|arm| {
        arm.joints[0].friction =
            Some(JointFriction { phi1_nm: 500.0, phi2_s_rad: 50.0, phi3_rad_s: 0.0 });
    });
    assert!(matches!(stuck, ExcitationError::Friction { index: 0, .. }), "{stuck}");
    let impossible =
        changed(&|arm| arm.joints[0].link.inertia_kg_m2 = [1.0, 0.0, 0.0, 0.1, 0.0, 0.1]);
    assert!(matches!(impossible, ExcitationError::Arm(_)), "{impossible}");
}

#[test]
fn a_search_tells_its_steps_and_ends_on_request() {
    let done = AtomicU64::new(0);
    let hear = |count: u64| {
        done.fetch_add(count, Ordering::Relaxed);
        ControlFlow::Continue(())
    };
    let found = identification::excite(&generated(2, 3), &quick(), &hear).unwrap();
    let done = done.into_inner();
    assert!(done <= quick().steps(), "{done} of {}", quick().steps());
    assert!(done > quick().steps() / 2, "{done} of {}", quick().steps());
    assert_eq!(found.motion, excite(&generated(2, 3), &quick()).unwrap().motion);

    let seen = AtomicU64::new(0);
    let stop = |_| match seen.fetch_add(1, Ordering::Relaxed) {
        0..20 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let stopped = identification::excite(&generated(2, 3), &quick(), &stop);
    assert!(matches!(stopped, Err(ExcitationError::Stopped)), "{stopped:?}");
}
