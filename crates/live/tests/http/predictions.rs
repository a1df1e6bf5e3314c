//! Tests of single predictions.

use models::{Sampling, TrainedModel};
use serde_json::{Value, json};
use series::{MeasurementNoise, Series, Shape};
use spec::{SamplerKind, SamplerSpec};

use crate::fixture::{
    CONTEXT, HORIZON, JOINTS, Server, fields, model, numbers, rows, scenario, scenario_of, twins,
};

/// Two scenarios as the model's own input.
fn input(context: usize, horizon: usize) -> Series {
    let of = |scale: f32| (rows(context + horizon, 3.0 * scale), rows(context, scale));
    let (first, second) = (of(0.2), of(0.4));
    let shape = Shape { robots: 2, samples: context + horizon, joints: JOINTS };
    let [u, y] =
        [[first.0, second.0], [first.1, second.1]].map(|rows| rows.concat().into_flattened());
    Series::question(shape, context, 60.0, u, y).unwrap()
}

fn two() -> Value {
    json!({"scenarios": [scenario(0.2), scenario(0.4)]})
}

/// The same two scenarios as a request, for a model with another context and horizon.
fn two_of(model: &TrainedModel) -> Value {
    let of = |scale| scenario_of(model.context(), model.horizon(), scale);
    json!({"scenarios": [of(0.2), of(0.4)]})
}

#[tokio::test]
async fn what_is_answered_is_what_the_model_says() {
    let server = Server::start().await;
    for twin in twins() {
        let model = model(&twin);
        let checkpoint = server.checkpoint(&twin).await;
        let (status, answer) = server.predict(checkpoint, &two_of(&model)).await;
        assert_eq!(status, 200, "{answer}");
        let input = input(model.context(), model.horizon());
        let expected = model.predict(&input.observed(model.context())).unwrap();
        let found: Vec<f32> = answer["scenarios"]
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|scenario| numbers(&scenario["y"]))
            .collect();
        assert_eq!(found, expected, "{twin}");
        assert_eq!(answer["checkpoint"], checkpoint);
        assert_eq!(answer["weights"].as_str().unwrap().len(), 64);
        assert_eq!((&answer["device"], &answer["threads"]), (&json!("cpu"), &json!(2)));
        assert!(answer["latency_ms"]["compute"].as_f64().unwrap() > 0.0, "{twin}");
        assert!(answer["scenarios"][0].get("samples").is_none());
    }
}

#[tokio::test]
async fn a_law_answers_at_multiples_of_its_rate_as_it_does_in_evaluations() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("lagrangian").await;
    let model = model("lagrangian");
    for multiple in [1, 2, 5] {
        let [context, horizon] = [model.context(), model.horizon()].map(|rows| multiple * rows);
        let rate_hz = 60.0 * multiple as f64;
        let question = json!({
            "scenarios": [scenario_of(context, horizon, 0.2)],
            "rate_hz": rate_hz, "position_noise_rad": 1e-4,
        });
        let (status, answer) = server.predict(checkpoint, &question).await;
        assert_eq!(status, 200, "{answer}");
        assert_eq!(answer["rate_hz"], rate_hz);
        // An evaluation asks the model with the recording's rate.
        let shape = Shape { robots: 1, samples: context + horizon, joints: JOINTS };
        let u = rows(context + horizon, 3.0 * 0.2).into_flattened();
        let y = rows(context, 0.2).into_flattened();
        let recording = Series::question(shape, context, rate_hz, u, y).unwrap();
        let recording = recording.with_noise(MeasurementNoise::new(1e-4, 0.0));
        let expected = model.predict(&recording.observed(context)).unwrap();
        assert_eq!(numbers(&answer["scenarios"][0]["y"]), expected, "{multiple}");
    }
}

