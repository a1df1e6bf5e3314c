//! Server-sent events.

use std::time::Duration;

use api::{App, Options};
use axum::body::{Body, BodyDataStream};
use axum::http::header::{AUTHORIZATION, HOST};
use axum::http::{Method, Request, StatusCode};
use axum::response::Response;
use futures::StreamExt;
use serde_json::{Value, json};
use spec::Digest;
use store::{Access, Metric, NewToken, Scope, Store};
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::time::{Instant, timeout};

use crate::contract;
use crate::fixture::{Server, small_pipeline, small_simulation};

/// Longer than anything here takes.
const LONG: Duration = Duration::from_secs(30);

/// A message of a stream.
#[derive(Clone, Debug, Default, PartialEq)]
struct Message {
    id: Option<i64>,
    event: String,
    data: Value,
}

/// A client of a stream.
struct Client {
    stream: BodyDataStream,
    text: String,
}

impl Client {
    async fn open(server: &Server, path: &str, headers: &[(&str, &str)]) -> Self {
        let response = ask(server, path, headers).await;
        assert_eq!(response.status(), StatusCode::OK);
        let header = |name: &str| response.headers()[name].to_str().unwrap().to_owned();
        assert_eq!(header("content-type"), "text/event-stream");
        assert_eq!(header("cache-control"), "no-cache");
        assert_eq!(header("x-accel-buffering"), "no");
        Self::new(response)
    }

    async fn after(server: &Server, path: &str, id: i64) -> Self {
        Self::open(server, path, &[("last-event-id", &id.to_string())]).await
    }

    fn new(response: Response) -> Self {
        Self { stream: response.into_body().into_data_stream(), text: String::new() }
    }

    /// The next block of lines; `None` at the end of the stream.
    async fn block(&mut self) -> Option<String> {
        loop {
            if let Some((block, rest)) = self.text.split_once("\n\n") {
                let block = block.to_owned();
                self.text = rest.to_owned();
                return Some(block);
            }
            let more = timeout(LONG, self.stream.next()).await.expect("something happens")?;
            self.text.push_str(std::str::from_utf8(&more.unwrap()).unwrap());
        }
    }

    /// The next message with content. It must match the document.
    async fn next(&mut self) -> Option<Message> {
        loop {
            let block = self.block().await?;
            let mut message = Message::default();
            for line in block.lines() {
                match line.split_once(": ") {
                    Some(("id", id)) => message.id = Some(id.parse().unwrap()),
                    Some(("event", event)) => event.clone_into(&mut message.event),
                    Some(("data", data)) => message.data = serde_json::from_str(data).unwrap(),
                    _ => assert!(line.starts_with(':') || line.starts_with("retry:"), "{line}"),
                }
            }
            if !message.event.is_empty() {
                contract::check_event(&message.data);
                assert_eq!(message.data["event"], message.event);
                assert_eq!(message.data["id"].as_i64(), message.id);
                return Some(message);
            }
        }
    }

    async fn must_next(&mut self) -> Message {
        self.next().await.expect("the stream goes on")
    }

    async fn rest(&mut self) -> Vec<Message> {
        let mut messages = Vec::new();
        while let Some(message) = self.next().await {
            messages.push(message);
        }
        messages
    }

    /// This number of stored messages; others are skipped.
    async fn kept(&mut self, count: usize) -> Vec<Message> {
        let mut messages = Vec::new();
        while messages.len() < count {
            let message = self.must_next().await;
            if message.id.is_some() {
                messages.push(message);
            }
        }
        messages
    }
}

async fn ask(server: &Server, path: &str, headers: &[(&str, &str)]) -> Response {
    let mut request = Request::get(path).header(HOST, "127.0.0.1:7070");
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    server.answer(request.body(Body::empty()).unwrap()).await
}

/// The event and the state of each message.
fn told(messages: &[Message]) -> Vec<(&str, &str)> {
    messages
        .iter()
        .map(|message| (&message.event[..], message.data["state"].as_str().unwrap_or("")))
        .collect()
}

