use series::{Series, Shape};

use super::*;
use crate::{DampedIntegrator, HoldLast, Measure, Row};

const JOINTS: usize = 7;

fn scoring() -> Scoring {
    Scoring {
        pre_roll: 0,
        context: 20,
        samples: 4,
        band_edge_hz: Some(8.0),
        given: Given::Torques,
        limits_rad: vec![Range::new(-2.0, 2.0); JOINTS],
        horizons: ErrorHorizon::all(&[0.1, 9.0], 60.0, 40),
    }
}

fn scenarios() -> Series {
    let y: Vec<f32> = (0..3 * 60 * JOINTS).map(|k| (0.01 * k as f32).sin()).collect();
    let shape = Shape { robots: 3, samples: 60, joints: JOINTS };
    Series::new(shape, 60.0, y.clone(), y).unwrap()
}

/// Holds the last position, except for one value.
struct Broken {
    value: f32,
    at: usize,
}

impl Predictor for Broken {
    fn name(&self) -> &'static str {
        "broken"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let mut predicted = HoldLast.predict(observed)?;
        predicted[self.at] = self.value;
        Ok(predicted)
    }
}

struct TooShort;

impl Predictor for TooShort {
    fn name(&self) -> &'static str {
        "too-short"
    }

    fn predict(&self, _: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(vec![0.0; 3])
    }
}

/// The last position and its neighbours.
struct Several;

impl Predictor for Several {
    fn name(&self) -> &'static str {
        "several"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        HoldLast.predict(observed)
    }

    fn answer(&self, observed: &Observed<'_>, count: usize) -> Result<Answer, EvaluationError> {
        let held = HoldLast.predict(observed)?;
        let positions = (0..count).flat_map(|k| held.iter().map(move |q| q + 0.1 * k as f32));
        Ok(Answer::of_samples(count, positions.collect()))
    }
}

fn result(predictors: &[Box<dyn Predictor>]) -> CellResult {
    CellResult {
        cell: 1,
        family: Some(Family::Chirp),
        frequency_hz: Some(0.3),
        position_noise_rad: 0.0,
        first: 200,
        joints: JOINTS,
        horizons_s: scoring().horizons.iter().map(|horizon| horizon.seconds).collect(),
        predictors: evaluate_cell(&scenarios().view(), &scoring(), predictors),
        measured_jitter_deg: measured_jitter_deg(&scenarios().view(), &scoring()),
        measured_left_limits: measured_left_limits(&scenarios().view(), &scoring()),
        within_torque_limits: within_torque_limits(&scenarios().view(), &[1.0; JOINTS]),
        warnings: Vec::new(),
    }
}

#[test]
fn a_value_that_is_not_finite_is_reported_with_its_scenario_and_not_averaged_away() {
    let row = 40 * JOINTS;
    for value in [f32::NAN, f32::INFINITY] {
        let broken = result(&[Box::new(Broken { value, at: 2 * row + 5 }), Box::new(HoldLast)]);
        let [broken, held] = &broken.predictors[..] else { panic!("two predictors") };
        let failure = broken.failure.as_ref().unwrap();
        assert_eq!((failure.scenarios, failure.first), (1, 2));
        assert_eq!(broken.rmse_deg[2], None);
        assert_eq!(broken.rmse_deg[..2], held.rmse_deg[..2]);
        assert!(held.failure.is_none() && held.rmse_deg.iter().all(Option::is_some));
    }
}

#[test]
fn rollouts_that_leave_the_limits_and_those_that_diverge_are_counted() {
    let row = 40 * JOINTS;
    // The first value is within 180° of the measured position of the second scenario. The next one
    // is further away from that of the third scenario.
    let found = result(&[
        Box::new(Broken { value: 2.5, at: row + 5 }),
        Box::new(Broken { value: 7.0, at: 2 * row + 5 }),
        Box::new(Broken { value: f32::NAN, at: 5 }),
        Box::new(HoldLast),
    ]);
    let rollouts: Vec<Rollouts> =
        found.predictors.iter().map(|errors| errors.rollouts.unwrap()).collect();
    let expected = [(1, 0), (1, 1), (1, 1), (0, 0)]
        .map(|(left, diverged)| Rollouts { left_limits: Some(left), diverged });
    assert_eq!(rollouts, expected);
    assert_eq!(found.measured_left_limits, Some(0.0));
    let scenario = found.predictors[0].scenarios[1].as_ref().unwrap();
    let beyond = scenario.get(Measure::BeyondLimitsDeg).unwrap();
    assert!((f64::from(beyond[5]) - 0.5_f64.to_degrees()).abs() < 1e-4, "{beyond:?}");
    assert_eq!(beyond[4], 0.0);
}

#[test]
fn predictions_that_stand_still_while_the_robot_moves_are_counted() {
    let row = 40 * JOINTS;
    let found = result(&[Box::new(Broken { value: 0.5, at: row + 9 }), Box::new(HoldLast)]);
    assert_eq!(found.predictors[0].held, [0, 2]);
    assert_eq!(found.predictors[1].held, [0, 1, 2]);
}

#[test]
fn a_predictor_that_fails_leaves_the_others_of_the_cell_alone() {
    let found = result(&[Box::new(TooShort), Box::new(HoldLast)]);
    let failure = found.predictors[0].failure.as_ref().unwrap();
    assert_eq!((failure.scenarios, failure.first), (3, 0));
    assert!(failure.reason.contains("3 values, expected 840"), "{}", failure.reason);
    assert!(found.predictors[1].rmse_deg.iter().all(Option::is_some));
}

