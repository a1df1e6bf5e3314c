//! Arms under a controller, from data to report.

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, member};

/// A few samples of `panda-real`, with other references for each seed.
fn data(trajectories: u32, seed: u32, excitation: &Value) -> Value {
    json!({
        "preset": "panda-real", "trajectories": trajectories, "samples": 60, "seed": seed,
        "excitation": excitation,
    })
}

#[tokio::test]
async fn models_and_baselines_answer_for_arms_under_a_controller() {
    let grid = json!({
        "fourier": {"frequency_hz": {"grid": [0.2]}},
        "point_to_point": {"frequency_hz": {"grid": [0.5, 1.0]}},
        "via_points": {"frequency_hz": {"grid": [1.0]}},
    });
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let pipeline = json!({
        "kind": "pipeline", "name": "controlled", "jobs": {
            "data": data(40, 1, &json!({})),
            "verify": {"kind": "verify", "data": {"job": "data"}},
            "train": {
                "kind": "train", "data": {"job": "data"}, "context": 40, "batch_size": 8,
                "steps": 4, "optimizer": {"warmup_steps": 0}, "model": {"preset": "lagrangian-tiny"},
            },
            "evaluate": {
                "kind": "evaluate", "data": {"stream": data(8, 9, &grid)}, "context": 40,
                "horizons_s": [0.1, 0.3], "checkpoints": [{"job": "train"}],
                "bootstrap": {"resamples": 100},
            },
            "control": {
                "kind": "control", "data": {"stream": data(3, 9, &json!({}))}, "context": 40,
                "duration_s": 0.3, "robots": 3, "checkpoints": [{"job": "train"}],
                "bootstrap": {"resamples": 100},
            },
        },
    });
    let id = product.submit(&pipeline).await;
    let pipeline = product.succeeded(id).await;
    control_of(&product, &pipeline).await;

    let simulated = product.get(&format!("/v1/jobs/{}", member(&pipeline, "data"))).await;
    let path = format!("/v1/datasets/{}/files/dataset.json", simulated["dataset"]);
    let columns = product.get(&path).await["columns"].to_string();
    for name in ["r1", "r7", "q_measured7", "reference", "controller"] {
        assert!(columns.contains(&format!("\"{name}\"")), "{name}: {columns}");
    }

    let evaluation = member(&pipeline, "evaluate");
    let report = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    assert_eq!(report["failures"], json!([]));
    let run = product.get(&format!("/v1/jobs/{evaluation}")).await["run"].clone();
    let metrics = product.get(&format!("/v1/runs/{run}")).await["metrics"].clone();
    for group in report["groups"].as_array().unwrap() {
        for rmse in group["rmse_deg"].as_array().unwrap() {
            let key = format!("{}/{}/rmse_deg", group["name"], rmse["predictor"]).replace('"', "");
            assert_eq!(metrics[&key]["value"], rmse["mean"], "{key}: {metrics}");
        }
    }
    let cells: Vec<(&str, f64)> = report["cells"]
        .as_array()
        .unwrap()
        .iter()
        .map(|cell| (cell["family"].as_str().unwrap(), cell["frequency_hz"].as_f64().unwrap()))
        .collect();
    let expected =
        [("fourier", 0.2), ("point-to-point", 0.5), ("point-to-point", 1.0), ("via-points", 1.0)];
    assert_eq!(cells, expected);
}

/// Every predictor adds torques to those of the controllers, and the page shows how far that helps.
async fn control_of(product: &Product, pipeline: &Value) {
    let id = member(pipeline, "control");
    let job = product.get(&format!("/v1/jobs/{id}")).await;
    let artifact = |name: &str| format!("/v1/runs/{}/artifacts/{name}", job["run"]);
    let report = product.get(&artifact("report.json")).await;
    let controllers = report["controllers"].as_array().unwrap();
    let names: Vec<&str> =
        controllers.iter().map(|controller| controller["name"].as_str().unwrap()).collect();
    let baselines =
        ["zero-torque", "damped-integrator", "nominal-simulator", "identification", "oracle"];
    assert_eq!(names[..5], baselines);
    assert!(names[5].starts_with("lagrangian"), "{names:?}");
    let rms = |k: usize| controllers[k]["rms_deg"]["mean"].as_f64().unwrap();
    assert!(rms(4) < rms(2) && rms(2) < rms(0), "{report:#}");
    assert_eq!(controllers[4]["oracle_share"], 1.0);
    assert_eq!(controllers[5]["failed"], 0, "{report:#}");
    assert!(report.get("planner").is_none());
    let page = product.get(&format!("/jobs/{id}")).await.to_string();
    for part in ["of the way to oracle", "under its own controller", "tracking.svg"] {
        assert!(page.contains(part), "{part}: {page}");
    }
    let motions = String::from_utf8(product.download(&artifact("robot-00.csv")).await).unwrap();
    // A header, and six controllers for 18 samples.
    assert_eq!(motions.lines().count(), 1 + 6 * 18);
}