#[tokio::test]
async fn a_job_is_told_from_its_progress_to_its_end() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    let mut client = Client::open(&server, "/v1/jobs/1/events", &[]).await;
    let first = client.must_next().await;
    assert_eq!((first.event.as_str(), &first.data["state"]), ("progress", &json!("queued")));
    assert_eq!(first.data["progress"]["total"], 10);
    server.submitted(&small_simulation(2)).await;
    server.work().await;
    let messages = client.rest().await;
    let of_others = messages.iter().filter(|message| message.data["job"] != 1).count();
    assert_eq!(of_others, 0, "{messages:?}");
    let kept: Vec<Message> =
        messages.iter().filter(|message| message.id.is_some()).cloned().collect();
    let expected =
        [("task", "running"), ("job", "running"), ("task", "succeeded"), ("job", "succeeded")];
    assert_eq!(told(&kept), expected);
    assert!(kept.is_sorted_by_key(|message| message.id));
    let [.., progress, end] = &messages[..] else { panic!("{messages:?}") };
    assert_eq!(
        (progress.event.as_str(), &progress.data["progress"]["done"]),
        ("progress", &json!(10))
    );
    assert_eq!(end.data, json!({"event": "end", "job": 1, "state": "succeeded", "error": null}));

    // A client that comes later gets the same events and the end.
    let mut client = Client::open(&server, "/v1/jobs/1/events?after=0", &[]).await;
    let replayed = client.rest().await;
    assert_eq!(replayed[1..5], kept, "after the event of its beginning");
    assert_eq!(replayed[5..], [progress.clone(), end.clone()]);
    let mut client = Client::open(&server, "/v1/jobs/1/events", &[]).await;
    assert_eq!(client.rest().await, [progress.clone(), end.clone()]);
}

/// The server looks for events every 200 ms, so it learns later of a job's end than it can read the
/// job's state.
#[tokio::test]
async fn whoever_comes_right_after_the_end_gets_the_final_event() {
    let server = Server::start().await;
    let _listener = Client::open(&server, "/v1/events", &[]).await;
    for seed in 1..=5 {
        let job = server.submitted(&small_simulation(seed)).await["id"].clone();
        server.work().await;
        let path = format!("/v1/jobs/{job}/events?after=0");
        let messages = Client::open(&server, &path, &[]).await.rest().await;
        let kept = messages.iter().rfind(|message| message.id.is_some()).unwrap();
        assert_eq!((kept.event.as_str(), &kept.data["state"]), ("job", &json!("succeeded")));
        assert_eq!(messages.last().unwrap().event, "end");
    }
}

#[tokio::test]
async fn a_pipeline_tells_of_its_jobs_and_a_run_of_its_training() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await["id"].clone();
    let mut client = Client::open(&server, &format!("/v1/jobs/{pipeline}/events"), &[]).await;
    assert_eq!(client.must_next().await.data["members"].as_array().unwrap().len(), 4);
    server.work().await;
    let messages = client.rest().await;
    for job in 1..=5 {
        let ended =
            |message: &&Message| message.event == "job" && message.data["state"] == "succeeded";
        assert!(
            messages.iter().filter(ended).any(|message| message.data["job"] == job),
            "job {job}"
        );
    }
    let run = server.json("/v1/runs/1").await;
    let mut client = Client::open(&server, "/v1/runs/1/events?after=0", &[]).await;
    let messages = client.rest().await;
    assert!(messages.iter().all(|message| message.data["job"] == run["job"]), "{messages:?}");
    let data =
        |event: &str| messages.iter().find(|message| message.event == event).unwrap().data.clone();
    assert_eq!((&data("metrics")["run"], &data("metrics")["step"]), (&json!(1), &json!(99)));
    assert_eq!(data("checkpoint")["checkpoint"], 1);
}

#[tokio::test]
async fn a_client_goes_on_where_it_was_also_after_a_restart() {
    let server = Server::with_small_pipeline().await;
    let all = Client::open(&server, "/v1/events?after=0", &[]).await.kept(30).await;
    assert!(all.is_sorted_by(|a, b| a.id < b.id));
    let last = all[11].id.unwrap();
    let mut client = Client::after(&server, "/v1/events", last).await;
    assert_eq!(client.kept(18).await, all[12..]);
    let server = server.restarted_with(&Options::default());
    let mut client = Client::after(&server, "/v1/events", last).await;
    assert_eq!(client.kept(18).await, all[12..]);
    let mut client = Client::open(&server, &format!("/v1/events?after={last}"), &[]).await;
    assert_eq!(client.kept(18).await, all[12..], "for those who cannot send the header");
    let newest = server.store.kept_events().await.unwrap().1;
    let mut client = Client::after(&server, "/v1/events", newest).await;
    server.submitted(&small_simulation(9)).await;
    let next = client.must_next().await;
    assert_eq!((next.event.as_str(), &next.data["state"]), ("job", &json!("queued")));
    assert!(next.id > Some(newest));
}

