//! The torques that motions take, over HTTP and WebSocket.

use serde_json::{Value, json};
use series::{JointMotion, Series, Shape};

use crate::fixture::{self, JOINTS, Server, fields, model, numbers, rows};
use crate::streams::{ask, connect};

/// Context length of the twin of a `lagrangian`.
const CONTEXT: usize = 8;

fn motion(instants: usize, scale: f32) -> Value {
    json!({
        "q": rows(instants, scale), "qd": rows(instants, 2.0 * scale), "qdd": rows(instants, 5.0 * scale),
    })
}

fn scenario(scale: f32, instants: usize) -> Value {
    json!({
        "u": rows(CONTEXT, 3.0 * scale), "y": rows(CONTEXT, scale), "motion": motion(instants, scale),
    })
}

/// The torques that the model itself says for a motion after a context.
fn expected(context_scale: f32, instants: usize, scale: f32) -> Vec<f32> {
    expected_at(1, context_scale, instants, scale)
}

/// The same after a context of `multiple` times the rate.
fn expected_at(multiple: usize, context_scale: f32, instants: usize, scale: f32) -> Vec<f32> {
    let wide = |scale: f32| -> Vec<f64> {
        rows(instants, scale).into_iter().flatten().map(f64::from).collect()
    };
    let motion = JointMotion::new(JOINTS, wide(scale), wide(2.0 * scale), wide(5.0 * scale));
    let context = multiple * CONTEXT;
    let shape = Shape { robots: 1, samples: context + 1, joints: JOINTS };
    let mut u = rows(context, 3.0 * context_scale);
    u.push(u[context - 1]);
    let (u, y) = (u.into_flattened(), rows(context, context_scale).into_flattened());
    let series = Series::question(shape, context, 60.0 * multiple as f64, u, y).unwrap();
    let said = model("lagrangian").torques(&series.observed(context), &[motion.unwrap()]);
    said.unwrap().unwrap().remove(0)
}

#[tokio::test]
async fn torques_are_those_of_the_model_and_the_robot_of_a_context_is_remembered() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("lagrangian").await;
    let path = format!("/v1/checkpoints/{checkpoint}/torque");
    let question = json!({"scenarios": [scenario(0.2, 5), scenario(0.4, 1)]});
    let (status, answer) = server.post(&path, &question).await;
    assert_eq!(status, 200, "{answer}");
    for (index, instants, scale) in [(0, 5, 0.2), (1, 1, 0.4)] {
        let said = numbers(&answer["scenarios"][index]["u"]);
        assert_eq!(said, expected(scale, instants, scale));
    }
    assert_eq!(answer["checkpoint"], checkpoint);
    assert!(answer["latency_ms"]["queue"].as_f64().unwrap() > 0.0);
    // Another motion after the same contexts waits for no computation.
    let other = json!({"scenarios": [scenario(0.2, 9), scenario(0.4, 2)]});
    let (_, again) = server.post(&path, &other).await;
    assert_eq!(again["latency_ms"]["queue"], 0.0, "{again}");
    assert_eq!(numbers(&again["scenarios"][0]["u"]), expected(0.2, 9, 0.2));
    // Robots that were fitted are asked again without their contexts.
    assert_eq!(again["fit"], answer["fit"]);
    let of = |instants: usize| json!({"motion": motion(instants, 0.2)});
    let known = json!({"fit": answer["fit"], "scenarios": [of(9), of(3)]});
    let (status, again) = server.post(&path, &known).await;
    assert_eq!(status, 200, "{again}");
    assert_eq!(numbers(&again["scenarios"][0]["u"]), expected(0.2, 9, 0.2));
    assert_eq!(numbers(&again["scenarios"][1]["u"]), expected(0.4, 3, 0.2));
    for (question, field) in [
        (json!({"fit": "0".repeat(64), "scenarios": [of(1), of(1)]}), "fit"),
        (json!({"fit": answer["fit"], "scenarios": [of(1)]}), "fit"),
        (json!({"fit": answer["fit"], "scenarios": [of(1), scenario(0.4, 1)]}), "scenarios[1].u"),
        (json!({"scenarios": [of(1)]}), "scenarios[0].u"),
    ] {
        let (status, answer) = server.post(&path, &question).await;
        assert_eq!((status.as_u16(), fields(&answer)[0]), (422, field), "{answer}");
    }
}

#[tokio::test]
async fn torques_after_a_context_of_a_higher_rate_are_those_of_the_model_there() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("lagrangian").await;
    let path = format!("/v1/checkpoints/{checkpoint}/torque");
    let mut longer = scenario(0.2, 3);
    longer["u"] = json!(rows(2 * CONTEXT, 3.0 * 0.2));
    longer["y"] = json!(rows(2 * CONTEXT, 0.2));
    let (_, problem) = server.post(&path, &json!({"scenarios": [longer]})).await;
    assert_eq!(fields(&problem), ["scenarios[0].u", "scenarios[0].y"], "{problem}");
    let (status, answer) =
        server.post(&path, &json!({"scenarios": [longer], "rate_hz": 120})).await;
    assert_eq!((status.as_u16(), &answer["rate_hz"]), (200, &json!(120.0)), "{answer}");
    assert_eq!(numbers(&answer["scenarios"][0]["u"]), expected_at(2, 0.2, 3, 0.2));
    let (_, problem) = server.post(&path, &json!({"scenarios": [longer], "rate_hz": 100})).await;
    assert_eq!(fields(&problem), ["rate_hz"], "{problem}");
}

