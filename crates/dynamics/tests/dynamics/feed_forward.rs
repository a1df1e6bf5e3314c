//! Torques that are added to those of a controller.

use dynamics::{Excitation, Scenario, Scenarios, Trajectories, inverse_dynamics};
use serde_json::{Value, json};
use spec::SimulateSpec;

use crate::{JOINTS, run, spec};

const SAMPLES: usize = 120;

/// Arms with unknown loads and friction, whose recordings begin after `settle_s`.
fn arms(law: &Value, settle_s: f64) -> SimulateSpec {
    let fields = json!({
        "samples": SAMPLES, "rate_hz": 100,
        "robot": {
            "damping_nm_s_rad": vec![0.5; JOINTS], "armature_kg_m2": vec![0.1; JOINTS],
            "friction": {}, "payload": {"mass_kg": [0, 3]},
        },
        "controller": {"law": law, "settle_s": settle_s},
    });
    spec(&json!({"via_points": {"frequency_hz": {"fixed": 1.0}}}), &fields)
}

/// The scenarios with `torques` added.
fn with_added(scenarios: &[Scenario], torques: impl Fn(&Scenario) -> Vec<f32>) -> Vec<Scenario> {
    let mut scenarios = scenarios.to_vec();
    for scenario in &mut scenarios {
        let added = torques(scenario);
        let Excitation::ClosedLoop(tracking) = &mut scenario.excitation else {
            panic!("a controller")
        };
        tracking.added_nm = added;
    }
    scenarios
}

/// The largest distance of an arm from its reference, rad.
fn largest_error(trajectories: &Trajectories) -> f32 {
    let reference = trajectories.reference.as_ref().unwrap().iter();
    let both = reference.zip(trajectories.series.true_y());
    both.map(|(r, q)| (r - q).abs()).fold(0.0, f32::max)
}

#[test]
fn an_arm_that_gets_the_torque_of_its_reference_follows_it_under_every_law() {
    for law in
        ["joint-pd", "computed-torque", "operational-space", "cartesian-impedance"].map(|law| {
            let gains = match law {
                "joint-pd" => json!({"natural_frequency_hz": [4, 4]}),
                _ => json!({}),
            };
            json!({law: gains})
        })
    {
        // The arm starts on its reference.
        let spec = arms(&law, 0.0);
        let alone = run(&spec, 0..6);
        let source = Scenarios::new(&spec);
        let scenarios = with_added(&alone.scenarios, |scenario| {
            let states = source.references(scenario, 0).unwrap();
            let torques = states.iter().flat_map(|state| {
                let wanted = inverse_dynamics(&scenario.robot, state.r, state.rd, state.rdd);
                let own = source.torques_on_reference(state).unwrap();
                (0..JOINTS).map(move |joint| (wanted[joint] - own[joint]) as f32)
            });
            torques.collect()
        });
        let helped = dynamics::simulate_scenarios(&spec, &scenarios).unwrap();
        let (alone_rad, helped_rad) = (largest_error(&alone), largest_error(&helped));
        assert!(helped_rad < 0.1 * alone_rad, "{law}: {helped_rad} beside {alone_rad}");
    }
}

#[test]
fn torques_are_added_from_the_first_recorded_sample_on_to_their_own_arm() {
    let spec = arms(&json!({"joint-pd": {}}), 0.3);
    let alone = run(&spec, 0..6);
    let late = 40 * JOINTS;
    let scenarios = with_added(&alone.scenarios, |scenario| match scenario.index {
        // Ten control periods to a sample.
        2 => [vec![0.0; 10 * late], vec![1.0; 10 * JOINTS]].concat(),
        _ => Vec::new(),
    });
    let again = dynamics::simulate_scenarios(&spec, &scenarios).unwrap();
    let row = SAMPLES * JOINTS;
    let same = alone.series.u().iter().zip(again.series.u()).map(|(alone, again)| alone == again);
    let same: Vec<bool> = same.collect();
    for (index, same) in same.chunks_exact(row).enumerate() {
        let first = same.iter().position(|same| !same);
        assert_eq!(first, (index == 2).then_some(late), "{index}");
    }
    let [alone, again] =
        [&alone, &again].map(|it| it.series.true_u()[2 * row + late..][..JOINTS].to_vec());
    for (alone, again) in alone.iter().zip(&again) {
        assert!((again - alone - 1.0).abs() < 0.2, "{again} after {alone}");
    }
}
