//! The worst bodies that a request may have. A question of 8 MB with empty scenarios got an answer
//! of 1 GiB and left 5 GiB of memory behind; a spec of 1 MB got one of 35 MB.

use std::sync::Arc;
use std::time::{Duration, Instant};

use api::Options;
use api::limits::{ANSWERED_NUMBERS, ASKED_NUMBERS, BODY_BYTES, PAGE_BYTES, QUESTION_BYTES};
use api::live::{
    AboutModel, LiveError, LiveModel, LiveModels, LivePrediction, LiveQueue, Question,
};
use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HOST};
use axum::http::{Method, Request};
use futures::FutureExt;
use futures::future::BoxFuture;
use http_body_util::BodyExt;
use serde_json::Value;
use store::Checkpoint;

use crate::fixture::Server;

/// The most bytes of an answer to a refused request, as docs/limits.md says.
const REFUSAL_BYTES: usize = 1 << 20;

/// Far more than a check takes, and less than the slowest took.
const WITHIN: Duration = Duration::from_secs(20);

/// A model of 7 joints that stay where they are, with as many samples as are asked for.
struct Rest(AboutModel);

impl LiveModels for Rest {
    fn load<'a>(
        &'a self,
        _: &'a Checkpoint,
    ) -> BoxFuture<'a, Result<Arc<dyn LiveModel>, LiveError>> {
        let model: Arc<dyn LiveModel> = Arc::new(Self(self.0.clone()));
        async move { Ok(model) }.boxed()
    }
}

impl LiveModel for Rest {
    fn about(&self) -> &AboutModel {
        &self.0
    }

    fn predict(
        &self,
        question: Question,
        _: LiveQueue,
    ) -> BoxFuture<'static, Result<LivePrediction, LiveError>> {
        let samples = question.samples.unwrap_or(1);
        let answers = question.scenarios.shape().robots;
        let numbers = question.scenarios.u().len() + question.scenarios.y().len();
        assert!(numbers <= ASKED_NUMBERS, "{numbers}");
        let positions = vec![-0.123_456_79; samples * answers * self.0.horizon * self.0.joints];
        let none = Duration::ZERO;
        let warnings = Vec::new();
        async move { Ok(LivePrediction { positions, samples, warnings, queued: none, computed: none }) }
            .boxed()
    }
}

async fn server(context: usize, horizon: usize) -> Server {
    let about = AboutModel {
        context,
        horizon,
        joints: 7,
        rate_hz: 60.0,
        lengths: spec::Lengths::Trained,
        given: spec::Given::Torques,
        limits: Arc::default(),
        has_samples: true,
        sampler: None,
        needs_future: false,
        device: "cpu".to_owned(),
        threads: 1,
    };
    let server =
        Server::start_app(&Options::default(), |app| app.with_models(Arc::new(Rest(about)))).await;
    server.submitted(&crate::fixture::small_pipeline()).await;
    server.work().await;
    server
}

/// Sends `body`. Returns the status and the answer, which came in time.
async fn sent(
    server: &Server,
    method: Method,
    path: &str,
    kind: &str,
    body: String,
) -> (u16, Vec<u8>) {
    let request = Request::builder().method(method).uri(path).header(HOST, "127.0.0.1:7070");
    let request = request.header(CONTENT_TYPE, kind).body(Body::from(body)).unwrap();
    let began = Instant::now();
    let (parts, body) = server.answer(request).await.into_parts();
    let answer = body.collect().await.unwrap().to_bytes().to_vec();
    let took = began.elapsed();
    assert!(took < WITHIN, "{path} took {took:?}");
    (parts.status.as_u16(), answer)
}

const JSON: &str = "application/json";