#[tokio::test]
async fn only_events_of_a_kind_come_where_they_are_asked_for() {
    let server = Server::with_small_pipeline().await;
    let mut client = Client::open(&server, "/v1/events?kind=checkpoint&after=0", &[]).await;
    assert_eq!(client.must_next().await.event, "checkpoint");
    server.submitted(&small_simulation(9)).await;
    server.work().await;
    let task = server.submitted(&small_training()).await;
    assert_eq!(task["id"], 7);
    server.work().await;
    let next = client.must_next().await;
    assert_eq!((next.event.as_str(), &next.data["job"]), ("checkpoint", &json!(7)));
}

fn small_training() -> Value {
    crate::fixture::small_training(&json!({"dataset": 1}))
}

#[tokio::test]
async fn whoever_comes_too_late_or_from_elsewhere_is_told_of_a_gap() {
    let server = Server::with_small_pipeline().await;
    let all = Client::open(&server, "/v1/events?after=0", &[]).await.kept(30).await;
    server.store.forget_events(10, LONG).await.unwrap();
    let (oldest, newest) = server.store.kept_events().await.unwrap();
    let missed = all[3].id.unwrap();
    let mut client = Client::after(&server, "/v1/events", missed).await;
    let gap = client.must_next().await;
    assert_eq!(gap.data, json!({"event": "gap", "id": oldest - 1, "after": missed}));
    let rest = client.kept(10).await;
    assert_eq!((rest[0].id, rest[9].id), (Some(oldest), Some(newest)));
    // It continues after the gap without another one.
    let mut client = Client::after(&server, "/v1/events", oldest - 1).await;
    assert_eq!(client.must_next().await, rest[0]);
    // The progress of the whole job is sent again.
    let mut client = Client::after(&server, "/v1/jobs/1/events", missed).await;
    let events = client.rest().await;
    let names: Vec<&str> = events.iter().map(|event| event.event.as_str()).collect();
    assert_eq!(names, ["gap", "progress", "end"]);

    let elsewhere = newest + 1_000_000;
    let mut client = Client::after(&server, "/v1/events", elsewhere).await;
    let gap = client.must_next().await;
    assert_eq!(gap.data, json!({"event": "gap", "id": newest, "after": elsewhere}));
    server.submitted(&small_simulation(9)).await;
    assert!(client.must_next().await.id > Some(newest));
}

/// More events than the server keeps in memory for any client.
#[tokio::test]
async fn a_client_that_falls_behind_misses_nothing() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    server.work().await;
    server.submitted(&small_training()).await;
    let task = server.claim().await.unwrap();
    let mut client = Client::open(&server, "/v1/events", &[]).await;
    // The stream has begun, and the client reads nothing more.
    client.block().await.unwrap();
    let count = u64::try_from(api::limits::EVENT_BACKLOG).unwrap() + 300;
    for step in 0..count {
        let metric = Metric { key: "loss".to_owned(), step, value: 1.0 };
        server.store.record_metrics(task.fence, &[metric]).await.unwrap();
    }
    tokio::time::sleep(3 * api::limits::EVENT_POLL).await;
    for step in 0..count {
        let message = client.must_next().await;
        assert_eq!((message.event.as_str(), &message.data["step"]), ("metrics", &json!(step)));
    }
}

#[tokio::test]
async fn a_stream_says_that_it_is_there() {
    let heartbeat = Duration::from_millis(50);
    let options = Options { event_heartbeat: heartbeat, ..Options::default() };
    let server = Server::start_with(&options).await;
    let mut client = Client::open(&server, "/v1/events", &[]).await;
    assert_eq!(client.block().await.unwrap(), "retry: 1000");
    let began = Instant::now();
    for _ in 0..3 {
        assert_eq!(client.block().await.unwrap(), ":");
    }
    assert!(began.elapsed() >= 2 * heartbeat);
}

#[tokio::test]
async fn a_job_that_waits_and_gets_on_tells_its_progress() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    let mut client = Client::open(&server, "/v1/jobs/1/events", &[]).await;
    let task = server.claim().await.unwrap();
    for done in [3, 7] {
        let progress = store::Progress { done, ..store::Progress::default() };
        server.store.renew(task.fence, LONG, &progress).await.unwrap();
        loop {
            let message = client.must_next().await;
            if message.event == "progress" && message.data["progress"]["done"] == done {
                assert_eq!(message.id, None);
                break;
            }
        }
    }
}

#[tokio::test]
async fn as_many_streams_are_open_as_may_be() {
    let server = Server::start().await;
    let mut clients = Vec::new();
    for _ in 0..api::limits::EVENT_STREAMS {
        clients.push(Client::open(&server, "/v1/events", &[]).await);
    }
    let answer = server.get("/v1/events").await;
    answer.problem(503);
    assert_eq!(answer.header("retry-after"), "1");
    clients.pop();
    Client::open(&server, "/v1/events", &[]).await;
}