#[tokio::test]
async fn a_rate_that_a_model_does_not_answer_at_is_refused_with_those_that_it_does() {
    let server = Server::start().await;
    let law = server.checkpoint("lagrangian").await;
    let network = server.checkpoint("cdt").await;
    let multiples = "60, the checkpoint's rate, or a whole multiple of it up to 1000";
    for (checkpoint, rate_hz, allowed) in [
        (law, json!(90.0), multiples),
        (law, json!(30.0), multiples),
        (law, json!(1020.0), multiples),
        (law, json!(-60.0), multiples),
        (network, json!(120.0), "60, the checkpoint's rate"),
    ] {
        let mut question = two();
        question["rate_hz"] = rate_hz;
        let (status, problem) = server.predict(checkpoint, &question).await;
        assert_eq!((status.as_u16(), fields(&problem)), (422, vec!["rate_hz"]), "{problem}");
        assert_eq!(problem["violations"][0]["allowed"], allowed);
    }
    // Rows are counted at the rate that is asked.
    let mut question = two_of(&model("lagrangian"));
    question["rate_hz"] = json!(120.0);
    let (_, problem) = server.predict(law, &question).await;
    assert_eq!(fields(&problem)[0], "scenarios[0].u", "{problem}");
    let allowed = "16 rows, the checkpoint's context at 120 Hz";
    assert_eq!(problem["violations"][0]["allowed"], allowed);
}

#[tokio::test]
async fn several_futures_share_a_context_and_are_answered_in_their_order() {
    let server = Server::start().await;
    for twin in ["cdt", "lagrangian", "robomorph"] {
        let model = model(twin);
        let checkpoint = server.checkpoint(twin).await;
        let mut repeated = two_of(&model);
        for name in ["u", "y"] {
            repeated["scenarios"][1][name] = repeated["scenarios"][0][name].clone();
        }
        let mut shared = repeated.clone();
        let futures = [0, 1].map(|k| repeated["scenarios"][k]["future_u"].clone());
        let first = shared["scenarios"][0].as_object_mut().unwrap();
        first.remove("future_u");
        first.insert("futures".to_owned(), json!(futures));
        shared["scenarios"].as_array_mut().unwrap().truncate(1);
        let (status, answer) = server.predict(checkpoint, &shared).await;
        assert_eq!(status, 200, "{answer}");
        let (_, expected) = server.predict(checkpoint, &repeated).await;
        assert_eq!(answer["scenarios"].as_array().unwrap().len(), 2);
        assert_eq!(answer["scenarios"], expected["scenarios"], "{twin}");
    }
}

#[tokio::test]
async fn samples_their_mean_and_quantiles_are_those_of_the_seed_and_the_sampler() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let mut question = two();
    question["sampling"] = json!({
        "sampler": {"kind": "ddim", "steps": 3}, "samples": 5, "seed": 11,
        "quantiles": [0.0, 0.5, 1.0], "return_samples": true,
    });
    let (status, answer) = server.predict(checkpoint, &question).await;
    assert_eq!(status, 200, "{answer}");
    let sampler = SamplerSpec { kind: SamplerKind::Ddim, steps: Some(3), ..SamplerSpec::default() };
    let sampling = Sampling { sampler: Some(sampler), seed: 11, samples: 5, ..Sampling::default() };
    let expected =
        model("cdt").sample(&input(CONTEXT, HORIZON).observed(CONTEXT), &sampling).unwrap();
    let row = HORIZON * 7;
    for scenario in 0..2 {
        let told = &answer["scenarios"][scenario];
        let samples: Vec<&[f32]> = expected.chunks(row).skip(scenario).step_by(2).collect();
        assert_eq!(numbers(&told["samples"]), samples.concat());
        for place in [0, row - 1] {
            let mut values: Vec<f32> = samples.iter().map(|sample| sample[place]).collect();
            values.sort_by(f32::total_cmp);
            let mean = values.iter().sum::<f32>() / 5.0;
            assert!((numbers(&told["y"])[place] - mean).abs() < 1e-5);
            let quantiles = told["quantiles"].as_array().unwrap();
            let found: Vec<f32> =
                quantiles.iter().map(|quantile| numbers(&quantile["y"])[place]).collect();
            assert_eq!(found, [values[0], values[2], values[4]]);
        }
    }
}

