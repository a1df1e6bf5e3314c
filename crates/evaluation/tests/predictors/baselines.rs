use evaluation::{
    ConstantVelocity, Identification, LeastSquares, NominalArm, Predictor, baseline,
    prior_knowledge, rmse_deg,
};
use models::{Interrupt, Interrupted};
use serde_json::json;
use series::Series;
use spec::{Baseline, DataSpec, Given, ImportSpec, JobSpec, RobotSpec};

use super::{arm, scenarios, simulation};

use crate::JOINTS;

/// Mean RMSE in degrees after `context` samples.
fn error(predictor: &dyn Predictor, scenarios: &Series, context: usize) -> f64 {
    let predicted = predictor.predict(&scenarios.observed(context)).unwrap();
    let errors = rmse_deg(&scenarios.view(), context, &predicted);
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn identification_finds_an_arm_as_it_was_drawn() {
    let heavy = json!({"robot": {"gravity": "compensated", "payload": {"mass_kg": [1.0, 1.0]}}});
    for fields in [json!({}), json!({"precision": "f64"}), heavy] {
        let spec = simulation(400, &fields);
        let scenarios = scenarios(&spec, 6);
        let identified = error(&Identification::new(&arm(&spec)), &scenarios, 320);
        let fitted = error(&LeastSquares, &scenarios, 320);
        assert!(identified < 0.02, "{fields}: {identified}°");
        assert!(identified < 0.02 * fitted, "{fields}: {identified}°, least squares {fitted}°");
    }
}

/// Armatures, friction, lengths and payload are fitted where the data's robots differ in them.
#[test]
fn identification_finds_everything_that_robots_differ_in() {
    let payload =
        json!({"mass_kg": [0.0, 3.0], "center_m": [[-0.05, 0.05], [0.0, 0.0], [0.05, 0.2]]});
    let varied = json!({"robot": {
        "gravity": "compensated", "armature_fraction": 0.3, "geometry_fraction": 0.05,
        "friction": {"phi1_fraction": 0.5}, "payload": payload,
    }});
    let spec = simulation(400, &varied);
    let scenarios = scenarios(&spec, 6);
    let told = error(&Identification::new(&arm(&spec)), &scenarios, 320);
    let middle = json!({"robot": {
        "gravity": "compensated", "friction": {"phi1_fraction": 0.0},
        "payload": {"mass_kg": [1.5, 1.5], "center_m": [[0.0, 0.0], [0.0, 0.0], [0.125, 0.125]]},
    }});
    let not_told = error(&Identification::new(&arm(&simulation(400, &middle))), &scenarios, 320);
    assert!(told < 0.03, "{told}°");
    assert!(told < 0.2 * not_told, "{told}°, not told {not_told}°");
}

#[test]
fn a_table_says_what_identification_is_not_told() {
    let told = |fields: &serde_json::Value| {
        let data = DataSpec::Simulation(simulation(400, fields));
        prior_knowledge(Baseline::Identification, Given::Torques, &data)
    };
    assert_eq!(told(&json!({})), Baseline::Identification.prior_knowledge(Given::Torques));
    let per_entry = told(&json!({"robot": {"inertia_scheme": "per-entry"}}));
    assert!(per_entry.ends_with("; not products of inertia"), "{per_entry}");
    let recorded =
        prior_knowledge(Baseline::Identification, Given::Torques, &DataSpec::Import(import()));
    assert!(recorded.ends_with("; not friction and payload"), "{recorded}");
    assert_eq!(
        prior_knowledge(Baseline::Arx, Given::Torques, &DataSpec::Import(import())),
        "nothing"
    );
}

/// Its load is unknown, and hardly any damping forgets a velocity that a wrong load leads to.
#[test]
fn a_light_arm_under_a_controller_is_identified_from_its_measured_velocities() {
    for preset in ["panda-real", "ur10e-real"] {
        let text = json!({"preset": preset, "trajectories": 100, "samples": 350}).to_string();
        let Ok(JobSpec::Simulate(spec)) = spec::parse(text.as_bytes()) else {
            panic!("{preset} is no simulation")
        };
        let scenarios = scenarios(&spec, 8);
        let identified = error(&Identification::new(&arm(&spec)), &scenarios, 320);
        let moving = error(&ConstantVelocity, &scenarios, 320);
        assert!(identified < 0.3 * moving, "{preset}: {identified}°, constant velocity {moving}°");
    }
}

/// Without being told of lengths and armature, the result is the closest arm without them.
#[test]
fn identification_of_an_arm_it_has_no_model_of_is_still_better_than_none() {
    let unknown = json!({"robot": {
        "geometry_fraction": 0.1, "armature_fraction": 0.3, "damping_fraction": 0.3,
    }});
    let spec = simulation(400, &unknown);
    let assumed = simulation(400, &json!({}));
    let scenarios = scenarios(&spec, 6);
    let identified = error(&Identification::new(&arm(&assumed)), &scenarios, 320);
    let fitted = error(&LeastSquares, &scenarios, 320);
    assert!(identified < 0.5 * fitted, "{identified}°, least squares {fitted}°");
}

#[test]
fn where_the_simulation_diverges_the_last_position_is_held() {
    // One explicit step per period is far from stable with this damping.
    let spec = simulation(140, &json!({}));
    let NominalArm { robot, rate_hz, precision, .. } = arm(&spec);
    let unstable =
        NominalArm { robot, rate_hz, precision, integrator: spec::Integrator::Rk4 { substeps: 1 } };
    let scenarios = scenarios(&spec, 2);
    let observed = scenarios.observed(110);
    let predicted = Identification::new(&unstable).predict(&observed).unwrap();
    let held = predicted[..30 * JOINTS].chunks(JOINTS);
    assert!(held.into_iter().all(|q| *q == observed.y(0)[109]));
}

#[test]
fn a_short_context_still_has_an_answer() {
    let spec = simulation(60, &json!({}));
    let scenarios = scenarios(&spec, 2);
    for context in [1, 2, 3, 10] {
        let observed = scenarios.observed(context);
        let predicted = Identification::new(&arm(&spec)).predict(&observed).unwrap();
        assert_eq!(predicted.len(), 2 * (60 - context) * JOINTS);
        assert!(predicted.iter().all(|q| q.is_finite()));
    }
}

#[test]
fn of_recordings_the_nominal_arm_is_the_reference_at_their_rate() {
    let arm = NominalArm::of(&DataSpec::Import(import()));
    assert_eq!((arm.robot, arm.rate_hz), (RobotSpec::default(), 100.0));
}

fn import() -> ImportSpec {
    let columns =
        |prefix: &str| -> Vec<String> { (1..=7).map(|k| format!("{prefix}{k}")).collect() };
    let text = json!({
        "kind": "import", "file": "0".repeat(64), "format": "csv", "rate_hz": 100.0, "samples": 50,
        "columns": {"u": columns("u"), "q": columns("q")},
    });
    match spec::parse(text.to_string().as_bytes()).unwrap() {
        JobSpec::Import(spec) => spec,
        _ => panic!("not an import"),
    }
}

#[test]
fn every_baseline_ends_when_it_is_interrupted() {
    let spec = simulation(60, &json!({}));
    let scenarios = scenarios(&spec, 4);
    for name in Baseline::all() {
        let predictor = baseline(name, &arm(&spec));
        let answer = || Ok::<_, Interrupted>(predictor.predict(&scenarios.observed(40)).is_ok());
        let interrupt = Interrupt::default();
        assert_eq!(interrupt.guard(answer), Ok(true), "{name:?}");
        interrupt.raise();
        assert_eq!(interrupt.guard(answer), Err(Interrupted), "{name:?}");
    }
}
