//! Torques of motions that leave the limits of the arm that a law is told.

use std::sync::Arc;
use std::time::Duration;

use api::live::{
    AboutModel, FittedRobot, JointLimits, LiveError, LiveFit, LiveModel, LiveModels,
    LivePrediction, LiveQueue, Question,
};
use api::{App, Options};
use axum::body::Body;
use axum::http::Request;
use axum::http::header::{CONTENT_TYPE, HOST};
use futures::FutureExt;
use futures::future::BoxFuture;
use serde_json::{Value, json};
use series::{JointMotion, Series};
use spec::{Digest, Range};
use store::Checkpoint;
use tokio::net::TcpListener;

use crate::fixture::Server;
use crate::streams::Client;

/// A law of two joints, with a context of one sample. A velocity takes ten times as much torque.
#[derive(Clone)]
struct Law(AboutModel);

impl Law {
    fn told(limits: &[JointLimits]) -> Self {
        Self(AboutModel {
            context: 1,
            horizon: 1,
            joints: 2,
            rate_hz: 60.0,
            lengths: spec::Lengths::Any,
            given: spec::Given::Torques,
            limits: limits.into(),
            has_samples: true,
            sampler: None,
            needs_future: false,
            device: "cpu".to_owned(),
            threads: 1,
        })
    }
}

impl LiveModels for Law {
    fn load<'a>(
        &'a self,
        _: &'a Checkpoint,
    ) -> BoxFuture<'a, Result<Arc<dyn LiveModel>, LiveError>> {
        let model: Arc<dyn LiveModel> = Arc::new(self.clone());
        async move { Ok(model) }.boxed()
    }
}

impl LiveModel for Law {
    fn about(&self) -> &AboutModel {
        &self.0
    }

    fn predict(
        &self,
        question: Question,
        _: LiveQueue,
    ) -> BoxFuture<'static, Result<LivePrediction, LiveError>> {
        let positions = vec![0.0; question.scenarios.shape().robots * 2];
        let (warnings, none) = (Vec::new(), Duration::ZERO);
        let answer =
            LivePrediction { positions, samples: 1, warnings, queued: none, computed: none };
        async move { Ok(answer) }.boxed()
    }

    fn fit(
        &self,
        contexts: Series,
        _: LiveQueue,
    ) -> BoxFuture<'static, Result<LiveFit, LiveError>> {
        #[expect(clippy::cast_possible_truncation, reason = "torques are f32")]
        let said = |motion: &JointMotion| motion.qd().iter().map(|qd| (10.0 * qd) as f32).collect();
        let robot: FittedRobot = Arc::new(said);
        let fit = LiveFit {
            digest: Digest::from_bytes([7; 32]),
            robots: vec![robot; contexts.robots()],
            warnings: Vec::new(),
            queued: Duration::ZERO,
            computed: Duration::ZERO,
        };
        async move { Ok(fit) }.boxed()
    }
}

/// 0.7 is no f32, and a position of 0.7 is within.
fn limits() -> [JointLimits; 2] {
    let joint = |reach: f64, velocity_rad_s: f64, torque_nm: f64| JointLimits {
        position_rad: Range::new(-reach, reach),
        velocity_rad_s,
        torque_nm,
    };
    [joint(0.7, 3.0, 300.0), joint(2.0, 20.0, 150.0)]
}

async fn server(law: Law) -> Server {
    let server = Server::start_app(&Options::default(), |app| app.with_models(Arc::new(law))).await;
    server.submitted(&crate::fixture::small_pipeline()).await;
    server.work().await;
    server
}

async fn torques(server: &Server, motions: &[Value]) -> Value {
    let scenario = |motion: &Value| json!({"u": [[0, 0]], "y": [[0, 0]], "motion": motion});
    let body = json!({"scenarios": motions.iter().map(scenario).collect::<Vec<_>>()});
    let request = Request::post("/v1/checkpoints/1/torque").header(HOST, "127.0.0.1:7070");
    let request = request.header(CONTENT_TYPE, "application/json");
    let answer = server.send(request.body(Body::from(body.to_string())).unwrap()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.json()
}

/// Kind, joint, value and number of scenarios.
fn told(answer: &Value) -> Vec<(&str, u64, f64, u64)> {
    let warnings = answer["warnings"].as_array().map(Vec::as_slice).unwrap_or_default();
    let of = |warning: &'_ Value| {
        let number = |field: &str| warning[field].as_u64().unwrap();
        (number("joint"), warning["reached"].as_f64().unwrap(), number("scenarios"))
    };
    let kinds = warnings.iter().map(|warning| warning["kind"].as_str().unwrap());
    kinds.zip(warnings.iter().map(of)).map(|(kind, (a, b, c))| (kind, a, b, c)).collect()
}

fn motion(q: [f64; 2], qd: [f64; 2]) -> Value {
    json!({"q": [[0, 0], q], "qd": [[0, 0], qd], "qdd": [[0, 0], [0, 0]]})
}

/// Regression: a velocity of 500 rad/s took 36 941 N·m without a word.
#[tokio::test]
async fn motions_and_torques_beyond_the_limits_of_the_arm_are_told_with_both_numbers() {
    let server = server(Law::told(&limits())).await;
    let within = motion([0.7, -2.0], [3.0, -15.0]);
    assert_eq!(told(&torques(&server, &[within]).await), []);
    let beyond = motion([-0.75, 2.5], [500.0, -15.5]);
    let further = motion([0.0, 3.5], [0.0, 15.0]);
    let answer = torques(&server, &[beyond, further]).await;
    let expected = [
        ("position-limits", 1, -0.75, 1),
        ("position-limits", 2, 3.5, 2),
        ("velocity-limits", 1, 500.0, 1),
        ("torque-limits", 1, 5000.0, 1),
        ("torque-limits", 2, -155.0, 1),
    ];
    assert_eq!(told(&answer), expected);
    let message = "the torque of joint 1 reaches 5000 N·m; its limits are -300 to 300 N·m";
    assert_eq!(answer["warnings"][3]["message"], message);
}

#[tokio::test]
async fn a_law_that_is_told_no_arm_knows_no_limits() {
    let server = server(Law::told(&[])).await;
    let answer = torques(&server, &[motion([9.0, 9.0], [500.0, 500.0])]).await;
    assert_eq!(told(&answer), []);
}

#[tokio::test]
async fn a_stream_warns_of_limits_with_every_motion() {
    let server = Server::with_small_pipeline().await;
    let law = Arc::new(Law::told(&limits()));
    let app = App::new(server.store.clone(), &Options::default()).with_models(law);
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(api::serve(listener, app, std::future::pending()));
    let mut client = Client::connect(address).await;
    for message in
        [json!({"open": {}}), json!({"step": {"u": [[0, 0]], "y": [[0, 0]]}}), json!({"fit": {}})]
    {
        client.say(&message).await;
        let answer = client.hear().await;
        assert!(answer.get("error").is_none(), "{answer}");
    }
    for _ in 0..2 {
        client.say(&json!({"motion": motion([0.0, 0.0], [4.0, 0.0])})).await;
        let answer = client.hear().await;
        assert_eq!(told(&answer["torques"]), [("velocity-limits", 1, 4.0, 1)], "{answer}");
    }
}
