//! Trainings: violations before anything is queued, warnings, and results.

use std::collections::BTreeMap;
use std::sync::Arc;

use api::{App, Options};
use serde_json::{Value, json};
use spec::{DataSpec, Doubt, TrainSpec};
use store::NewCheckpoint;

use crate::fixture::{Server, small_pipeline, small_simulation, small_training};

/// The violations of a spec that must be refused, as `field is value, allowed: ...`.
async fn refused(server: &Server, spec: &Value) -> Vec<String> {
    let before = server.json("/v1/jobs").await["jobs"].as_array().unwrap().len();
    let problem = server.submit(spec).await.problem(422);
    let after = server.json("/v1/jobs").await["jobs"].as_array().unwrap().len();
    assert_eq!(before, after, "something was queued");
    let text = |violation: &Value, key: &str| violation[key].as_str().unwrap().to_owned();
    problem["violations"]
        .as_array()
        .unwrap()
        .iter()
        .map(|violation| {
            let [field, value, allowed] =
                ["field", "value", "allowed"].map(|key| text(violation, key));
            format!("{field} is {value}, allowed: {allowed}")
        })
        .collect()
}

#[tokio::test]
async fn a_model_that_does_not_fit_its_data_is_refused_with_both_numbers() {
    let server = Server::start().await;
    // 10 trajectories of 400 samples.
    let data = server.submitted(&small_simulation(1)).await;
    let data = json!({"dataset": data["dataset"]});
    let cases = [
        (
            json!({"context": 400}),
            "context is 400, allowed: less than the data's samples, which are 400",
        ),
        (
            json!({"context": 385, "model": {"preset": "robomorph-tiny", "patch": 7}}),
            "model.patch is 7, allowed: a divisor of the horizon, which is 15 samples",
        ),
        (
            json!({"model": {"preset": "diffuser-tiny", "multipliers": [1, 1, 1, 1, 1, 1]}}),
            "model is a U-Net of stride 32, allowed: one whose stride divides the data's samples, \
             which are 400",
        ),
        (
            json!({"model": {"preset": "cdcnn-tiny", "widths": [16, 16, 16, 16, 16, 16]}}),
            "model is a U-Net of stride 32, allowed: one whose stride divides the data's samples, \
             which are 400",
        ),
        (
            json!({"batch_size": 10}),
            "batch_size is 10, allowed: at most the number of training trajectories, which is 9",
        ),
        (
            json!({"early_stop": {}, "validation_fraction": 0.01}),
            "validation_fraction is 0.01, allowed: a larger value: early_stop needs trajectories to \
             validate with, and this keeps 0 of 10",
        ),
    ];
    for (fields, expected) in cases {
        let mut spec = small_training(&data);
        for (key, value) in fields.as_object().unwrap() {
            spec[key] = value.clone();
        }
        assert_eq!(refused(&server, &spec).await, [expected], "{fields}");
    }
}

#[tokio::test]
async fn sizes_of_a_model_that_do_not_divide_are_refused_with_both_numbers() {
    let server = Server::start().await;
    let data = json!({"stream": {"preset": "D1-chirp"}});
    let cases = [
        (json!({"preset": "robomorph-tiny", "heads": 5}), ["model.d_model is 64", "which is 5"]),
        (json!({"preset": "cdt-tiny", "heads": 7}), ["model.d_model is 48", "which is 7"]),
        (json!({"preset": "cdt-tiny", "d_model": 45, "heads": 5}), ["model.d_model is 45", "of 2"]),
        (json!({"preset": "diffuser-tiny", "width": 20}), ["model.width is 20", "which are 8"]),
        (json!({"preset": "cdcnn-tiny", "widths": [12]}), ["model.widths[0] is 12", "which are 8"]),
        (json!({"preset": "robomorph-tiny", "patch": 3}), ["context is 320", "which is 3"]),
    ];
    for (model, parts) in cases {
        let mut spec = small_training(&data);
        spec["model"] = model.clone();
        let found = refused(&server, &spec).await;
        for part in parts {
            assert!(found[0].contains(part), "{model}: {found:?} lacks {part:?}");
        }
    }
    let mut parts = small_training(&data);
    parts["gradient_accumulation"] = json!(3);
    let expected = "gradient_accumulation is 3, allowed: a divisor of batch_size, which is 4";
    assert_eq!(refused(&server, &parts).await, [expected]);
}

#[tokio::test]
async fn an_evaluation_of_other_data_than_the_model_is_for_is_refused_with_both_numbers() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    let train = server.submitted(&small_training(&json!({"dataset": data["dataset"]}))).await;
    let grid = |fields: Value| {
        let mut grid = json!({"preset": "grid-chirp"});
        grid.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        json!({"stream": grid})
    };
    let evaluate = |data: Value, context: u32| {
        json!({"kind": "evaluate", "data": data, "context": context,
               "checkpoints": [{"digest": train["digest"]}]})
    };
    let field = "checkpoints[0] is trained with";
    let asks = "as this evaluation asks";
    assert_eq!(
        refused(&server, &evaluate(grid(json!({"rate_hz": 100.0})), 320)).await,
        [format!("{field} rate_hz 60, allowed: rate_hz 100, {asks}")]
    );
    assert_eq!(
        refused(&server, &evaluate(grid(json!({"samples": 500})), 320)).await,
        [format!("{field} samples 400, allowed: samples 500, {asks}")]
    );
    assert_eq!(
        refused(&server, &evaluate(grid(json!({})), 300)).await,
        [format!("{field} context 320, allowed: context 300, {asks}")]
    );
}

