//! Whatever a client sends, the answer is never an internal error.

use axum::body::Body;
use axum::http::Request;
use axum::http::header::{CONTENT_TYPE, HOST};
use proptest::prelude::*;
use serde_json::{Value, json};
use tokio::runtime::Runtime;

use crate::fixture::{Server, small_pipeline};

/// Any JSON, with words of specs among its keys.
fn any_json() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<f64>().prop_map(Value::from),
        prop_oneof![
            Just("simulate"),
            Just("train"),
            Just("evaluate"),
            Just("pipeline"),
            Just("robomorph"),
            Just("D1-chirp"),
            Just("quickstart"),
            Just("grid-chirp"),
        ]
        .prop_map(Value::from),
        ".{0,8}".prop_map(Value::from),
    ];
    leaf.prop_recursive(4, 40, 6, |inner| {
        let key = prop_oneof![
            Just("kind"),
            Just("preset"),
            Just("data"),
            Just("jobs"),
            Just("job"),
            Just("name"),
            Just("dataset"),
            Just("checkpoint"),
            Just("digest"),
            Just("model"),
            Just("excitation"),
            Just("multisine"),
            Just("frequency_hz"),
            Just("grid"),
            Just("checkpoints"),
            Just("trajectories"),
            Just("steps"),
            Just("needs"),
            Just("execution"),
            Just("samples"),
        ]
        .prop_map(str::to_owned);
        prop_oneof![
            proptest::collection::vec(inner.clone(), 0..4).prop_map(Value::from),
            proptest::collection::hash_map(key, inner, 0..6).prop_map(Value::from_iter),
        ]
    })
}

/// A valid spec with one arbitrary field.
fn almost_a_spec() -> impl Strategy<Value = Value> {
    let base = prop_oneof![
        Just(json!({"preset": "D1-multisine", "trajectories": 10})),
        Just(json!({"kind": "train", "data": {"dataset": 1}, "steps": 5, "batch_size": 4,
                    "model": {"preset": "robomorph-tiny"}})),
        Just(json!({"kind": "evaluate", "data": {"dataset": 2},
                    "checkpoints": [{"checkpoint": 1}]})),
        Just(small_pipeline()),
    ];
    let field = prop_oneof![
        Just("trajectories"),
        Just("seed"),
        Just("samples"),
        Just("rate_hz"),
        Just("excitation"),
        Just("shard_trajectories"),
        Just("data"),
        Just("model"),
        Just("steps"),
        Just("context"),
        Just("checkpoints"),
        Just("baselines"),
        Just("bootstrap"),
        Just("jobs"),
        Just("execution"),
        Just("robot"),
        Just("integrator"),
        Just("rejection"),
        Just("initial_state"),
    ];
    (base, field, any_json()).prop_map(|(mut base, field, value)| {
        base[field] = value;
        base
    })
}

fn submit(body: Vec<u8>, path: &str) -> Request<Body> {
    Request::post(path)
        .header(HOST, "localhost")
        .header(CONTENT_TYPE, "application/json")
        .body(Body::from(body))
        .unwrap()
}

/// Sends the drawn `requests` to one server and checks every answer.
fn check(requests: impl Strategy<Value = Option<Request<Body>>>, cases: u32) {
    let runtime = Runtime::new().unwrap();
    let server = runtime.block_on(Server::with_small_pipeline());
    let config = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    proptest!(config, |(request in requests)| {
        if let Some(request) = request {
            let answer = runtime.block_on(server.send(request));
            prop_assert!(!answer.status.is_server_error(), "{:?}", answer);
            if answer.status.is_client_error() && !answer.body.is_empty() {
                let kind = answer.header("content-type");
                let told = ["application/problem+json", "text/html; charset=utf-8"].contains(&kind);
                prop_assert!(told, "{:?}", answer);
            }
        }
    });
}

#[test]
fn no_body_is_a_fault_of_the_server() {
    let bodies = prop_oneof![
        proptest::collection::vec(any::<u8>(), 0..200),
        any_json().prop_map(|value| value.to_string().into_bytes()),
        almost_a_spec().prop_map(|value| value.to_string().into_bytes()),
    ];
    check(bodies.prop_map(|body| Some(submit(body, "/v1/jobs"))), 600);
}

#[test]
fn no_path_query_or_header_is_a_fault_of_the_server() {
    let segment = prop_oneof![
        Just("v1".to_owned()),
        Just("jobs".to_owned()),
        Just("datasets".to_owned()),
        Just("runs".to_owned()),
        Just("checkpoints".to_owned()),
        Just("evaluations".to_owned()),
        Just("files".to_owned()),
        Just("metrics".to_owned()),
        Just("figures".to_owned()),
        Just("1".to_owned()),
        Just("tasks".to_owned()),
        Just("trajectories".to_owned()),
        Just("figure.svg".to_owned()),
        Just("figure.csv".to_owned()),
        Just("summary".to_owned()),
        Just("spectrum.svg".to_owned()),
        Just("dataset.json".to_owned()),
        any::<i64>().prop_map(|id| id.to_string()),
        "[ -~]{0,6}",
        "(%[0-9a-fA-F]{2}){1,3}",
    ];
    let query = prop_oneof![
        Just(String::new()),
        "\\?(limit|before|cursor|sort|tag|text|since|points|state|kind|force|format|trajectory)=[-0-9a-z%]{0,8}",
        "\\?[ -~]{0,12}",
    ];
    let path = (proptest::collection::vec(segment, 1..6), query)
        .prop_map(|(segments, query)| format!("/{}{query}", segments.join("/")));
    let header =
        prop_oneof![Just("range"), Just("if-range"), Just("if-none-match"), Just("accept")];
    let requests = (path, header, "[ -~]{0,16}").prop_map(|(path, header, value)| {
        // hyper does not let invalid URIs through either.
        Request::get(path)
            .header(HOST, "localhost")
            .header(header, value)
            .body(Body::empty())
            .ok()
            .filter(|request| request.uri().path() != "*")
    });
    check(requests, 1500);
}

/// The same for paths that are similar to existing ones.
#[test]
fn no_look_into_a_dataset_is_a_fault_of_the_server() {
    let number = prop_oneof![
        (0u64..25).prop_map(|value| value.to_string()),
        any::<u64>().prop_map(|value| value.to_string()),
        any::<i64>().prop_map(|value| value.to_string()),
        "[-+0-9a-fx.%]{0,5}",
    ];
    let tail = prop_oneof![
        Just("/figure.svg"),
        Just("/figure.csv"),
        Just("?format=arrow"),
        Just("?format=json"),
        Just("?format="),
        Just("/"),
        Just(""),
    ];
    let path = (0u32..4, number, tail, any::<bool>()).prop_map(|(id, number, tail, page)| {
        if page {
            format!("/datasets/{id}?trajectory={number}")
        } else {
            format!("/v1/datasets/{id}/trajectories/{number}{tail}")
        }
    });
    let accept =
        prop_oneof![Just("application/vnd.apache.arrow.stream".to_owned()), "[ -~]{0,16}",];
    let requests = (path, accept).prop_map(|(path, accept)| {
        let request = Request::get(path).header(HOST, "localhost").header("accept", accept);
        request.body(Body::empty()).ok()
    });
    check(requests, 400);
}
