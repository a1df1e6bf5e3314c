//! Prediction streams, with a model that takes as long as a test wants.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use api::live::{
    AboutModel, LiveError, LiveModel, LiveModels, LivePrediction, LiveQueue, Question,
};
use api::{App, Options};
use futures::FutureExt;
use futures::future::BoxFuture;
use serde_json::{Value, json};
use store::Checkpoint;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, mpsc};
use tokio::time::timeout;

use crate::fixture::Server;

/// Longer than anything here takes, and shorter than the limits that would end a prediction.
const PATIENCE: Duration = Duration::from_secs(20);

/// A model of one joint with a context and a horizon of one sample. It ends one prediction per
/// permit.
#[derive(Clone)]
struct Slow {
    about: AboutModel,
    permits: Arc<Semaphore>,
    events: mpsc::UnboundedSender<&'static str>,
}

/// Reports that a prediction was cancelled, unless it has ended.
struct Running {
    events: mpsc::UnboundedSender<&'static str>,
    has_ended: bool,
}

impl Running {
    fn end(mut self) {
        self.has_ended = true;
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if !self.has_ended {
            let _ = self.events.send("dropped");
        }
    }
}

impl LiveModels for Slow {
    fn load<'a>(
        &'a self,
        _: &'a Checkpoint,
    ) -> BoxFuture<'a, Result<Arc<dyn LiveModel>, LiveError>> {
        let model: Arc<dyn LiveModel> = Arc::new(self.clone());
        async move { Ok(model) }.boxed()
    }
}

impl LiveModel for Slow {
    fn about(&self) -> &AboutModel {
        &self.about
    }

    fn predict(
        &self,
        question: Question,
        _: LiveQueue,
    ) -> BoxFuture<'static, Result<LivePrediction, LiveError>> {
        let (permits, events) = (Arc::clone(&self.permits), self.events.clone());
        let running = Running { events: self.events.clone(), has_ended: false };
        async move {
            events.send("begun").unwrap();
            permits.acquire().await.unwrap().forget();
            running.end();
            Ok(LivePrediction {
                positions: vec![*question.scenarios.u().last().unwrap()],
                samples: 1,
                warnings: Vec::new(),
                queued: Duration::ZERO,
                computed: Duration::ZERO,
            })
        }
        .boxed()
    }
}

/// A server with [`Slow`] as its only model.
struct Service {
    address: SocketAddr,
    permits: Arc<Semaphore>,
    events: mpsc::UnboundedReceiver<&'static str>,
    _server: Server,
}

impl Service {
    async fn start() -> Self {
        let server = Server::with_small_pipeline().await;
        let (sender, events) = mpsc::unbounded_channel();
        let permits = Arc::new(Semaphore::new(0));
        let about = AboutModel {
            context: 1,
            horizon: 1,
            joints: 1,
            rate_hz: 60.0,
            lengths: spec::Lengths::Trained,
            given: spec::Given::Torques,
            limits: Arc::default(),
            has_samples: false,
            sampler: None,
            needs_future: false,
            device: "cpu".to_owned(),
            threads: 1,
        };
        let model = Slow { about, permits: Arc::clone(&permits), events: sender };
        let app = App::new(server.store.clone(), &Options::default()).with_models(Arc::new(model));
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(api::serve(listener, app, std::future::pending()));
        Self { address, permits, events, _server: server }
    }

    async fn event(&mut self) -> &'static str {
        timeout(PATIENCE, self.events.recv()).await.expect("an event in time").unwrap()
    }

    /// A client that has opened its stream.
    async fn client(&mut self) -> Client {
        let mut client = Client::connect(self.address).await;
        self.permits.add_permits(1);
        client.say(&json!({"open": {}})).await;
        assert_eq!(self.event().await, "begun");
        assert!(client.hear().await["opened"].is_object());
        client
    }
}

/// The part of a WebSocket (RFC 6455) that is needed here, on a connection that a test can drop.
pub struct Client(TcpStream);

