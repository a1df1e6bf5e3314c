use serde_json::{Value, json};
use spec::{StudyEdition, StudyEvaluation, StudyQuestion, StudyScale};

use super::*;
use crate::study::fixture::{interval, record, report, trainings};
use crate::study::{Plan, Training, write};

/// A study with invented numbers: the error of the k-th predictor of an evaluation, models first, is
/// k + 1 degrees over 1.33 s and a tenth of that over 0.1 s. The oracle has 0.5 and holding 10.5.
fn study() -> Study {
    let mut plan = Plan::of(StudyEdition::Real, StudyScale::Tiny).unwrap();
    let recordings: Vec<_> = real_study().recordings.iter().map(|it| (it, 7)).collect();
    plan.add_recordings(&recordings).unwrap();
    let trainings = trainings(&plan);
    let evaluations = plan.parts.evaluations.iter().map(|it| evaluation(it, &trainings)).collect();
    Study {
        edition: plan.edition,
        scale: plan.scale,
        spec: plan.pipeline.clone(),
        pipeline: record("real-study-tiny", 1),
        evaluations,
        trainings,
    }
}

fn evaluation(plan: &StudyEvaluation, trainings: &[Training]) -> Evaluation {
    let of_arm: Vec<&Training> =
        trainings.iter().filter(|training| training.plan.set == plan.set).collect();
    let mut predictors: Vec<Value> = ["hold-last", "identification", "oracle"]
        .map(|name| json!({"name": name, "kind": "baseline", "told": "something"}))
        .to_vec();
    predictors.extend(of_arm.iter().map(|training| {
        json!({"name": training.plan.job, "kind": "checkpoint", "digest": training.record.digest})
    }));
    let mut entries: Vec<(Vec<&str>, f64)> =
        vec![(vec!["hold-last"], 10.5), (vec!["identification"], 2.0), (vec!["oracle"], 0.5)];
    let mut models: Vec<&str> = Vec::new();
    for training in &of_arm {
        if !models.contains(&training.plan.model.as_str()) {
            models.push(&training.plan.model);
            entries.push((Vec::new(), models.len() as f64));
        }
        entries.last_mut().unwrap().0.push(&training.plan.job);
    }
    let replications: Vec<Value> = entries
        .iter()
        .map(|(names, mean)| {
            let error = |seconds: f64, mean: f64| {
                json!({"seconds": seconds, "rmse_deg": interval(mean), "seed_rmse_deg": [mean]})
            };
            let errors = [error(0.1, 0.1 * mean), error(1.33, *mean)];
            json!({"predictors": names, "errors": errors, "diverged": 0.25})
        })
        .collect();
    let difference = |ours: &(Vec<&str>, f64), theirs: &(Vec<&str>, f64)| {
        json!({
            "predictor": ours.0[0], "against": theirs.0[0], "seconds": 1.33,
            "difference_deg": interval(ours.1 - theirs.1),
        })
    };
    let pairs = entries.iter().enumerate();
    let differences: Vec<Value> = pairs
        .flat_map(|(k, ours)| entries[..k].iter().map(move |theirs| difference(ours, theirs)))
        .collect();
    let scores: Vec<Value> = of_arm
        .iter()
        .map(|training| {
            let inside = |nominal: f64| {
                json!({
                    "nominal": nominal, "coverage": interval(nominal), "width_deg": interval(1.0),
                    "joint_coverage": [0.7, 0.8], "step_coverage": vec![0.6; 80],
                })
            };
            json!({
                "predictor": training.plan.job, "joint_rmse_deg": [1.0, 2.0],
                "step_rmse_deg": vec![1.0; 80], "crps_deg": interval(0.3),
                "mean_rmse_deg": interval(0.4), "intervals": [inside(0.5), inside(0.9)],
            })
        })
        .collect();
    let group = json!({
        "name": "all scenarios", "scenarios": 8, "rmse_deg": [], "scores": scores,
        "replications": replications, "replication_differences": differences,
    });
    let report = report(&json!({"predictors": predictors, "groups": [group], "paired": []}));
    Evaluation { plan: plan.clone(), record: record(&plan.job, 900), report, files: Vec::new() }
}

#[test]
fn the_headline_has_a_row_for_each_model_before_the_baselines() {
    let text = usual(&study()).to_markdown();
    let line = "| law | 2 |  | 0.10 [0.00, 0.20] | 1.00 [0.90, 1.10] | 0.95 | 25.0 % | - |";
    assert!(text.contains(line), "{text}");
    let places =
        ["| law |", "| diffuser |", "| hold-last | - | something |"].map(|line| text.find(line));
    assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{text}");
}

#[test]
fn a_difference_has_the_sign_of_its_row_whichever_came_first() {
    let text = differences(&study());
    // `law` has 1, `identification` 2 and `robomorph` 6 degrees.
    let law = text.lines().rfind(|line| line.starts_with("| law |")).unwrap();
    assert!(law.contains("| -1.00 [-1.10, -0.90] |") && law.contains("| -5.00 ["), "{text}");
}

#[test]
fn questions_are_columns_and_recordings_too() {
    let study = study();
    let changed = by_horizon(&study, &CHANGED, false);
    assert!(
        changed.contains("|  | as in training | masses ±50 % | load of 3 to 5 kg |"),
        "{changed}"
    );
    let contexts = by_horizon(&study, &CONTEXTS, true);
    assert!(contexts.contains("Over 1.33 s:"), "{contexts}");
    let arms = by_horizon(&study, &OTHER_ARM, false);
    assert!(arms.contains("| a UR10e | a real UR10e | the same with 2.8 kg |"), "{arms}");
    assert!(by_horizon(&study, &["no such question"], false).is_empty());
}

#[test]
fn coverage_is_told_by_time_and_by_joint() {
    let text = coverage(&study());
    assert!(
        text.contains(
            "| law | 0.40 | 0.30 | 50.0 % | 60.0 % | 60.0 % | 90.0 % | 60.0 % | 60.0 % |"
        ),
        "{text}"
    );
    assert!(text.contains("| law | 70.0 % | 80.0 % |"), "{text}");
}

#[test]
fn every_question_of_the_list_is_in_the_report() {
    let study = study();
    let shown: Vec<&str> = [USUAL, SAMPLES, REAL_PANDA]
        .into_iter()
        .chain(CHANGED)
        .chain(CONTEXTS)
        .chain(OTHER_ARM)
        .collect();
    for evaluation in &study.evaluations {
        let StudyQuestion::Arms(name) = evaluation.plan.question else { panic!("another edition") };
        assert!(shown.contains(&name), "{name}");
    }
}

#[test]
fn the_report_is_a_folder_of_text_tables_figures_and_sources() {
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("report");
    write(&out, &study()).unwrap();
    let errors = std::fs::read_to_string(out.join("tables/errors.csv")).unwrap();
    let line =
        "panda,panda-usual,as in training,8,5.333333333333333,law,2,1.33,1,0.9,1.1,1,0.25,900,";
    assert!(errors.contains(line), "{errors}");
    let readme = std::fs::read_to_string(out.join("README.md")).unwrap();
    for (_, rest) in readme.match_indices("](figures/").map(|(at, _)| readme.split_at(at)) {
        let file = rest[2..].split(')').next().unwrap();
        assert!(out.join(file).is_file(), "{file}");
    }
    assert!(readme.contains("## A recorded Panda"), "{readme}");
}
