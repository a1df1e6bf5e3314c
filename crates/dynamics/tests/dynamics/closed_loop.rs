//! Arms that follow references under a controller.

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use dynamics::{
    Gains, InstructionSet, Joints, Reference, ReferenceState, Robot, Scenario, bias_forces,
    forward_dynamics, gravity, mass_matrix, simulate_on,
};
use nalgebra::{DMatrix, DVector, Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use spec::{ControlLaw, Precision, RobotSpec, SimulateSpec};

use crate::{JOINTS, failure, run, spec};

const RATE_HZ: f64 = 100.0;

fn fourier() -> Value {
    json!({"fourier": {"frequency_hz": {"fixed": 0.3}}})
}

/// A lightly damped arm with friction and a payload that its controller does not know.
fn light(excitation: &Value, law: &Value, fields: &Value) -> SimulateSpec {
    let mut all = json!({
        "samples": 200, "rate_hz": RATE_HZ,
        "robot": {
            "damping_nm_s_rad": vec![0.5; JOINTS], "damping_fraction": 0.9,
            "armature_kg_m2": vec![0.1; JOINTS],
            "friction": {}, "payload": {"mass_kg": [0, 3]},
        },
        "controller": {"law": law, "delay_periods": [0, 3], "torque_rate_nm_s": 5000},
    });
    let object = all.as_object_mut().unwrap();
    object.extend(fields.as_object().unwrap().clone());
    spec(excitation, &all)
}

fn laws() -> [Value; 5] {
    [
        json!({"joint-pd": {"integral_per_s": [0.0, 0.5]}}),
        json!({"computed-torque": {"integral_per_s": [0.0, 0.5]}}),
        json!({"operational-space": {}}),
        json!({"cartesian-impedance": {}}),
        json!({"operational-space": {"orientation": false}}),
    ]
}

/// Position and orientation of the hand in the world.
fn hand(arm: &Robot, q: &Numbers) -> (Vector3<f64>, Matrix3<f64>) {
    let pose = arm.kinematics.end_effector_pose(*q);
    let turn = UnitQuaternion::from_quaternion(Quaternion::from(pose.quaternion_xyzw));
    (pose.position_m.into(), turn.to_rotation_matrix().into_inner())
}

/// The hand's Jacobian by differences of poses.
fn jacobian(arm: &Robot, q: &Numbers) -> DMatrix<f64> {
    const STEP: f64 = 1e-5;

    let mut jacobian = DMatrix::zeros(6, JOINTS);
    for joint in 0..JOINTS {
        let [before, after] = [-STEP, STEP].map(|step| {
            let mut q = *q;
            q[joint] += step;
            hand(arm, &q)
        });
        let turn = (after.1 * before.1.transpose() - before.1 * after.1.transpose()) / (8.0 * STEP);
        let column = jacobian.column_mut(joint);
        let linear = (after.0 - before.0) / (2.0 * STEP);
        let turn =
            [turn[(2, 1)] - turn[(1, 2)], turn[(0, 2)] - turn[(2, 0)], turn[(1, 0)] - turn[(0, 1)]];
        let values = linear.iter().copied().chain(turn);
        column.into_iter().zip(values).for_each(|(entry, value)| *entry = value);
    }
    jacobian
}

/// Velocity and acceleration of the hand.
fn motion(arm: &Robot, q: &Numbers, qd: &Numbers, qdd: &Numbers) -> [DVector<f64>; 2] {
    const STEP: f64 = 1e-4;

    let moved = |step: f64| Joints::from_fn(JOINTS, |joint| q[joint] + step * qd[joint]);
    let [slower, faster] = [-STEP, STEP].map(|step| jacobian(arm, &moved(step)));
    let vector = |numbers: &Numbers| DVector::from_iterator(JOINTS, numbers.iter().copied());
    let here = jacobian(arm, q);
    [&here * vector(qd), here * vector(qdd) + (faster - slower) / (2.0 * STEP) * vector(qd)]
}

/// The torques of a controller of the hand, from matrices and their inverses.
fn hand_torques(
    law: &ControlLaw,
    gains: &Gains,
    known: &Robot,
    reference: &ReferenceState,
    [q, v]: [&Numbers; 2],
) -> Numbers {
    let dims = gains.kp.len();
    let zero = Joints::splat(JOINTS, 0.0);
    let ([x, axes], [x_r, axes_r]) = (hand_of(known, q), hand_of(known, &reference.r));
    let [speed, bias] = motion(known, q, v, &zero);
    let [speed_r, acceleration_r] = motion(known, &reference.r, &reference.rd, &reference.rdd);
    let turn: Vector3<f64> =
        (0..3).map(|axis| 0.5 * axes.column(axis).cross(&axes_r.column(axis))).sum();
    let error: Vec<f64> =
        (x_r.column(0) - x.column(0)).iter().chain(turn.iter()).copied().collect();
    let pull = DVector::from_fn(dims, |row, _| {
        gains.kp[row] * error[row] + gains.kd[row] * (speed_r[row] - speed[row])
    });
    let jacobian = jacobian(known, q).rows(0, dims).into_owned();
    let (kn, dn) = (gains.kn.unwrap(), gains.dn.unwrap());
    let kept = DVector::from_fn(JOINTS, |joint, _| {
        kn * (reference.r[joint] - q[joint]) + dn * (reference.rd[joint] - v[joint])
    });
    let torques = match law {
        ControlLaw::OperationalSpace(_) => {
            let matrix = mass_matrix(known, *q);
            let matrix = DMatrix::from_fn(JOINTS, JOINTS, |row, column| matrix[row][column]);
            let inverse = matrix.clone().try_inverse().unwrap();
            let lambda = (&jacobian * inverse * jacobian.transpose()).try_inverse().unwrap();
            let kept = kept + DVector::from_iterator(JOINTS, reference.rdd.iter().copied());
            let wanted = pull + acceleration_r.rows(0, dims) - bias.rows(0, dims);
            let force = lambda * (wanted - &jacobian * &kept);
            let forces = bias_forces(known, *q, *v);
            matrix * kept
                + jacobian.transpose() * force
                + DVector::from_iterator(JOINTS, forces.iter().copied())
        }
        _ => {
            let gram = (&jacobian * jacobian.transpose()).try_inverse().unwrap();
            let free = DMatrix::identity(JOINTS, JOINTS) - jacobian.transpose() * gram * &jacobian;
            let weight = gravity(known, *q);
            jacobian.transpose() * pull
                + free * kept
                + DVector::from_iterator(JOINTS, weight.iter().copied())
        }
    };
    torques.iter().copied().collect()
}

/// The hand's position as the first column of a matrix, and its axes as the columns of another.
fn hand_of(arm: &Robot, q: &Numbers) -> [Matrix3<f64>; 2] {
    let (position, axes) = hand(arm, q);
    [Matrix3::from_columns(&[position, Vector3::zeros(), Vector3::zeros()]), axes]
}

/// Positions at each sample and mean torques after it, by an integration and a controller that share
/// nothing with the lanes.
fn simulated_alone(spec: &SimulateSpec, scenario: &Scenario) -> [Vec<[f64; JOINTS]>; 2] {
    const STEPS: usize = 4;

    let controller = spec.controller.as_ref().unwrap();
    let tracking = scenario.excitation.tracking().unwrap();
    let gains = &tracking.gains;
    let known = Robot::nominal(&RobotSpec { payload: None, ..spec.robot.clone() });
    let period = 1.0 / controller.rate_hz;
    let periods = controller.periods(spec.rate_hz);
    let settling = controller.settling_samples(spec.rate_hz);
    let limits = spec.robot.description().per_joint(|joint| joint.torque_nm);
    let ratio = TAU * controller.velocity_cutoff_hz * period;

    let (mut q, mut qd) = (scenario.q0, scenario.qd0);
    let (mut measured, mut velocity) = (q, qd);
    let mut sum = Joints::splat(JOINTS, 0.0);
    let mut commands = vec![gravity(&known, q)];
    let (mut positions, mut torques) = (Vec::new(), Vec::new());
    for sample in 0..settling + spec.samples as usize {
        let start = q;
        let mut impulse = [0.0; JOINTS];
        for of_sample in 0..periods {
            let reference = tracking.reference.at((sample * periods + of_sample) as f64 * period);
            let mut wish = Joints::splat(JOINTS, 0.0);
            for joint in 0..JOINTS {
                let difference = (q[joint] - measured[joint]) / period;
                velocity[joint] += ratio / (1.0 + ratio) * (difference - velocity[joint]);
                if gains.kn.is_some() {
                    continue;
                }
                let error = reference.r[joint] - q[joint];
                sum[joint] += error * period;
                wish[joint] = gains.kp[joint] * error
                    + gains.kd[joint] * (reference.rd[joint] - velocity[joint])
                    + gains.ki[joint] * sum[joint];
            }
            measured = q;
            let mut command = match controller.law {
                ControlLaw::JointPd(_) => {
                    let weight = gravity(&known, q);
                    Joints::from_fn(JOINTS, |joint| wish[joint] + weight[joint])
                }
                ControlLaw::ComputedTorque(_) => {
                    let matrix = mass_matrix(&known, q);
                    let bias = bias_forces(&known, q, velocity);
                    Joints::from_fn(JOINTS, |row| {
                        let inertia = |joint: usize| {
                            matrix[row][joint] * (reference.rdd[joint] + wish[joint])
                        };
                        bias[row] + (0..JOINTS).map(inertia).sum::<f64>()
                    })
                }
                ControlLaw::OperationalSpace(_) | ControlLaw::CartesianImpedance(_) => {
                    hand_torques(&controller.law, gains, &known, &reference, [&q, &velocity])
                }
            };
            let before = commands[commands.len() - 1];
            let most = controller.torque_rate_nm_s.unwrap() * period;
            for joint in 0..JOINTS {
                let limited = command[joint].clamp(-limits[joint], limits[joint]);
                command[joint] = before[joint] + (limited - before[joint]).clamp(-most, most);
            }
            commands.push(command);
            let age = gains.delay_periods as usize;
            let torque = commands[(commands.len() - 1).saturating_sub(age)];
            for joint in 0..JOINTS {
                impulse[joint] += torque[joint];
            }
            for _ in 0..STEPS {
                (q, qd) = runge_kutta(&scenario.robot, &q, &qd, &torque, period / STEPS as f64);
            }
        }
        if sample >= settling {
            positions.push(std::array::from_fn(|joint| start[joint]));
            torques.push(impulse.map(|sum| sum / periods as f64));
        }
    }
    [positions, torques]
}

type Numbers = Joints<f64>;

fn runge_kutta(
    robot: &Robot,
    q: &Numbers,
    qd: &Numbers,
    torque: &Numbers,
    h: f64,
) -> (Numbers, Numbers) {
    let ahead = |from: &Numbers, slope: &Numbers, h: f64| {
        Joints::from_fn(JOINTS, |joint| from[joint] + h * slope[joint])
    };
    let at = |q: &Numbers, qd: &Numbers| forward_dynamics(robot, *q, *qd, *torque);
    let a1 = at(q, qd);
    let (q2, v2) = (ahead(q, qd, 0.5 * h), ahead(qd, &a1, 0.5 * h));
    let a2 = at(&q2, &v2);
    let (q3, v3) = (ahead(q, &v2, 0.5 * h), ahead(qd, &a2, 0.5 * h));
    let a3 = at(&q3, &v3);
    let (q4, v4) = (ahead(q, &v3, h), ahead(qd, &a3, h));
    let a4 = at(&q4, &v4);
    let mean = |a: &Numbers, b: &Numbers, c: &Numbers, d: &Numbers| {
        Joints::from_fn(JOINTS, |joint| {
            (a[joint] + 2.0 * b[joint] + 2.0 * c[joint] + d[joint]) / 6.0
        })
    };
    (ahead(q, &mean(qd, &v2, &v3, &v4), h), ahead(qd, &mean(&a1, &a2, &a3, &a4), h))
}

#[test]
fn lanes_move_as_a_controller_and_an_integrator_that_are_written_again() {
    for law in laws() {
        for (precision, position_rad, torque_nm) in [("f64", 2e-6, 1e-2), ("f32", 5e-5, 3e-2)] {
            let spec = light(&fourier(), &law, &json!({"precision": precision}));
            let trajectories = run(&spec, 0..6);
            let row = trajectories.series.samples() * JOINTS;
            for (index, scenario) in trajectories.scenarios.iter().enumerate() {
                let [positions, torques] = simulated_alone(&spec, scenario);
                let recorded = |series: &[f32]| series[index * row..][..row].to_vec();
                for (expected, found, tolerance, what) in [
                    (positions, recorded(trajectories.series.y()), position_rad, "q"),
                    (torques, recorded(trajectories.series.u()), torque_nm, "u"),
                ] {
                    for (place, found) in found.iter().enumerate() {
                        let error =
                            (expected[place / JOINTS][place % JOINTS] - f64::from(*found)).abs();
                        assert!(
                            error < tolerance,
                            "{law} {precision} {what} {index} {place} {error:e}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn instructions_ranges_and_neighbours_change_nothing() {
    let noise = json!({"position_noise_rad": 1e-4, "position_resolution_rad": 1e-5, "joint_velocities": true});
    for law in laws() {
        for precision in [Precision::F32, Precision::F64] {
            let fields = json!({"observations": noise, "samples": 40, "precision": precision});
            let spec = light(&fourier(), &law, &fields);
            let whole = run(&spec, 0..37);
            let row = whole.series.samples() * JOINTS;
            for instructions in InstructionSet::available() {
                let part = simulate_on(instructions, &spec, 5..24, &|_| ControlFlow::Continue(()));
                let part = part.unwrap();
                let same = 5 * row..24 * row;
                assert_eq!(part.scenarios, whole.scenarios[5..24]);
                assert_eq!(part.series.u(), &whole.series.u()[same.clone()]);
                assert_eq!(part.series.y(), &whole.series.y()[same.clone()]);
                assert_eq!(part.series.true_y(), &whole.series.true_y()[same.clone()]);
                for (part, whole) in [(&part.reference, &whole.reference), (&part.qd, &whole.qd)] {
                    assert_eq!(part.as_ref().unwrap(), &whole.as_ref().unwrap()[same.clone()]);
                }
            }
        }
    }
}

#[test]
fn an_arm_follows_every_family_of_references_and_they_are_recorded() {
    let families = json!({
        "fourier": {"frequency_hz": {"fixed": 0.2}},
        "point_to_point": {"frequency_hz": {"fixed": 0.5}, "profile": "trapezoid"},
        "via_points": {"frequency_hz": {"uniform": [0.5, 1]}},
    });
    let law = json!({"computed-torque": {"natural_frequency_hz": [5, 5]}});
    let mut spec = light(&families, &law, &json!({"controller": {"law": law}}));
    spec.robot.payload = None;
    let trajectories = run(&spec, 0..60);
    let reference = trajectories.reference.as_ref().unwrap();
    let row = trajectories.series.samples() * JOINTS;
    let mut seen = std::collections::BTreeMap::new();
    for (index, scenario) in trajectories.scenarios.iter().enumerate() {
        *seen.entry(scenario.family).or_insert(0) += 1;
        let tracking = scenario.excitation.tracking().unwrap();
        for sample in 0..trajectories.series.samples() {
            // The controller's half second of settling comes before the first sample.
            let expected = tracking.reference.at(0.5 + sample as f64 / RATE_HZ).r;
            for joint in 0..JOINTS {
                let at = index * row + sample * JOINTS + joint;
                assert!((f64::from(reference[at]) - expected[joint]).abs() < 1e-6);
                let error = (reference[at] - trajectories.series.y()[at]).abs();
                let family = scenario.family;
                assert!(error < 0.05, "{family} {index} {sample} {joint}: {error} rad");
            }
        }
    }
    assert_eq!(seen.len(), 3);
    assert!(seen.values().all(|count| (10..=30).contains(count)), "{seen:?}");
}

#[test]
fn a_grid_gives_each_family_its_trajectories() {
    let families = json!({
        "point_to_point": {"frequency_hz": {"grid": [0.5, 1.0]}},
        "via_points": {"frequency_hz": {"grid": [0.7]}},
    });
    let spec = light(&families, &laws()[0], &json!({"trajectories": 9, "samples": 20}));
    let trajectories = run(&spec, 0..9);
    let found: Vec<_> = trajectories
        .scenarios
        .iter()
        .map(|scenario| (scenario.family.to_string(), scenario.frequency_hz))
        .collect();
    for (cell, expected) in
        [("point-to-point", 0.5), ("point-to-point", 1.0), ("via-points", 0.7)].iter().enumerate()
    {
        for found in &found[3 * cell..3 * cell + 3] {
            assert_eq!((found.0.as_str(), found.1), *expected);
        }
    }
}

#[test]
fn a_controller_sees_what_is_recorded_as_measured() {
    let fields = |noise_rad: f64| json!({"observations": {"position_noise_rad": noise_rad, "position_resolution_rad": 1e-3}});
    let noisy = run(&light(&fourier(), &laws()[0], &fields(2e-3)), 0..20);
    let (measured, truth) = (noisy.series.y(), noisy.series.true_y());
    let mut square = 0.0;
    for (measured, truth) in measured.iter().zip(truth) {
        let steps = f64::from(*measured) / 1e-3;
        assert!((steps - steps.round()).abs() < 1e-3, "{measured}");
        square += f64::from(measured - truth).powi(2);
    }
    let deviation = (square / measured.len() as f64).sqrt();
    let expected = 2e-3_f64.hypot(1e-3 / 12.0_f64.sqrt());
    assert!((deviation / expected - 1.0).abs() < 0.02, "{deviation}");
    // The noise moves the arm, because the controller acts on it.
    let quiet = run(&light(&fourier(), &laws()[0], &json!({})), 0..20);
    let moved = quiet.series.y().iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(moved > 1e-5, "{moved}");
    assert_eq!(quiet.scenarios, noisy.scenarios);
}

#[test]
fn torques_stay_within_their_limit_and_their_rate() {
    let fields = json!({"controller": {
        "law": {"joint-pd": {"natural_frequency_hz": [4, 4]}}, "gravity_compensation": false,
        "torque_share": 0.5, "torque_rate_nm_s": 200, "rate_hz": RATE_HZ, "settle_s": 0,
    }, "rejection": {"position_margin_rad": null}, "samples": 30});
    let spec = light(&fourier(), &laws()[0], &fields);
    let trajectories = run(&spec, 0..20);
    let limits = spec.robot.description().per_joint(|joint| joint.torque_nm);
    let mut reached = 0;
    for u in trajectories.series.u().chunks_exact(30 * JOINTS) {
        for (pair, at) in u.windows(JOINTS + 1).zip(0..) {
            let change = f64::from((pair[JOINTS] - pair[0]).abs());
            assert!(change <= 2.0 + 1e-4, "{change}");
            reached += usize::from(change > 1.999);
            assert!(f64::from(pair[0].abs()) <= 0.5 * limits[at % JOINTS] + 1e-4);
        }
    }
    assert!(reached > 100, "{reached} changes as fast as the limit");
}

#[test]
fn an_unstable_controller_ends_with_its_gains_and_the_time() {
    let law =
        json!({"computed-torque": {"natural_frequency_hz": [60, 60], "damping_ratio": [0, 0]}});
    let spec = light(&fourier(), &law, &json!({"rejection": {"max_draws": 3}}));
    let error = failure(&spec, 0..4).to_string();
    for part in ["none of 3 draws followed its reference", "kp 1", "kd 0.0000", "s after the start"]
    {
        assert!(error.contains(part), "{part}: {error}");
    }
}

#[test]
fn an_arm_of_another_structure_is_controlled_too() {
    let mut description = RobotSpec::default().description().clone();
    description.joints.truncate(3);
    description.joints[1].alpha_deg = -60.0;
    description.initial_state.center_rad.truncate(3);
    let spec = spec(
        &fourier(),
        &json!({
            "robot": {"model": description}, "samples": 50,
            "controller": {"law": laws()[1], "settle_s": 0.2},
        }),
    );
    assert_eq!(spec.controller.as_ref().unwrap().rate_hz, 1020.0);
    let trajectories = run(&spec, 0..5);
    assert_eq!(trajectories.series.joints(), 3);
    let reference = trajectories.reference.unwrap();
    let off = reference.iter().zip(trajectories.series.y()).map(|(r, q)| (r - q).abs());
    assert!(off.fold(0.0, f32::max) < 0.3);
}

#[test]
fn the_hand_follows_circles_spirals_and_lines_under_every_law() {
    let paths = json!({"hand_paths": {"frequency_hz": {"fixed": 0.4}, "radius_m": [0.05, 0.1]}});
    for law in laws() {
        let mut spec =
            light(&paths, &law, &json!({"controller": {"law": law, "gain_fraction": 0.0}}));
        // Nothing disturbs the arm, so that every law follows as well as its gains allow.
        spec.robot = RobotSpec {
            payload: None,
            friction: None,
            gravity: spec.robot.gravity,
            ..RobotSpec::default()
        };
        spec.robot.mass_fraction = 0.0;
        spec.robot.inertia_fraction = 0.0;
        spec.robot.com_fraction = 0.0;
        spec.robot.damping_nm_s_rad = vec![0.1; JOINTS];
        let trajectories = run(&spec, 0..12);
        let row = trajectories.series.samples() * JOINTS;
        let known = Robot::nominal(&spec.robot);
        let mut shapes = std::collections::BTreeSet::new();
        for (index, scenario) in trajectories.scenarios.iter().enumerate() {
            let Reference::HandPath(path) = &scenario.excitation.tracking().unwrap().reference
            else {
                panic!("{:?}", scenario.family)
            };
            shapes.insert(format!("{:?}", path.shape));
            let q = &trajectories.series.y()[index * row..][..row];
            for (sample, q) in q.chunks_exact(JOINTS).enumerate() {
                let q = q.iter().map(|q| f64::from(*q)).collect();
                let wanted = path.hand_at(0.5 + sample as f64 / RATE_HZ).0;
                let off = (hand(&known, &q).0 - Vector3::from(wanted)).norm();
                assert!(off < 0.06, "{law} {index} {sample}: {off} m off");
            }
        }
        assert_eq!(shapes.len(), 3, "{shapes:?}");
    }
}

#[test]
fn a_path_that_joints_cannot_follow_ends_with_the_reason() {
    let paths = json!({"hand_paths": {
        "frequency_hz": {"fixed": 0.5}, "radius_m": [2, 3], "speed": 0.01, "shapes": ["circle"],
    }});
    let spec = light(&paths, &laws()[2], &json!({"rejection": {"max_draws": 2}}));
    let error = failure(&spec, 0..4).to_string();
    for part in
        ["of 2 draws", "faster than its share", "s after the start", "excitation.hand_paths"]
    {
        assert!(error.contains(part), "{part}: {error}");
    }
}

#[test]
fn a_singular_posture_ends_with_gains_robot_and_time() {
    // With a straight elbow, the hand cannot move towards the shoulder.
    let mut description = RobotSpec::default().description().clone();
    description.joints[3].position_rad = spec::Range::new(-3.0, 3.0);
    let slow = json!({"fourier": {
        "frequency_hz": {"fixed": 0.1}, "reach": 0.001, "speed": [0.001, 0.001],
    }});
    let fields = json!({
        "robot": {"model": description},
        "initial_state": {"center_rad": [0.0, 0.0, 0.0, 0.0, 0.0, 1.6, 0.0]},
        "rejection": {"max_draws": 2, "position_margin_rad": null},
    });
    let error = failure(&light(&slow, &laws()[2], &fields), 0..2).to_string();
    for part in ["trajectory 0", "singular posture", "kp ", "s after the start"] {
        assert!(error.contains(part), "{part}: {error}");
    }
}