#[tokio::test]
async fn a_question_for_torques_is_refused_with_all_that_is_wrong_with_it() {
    let server = Server::start().await;
    let law = server.checkpoint("lagrangian").await;
    let network = server.checkpoint("cdt").await;
    let ask = async |checkpoint: i64, question: Value| {
        server.post(&format!("/v1/checkpoints/{checkpoint}/torque"), &question).await
    };
    let mut longer = scenario(0.2, 1);
    longer["u"] = json!(rows(fixture::CONTEXT, 0.6));
    longer["y"] = json!(rows(fixture::CONTEXT, 0.2));
    let (status, answer) = ask(network, json!({"scenarios": [longer]})).await;
    assert_eq!((status.as_u16(), fields(&answer)), (422, vec!["checkpoint"]), "{answer}");
    let (status, _) = ask(99, json!({"scenarios": [scenario(0.2, 1)]})).await;
    assert_eq!(status, 404);

    let mut wrong = scenario(0.2, 2);
    wrong["u"] = json!(rows(3, 0.1));
    wrong["motion"]["qd"] = json!(rows(1, 0.1));
    wrong["motion"]["qdd"][1] = json!([1, 2]);
    let (status, answer) = ask(law, json!({"scenarios": [wrong], "position_noise_rad": 1})).await;
    assert_eq!(status, 422, "{answer}");
    let expected = [
        "scenarios[0].u",
        "scenarios[0].motion.qd",
        "scenarios[0].motion.qdd[1]",
        "position_noise_rad",
    ];
    assert_eq!(fields(&answer), expected);
    for (question, field) in [
        (json!({"scenarios": []}), "scenarios"),
        (json!({"scenarios": [scenario(0.1, 0)]}), "scenarios[0].motion.q"),
        (json!({"scenarios": [scenario(0.1, 1001)]}), "scenarios[0].motion.q"),
    ] {
        let (status, answer) = ask(law, question).await;
        assert_eq!((status.as_u16(), fields(&answer)), (422, vec![field]), "{answer}");
    }
    let (status, answer) = ask(law, json!({"scenarios": [{"u": [], "y": []}]})).await;
    assert_eq!(status, 422);
    assert!(answer.to_string().contains("motion"), "{answer}");

    let exploded = server.exploded_checkpoint("lagrangian").await;
    let (status, answer) = ask(exploded, json!({"scenarios": [scenario(0.2, 1)]})).await;
    let kind = answer["type"].as_str().unwrap();
    assert!(status == 500 && kind.ends_with(":model-failed"), "{answer}");
}

#[tokio::test]
async fn a_stream_says_torques_of_the_robot_that_it_fitted_last() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("lagrangian").await;
    let mut stream = connect(&server, checkpoint).await;
    let error = |answer: &Value| fields(&answer["error"]).join(" ");
    let answer = ask(&mut stream, &json!({"motion": motion(1, 0.1)})).await;
    assert_eq!(error(&answer), "motion");
    ask(&mut stream, &json!({"open": {}})).await;
    let answer = ask(&mut stream, &json!({"fit": {}})).await;
    assert_eq!(error(&answer), "fit");
    let step = json!({"step": {"u": rows(CONTEXT, 3.0 * 0.2), "y": rows(CONTEXT, 0.2)}});
    ask(&mut stream, &step).await;
    let fitted = ask(&mut stream, &json!({"fit": {}})).await;
    assert!(fitted["fitted"]["latency_ms"]["total"].as_f64().unwrap() > 0.0, "{fitted}");

    let answer = ask(&mut stream, &json!({"motion": motion(3, 0.1)})).await;
    assert_eq!(numbers(&answer["torques"]["u"]), expected(0.2, 3, 0.1));
    assert_eq!(answer["torques"]["age"], 0);
    // New samples do not change the robot until the next fit.
    ask(&mut stream, &json!({"step": {"u": rows(2, 1.0), "y": rows(2, 1.0)}})).await;
    let answer = ask(&mut stream, &json!({"motion": motion(3, 0.1)})).await;
    assert_eq!(numbers(&answer["torques"]["u"]), expected(0.2, 3, 0.1));
    assert_eq!(answer["torques"]["age"], 2);
    ask(&mut stream, &json!({"fit": {}})).await;
    let answer = ask(&mut stream, &json!({"motion": motion(3, 0.1)})).await;
    assert_ne!(numbers(&answer["torques"]["u"]), expected(0.2, 3, 0.1));
    let answer = ask(&mut stream, &json!({"motion": {"q": [[1]], "qd": [], "qdd": []}})).await;
    assert!(error(&answer).contains("motion.q[0]"), "{answer}");
    ask(&mut stream, &json!({"reset": {}})).await;
    let answer = ask(&mut stream, &json!({"motion": motion(1, 0.1)})).await;
    assert_eq!(error(&answer), "motion");

    let network = server.checkpoint("cdt").await;
    let mut stream = connect(&server, network).await;
    ask(&mut stream, &json!({"open": {}})).await;
    ask(&mut stream, &step).await;
    ask(&mut stream, &step).await;
    let answer = ask(&mut stream, &json!({"fit": {}})).await;
    assert_eq!(error(&answer), "checkpoint");
}