#[test]
fn the_table_has_a_row_per_scenario_joint_and_predictor() {
    let integrator = DampedIntegrator { damping_nm_s_rad: vec![10.0; JOINTS] };
    let found = result(&[Box::new(Several), Box::new(integrator)]);
    let rows: Vec<Row<'_>> = found.rows().collect();
    assert_eq!(rows.len(), 2 * 3 * JOINTS);
    let last = &rows[2 * JOINTS + 6];
    assert_eq!((last.predictor, last.trajectory, last.joint), ("several", 202, 7));
    let of_scenario = &rows[2 * JOINTS..3 * JOINTS];
    let rmse = |row: &Row<'_>| f64::from(row.get(Measure::RmseDeg).unwrap());
    let mean = of_scenario.iter().map(rmse).sum::<f64>();
    assert!((mean / 7.0 - found.predictors[0].rmse_deg[2].unwrap()).abs() < 1e-6);
    for measure in [Measure::CrpsDeg, Measure::Coverage50, Measure::JitterDeg] {
        assert!(last.get(measure).is_some(), "{measure:?}");
    }
    // Four samples are too few for this interval.
    assert_eq!(last.get(Measure::Coverage90), None);
    assert_eq!(rows[3 * JOINTS].get(Measure::CrpsDeg), None);
}

#[test]
fn the_rows_of_a_scenario_hold_its_errors() {
    let found = result(&[Box::new(Several), Box::new(HoldLast), Box::new(TooShort)]);
    let rows: Vec<Row<'_>> = found.rows().collect();
    let mut read = found.clone();
    for errors in &mut read.predictors {
        errors.scenarios.clear();
    }
    assert!(read.take_rows(&rows), "rows of this cell");
    for (read, made) in read.predictors.iter().zip(&found.predictors) {
        let mut made = made.scenarios.clone();
        for errors in made.iter_mut().flatten() {
            // The cell stores the calibration and the coverage of steps as a whole.
            errors.calibration.clear();
            errors.step_coverage.clear();
        }
        assert_eq!(read.scenarios, made);
    }
    assert!(!read.take_rows(&rows[7..]), "a scenario is missing");
}

#[test]
fn the_error_over_the_whole_horizon_is_the_error_and_a_shorter_one_is_of_the_first_steps() {
    let found = result(&[Box::new(HoldLast)]);
    assert_eq!(found.horizons_s, [0.1, 40.0 / 60.0]);
    let errors = &found.predictors[0];
    for scenario in errors.scenarios.iter().flatten() {
        assert_eq!(Some(&scenario.horizons[1]), scenario.get(Measure::RmseDeg));
    }
    for joint in 0..JOINTS {
        let by_step: f64 = errors.step_squares_deg2[..6].iter().map(|step| step[joint]).sum();
        let scenarios = errors.scenarios.iter().flatten();
        let of_scenario = |errors: &ScenarioErrors| f64::from(errors.horizons[0][joint]).powi(2);
        let by_scenario = 6.0 * scenarios.map(of_scenario).sum::<f64>();
        assert!((by_step / by_scenario - 1.0).abs() < 1e-5, "{by_step} {by_scenario}");
    }
}

#[test]
fn errors_of_steps_and_of_joints_are_the_same_errors() {
    let found = result(&[Box::new(HoldLast)]);
    let errors = &found.predictors[0];
    for joint in 0..JOINTS {
        let by_step: f64 = errors.step_squares_deg2.iter().map(|step| step[joint]).sum();
        let by_scenario: f64 = errors
            .scenarios
            .iter()
            .flatten()
            .map(|errors| f64::from(errors.get(Measure::RmseDeg).unwrap()[joint]).powi(2) * 40.0)
            .sum();
        assert!((by_step / by_scenario - 1.0).abs() < 1e-5, "{by_step} {by_scenario}");
    }
}

#[test]
fn intervals_hold_as_often_over_steps_as_over_joints() {
    let found = result(&[Box::new(Several), Box::new(HoldLast)]);
    let errors = &found.predictors[0];
    // Four samples are enough for one of the intervals.
    let [steps] = &errors.step_coverage[..] else { panic!("{:?}", errors.step_coverage) };
    assert_eq!(steps.len(), 40);
    let by_step = steps.iter().sum::<f64>() / 40.0;
    let scenarios = errors.scenarios.iter().flatten();
    let by_joint: Vec<f64> = scenarios.filter_map(|it| it.mean(Measure::Coverage50)).collect();
    let by_joint = by_joint.iter().sum::<f64>() / by_joint.len() as f64;
    assert!((by_step - by_joint).abs() < 1e-6, "{by_step} {by_joint}");
    assert!(steps.iter().any(|share| *share != steps[0]), "steps differ: {steps:?}");
    assert!(found.predictors[1].step_coverage.is_empty());
}

#[test]
fn a_result_without_its_scenarios_reads_back_from_its_json() {
    let mut found = result(&[Box::new(Several), Box::new(TooShort)]);
    let text = serde_json::to_string(&found).unwrap();
    for errors in &mut found.predictors {
        errors.scenarios.clear();
    }
    assert_eq!(serde_json::from_str::<CellResult>(&text).unwrap(), found);
}