#[tokio::test]
async fn a_path_beside_references_and_references_without_a_controller_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let control = json!({
        "kind": "control", "data": {"stream": data(2, 1, &json!({}))}, "robots": 2, "context": 40,
        "duration_s": 0.3, "path": {"swing": {"frequency_hz": vec![0.4; 7]}},
    });
    let mut open_loop = data(2, 1, &json!({}));
    open_loop["controller"] = Value::Null;
    for (spec, part) in [(control, "path"), (open_loop, "references need a controller")] {
        let (status, answer) = product.post("/v1/jobs", spec.to_string()).await;
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{answer}");
        assert!(answer.to_string().contains(part), "{answer}");
    }
}

#[tokio::test]
async fn models_and_baselines_predict_from_references_told_the_controller_or_not() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let train = json!({
        "kind": "train", "given": "references", "context": 40, "batch_size": 8, "steps": 60,
        "optimizer": {"warmup_steps": 0, "learning_rate": 0.002},
        "model": {"preset": "robomorph-tiny", "patch": 4, "residual": "reference"},
    });
    let on = |data: Value| {
        let mut train = train.clone();
        train["data"] = data;
        train
    };
    let baselines = [
        "hold-last",
        "constant-velocity",
        "follow-reference",
        "least-squares",
        "arx",
        "nominal-simulator",
        "oracle",
    ];
    let evaluate = |data: Value| {
        json!({
            "kind": "evaluate", "data": data, "context": 40, "given": "references",
            "baselines": baselines,
            "checkpoints": [{"job": "train"}, {"job": "streamed"}],
            "bootstrap": {"resamples": 100},
        })
    };
    let same = data(40, 1, &json!({}));
    let pipeline = json!({
        "kind": "pipeline", "name": "references", "jobs": {
            "data": same,
            "train": on(json!({"job": "data"})),
            "streamed": on(json!({"stream": data(40, 1, &json!({}))})),
            "stored": evaluate(json!({"job": "data"})),
            "simulated": evaluate(json!({"stream": same})),
        },
    });
    let id = product.submit(&pipeline).await;
    let pipeline = product.succeeded(id).await;
    let report = async |name: &str| {
        let evaluation = member(&pipeline, name);
        product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone()
    };
    let [stored, simulated] = [report("stored").await, report("simulated").await];
    assert_eq!((&stored["given"], &stored["failures"]), (&json!("references"), &json!([])));
    // The dataset and the stream have the same robots, references and noise.
    assert_eq!(stored["groups"], simulated["groups"]);
    let names: Vec<&str> = stored["predictors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|predictor| predictor["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, [&baselines[..], &["train", "streamed"]].concat());
    let rmse = |place: usize| stored["groups"][0]["rmse_deg"][place]["mean"].as_f64().unwrap();
    assert!(rmse(2) < 0.5 * rmse(0), "the reference tells where the arm goes: {stored:#}");
    assert!(rmse(6) < 0.1 * rmse(5), "a known controller moves its own robot: {stored:#}");

    let training = product.get(&format!("/v1/jobs/{}", member(&pipeline, "train"))).await;
    let id = training["checkpoints"].as_array().unwrap().last().unwrap().clone();
    let config = product.get(&format!("/v1/checkpoints/{id}/files/config.json")).await;
    assert_eq!(
        (&config["given"], &config["ranges"]["given"]),
        (&json!("references"), &json!("references"))
    );
    let control = json!({
        "kind": "control", "checkpoints": [{"checkpoint": id}], "robots": 2, "context": 40,
        "data": {"stream": {"preset": "D1-multisine", "trajectories": 2, "samples": 60}},
        "planner": {"horizon": 20},
    });
    let (status, answer) = product.post("/v1/jobs", control.to_string()).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{answer}");
    assert!(answer.to_string().contains("given references"), "{answer}");
}
