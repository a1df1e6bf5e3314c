//! What checkpoints predict for a stored trajectory is what an evaluation says about it.

use serde_json::{Value, json};

use crate::product::{Product, member, run_to_end, torqued};

fn training(preset: &str) -> Value {
    json!({
        "kind": "train", "data": {"job": "data"}, "context": 40, "model": {"preset": preset},
        "batch_size": 8, "steps": 10, "validate_every_steps": 10, "validation_trajectories": 8,
        "optimizer": {"warmup_steps": 0},
    })
}

fn pipeline() -> Value {
    json!({
        "kind": "pipeline", "name": "looked at", "jobs": {
            "data": {
                "preset": "D1-multisine", "samples": 60, "trajectories": 24,
                "observations": {"position_noise_rad": 1e-3, "torque_noise_nm": 0.05},
            },
            "law": training("lagrangian-tiny"),
            "denoiser": training("cdt-tiny"),
            "evaluate": {
                "kind": "evaluate", "data": {"job": "data"}, "context": 40,
                "checkpoints": [{"job": "law"}], "baselines": ["hold-last"],
                "bootstrap": {"resamples": 100},
            },
        },
    })
}

/// Checks that the predictions of `law`, the only checkpoint of the evaluation `run`, have the errors
/// that the evaluation told.
async fn check_told(product: &Product, dataset: &Value, law: i64, run: &Value) {
    let drawn = product.get(&format!("/v1/runs/{run}/artifacts/predictions.json")).await;
    for scenario in drawn["scenarios"].as_array().unwrap() {
        let (trajectory, told) = (&scenario["trajectory"], scenario["rmse_deg"].as_f64().unwrap());
        let path = format!(
            "/v1/datasets/{dataset}/trajectories/{trajectory}/predictions?checkpoint={law}&samples=1"
        );
        let found = product.get(&path).await;
        let predictions = found["predictions"].as_array().unwrap();
        let rmse = predictions[0]["rmse_deg"].as_f64().unwrap();
        assert!((rmse - told).abs() < 1e-4 * told, "{rmse}, and the evaluation told {told}");
        assert_eq!((&found["begin"], &found["first"]), (&json!(40), &json!(20)));
        assert_eq!(found["truth"].as_array().unwrap().len(), 40);
        assert_eq!(predictions[1]["name"], "hold-last");
        assert!(
            predictions[1].get("checkpoint").is_none() && predictions[0].get("quantiles").is_none()
        );
    }
}

/// Regression: a law was evaluated at twice its rate, and its predictions of the same trajectories
/// were refused.
#[tokio::test]
async fn a_law_of_half_the_rate_is_viewed_as_it_is_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let mut slow = pipeline();
    let jobs = slow["jobs"].as_object_mut().unwrap();
    jobs["law"]["data"] =
        json!({"stream": {"preset": "D1-multisine", "samples": 30, "rate_hz": 30}});
    jobs["law"]["context"] = json!(20);
    let ended = product.succeeded(product.submit(&slow).await).await;
    let of = async |name: &str, field: &str| {
        product.get(&format!("/v1/jobs/{}", member(&ended, name))).await[field].clone()
    };
    let (dataset, run) = (of("data", "dataset").await, of("evaluate", "run").await);
    let law = of("law", "checkpoints").await.as_array().unwrap().last().unwrap().as_i64().unwrap();
    check_told(&product, &dataset, law, &run).await;

    // Networks answer at their own rate, and a law at no part of it.
    let faster = json!({"preset": "D1-multisine", "samples": 60, "trajectories": 4, "rate_hz": 45});
    let faster = product.succeeded(product.submit(&faster).await).await["dataset"].clone();
    let denoiser = of("denoiser", "checkpoints").await[0].as_i64().unwrap();
    let path = format!("/v1/datasets/{faster}/trajectories/0/predictions");
    let query = format!("?checkpoint={law},{denoiser}");
    let (status, problem) = product.try_get(&format!("{path}{query}")).await;
    assert_eq!(status, 422, "{problem}");
    let allowed: Vec<&Value> =
        problem["violations"].as_array().unwrap().iter().map(|it| &it["allowed"]).collect();
    assert_eq!(
        allowed,
        ["45 Hz, as the trajectory has, or a whole part of it", "45 Hz, as the trajectory has"]
    );
}

