//! Arms that follow references under a controller.

use std::ops::ControlFlow;

use dynamics::{InstructionSet, Reference, Robot, simulate, simulate_on};
use nalgebra::Vector3;
use serde_json::{Value, json};
use spec::{JobSpec, Precision, RobotSpec, SimulateSpec};

use crate::simulated_alone::{hand, simulated_alone};
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

/// Pandas under `computed-torque` of a natural frequency, with the largest delays.
fn stiff(natural_frequency_hz: f64, max_draws: u32) -> SimulateSpec {
    let law = json!({"computed-torque": {"natural_frequency_hz": vec![natural_frequency_hz; 2]}});
    let controller = json!({"law": law, "delay_periods": [3, 3], "torque_rate_nm_s": null});
    let rejection = json!({"max_draws": max_draws});
    let fields = json!({"preset": "panda-real", "controller": controller, "rejection": rejection});
    match spec::parse(fields.to_string().as_bytes()).unwrap() {
        JobSpec::Simulate(spec) => spec,
        other => panic!("{other:?}"),
    }
}

/// Such torques were data, although their motion had nothing of the arm.
#[test]
fn a_limit_cycle_is_no_data_and_ends_with_joint_gains_delay_and_time() {
    let once = stiff(20.0, 1);
    let go_on = |_| ControlFlow::Continue(());
    let failures = (0..40).filter_map(|index| simulate(&once, index..index + 1, &go_on).err());
    let errors: Vec<String> = failures.map(|error| error.to_string()).collect();
    let unstable: Vec<&String> =
        errors.iter().filter(|error| error.contains("its controller is unstable")).collect();
    assert!(unstable.len() > 5, "{errors:?}");
    for part in [
        "none of 1 draws followed its reference; in the last one, its controller is unstable (the torque of a joint \
         swings from limit to limit): joint ",
        " s after the start, with kp ",
        "and a delay of 3 control periods",
    ] {
        assert!(unstable.iter().all(|error| error.contains(part)), "{part}: {unstable:?}");
    }

    let spec = stiff(15.0, 1000);
    let kept = run(&spec, 0..100);
    assert!(kept.rejected > 0);
    let limits = spec.robot.description().per_joint(|joint| 0.9 * joint.torque_nm);
    let row = spec.samples as usize * JOINTS;
    for u in kept.series.u().chunks_exact(row) {
        let jumps = u.windows(JOINTS + 1).zip(0..).filter(|(pair, at)| {
            let limit = limits[at % JOINTS];
            f64::from(pair[0].abs()) > limit && f64::from(pair[0] * pair[JOINTS]) < -limit * limit
        });
        assert!(jumps.count() < 20, "a limit cycle was kept");
    }
}

#[test]
fn no_draw_of_the_presets_has_a_limit_cycle() {
    for preset in ["panda-real", "ur10e-real"] {
        let text = json!({"preset": preset}).to_string();
        let JobSpec::Simulate(spec) = spec::parse(text.as_bytes()).unwrap() else { panic!() };
        assert_eq!(run(&spec, 0..1000).rejected, 0, "{preset}");
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