const TEXT: u8 = 1;
const CLOSE: u8 = 8;
const PING: u8 = 9;
const PONG: u8 = 10;

impl Client {
    pub async fn connect(address: SocketAddr) -> Self {
        let mut connection = TcpStream::connect(address).await.unwrap();
        let handshake = format!(
            "GET /v1/checkpoints/1/stream HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\n\
             Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        );
        connection.write_all(handshake.as_bytes()).await.unwrap();
        let mut answer = Vec::new();
        while !answer.ends_with(b"\r\n\r\n") {
            answer.push(connection.read_u8().await.unwrap());
        }
        assert!(answer.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&answer));
        Self(connection)
    }

    /// Sends a frame with a mask that changes nothing.
    async fn send(&mut self, kind: u8, payload: &[u8]) {
        let length = payload.len() as u64;
        let mut frame = vec![0x80 | kind, 0x80 | 127];
        frame.extend(length.to_be_bytes());
        frame.extend([0; 4]);
        frame.extend(payload);
        self.0.write_all(&frame).await.unwrap();
    }

    async fn receive(&mut self) -> (u8, Vec<u8>) {
        let frame = async {
            let kind = self.0.read_u8().await.unwrap() & 0x0f;
            let length = match self.0.read_u8().await.unwrap() {
                126 => self.0.read_u16().await.unwrap().into(),
                127 => usize::try_from(self.0.read_u64().await.unwrap()).unwrap(),
                short => usize::from(short),
            };
            let mut payload = vec![0; length];
            self.0.read_exact(&mut payload).await.unwrap();
            (kind, payload)
        };
        timeout(PATIENCE, frame).await.expect("a frame in time")
    }

    /// The code with which the server closes the stream.
    async fn closing_code(&mut self) -> u16 {
        let (kind, payload) = self.receive().await;
        assert_eq!(kind, CLOSE, "{}", String::from_utf8_lossy(&payload));
        u16::from_be_bytes([payload[0], payload[1]])
    }

    pub async fn say(&mut self, message: &Value) {
        self.send(TEXT, message.to_string().as_bytes()).await;
    }

    pub async fn hear(&mut self) -> Value {
        let (kind, payload) = self.receive().await;
        assert_eq!(kind, TEXT, "{}", String::from_utf8_lossy(&payload));
        serde_json::from_slice(&payload).unwrap()
    }
}

/// A message that asks for a prediction of `future`, which [`Slow`] returns.
fn step(future: u32) -> Value {
    json!({"step": {"u": [[0.5]], "y": [[0.5]], "future_u": [[future]]}})
}

/// Regression: after its client had gone, a prediction ran to its end and kept others waiting.
#[tokio::test]
async fn a_client_that_leaves_interrupts_its_prediction() {
    let mut service = Service::start().await;
    for says_so in [true, false] {
        let mut client = service.client().await;
        client.say(&step(1)).await;
        assert_eq!(service.event().await, "begun");
        if says_so {
            client.send(CLOSE, &[]).await;
            assert_eq!(service.event().await, "dropped");
        }
        drop(client);
        if !says_so {
            assert_eq!(service.event().await, "dropped");
        }
    }
}

/// There are more messages than the backlog holds. They wait in the connection, so the server
/// cannot read its end.
#[tokio::test]
async fn a_client_that_leaves_many_messages_behind_interrupts_its_prediction_too() {
    let mut service = Service::start().await;
    let mut client = service.client().await;
    for future in 0..200 {
        client.say(&step(future)).await;
    }
    assert_eq!(service.event().await, "begun");
    tokio::time::sleep(Duration::from_millis(100)).await;
    drop(client);
    assert_eq!(service.event().await, "dropped");
}

