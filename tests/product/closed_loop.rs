//! Robots under model predictive control, by a model that this test trains.

use serde_json::{Value, json};

use crate::product::{Product, member, run_to_end, small_pipeline, torqued};

/// The small pipeline's training, and two robots for half a second.
fn closed_loop() -> Value {
    let mut spec = small_pipeline();
    let jobs = spec["jobs"].as_object_mut().unwrap();
    jobs.remove("test-grid");
    jobs.remove("evaluate");
    let robots = json!({"preset": "D1-multisine", "trajectories": 2, "samples": 60, "seed": 77});
    let control = json!({
        "kind": "control",
        "data": {"stream": robots},
        "checkpoints": [{"job": "train"}],
        "robots": 2,
        "context": 40,
        "duration_s": 0.5,
        "path": {"point-to-point": {"displacement_rad": vec![0.2; 7], "duration_s": 0.4}},
        "planner": {"samples": 16, "horizon": 12, "knot_every": 6},
        "bootstrap": {"resamples": 200},
    });
    jobs.insert("control".to_owned(), control);
    spec
}

async fn report(product: &Product, pipeline: &Value) -> Value {
    let job = product.get(&format!("/v1/jobs/{}", member(pipeline, "control"))).await;
    product.get(&format!("/v1/runs/{}/artifacts/report.json", job["run"])).await
}

fn controller<'a>(report: &'a Value, name: &str) -> &'a Value {
    let controllers = report["controllers"].as_array().unwrap();
    controllers
        .iter()
        .find(|controller| controller["name"] == name)
        .unwrap_or_else(|| panic!("{report:#}"))
}

/// The part of a report that does not depend on this machine's speed.
fn without_times(mut report: Value) -> Value {
    for controller in report["controllers"].as_array_mut().unwrap() {
        controller.as_object_mut().unwrap().remove("plan");
    }
    report
}

#[tokio::test]
async fn a_control_job_compares_a_checkpoint_with_simulators_and_shows_it() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let file = data.path().join("spec.json");
    std::fs::write(&file, closed_loop().to_string()).unwrap();
    let mut submit = torqued(&["submit", "--watch", "--server", &product.url]);
    let (code, table, progress) = run_to_end(submit.arg(&file));
    assert_eq!(code, Some(0), "{table}\n{progress}");
    for name in ["zero-torque", "damped-integrator", "nominal-simulator", "oracle", "robomorph"] {
        assert!(table.lines().any(|line| line.starts_with(name)), "{name} is not in\n{table}");
    }

    let id = product.submit(&closed_loop()).await;
    let pipeline = product.succeeded(id).await;
    let report = report(&product, &pipeline).await;
    let rms = |name: &str| controller(&report, name)["rms_deg"]["mean"].as_f64().unwrap();
    assert!(rms("oracle") < 0.5 * rms("zero-torque"), "{report:#}");
    assert!(rms("robomorph").is_finite());
    assert_eq!(report["robots"], 2);
    assert_eq!(report["steps"], 30);
    let robomorph = controller(&report, "robomorph");
    assert!(robomorph["plan"]["threads"].as_u64() >= Some(1), "{robomorph:#}");

    let job = product.get(&format!("/v1/jobs/{}", member(&pipeline, "control"))).await;
    let run = product.get(&format!("/v1/runs/{}", job["run"])).await;
    let artifacts = run["artifacts"].as_array().unwrap();
    let artifacts: Vec<&str> =
        artifacts.iter().map(|artifact| artifact["name"].as_str().unwrap()).collect();
    let expected = [
        "report.json",
        "robot-00.csv",
        "robot-00.svg",
        "robot-01.csv",
        "robot-01.svg",
        "tracking.csv",
        "tracking.svg",
        "trials.csv",
    ];
    assert_eq!(artifacts, expected);
    let motions = product.get(&format!("/v1/runs/{}/artifacts/robot-01.csv", job["run"])).await;
    assert_eq!(motions.as_str().unwrap().lines().count(), 1 + 5 * 30);
    let page = product.get(&format!("/jobs/{}", job["id"])).await;
    for text in ["tracking.svg", "robot-00.svg", "Tracking error, with 95 % intervals", "robomorph"]
    {
        assert!(page.as_str().unwrap().contains(text), "{text} is not in {page}");
    }
}

#[tokio::test]
async fn a_worker_that_dies_in_a_control_job_changes_nothing_of_its_result() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut reports = Vec::new();
    let baselines = json!({
        "kind": "control", "robots": 3, "context": 40, "duration_s": 4.0,
        "data": {"stream": {"preset": "D1-multisine", "trajectories": 3, "samples": 60}},
        "planner": {"samples": 512}, "bootstrap": {"resamples": 200},
    });
    for kills in [0, 2] {
        let (status, job) = product.post("/v1/jobs?force=true", baselines.to_string()).await;
        assert!(status.is_success(), "{job:#}");
        let id = job["id"].as_i64().unwrap();
        for done in 0..kills {
            let begun = |job: &Value| job["progress"]["done"].as_u64() > Some(done * 400);
            product.job_when(id, begun).await;
            product.kill_worker().await;
        }
        let job = product.succeeded(id).await;
        let path = format!("/v1/runs/{}/artifacts/report.json", job["run"]);
        reports.push(without_times(product.get(&path).await));
    }
    assert_eq!(reports[0], reports[1]);
}

#[tokio::test]
async fn a_control_job_that_does_not_fit_its_checkpoint_or_its_robots_is_refused() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let bad = [
        (json!({"planner": {"horizon": 21}}), "at most 20, the horizon of checkpoints[0]"),
        (json!({"context": 39}), "trained with context 40"),
        (json!({"robots": 3}), "at most the data's trajectories, 2"),
        (json!({"duration_s": 0.001}), "duration_s"),
        (json!({"path": {"swing": {"amplitude_rad": vec![3.0; 7]}}}), "limits"),
        (json!({"data": {"job": "train"}}), "a simulate or import job"),
        (
            json!({"data": {"stream": {"preset": "D1-multisine", "robot": {"gravity": "compensated"}}}}),
            "off or on",
        ),
    ];
    for (fields, expected) in bad {
        let mut spec = closed_loop();
        spec["jobs"]["control"]
            .as_object_mut()
            .unwrap()
            .extend(fields.as_object().unwrap().clone());
        let (status, problem) = product.post("/v1/jobs", spec.to_string()).await;
        assert_eq!(status.as_u16(), 422, "{fields}: {problem:#}");
        assert!(problem.to_string().contains(expected), "{expected:?} is not in {problem:#}");
    }
    assert_eq!(product.get("/v1/jobs").await["jobs"], json!([]));
}