#[tokio::test]
async fn everything_that_is_wrong_with_a_question_is_named() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let check = async |question: Value, expected: &[&str]| {
        let (status, problem) = server.predict(checkpoint, &question).await;
        assert_eq!(status, 422, "{problem}");
        assert_eq!(problem["type"], "tag:torqued,2026:question");
        assert_eq!(fields(&problem), expected, "{problem}");
    };
    check(json!({"scenarios": []}), &["scenarios"]).await;
    let mut wrong = two();
    wrong["scenarios"][1]["y"].as_array_mut().unwrap().pop();
    wrong["scenarios"][0]["future_u"][3][6] = json!(1e30);
    wrong["sampling"] = json!({"quantiles": [0.1, 1.5], "seed": 9_007_199_254_740_992_u64});
    let expected = [
        "scenarios[0].future_u[3][6]",
        "scenarios[1].y",
        "sampling.samples",
        "sampling.quantiles[1]",
        "sampling.seed",
    ];
    check(wrong, &expected).await;
    let mut wrong = two();
    wrong["scenarios"][0]["u"][2] = json!([1, 2, 3]);
    check(wrong, &["scenarios[0].u[2]"]).await;
    let mut wrong = two();
    wrong["scenarios"][1]["y"][3] = json!([1, 2, 3, 4, 5, 6, 7, 8]);
    check(wrong, &["scenarios[1].y[3]"]).await;
    let mut wrong = two();
    wrong["scenarios"][0]["y"][0][0] = Value::Null;
    check(wrong, &["scenarios[0].y[0][0]"]).await;
    let mut wrong = two();
    wrong["scenarios"][0].as_object_mut().unwrap().remove("future_u");
    check(wrong, &["scenarios[0].future_u"]).await;
    let mut wrong = two();
    let future = wrong["scenarios"][1]["future_u"].clone();
    wrong["scenarios"][1]["futures"] = json!([future]);
    check(wrong.clone(), &["scenarios[1].futures"]).await;
    wrong["scenarios"][1].as_object_mut().unwrap().remove("future_u");
    wrong["scenarios"][1]["futures"][0][3][6] = json!(1e30);
    check(wrong, &["scenarios[1].futures[0][3][6]"]).await;
    let sampling = |sampling: Value| {
        let mut question = two();
        question["sampling"] = sampling;
        question
    };
    check(sampling(json!({"sample": 3})), &["sampling.sample"]).await;
    check(sampling(json!({"samples": 100_000_000})), &["sampling.samples"]).await;
    check(sampling(json!({"samples": 0})), &["sampling.samples"]).await;
    let question = sampling(json!({"sampler": {"kind": "ddim", "steps": 21}}));
    check(question, &["sampling.sampler.steps"]).await;

    for noise in [-1e-3, 0.2, 1e300] {
        let mut question = two();
        question["position_noise_rad"] = json!(noise);
        check(question, &["position_noise_rad"]).await;
    }

    let (status, problem) = server.predict(checkpoint, &json!([])).await;
    assert!(status == 422, "{problem}");
    let (status, problem) = server.predict(999, &two()).await;
    assert_eq!((status.as_u16(), &problem["title"]), (404, &json!("There is no such resource")));
}

#[tokio::test]
async fn a_model_that_filters_is_told_the_noise() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("lagrangian").await;
    let answer = async |noise: Option<f64>| {
        let mut question = two_of(&model("lagrangian"));
        if let Some(noise) = noise {
            question["position_noise_rad"] = json!(noise);
        }
        let (status, answer) = server.predict(checkpoint, &question).await;
        assert_eq!(status, 200, "{answer}");
        numbers(&answer["scenarios"][0]["y"])
    };
    let plain = answer(None).await;
    assert_eq!(plain, answer(Some(0.0)).await);
    assert_ne!(plain, answer(Some(1e-3)).await);
}

#[tokio::test]
async fn what_is_no_json_or_too_much_of_it_is_refused() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let url = format!("http://{}/v1/checkpoints/{checkpoint}/predict", server.address);
    let send = async |kind: &str, body: Vec<u8>| {
        let request = server.http.post(&url).header("content-type", kind).body(body);
        request.send().await.unwrap().status().as_u16()
    };
    assert_eq!(send("application/json", b"{\"scenarios\": [".to_vec()).await, 400);
    assert_eq!(send("text/plain", b"{}".to_vec()).await, 415);
    assert_eq!(send("application/json", vec![b' '; (8 << 20) + 1]).await, 413);
}

#[tokio::test]
async fn a_model_with_one_answer_has_no_samples_and_removes_no_noise() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("robomorph").await;
    for (sampling, field) in [
        (json!({"samples": 2}), "sampling.samples"),
        (json!({"sampler": {"kind": "ddim"}}), "sampling.sampler"),
    ] {
        let mut question = two_of(&model("robomorph"));
        question["sampling"] = sampling;
        let (status, problem) = server.predict(checkpoint, &question).await;
        assert_eq!(status, 422, "{problem}");
        assert_eq!(fields(&problem), [field]);
    }
}