#[tokio::test]
async fn a_viewed_prediction_has_the_error_that_the_evaluation_told() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let ended = product.succeeded(product.submit(&pipeline()).await).await;
    let of = async |name: &str, field: &str| {
        product.get(&format!("/v1/jobs/{}", member(&ended, name))).await[field].clone()
    };
    let (dataset, run) = (of("data", "dataset").await, of("evaluate", "run").await);
    let newest = |ids: Value| ids.as_array().unwrap().last().unwrap().as_i64().unwrap();
    let law = newest(of("law", "checkpoints").await);
    let denoiser = newest(of("denoiser", "checkpoints").await);

    check_told(&product, &dataset, law, &run).await;

    // A denoiser has samples, and the steps of its sampler can be chosen.
    let base = format!("/v1/datasets/{dataset}/trajectories/3/predictions");
    let found =
        product.get(&format!("{base}?checkpoint={law},{denoiser}&samples=8&steps=2&seed=5")).await;
    let both = &found["predictions"];
    assert_eq!((&both[0]["checkpoint"], &both[1]["checkpoint"]), (&json!(law), &json!(denoiser)));
    assert_eq!(both[1]["steps"], 2);
    let count = |field: &str| both[1][field].as_array().unwrap().len();
    assert_eq!((count("quantiles"), count("samples"), count("y")), (2, 4, 20));
    let low = &both[1]["quantiles"][0]["y"][19][6];
    let high = &both[1]["quantiles"][1]["y"][19][6];
    assert!(low.as_f64().unwrap() < high.as_f64().unwrap(), "{low} to {high}");

    // The server remembers an answer with the time that it took, and gives it to no other question.
    let ask = async |trajectory: u64, seed: u64| {
        let path = format!("/v1/datasets/{dataset}/trajectories/{trajectory}/predictions");
        let query = format!("checkpoint={denoiser}&samples=8&steps=2&seed={seed}");
        product.get(&format!("{path}?{query}")).await["predictions"][0].clone()
    };
    assert_eq!(ask(3, 5).await, both[1]);
    assert_ne!(ask(3, 6).await["y"], both[1]["y"]);
    assert_ne!(ask(4, 5).await["y"], both[1]["y"]);
}

#[tokio::test]
async fn the_page_and_the_command_show_the_same_errors_and_refuse_what_does_not_fit() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let ended = product.succeeded(product.submit(&pipeline()).await).await;
    let job = |name: &str| member(&ended, name);
    let dataset = product.get(&format!("/v1/jobs/{}", job("data"))).await["dataset"].clone();
    let checkpoints = product.get(&format!("/v1/jobs/{}", job("law"))).await["checkpoints"].clone();
    let law = checkpoints.as_array().unwrap().last().unwrap().clone();

    let base = format!("/v1/datasets/{dataset}/trajectories/3/predictions?checkpoint={law}");
    let found = product.get(&base).await;
    let rmse = found["predictions"][0]["rmse_deg"].as_f64().unwrap();
    let page = format!("/predict?dataset={dataset}&trajectory=3&checkpoint={law}");
    let page = String::from_utf8(product.download(&page).await).unwrap();
    let shown = reports_degrees(rmse);
    assert!(page.contains(&shown), "{shown} is not on the page");
    assert_eq!(page.matches("<metadata>").count(), 8, "the error, and seven joints");
    let arguments = [
        "predict",
        &law.to_string(),
        "--dataset",
        &dataset.to_string(),
        "--trajectory",
        "3",
        "--server",
        &product.url,
    ];
    let (code, table, _) = run_to_end(&mut torqued(&arguments));
    assert!(code == Some(0) && table.contains(&shown) && table.contains("hold-last"), "{table}");

    // A checkpoint's page and the evaluation's lead there.
    let evaluation = product.download(&format!("/evaluations/{}", job("evaluate"))).await;
    let evaluation = String::from_utf8(evaluation).unwrap();
    let link = format!("../predict?dataset={dataset}&#38;trajectory=");
    let worst = evaluation.matches(&format!("<th scope=\"row\"><a href=\"{link}")).count();
    assert!(worst >= 2, "the worst scenario of each predictor: {evaluation}");
    assert_eq!(evaluation.matches(&link).count(), 3 + worst, "{evaluation}");

    for (query, field) in [
        ("&begin=39", "begin"),
        ("&begin=41", "begin"),
        ("&samples=0", "sampling.samples"),
        ("&samples=999999", "sampling.samples"),
    ] {
        let (status, problem) = product.try_get(&format!("{base}{query}")).await;
        assert_eq!(status, 422, "{query}: {problem}");
        assert_eq!(problem["violations"][0]["field"], field, "{problem}");
        let page = format!("/predict?dataset={dataset}&trajectory=3&checkpoint={law}{query}");
        let page = String::from_utf8(product.download(&page).await).unwrap();
        assert!(page.contains("role=\"alert\"") && page.contains("name=\"begin\""), "{query}");
    }
    for (query, status) in [
        ("?checkpoint=1x", 400),
        ("?checkpoint=1,1,1,1,1,1,1,999", 404),
        ("?checkpoint=x", 404),
        ("?checkpoint=1,2,3,4,5,6,7", 400),
        ("?checkpoint=999", 404),
        ("?begin=-1", 400),
        ("?other=1", 400),
    ] {
        let path = format!("/v1/datasets/{dataset}/trajectories/3/predictions{query}");
        assert_eq!(product.try_get(&path).await.0, status, "{query}");
    }
    assert_eq!(
        product.try_get(&format!("/v1/datasets/{dataset}/trajectories/24/predictions")).await.0,
        404
    );
    let alone = product.get(&format!("/v1/datasets/{dataset}/trajectories/0/predictions")).await;
    assert_eq!(
        alone["predictions"].as_array().unwrap().len(),
        1,
        "hold-last, without a checkpoint"
    );
}

/// As tables show degrees: hundredths, and two digits of less.
fn reports_degrees(value: f64) -> String {
    if value >= 0.1 { format!("{value:.2}") } else { format!("{value:.4}") }
}