#[tokio::test]
async fn what_is_not_there_or_not_understood_is_refused() {
    let server = Server::start().await;
    server.get("/v1/jobs/9/events").await.problem(404);
    server.get("/v1/runs/9/events").await.problem(404);
    for path in [
        "/v1/events?after=-1",
        "/v1/events?after=x",
        "/v1/events?kind=progress",
        "/v1/events?job=1",
    ] {
        server.get(path).await.problem(400);
    }
    for id in ["x", "-1", "1.5"] {
        let headers = [("last-event-id", id)];
        let answer = server.request(axum::http::Method::GET, "/v1/events", &headers).await;
        let detail = answer.problem(400)["detail"].to_string();
        assert!(detail.contains("Last-Event-ID") && detail.contains(id), "{detail}");
    }
}

#[tokio::test]
async fn the_stream_of_a_revoked_token_ends() {
    let server = Server::start().await;
    let mut ids = Vec::new();
    for (name, scope) in [("ana", Scope::Admin), ("ben", Scope::Read)] {
        let new = NewToken {
            name,
            digest: Digest::of(name.as_bytes()),
            scope,
            lifetime: None,
            needs_an_admin: true,
        };
        ids.push(server.store.create_token(&new).await.unwrap().id);
    }
    let with = |name: &str| [(AUTHORIZATION.as_str(), format!("Bearer {name}"))];
    let mut clients = Vec::new();
    for name in ["ana", "ben"] {
        let [(header, value)] = &with(name);
        clients.push(Client::open(&server, "/v1/events", &[(*header, value)]).await);
    }
    let [ana, ben] = &mut clients[..] else { unreachable!() };
    server.store.revoke_token(ids[1]).await.unwrap();
    let began = Instant::now();
    assert_eq!(ben.next().await, None);
    assert!(began.elapsed() < Duration::from_secs(12), "{:?}", began.elapsed());
    let [(header, value)] = &with("ana");
    let submit = [(*header, value.as_str())];
    server.submit_to("/v1/jobs", &small_simulation(1), &submit).await;
    assert_eq!(ana.must_next().await.event, "job");
    let [(header, value)] = &with("ben");
    assert_eq!(
        ask(&server, "/v1/events", &[(*header, value)]).await.status(),
        StatusCode::UNAUTHORIZED
    );
}

#[tokio::test]
async fn deletions_are_told_to_those_who_follow_everything() {
    let server = Server::with_small_pipeline().await;
    let mut client = Client::open(&server, "/v1/events?kind=deletion", &[]).await;
    let job = server.json("/v1/datasets/1").await["job"].clone();
    assert_eq!(server.request(Method::DELETE, "/v1/datasets/1?force=true", &[]).await.status, 200);
    assert_eq!(server.post("/v1/datasets/1/restore").await.status, 200);
    for (change, message) in ["deleted", "restored"].into_iter().zip(client.kept(2).await) {
        let Value::Object(mut data) = message.data else { panic!("{:?}", message.data) };
        data.retain(|name, _| !["id", "at"].contains(&name.as_str()));
        let expected = json!({
            "event": "deletion", "job": job, "item": "dataset", "item_id": 1, "change": change,
        });
        assert_eq!(Value::Object(data), expected);
    }
}

#[tokio::test]
async fn streams_end_when_the_server_stops() {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::open(dir.path(), Access::Server).await.unwrap();
    let app = App::new(store, &Options::default());
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let shutdown = async {
        let _ = stopped.await;
    };
    let server = tokio::spawn(api::serve(listener, app, shutdown));
    let mut connection = tokio::net::TcpStream::connect(address).await.unwrap();
    let request = b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n";
    tokio::io::AsyncWriteExt::write_all(&mut connection, request).await.unwrap();
    let mut text = String::new();
    let mut bytes = [0; 4096];
    while !text.contains("retry: 1000\n") {
        let read = tokio::io::AsyncReadExt::read(&mut connection, &mut bytes).await.unwrap();
        assert!(read > 0, "{text}");
        text.push_str(std::str::from_utf8(&bytes[..read]).unwrap());
    }
    let began = Instant::now();
    stop.send(()).unwrap();
    timeout(LONG, server).await.unwrap().unwrap().unwrap();
    assert!(began.elapsed() < api::limits::SHUTDOWN_GRACE, "{:?}", began.elapsed());
    let mut rest = Vec::new();
    tokio::io::AsyncReadExt::read_to_end(&mut connection, &mut rest).await.unwrap();
    assert!(rest.ends_with(b"0\r\n\r\n"), "the stream ends in order");
}