#[tokio::test]
async fn a_model_that_fails_says_so_and_the_others_go_on() {
    let server = Server::start().await;
    let exploded = server.exploded_checkpoint("cdt").await;
    let damaged = server.keep(b"no tensors", b"{}").await;
    let leaky = server.leaky_checkpoint("cdt").await;
    let sound = server.checkpoint("cdt").await;
    for (checkpoint, status, kind, words) in [
        (exploded, 500, "model-failed", "not finite"),
        (damaged, 500, "model-unusable", "has no format_version"),
        (leaky, 422, "question", "look into the horizon"),
    ] {
        let (found, problem) = server.predict(checkpoint, &two()).await;
        assert_eq!(found.as_u16(), status, "{problem}");
        assert_eq!(problem["type"], format!("tag:torqued,2026:{kind}"));
        assert!(problem["detail"].as_str().unwrap().contains(words), "{problem}");
    }
    assert_eq!(server.predict(sound, &two()).await.0, 200);
}

/// Regression: a damaged checkpoint was answered with an internal error that named nothing.
#[tokio::test]
async fn a_damaged_checkpoint_is_named_with_its_file() {
    let server = Server::start().await;
    for file in [models::MODEL_FILE, models::CONFIG_FILE] {
        let checkpoint = server.checkpoint("cdt").await;
        server.damage(checkpoint, file).await;
        let (status, problem) = server.predict(checkpoint, &two()).await;
        assert_eq!(status, 500, "{problem}");
        assert_eq!(problem["type"], "tag:torqued,2026:damaged");
        let named = format!("{file} of checkpoint {checkpoint} is damaged");
        assert!(problem["detail"].as_str().unwrap().starts_with(&named), "{problem}");
        assert_eq!(crate::streams::refusal(&server, checkpoint, &[]).await, 500);
    }
    let sound = server.checkpoint("cdt").await;
    assert_eq!(server.predict(sound, &two()).await.0, 200);
}

#[tokio::test]
async fn a_model_that_finds_no_room_waits_for_those_in_use_to_be_let_go() {
    // There is room for one CDT of 23 676 bytes, but not for a CDCNN of 80 188.
    let server = Server::start_with(&api::Options::default(), 30_000).await;
    let first = server.checkpoint("cdt").await;
    let second = server.checkpoint("robomorph").await;
    let of_second = two_of(&model("robomorph"));
    let large = server.checkpoint("cdcnn").await;
    for (checkpoint, question) in [(first, &two()), (second, &of_second), (first, &two())] {
        let (status, answer) = server.predict(checkpoint, question).await;
        assert_eq!(status, 200, "{answer}");
    }
    let (status, problem) = server.predict(large, &two()).await;
    assert_eq!(status, 507, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("80188 bytes"), "{problem}");

    let stream = crate::streams::connect(&server, first).await;
    let (status, problem) = server.predict(second, &of_second).await;
    assert_eq!((status.as_u16(), &problem["type"]), (503, &json!("tag:torqued,2026:crowded")));
    drop(stream);
    let mut status = status;
    for _ in 0..500 {
        status = server.predict(second, &of_second).await.0;
        if status == 200 {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    assert_eq!(status, 200);
}

#[tokio::test]
async fn an_alias_predicts_and_opens_a_stream() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let patch = server.http.patch(format!("http://{}/v1/checkpoints/{checkpoint}", server.address));
    let patch = patch.header("content-type", "application/json");
    let labelled = patch.body(r#"{"add_aliases": ["champion"]}"#).send().await.unwrap();
    assert_eq!(labelled.status(), 200);
    let (_, by_id) = server.predict(checkpoint, &two()).await;
    let (status, by_alias) = server.post("/v1/checkpoints/champion/predict", &two()).await;
    assert_eq!(status, 200, "{by_alias}");
    assert_eq!(by_alias["scenarios"], by_id["scenarios"]);
    let mut socket = crate::streams::connect(&server, "champion").await;
    let opened = crate::streams::ask(&mut socket, &json!({"open": {}})).await;
    assert_eq!(opened["opened"]["checkpoint"], checkpoint, "{opened}");
}
