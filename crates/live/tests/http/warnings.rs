//! Warnings about data that differs from a checkpoint's training data.

use serde_json::{Value, json};

use crate::fixture::{CONTEXT, HORIZON, JOINTS, Server, rows, scenario};
use crate::streams::{ask, connect, step};

/// Kind, joint and message.
fn told(answer: &Value) -> Vec<(String, u64, String)> {
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let warnings = answer["warnings"].as_array().cloned().unwrap_or_default();
    let of = |warning: &Value| {
        (
            text(&warning["kind"]),
            warning["joint"].as_u64().unwrap_or_default(),
            text(&warning["message"]),
        )
    };
    warnings.iter().map(of).collect()
}

#[tokio::test]
async fn torques_beyond_the_trainings_are_told_with_both_numbers() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint_of_ranges("cdt", [-2.8, 2.8], [-1.0, 1.0], 1e6).await;
    let mut question = json!({"scenarios": [scenario(0.2), scenario(0.4)]});
    let (status, answer) = server.predict(checkpoint, &question).await;
    assert_eq!((status.as_u16(), told(&answer)), (200, Vec::new()));

    // The last torque of the horizon.
    question["scenarios"][1]["future_u"][HORIZON - 1][1] = json!(-30.1);
    let (_, answer) = server.predict(checkpoint, &question).await;
    let expected =
        "u of joint 2 reaches -30.1 N·m; the checkpoint was trained on -2.80 to 2.80 N·m";
    assert_eq!(told(&answer), [("torque-range".to_owned(), 2, expected.to_owned())]);
    assert_eq!(answer["warnings"][0]["scenarios"], 1);
}

#[tokio::test]
async fn a_prediction_beyond_the_limits_and_a_context_at_rest_are_told_of() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint_of_ranges("cdt", [-9.0, 9.0], [-9.0, 9.0], 1e-9).await;
    let (_, answer) = server.predict(checkpoint, &json!({"scenarios": [scenario(0.2)]})).await;
    let joints: Vec<u64> = told(&answer)
        .iter()
        .map(|(kind, joint, message)| {
            assert!(kind == "joint-limits" && message.contains("its limits are"), "{message}");
            *joint
        })
        .collect();
    assert_eq!(joints, (1..=JOINTS as u64).collect::<Vec<_>>());

    let checkpoint = server.checkpoint("cdt").await;
    let rest = json!({
        "u": rows(CONTEXT, 0.0), "y": rows(CONTEXT, 0.0), "future_u": rows(HORIZON, 1.0),
    });
    let (_, answer) = server.predict(checkpoint, &json!({"scenarios": [rest]})).await;
    assert_eq!(
        told(&answer).iter().map(|warning| warning.0.as_str()).collect::<Vec<_>>(),
        ["no-motion"]
    );
}

#[tokio::test]
async fn a_checkpoint_that_does_not_say_what_it_was_trained_on_warns_of_no_range() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let (_, answer) = server.predict(checkpoint, &json!({"scenarios": [scenario(50.0)]})).await;
    assert_eq!(told(&answer), []);
}

#[tokio::test]
async fn a_stream_warns_once_of_each_joint() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint_of_ranges("cdt", [-0.1, 0.1], [-9.0, 9.0], 1e6).await;
    let mut socket = connect(&server, checkpoint).await;
    ask(&mut socket, &json!({"open": {}})).await;
    let first = ask(&mut socket, &step(0, CONTEXT)).await["prediction"].take();
    assert_eq!(told(&first).len(), JOINTS, "{first}");
    for sample in CONTEXT..CONTEXT + 3 {
        let next = ask(&mut socket, &step(sample, 1)).await["prediction"].take();
        assert_eq!(told(&next), []);
    }
    ask(&mut socket, &json!({"reset": {}})).await;
    let again = ask(&mut socket, &step(0, CONTEXT)).await["prediction"].take();
    assert_eq!(told(&again), []);
}