/// Checks that the body is refused with a short answer, and returns the answer.
async fn refused(server: &Server, method: Method, path: &str, body: String) -> Value {
    let begin: String = body.chars().take(60).collect();
    let (status, answer) = sent(server, method, path, JSON, body).await;
    assert!((400..500).contains(&status), "{path} with {begin}: {status}");
    assert!(answer.len() <= REFUSAL_BYTES, "{path} with {begin}: {} bytes", answer.len());
    serde_json::from_slice(&answer).unwrap()
}

/// `item`, repeated as a list with about `bytes` bytes.
fn list(item: &str, bytes: usize) -> String {
    let times = bytes / (item.len() + 1);
    format!("[{}]", vec![item; times].join(","))
}

/// An object of about `bytes` bytes with fields that nobody knows.
fn unknown_fields(bytes: usize) -> String {
    let fields: Vec<String> = (0..bytes / 13).map(|i| format!("\"f{i:07}\":0")).collect();
    format!("{{{}}}", fields.join(","))
}

#[tokio::test]
async fn a_spec_full_of_faults_is_answered_with_a_hundred_and_a_number() {
    let server = Server::start().await;
    let joints = list(r#"{"a_m":0}"#, 900_000);
    let excitation = r#""excitation":{"chirp":{"frequency_hz":{"fixed":0.1}}}"#;
    let robot = format!(r#"{{"model":{{"name":"x","joints":{joints}}}}}"#);
    let spec = format!(r#"{{"kind":"simulate","trajectories":1,{excitation},"robot":{robot}}}"#);
    let problem = refused(&server, Method::POST, "/v1/jobs", spec).await;
    assert_eq!(problem["violations"].as_array().unwrap().len(), 100);
    let more = problem["more_violations"].as_u64().unwrap();
    assert!(more > 50_000, "{more}");
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.ends_with(&format!("; and {more} more")), "{detail}");

    let long = "\\u0001".repeat(150_000);
    for spec in [
        unknown_fields(900_000),
        list("0", 900_000),
        format!("\"{long}\""),
        format!(r#"{{"kind":"{long}"}}"#),
        format!(
            r#"{{"kind":"pipeline","name":"p","jobs":{{"{long}":{}}}}}"#,
            unknown_fields(50_000)
        ),
        format!(r#"{{"kind":"evaluate","checkpoints":{}}}"#, list(r#"{"checkpoint":1}"#, 900_000)),
    ] {
        refused(&server, Method::POST, "/v1/jobs", spec).await;
    }
}

#[tokio::test]
async fn a_question_full_of_faults_is_answered_in_few_words() {
    let server = server(10, 1).await;
    let path = "/v1/checkpoints/1/predict";
    let most = QUESTION_BYTES - 1000;
    let scenarios = |list: String| format!(r#"{{"scenarios":{list}}}"#);
    let with_futures = |list: String| scenarios(format!(r#"[{{"u":[],"y":[],"futures":{list}}}]"#));
    for body in [
        scenarios(list("{}", most)),
        scenarios(list("0", most)),
        scenarios(list(r#"{"u":[],"y":[]}"#, most)),
        scenarios(list(r#"{"u":[[0]],"y":[[]],"future_u":[[]]}"#, most)),
        scenarios(format!(r#"[{{"u":{},"y":[]}}]"#, list("[]", most))),
        with_futures(list("[]", most)),
        with_futures(list("[[0]]", most)),
        unknown_fields(most),
        format!(r#"{{"scenarios":[],"sampling":{{"quantiles":{}}}}}"#, list("2", most)),
        list(r#"{"":0}"#, most),
        scenarios(list(r#"{"":0}"#, most)),
    ] {
        let problem = refused(&server, Method::POST, path, body).await;
        assert!(!problem["violations"].as_array().unwrap().is_empty(), "{problem}");
    }
    // A smaller one is searched for every fault.
    let problem = refused(&server, Method::POST, path, scenarios(list("{}", 60_000))).await;
    assert_eq!(problem["violations"].as_array().unwrap().len(), 100);
    assert_eq!(problem["more_violations"], 2 * 20_000 - 100);
    // Faults within the model's lengths are capped, too.
    let body = scenarios(list(r#"{"u":[[0]],"y":[[]],"future_u":[[]]}"#, 400_000));
    let problem = refused(&server, Method::POST, path, body).await;
    assert_eq!(problem["violations"].as_array().unwrap().len(), 100);
}

/// A future of 15 bytes had a copy of its scenario's whole context.
#[tokio::test]
async fn a_long_context_is_not_copied_for_hundreds_of_thousands_of_futures() {
    let server = server(2000, 1).await;
    let row = "[0,0,0,0,0,0,0]";
    let context = list(row, 2000 * (row.len() + 1));
    let futures = list(&format!("[{row}]"), 5_000_000);
    let body = format!(r#"{{"scenarios":[{{"u":{context},"y":{context},"futures":{futures}}}]}}"#);
    let problem = refused(&server, Method::POST, "/v1/checkpoints/1/predict", body).await;
    let most = ASKED_NUMBERS / (4001 * 7);
    assert_eq!(problem["violations"][0]["field"], "scenarios");
    assert_eq!(
        problem["violations"][0]["allowed"],
        format!("1 to {most}, with each of their futures")
    );
}

#[tokio::test]
async fn the_largest_answer_of_a_model_has_a_size() {
    let server = server(1, 1).await;
    let path = "/v1/checkpoints/1/predict";
    let row = "[0,0,0,0,0,0,0]";
    let scenario = format!(r#"{{"u":[{row}],"y":[{row}],"future_u":[{row}]}}"#);
    let asked = |scenarios: usize, sampling: &str| {
        let scenarios = vec![scenario.as_str(); scenarios].join(",");
        format!(r#"{{"scenarios":[{scenarios}],"sampling":{sampling}}}"#)
    };
    let quantiles = list("0.5", 20 * 4);
    let with_quantiles = format!(r#"{{"samples":2,"quantiles":{quantiles}}}"#);
    let problem = refused(&server, Method::POST, path, asked(70_000, &with_quantiles)).await;
    assert_eq!(problem["violations"][0]["field"], "sampling", "{problem}");

    let most = ANSWERED_NUMBERS / (7 * 21);
    let (status, answer) =
        sent(&server, Method::POST, path, JSON, asked(most, &with_quantiles)).await;
    assert_eq!(status, 200);
    assert!(answer.len() > ANSWERED_NUMBERS * 5, "{}", answer.len());
    assert!(answer.len() <= ANSWERED_NUMBERS * 20, "{}", answer.len());
    let parsed: Value = serde_json::from_slice(&answer).unwrap();
    assert_eq!(parsed["scenarios"].as_array().unwrap().len(), most);
}

#[tokio::test]
async fn labels_and_tokens_that_are_none_are_answered_in_few_words() {
    let server = Server::with_small_pipeline().await;
    let most = BODY_BYTES - 1000;
    let long = "\\u0001".repeat(most / 6);
    for body in [
        format!(r#"{{"tags":{}}}"#, list(r#""ä""#, most)),
        format!(r#"{{"add_tags":{},"tags":[]}}"#, list(r#""x""#, most)),
        format!(r#"{{"name":"{long}"}}"#),
        format!(r#"{{"note":"{long}"}}"#),
        format!(r#"{{"tags":["{long}"]}}"#),
        format!(r#"{{"{long}":1}}"#),
        unknown_fields(most),
        list(r#"{"":0}"#, most),
    ] {
        for path in ["/v1/jobs/1", "/v1/runs/1", "/v1/datasets/1", "/v1/checkpoints/1"] {
            refused(&server, Method::PATCH, path, body.clone()).await;
        }
        refused(&server, Method::POST, "/v1/tokens", body).await;
    }
    let name = format!(r#"{{"name":"{long}","scope":"read"}}"#);
    refused(&server, Method::POST, "/v1/tokens", name).await;
}

#[tokio::test]
async fn values_of_a_query_are_shown_by_their_beginning() {
    let server = Server::start().await;
    let long = "%01".repeat(20_000);
    for path in
        ["/v1/jobs?limit=", "/v1/jobs?text=", "/v1/jobs?cursor=", "/v1/jobs?unknown", "/v1/"]
    {
        let problem = refused(&server, Method::GET, &format!("{path}{long}"), String::new()).await;
        let length = problem["detail"].as_str().unwrap().len();
        assert!(length < 70_000, "{path}: {length}");
    }
    let problem =
        refused(&server, Method::GET, &format!("/v1/jobs?limit={long}"), String::new()).await;
    assert!(problem["detail"].as_str().unwrap().len() < 2000, "{problem}");
}

#[tokio::test]
async fn what_clients_of_mlflow_send_wrongly_is_answered_in_few_words() {
    let server = Server::with_small_pipeline().await;
    let most = BODY_BYTES - 1000;
    let long = "\\u0001".repeat(most / 6);
    let metric = r#"{"key":"a","value":1,"timestamp":1,"step":0}"#;
    for (path, body) in [
        ("runs/log-batch", format!(r#"{{"run_id":"x","metrics":{}}}"#, list(metric, most))),
        ("runs/log-batch", format!(r#"{{"run_id":"x","tags":{}}}"#, list("{}", most))),
        ("runs/log-batch", format!(r#"{{"run_id":"{long}"}}"#)),
        ("runs/log-batch", list(r#"{"":0}"#, most)),
        ("runs/log-metric", format!(r#"{{"run_id":"x","key":"{long}","value":1,"timestamp":1}}"#)),
        (
            "runs/log-parameter",
            format!(r#"{{"run_id":"x","key":"a","value":{}}}"#, list("0", most)),
        ),
        ("runs/set-tag", format!(r#"{{"run_id":"x","key":"a/../b","value":"{long}"}}"#)),
        ("runs/search", format!(r#"{{"experiment_ids":["{long}"]}}"#)),
        ("runs/search", format!(r#"{{"experiment_ids":["1"],"filter":"{long}"}}"#)),
        ("runs/search", format!(r#"{{"experiment_ids":["1"],"order_by":["{long}"]}}"#)),
        (
            "runs/search",
            format!(r#"{{"experiment_ids":["1"],"order_by":{}}}"#, list("\"a\"", most)),
        ),
        ("experiments/search", format!(r#"{{"filter":"{long}"}}"#)),
        ("experiments/create", format!(r#"{{"name":"{long}"}}"#)),
        ("runs/create", format!(r#"{{"experiment_id":"{long}"}}"#)),
        ("runs/update", format!(r#"{{"run_id":"x","status":"{long}"}}"#)),
    ] {
        let path = format!("/api/2.0/mlflow/{path}");
        let error = refused(&server, Method::POST, &path, body).await;
        let message = error["message"].as_str().unwrap();
        assert!(message.len() < 3000, "{path}: {}", message.len());
    }
}

#[tokio::test]
async fn the_mapping_of_an_upload_is_checked_as_a_spec_is() {
    let server = Server::start().await;
    let most = BODY_BYTES - 2000;
    let named: Vec<String> = (0..most / 10).map(|i| format!("\"c{i:05}\"")).collect();
    let named = named.join(",");
    for spec in [
        unknown_fields(most),
        list("0", most),
        format!(r#"{{"columns":{}}}"#, list("0", most)),
        format!(r#"{{"columns":{{"u":[{named}],"q":[]}}}}"#),
        format!(r#"{{"kind":{}}}"#, list("0", most)),
        format!(r#"{{"robot":{{"model":{{"name":"x","joints":{}}}}}}}"#, list("{}", most)),
    ] {
        let body = format!(
            "--B\r\nContent-Disposition: form-data; name=\"spec\"\r\n\r\n{spec}\r\n--B\r\n\
             Content-Disposition: form-data; name=\"file\"; filename=\"a.csv\"\r\n\
             Content-Type: text/csv\r\n\r\nu1\n1\n\r\n--B--\r\n"
        );
        let begin: String = spec.chars().take(40).collect();
        let kind = "multipart/form-data; boundary=B";
        let (status, answer) = sent(&server, Method::POST, "/v1/datasets", kind, body).await;
        assert_eq!(status, 422, "{begin}: {}", String::from_utf8_lossy(&answer));
        assert!(answer.len() <= REFUSAL_BYTES, "{begin}: {}", answer.len());
    }
}

#[tokio::test]
async fn a_form_of_a_page_shows_what_is_wrong_with_it_in_few_words() {
    let server = Server::with_small_pipeline().await;
    let tags = "%01+".repeat(200_000);
    let form = "application/x-www-form-urlencoded";
    for (path, body) in [
        ("/jobs/1", format!("shown=a&name=b&note=&tags={tags}")),
        ("/jobs/1", format!("shown=a&name={tags}&note=&tags=")),
        ("/login", format!("token={tags}&back=%2F")),
    ] {
        let (status, answer) = sent(&server, Method::POST, path, form, body).await;
        assert!((300..500).contains(&status), "{path}: {status}");
        assert!(answer.len() <= REFUSAL_BYTES, "{path}: {}", answer.len());
    }
}

/// Answers to other requests do not wait for a body that takes long to be checked.
#[tokio::test]
async fn other_requests_are_answered_while_a_body_is_checked() {
    let server = Server::start().await;
    let spec = format!(r#"{{"kind":"simulate",{}"#, &unknown_fields(900_000)[1..]);
    let slow = refused(&server, Method::POST, "/v1/jobs", spec);
    let mut answered = 0;
    let others = async {
        loop {
            assert_eq!(server.get("/v1/presets").await.status, 200);
            answered += 1;
            tokio::task::yield_now().await;
        }
    };
    let problem = tokio::select! {
        biased;
        problem = slow => problem,
        () = others => unreachable!("it never ends"),
    };
    assert_eq!(problem["violations"].as_array().unwrap().len(), 100);
    assert!(answered > 0, "nothing was answered meanwhile");
}

/// 500 specs of 1 MiB were one answer.
#[tokio::test]
async fn a_page_of_large_specs_ends_early_and_the_next_goes_on() {
    let server = Server::start().await;
    let needs = list("\"a\"", 900_000);
    let simulation = |seed: u64| crate::fixture::small_simulation(seed).to_string();
    let second = format!("{},\"needs\":{needs}}}", simulation(2).strip_suffix('}').unwrap());
    for number in 0..22 {
        let jobs = format!(r#"{{"a":{},"b":{second}}}"#, simulation(1));
        let spec = format!(r#"{{"kind":"pipeline","name":"p{number}","jobs":{jobs}}}"#);
        let (status, answer) = sent(&server, Method::POST, "/v1/jobs", JSON, spec).await;
        assert_eq!(status, 201, "{}", String::from_utf8_lossy(&answer[..300]));
    }
    let mut seen = Vec::new();
    let mut path = "/v1/jobs?kind=pipeline&limit=100".to_owned();
    let mut pages = 0;
    loop {
        let (status, answer) = sent(&server, Method::GET, &path, JSON, String::new()).await;
        assert_eq!(status, 200);
        assert!(answer.len() <= PAGE_BYTES + (2 << 20), "{}", answer.len());
        let page: Value = serde_json::from_slice(&answer).unwrap();
        seen.extend(page["jobs"].as_array().unwrap().iter().map(|job| job["id"].as_i64().unwrap()));
        pages += 1;
        let Some(next) = page["next"].as_str() else { break };
        path = format!("/v1/jobs?kind=pipeline&limit=100&cursor={next}");
    }
    assert_eq!((pages, seen.len()), (2, 22));
    assert!(seen.is_sorted_by(|a, b| a > b), "{seen:?}");
}