#[tokio::test]
async fn messages_that_come_while_an_answer_is_computed_are_answered_in_their_order() {
    let mut service = Service::start().await;
    let mut client = service.client().await;
    let count = u32::try_from(api::limits::STREAM_BACKLOG).unwrap() + 30;
    for future in 0..count {
        client.say(&step(future)).await;
    }
    assert_eq!(service.event().await, "begun");
    tokio::time::sleep(Duration::from_millis(100)).await;
    service.permits.add_permits(count as usize);
    for future in 0..count {
        let prediction = client.hear().await["prediction"].take();
        assert_eq!(prediction["number"], future);
        assert_eq!(prediction["y"], json!([[f64::from(future)]]));
    }
}

#[tokio::test]
async fn pings_are_answered_while_an_answer_is_computed() {
    let mut service = Service::start().await;
    let mut client = service.client().await;
    client.say(&step(7)).await;
    assert_eq!(service.event().await, "begun");
    client.send(PING, b"there?").await;
    assert_eq!(client.receive().await, (PONG, b"there?".to_vec()));
    service.permits.add_permits(1);
    assert_eq!(client.hear().await["prediction"]["y"], json!([[7.0]]));
}

/// RFC 6455, sections 5.1, 5.2, 5.4, 5.5 and 7.4.1.
#[tokio::test]
async fn a_client_that_breaks_the_protocol_is_told_1002() {
    let mut service = Service::start().await;
    let masked = |first: u8, length: u8| vec![first, 0x80 | length, 0, 0, 0, 0];
    let faults = [
        ("a frame without a mask", vec![0x81, 2, b'{', b'}']),
        ("a kind that nobody knows", masked(0x83, 0)),
        ("a reserved bit", masked(0xc1, 0)),
        ("a ping in parts", masked(0x09, 0)),
        ("the second part of nothing", masked(0x80, 0)),
        ("half a code in a goodbye", [masked(0x88, 1), vec![3]].concat()),
    ];
    for (fault, frame) in faults {
        let mut client = service.client().await;
        client.0.write_all(&frame).await.unwrap();
        assert_eq!(client.closing_code().await, 1002, "{fault}");
    }
}

/// RFC 6455, section 8.1.
#[tokio::test]
async fn text_that_is_no_utf_8_is_told_1007() {
    let mut service = Service::start().await;
    let mut client = service.client().await;
    client.send(TEXT, &[b'"', 0xc3, 0x28, b'"']).await;
    assert_eq!(client.closing_code().await, 1007);
}

/// RFC 6455, section 5.5.1. Regression: the server dropped the connection without an answer.
#[tokio::test]
async fn a_goodbye_is_answered_with_its_code() {
    let mut service = Service::start().await;
    let mut client = service.client().await;
    client.send(CLOSE, &1000_u16.to_be_bytes()).await;
    assert_eq!(client.closing_code().await, 1000);
}

/// A message of 8 MB had an answer that named each of a million faults.
#[tokio::test]
async fn a_message_full_of_faults_is_answered_in_few_words() {
    let mut service = Service::start().await;
    let mut client = service.client().await;
    let most = api::limits::QUESTION_BYTES - 1000;
    let list = |item: &str| vec![item; most / (item.len() + 1)].join(",");
    for message in [
        format!(r#"{{"step":{{"u":[{}],"y":[]}}}}"#, list("[]")),
        format!(r#"{{"step":{{"u":[{}],"y":[]}}}}"#, list("[0]")),
        format!(r#"{{"step":[{}]}}"#, list("0")),
        format!(r#"{{"open":{{"sampling":{{"samples":2,"quantiles":[{}]}}}}}}"#, list("0")),
        format!("[{}]", list(r#"{"":0}"#)),
    ] {
        client.send(TEXT, message.as_bytes()).await;
        let (kind, payload) = client.receive().await;
        assert_eq!(kind, TEXT);
        assert!(payload.len() < 10_000, "{}", payload.len());
        let answer: Value = serde_json::from_slice(&payload).unwrap();
        assert_eq!(answer["error"]["status"], 422, "{answer}");
    }
    client.say(&step(3)).await;
    assert_eq!(service.event().await, "begun");
    service.permits.add_permits(1);
    assert_eq!(client.hear().await["prediction"]["y"], json!([[3.0]]));
}
