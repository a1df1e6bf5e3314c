//! Predictions with a receding horizon, over WebSocket.

use std::time::{Duration, Instant};

use futures::{SinkExt, StreamExt};
use models::{Sampling, WarmStart};
use serde_json::{Value, json};
use series::{Series, Shape};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

use crate::fixture::{CONTEXT, HORIZON, JOINTS, Server, fields, model, numbers, rows};

type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

async fn try_to_connect(
    server: &Server,
    checkpoint: impl std::fmt::Display,
    headers: &[(&'static str, &str)],
) -> Result<Socket, Error> {
    let url = format!("ws://{}/v1/checkpoints/{checkpoint}/stream", server.address);
    let mut request = url.into_client_request().unwrap();
    for (name, value) in headers {
        request.headers_mut().insert(*name, value.parse().unwrap());
    }
    Ok(connect_async(request).await?.0)
}

pub async fn connect(server: &Server, checkpoint: impl std::fmt::Display) -> Socket {
    try_to_connect(server, checkpoint, &[]).await.unwrap()
}

/// The status with which a handshake is refused.
pub async fn refusal(server: &Server, checkpoint: i64, headers: &[(&'static str, &str)]) -> u16 {
    match try_to_connect(server, checkpoint, headers).await {
        Err(Error::Http(response)) => response.status().as_u16(),
        other => panic!("{other:?}"),
    }
}

async fn next(socket: &mut Socket) -> Message {
    let patience = Duration::from_secs(60);
    tokio::time::timeout(patience, socket.next()).await.unwrap().unwrap().unwrap()
}

pub async fn ask(socket: &mut Socket, message: &Value) -> Value {
    socket.send(Message::text(message.to_string())).await.unwrap();
    serde_json::from_str(next(socket).await.to_text().unwrap()).unwrap()
}

/// Samples of one continuous recording: torques and positions from `first` on.
fn seen(first: usize, count: usize) -> (Vec<[f32; JOINTS]>, Vec<[f32; JOINTS]>) {
    let end = first + count;
    (rows(end, 0.6)[first..].to_vec(), rows(end, 0.2)[first..].to_vec())
}

/// A message with `count` samples from `first` on, which asks for a prediction.
pub fn step(first: usize, count: usize) -> Value {
    let (u, y) = seen(first, count);
    json!({"step": {"u": u, "y": y, "future_u": seen(first + count, HORIZON).0}})
}

/// The model's input after `end` samples.
fn question(end: usize) -> Series {
    let first = end - CONTEXT;
    let shape = Shape { robots: 1, samples: CONTEXT + HORIZON, joints: JOINTS };
    let (u, y) = (seen(first, CONTEXT + HORIZON).0.concat(), seen(first, CONTEXT).1.concat());
    Series::question(shape, CONTEXT, 60.0, u, y).unwrap()
}

#[tokio::test]
async fn each_prediction_begins_with_the_one_before() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let mut socket = connect(&server, checkpoint).await;
    let open = json!({"open": {"warm_start_steps": 4, "sampling": {"seed": 5}}});
    let opened = ask(&mut socket, &open).await["opened"].take();
    assert_eq!((&opened["context"], &opened["filled"]), (&json!(CONTEXT), &json!(0)));
    assert_eq!((&opened["horizon"], &opened["device"]), (&json!(HORIZON), &json!("cpu")));

    let (u, y) = seen(0, 10);
    let filled = ask(&mut socket, &json!({"step": {"u": u, "y": y}})).await;
    assert_eq!(filled, json!({"context": {"filled": 10, "context": CONTEXT}}));

    let model = model("cdt");
    let mut sampling = Sampling { seed: 5, ..Sampling::default() };
    let mut expected = model.sample(&question(16).observed(CONTEXT), &sampling).unwrap();
    let told = ask(&mut socket, &step(10, 6)).await["prediction"].take();
    assert_eq!(numbers(&told["y"]), expected);
    assert_eq!((&told["number"], &told["warm_start_shift"]), (&json!(0), &Value::Null));

    // First one more sample, then three at once, two of them in a message of their own.
    for (first, count, shift) in [(16, 1, 1), (19, 1, 3)] {
        if first == 19 {
            let (u, y) = seen(17, 2);
            ask(&mut socket, &json!({"step": {"u": u, "y": y}})).await;
        }
        sampling.warm_start = Some(WarmStart { previous: expected, shift, steps: 4 });
        expected = model.sample(&question(first + count).observed(CONTEXT), &sampling).unwrap();
        let told = ask(&mut socket, &step(first, count)).await["prediction"].take();
        assert_eq!(numbers(&told["y"]), expected);
        assert_eq!(told["warm_start_shift"], shift);
        assert!(told["latency_ms"]["total"].as_f64() >= told["latency_ms"]["compute"].as_f64());
    }

    let emptied = ask(&mut socket, &json!({"reset": {}})).await;
    assert_eq!(emptied["context"]["filled"], 0);
    let told = ask(&mut socket, &step(0, 16)).await["prediction"].take();
    sampling.warm_start = None;
    assert_eq!(
        numbers(&told["y"]),
        model.sample(&question(16).observed(CONTEXT), &sampling).unwrap()
    );
}

#[tokio::test]
async fn a_stream_at_a_multiple_of_the_rate_has_as_many_times_the_samples() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("lagrangian").await;
    let model = model("lagrangian");
    let [context, horizon] = [model.context(), model.horizon()].map(|rows| 2 * rows);
    let mut socket = connect(&server, checkpoint).await;
    let refused = ask(&mut socket, &json!({"open": {"rate_hz": 100}})).await;
    assert_eq!(fields(&refused["error"]), ["open.rate_hz"], "{refused}");
    let opened = ask(&mut socket, &json!({"open": {"rate_hz": 120}})).await["opened"].take();
    let found = [&opened["rate_hz"], &opened["context"], &opened["horizon"]];
    assert_eq!(found, [&json!(120.0), &json!(context), &json!(horizon)], "{opened}");

    let step_at = |first: usize, count: usize| {
        let (u, y) = seen(first, count);
        json!({"step": {"u": u, "y": y, "future_u": seen(first + count, horizon).0}})
    };
    for end in [context, context + 1] {
        let message = if end == context { step_at(0, context) } else { step_at(context, 1) };
        let told = ask(&mut socket, &message).await["prediction"].take();
        let first = end - context;
        let shape = Shape { robots: 1, samples: context + horizon, joints: JOINTS };
        let u = seen(first, context + horizon).0.into_flattened();
        let y = seen(first, context).1.into_flattened();
        let question = Series::question(shape, context, 120.0, u, y).unwrap();
        assert_eq!(numbers(&told["y"]), model.predict(&question.observed(context)).unwrap());
    }

    // Settings at the same rate keep the samples. Those of another rate mean nothing there.
    let open = async |socket: &mut Socket, settings: Value| {
        ask(socket, &json!({"open": settings})).await["opened"]["filled"].take()
    };
    let kept = open(&mut socket, json!({"rate_hz": 120, "position_noise_rad": 1e-3})).await;
    assert_eq!(kept, json!(context));
    assert_eq!(open(&mut socket, json!({})).await, json!(0));
}

#[tokio::test]
async fn a_message_that_cannot_be_accepted_is_answered_and_changes_nothing() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let mut socket = connect(&server, checkpoint).await;
    let (u, y) = seen(0, 16);
    let mut short = step(16, 1);
    short["step"]["future_u"].as_array_mut().unwrap().pop();
    let mut narrow = step(16, 1);
    narrow["step"]["u"][0].as_array_mut().unwrap().pop();
    let mut torn = step(16, 2);
    torn["step"]["y"].as_array_mut().unwrap().pop();
    for (message, field) in [
        (step(0, 16), "step"),
        (json!({"open": {"warm_start_steps": 21}}), "open.warm_start_steps"),
        (json!({"open": {"warm_start_steps": 0}}), "open.warm_start_steps"),
        (json!({"open": {"sampling": {"samples": 0}}}), "open.sampling.samples"),
        (json!({"open": {"sampling": {"sampler": {"steps": 21}}}}), "open.sampling.sampler.steps"),
        (json!({"open": {"sampler": {}}}), "open.sampler"),
        (json!({"open": {}}), ""),
        (json!({"close": {}}), "the message"),
        (step(0, 2), "step.future_u"),
        (json!({"step": {"u": [], "y": []}}), "step.u"),
        (json!({"step": {"u": u, "y": y}}), ""),
        (short, "step.future_u"),
        (narrow, "step.u[0]"),
        (torn, "step.y"),
    ] {
        let answer = ask(&mut socket, &message).await;
        match field {
            "" => assert!(answer.get("error").is_none(), "{answer}"),
            field => assert_eq!(fields(&answer["error"]), [field], "{answer}"),
        }
    }
    socket.send(Message::text("{")).await.unwrap();
    assert!(next(&mut socket).await.to_text().unwrap().contains("is not valid JSON"));
    socket.send(Message::binary(vec![1, 2, 3])).await.unwrap();
    assert!(next(&mut socket).await.to_text().unwrap().contains("binary"));
    let told = ask(&mut socket, &step(16, 1)).await["prediction"].take();
    assert_eq!(numbers(&told["y"]), model("cdt").predict(&question(17).observed(CONTEXT)).unwrap());
}

#[tokio::test]
async fn a_message_beyond_the_limit_closes_the_stream() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let mut socket = connect(&server, checkpoint).await;
    // The server may hang up before everything is sent.
    let _ = socket.send(Message::text(" ".repeat((8 << 20) + 1))).await;
    let closed = tokio::time::timeout(Duration::from_secs(60), socket.next()).await.unwrap();
    match closed {
        Some(Ok(Message::Close(Some(frame)))) => assert_eq!(u16::from(frame.code), 1009),
        other => assert!(!matches!(other, Some(Ok(_))), "{other:?}"),
    }
}