/// An app with a warning for batches of more than 8 trajectories.
fn memory_doubts(app: App) -> App {
    app.with_memory_doubts(Arc::new(|training: &TrainSpec, data: &DataSpec| {
        (training.batch_size > 8).then(|| Doubt {
            field: "batch_size".to_owned(),
            value: training.batch_size.to_string(),
            reason: format!("too many of {} samples", data.samples()),
        })
    }))
}

#[tokio::test]
async fn a_training_whose_memory_is_doubted_is_warned_about_in_a_pipeline_too() {
    let server = Server::start_app(&Options::default(), memory_doubts).await;
    let mut spec = small_training(&json!({"stream": {"preset": "D1-chirp"}}));
    assert_eq!(server.submitted(&spec).await["warnings"], json!([]));
    spec["batch_size"] = json!(64);
    let warning = "batch_size is 64: too many of 400 samples";
    assert_eq!(server.submitted(&spec).await["warnings"], json!([warning]));

    let mut simulation = small_simulation(1);
    simulation["trajectories"] = json!(80);
    let data = server.submitted(&simulation).await;
    spec["data"] = json!({"dataset": data["dataset"]});
    let pipeline = json!({"kind": "pipeline", "name": "one", "jobs": {"large": spec}});
    let pipeline = server.submitted(&pipeline).await;
    let found = pipeline["warnings"][0].as_str().unwrap();
    assert!(found.starts_with("jobs.large.batch_size is 64: too many of "), "{found}");
}

#[tokio::test]
async fn a_training_that_nothing_validates_is_warned_about() {
    let server = Server::start().await;
    let mut simulation = small_simulation(1);
    simulation["trajectories"] = json!(4);
    let data = server.submitted(&simulation).await;
    let mut spec = small_training(&json!({"dataset": data["dataset"]}));
    let warning = "validation_fraction is 0.1: this keeps 0 of 4 trajectories, so nothing validates the training and \
                   no checkpoint is the best; 0.125 keeps one";
    assert_eq!(server.submitted(&spec).await["warnings"], json!([warning]));
    spec["validation_fraction"] = json!(0.125);
    spec["batch_size"] = json!(3);
    assert_eq!(server.submitted(&spec).await["warnings"], json!([]));
}

#[tokio::test]
async fn a_checkpoint_that_is_not_the_final_one_is_evaluated_itself_and_the_best_by_name() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    let [training, grid] = ["train", "test-grid"].map(|name| {
        let members = pipeline["members"].as_array().unwrap();
        members.iter().find(|member| member["name"] == name).unwrap()["job"].clone()
    });
    let task = loop {
        let task = server.claim().await.unwrap();
        if task.kind == spec::JobKind::Train.as_str() {
            break task;
        }
        server.finish(&task).await;
    };
    let marked = |step: u64, is_best: bool, is_final: bool| {
        let metrics = BTreeMap::from([("validation/rmse_deg".to_owned(), 2.5)]);
        NewCheckpoint { step, is_final, is_best, metrics, files: Vec::new() }
    };
    server.keep(&task, marked(20, true, false)).await;
    server.keep(&task, marked(40, false, false)).await;
    server.keep(&task, marked(100, false, true)).await;
    server.store.complete(task.fence, None).await.unwrap();
    server.work().await;

    let ids = server.json(&format!("/v1/jobs/{training}")).await["checkpoints"].clone();
    let mut found = Vec::new();
    for id in ids.as_array().unwrap() {
        found.push(server.json(&format!("/v1/checkpoints/{id}")).await);
    }
    let marks: Vec<Value> = found
        .iter()
        .map(|checkpoint| {
            json!([checkpoint["step"], checkpoint["best"], checkpoint["last"], checkpoint["final"]])
        })
        .collect();
    let expected = [
        json!([20, true, false, false]),
        json!([40, false, false, false]),
        json!([100, false, true, true]),
    ];
    assert_eq!(marks, expected);
    assert_eq!(found[0]["metrics"], json!({"validation/rmse_deg": 2.5}));
    let page = server.get(&format!("/checkpoints/{}", found[0]["id"])).await;
    assert!(page.text().contains("step 20, best"), "{}", page.text());

    let grid = server.json(&format!("/v1/jobs/{grid}")).await["dataset"].clone();
    let digest = &found[0]["digest"];
    let evaluate = |checkpoints: Value| {
        json!({"kind": "evaluate", "data": {"dataset": grid}, "baselines": [],
               "checkpoints": checkpoints})
    };
    let references = json!([
        {"checkpoint": found[1]["id"]}, {"checkpoint": found[2]["id"]},
        {"best": {"digest": digest}}, {"step": {"digest": digest, "step": 20}},
    ]);
    let evaluation = server.submitted(&evaluate(references)).await;
    let resolved = json!([
        {"step": {"digest": digest, "step": 40}}, {"digest": digest},
        {"best": {"digest": digest}}, {"step": {"digest": digest, "step": 20}},
    ]);
    assert_eq!(evaluation["spec"]["checkpoints"], resolved);

    let gone = evaluate(json!([{"step": {"digest": digest, "step": 30}}]));
    let refusal = refused(&server, &gone).await;
    assert!(refusal[0].starts_with("checkpoints[0].step is "), "{refusal:?}");
    assert!(refusal[0].contains("after step 30"), "{refusal:?}");
}