#[tokio::test]
async fn who_reads_nothing_holds_up_nobody_else() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let (u, y) = seen(0, 16);
    let fill = json!({"step": {"u": u, "y": y}});
    let open = json!({"open": {"sampling": {"samples": 200, "return_samples": true,
                      "sampler": {"kind": "ddim", "steps": 1}}}});
    let mut idle = connect(&server, checkpoint).await;
    ask(&mut idle, &open).await;
    ask(&mut idle, &fill).await;
    // Sends questions without end. Their answers fill the connection until nothing more can be
    // sent.
    let flood = tokio::spawn(async move {
        while idle.send(Message::text(step(16, 1).to_string())).await.is_ok() {}
    });
    let mut other = connect(&server, checkpoint).await;
    ask(&mut other, &json!({"open": {"warm_start_steps": 2}})).await;
    ask(&mut other, &fill).await;
    for first in 16..60 {
        let told = ask(&mut other, &step(first, 1)).await;
        assert!(told["prediction"]["y"].is_array(), "{told}");
    }
    // The server drops the client that does not read.
    tokio::time::timeout(Duration::from_secs(60), flood).await.unwrap().unwrap();
}

#[tokio::test]
async fn only_so_many_streams_are_open_at_once() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let mut open = Vec::new();
    for _ in 0..16 {
        open.push(connect(&server, checkpoint).await);
    }
    assert_eq!(refusal(&server, checkpoint, &[]).await, 503);
    open.pop().unwrap().close(None).await.unwrap();
    let started = Instant::now();
    while try_to_connect(&server, checkpoint, &[]).await.is_err() {
        assert!(started.elapsed() < Duration::from_secs(60));
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test]
async fn another_site_opens_no_stream_and_a_token_is_asked_for() {
    let server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    assert_eq!(refusal(&server, checkpoint, &[("origin", "https://evil.example")]).await, 403);
    let own = format!("http://{}", server.address);
    assert!(try_to_connect(&server, checkpoint, &[("origin", &own)]).await.is_ok());
    assert_eq!(refusal(&server, 999, &[]).await, 404);
    let url = format!("http://{}/v1/checkpoints/{checkpoint}/stream", server.address);
    assert_eq!(server.http.get(url).send().await.unwrap().status(), 426);

    let options = api::Options { token: Some("secret".to_owned()), ..api::Options::default() };
    let guarded = Server::start_with(&options, live::LOADED_BYTES).await;
    assert_eq!(refusal(&guarded, 1, &[]).await, 401);
    assert_eq!(refusal(&guarded, 1, &[("authorization", "Bearer secret")]).await, 404);
}

#[tokio::test]
async fn streams_are_told_that_the_server_stops() {
    let mut server = Server::start().await;
    let checkpoint = server.checkpoint("cdt").await;
    let mut socket = connect(&server, checkpoint).await;
    ask(&mut socket, &json!({"open": {}})).await;
    let started = Instant::now();
    server.begin_to_stop();
    match next(&mut socket).await {
        Message::Close(Some(frame)) => assert_eq!(u16::from(frame.code), 1001),
        other => panic!("{other:?}"),
    }
    server.stopped().await;
    assert!(started.elapsed() < Duration::from_secs(3), "{:?}", started.elapsed());
}
