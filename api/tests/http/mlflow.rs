//! MLflow's REST API: requests of its clients, answered like its own server does.

use api::Options;
use axum::body::Body;
use axum::http::header::HOST;
use axum::http::{Method, Request};
use serde_json::{Value, json};

use crate::fixture::{Server, TestResponse, small_training};

const TRACKING: &str = "/api/2.0/mlflow";
const ARTIFACTS: &str = "/api/2.0/mlflow-artifacts/artifacts";

async fn post(server: &Server, path: &str, body: Value) -> TestResponse {
    server.submit_to(&format!("{TRACKING}/{path}"), &body, &[]).await
}

/// The answer to a request that must succeed.
pub async fn posted(server: &Server, path: &str, body: Value) -> Value {
    let answer = post(server, path, body).await;
    assert_eq!(answer.status, 200, "{path}: {answer:?}");
    answer.json()
}

async fn got(server: &Server, path: &str) -> Value {
    server.json(&format!("{TRACKING}/{path}")).await
}

/// Checks that this is an error in MLflow's form, and returns its message.
#[track_caller]
fn refused(answer: &TestResponse, status: u16, code: &str) -> String {
    assert_eq!(answer.status.as_u16(), status, "{answer:?}");
    assert_eq!(answer.header("content-type"), "application/json");
    let error = answer.json();
    assert_eq!(error["error_code"], code, "{error}");
    error["message"].as_str().unwrap().to_owned()
}

/// The id of a new run in the default experiment.
async fn new_run(server: &Server) -> String {
    let created = posted(server, "runs/create", json!({"start_time": 1_700_000_000_123_i64})).await;
    created["run"]["info"]["run_id"].as_str().unwrap().to_owned()
}

async fn names(server: &Server, search: Value) -> Vec<String> {
    let found = posted(server, "runs/search", search).await;
    let runs = found["runs"].as_array().unwrap();
    runs.iter().map(|run| run["info"]["run_name"].as_str().unwrap().to_owned()).collect()
}

async fn put(server: &Server, path: &str, bytes: &'static [u8]) -> TestResponse {
    let request = Request::put(format!("{ARTIFACTS}/{path}")).header(HOST, "127.0.0.1:7070");
    server.send(request.body(Body::from(bytes)).unwrap()).await
}

#[tokio::test]
async fn torqueds_own_runs_are_runs_of_its_experiment() {
    let server = Server::with_small_pipeline().await;
    let experiment = got(&server, "experiments/get-by-name?experiment_name=torqued").await;
    let id = experiment["experiment"]["experiment_id"].as_str().unwrap();
    let found = posted(&server, "runs/search", json!({"experiment_ids": [id]})).await;
    let runs = found["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 2, "{found}");
    let training = runs.iter().find(|run| run["info"]["run_name"] == "train").unwrap();
    let info = &training["info"];
    assert_eq!(
        (info["status"].as_str(), info["run_id"].as_str()),
        (Some("FINISHED"), Some("torqued-1"))
    );
    assert!(info["end_time"].as_i64() >= info["start_time"].as_i64());
    let value = |list: &str, key: &str| {
        let pairs = training["data"][list].as_array().unwrap();
        let pair = pairs.iter().find(|pair| pair["key"] == key);
        pair.unwrap_or_else(|| panic!("{key} is not in {pairs:?}"))["value"].clone()
    };
    assert_eq!(value("params", "steps"), "100");
    assert_eq!(value("params", "model.architecture"), "robomorph");
    assert_eq!(value("tags", "torqued.kind"), "train");
    assert_eq!(value("tags", "torqued.page"), "/runs/1");
    assert_eq!(value("tags", "torqued.dataset").as_str().unwrap().len(), 64);
    assert!(value("metrics", "train/loss").is_f64());
    let history =
        got(&server, "metrics/get-history?run_id=torqued-1&metric_key=train/loss&max_results=60")
            .await;
    assert_eq!(history["metrics"].as_array().unwrap().len(), 60);
    let rest = "metrics/get-history?run_id=torqued-1&metric_key=train/loss&page_token=60";
    let rest = got(&server, rest).await;
    assert_eq!(rest["metrics"][39]["step"], 99);
    assert!(rest.get("next_page_token").is_none());
}

#[tokio::test]
async fn files_of_own_runs_and_their_checkpoints_are_artifacts() {
    let server = Server::with_small_pipeline().await;
    let files = got(&server, "artifacts/list?run_id=torqued-1").await;
    assert_eq!(files["files"], json!([{"path": "checkpoints", "is_dir": true}]));
    assert_eq!(files["root_uri"], "mlflow-artifacts:/1/torqued-1/artifacts");
    let step = "checkpoints/step-00000100";
    let inner = server.json(&format!("{ARTIFACTS}?path=1/torqued-1/artifacts/{step}")).await;
    let expected = json!([
        {"path": "config.json", "is_dir": false, "file_size": 300},
        {"path": "model.safetensors", "is_dir": false, "file_size": 5000},
    ]);
    assert_eq!(inner["files"], expected);
    let weights = format!("{ARTIFACTS}/1/torqued-1/artifacts/{step}/model.safetensors");
    assert_eq!(server.get(&weights).await.body.len(), 5000);
    let report = server.get(&format!("{ARTIFACTS}/1/torqued-2/artifacts/report.json")).await;
    assert!(report.json().is_object());
    let models = posted(&server, "logged-models/search", json!({"experiment_ids": ["1"]})).await;
    assert_eq!(models, json!({"models": []}), "clients ask for these whenever they list files");
    let missing = server.get(&format!("{ARTIFACTS}/1/torqued-2/artifacts/nothing.txt")).await;
    refused(&missing, 404, "RESOURCE_DOES_NOT_EXIST");
}

/// Regression: a search only saw the newest 500 runs, which is a page of the store.
#[tokio::test]
async fn a_search_finds_all_of_torqueds_own_runs() {
    const RUNS: u64 = 501;
    let server = Server::start().await;
    let mut training = small_training(&json!({"stream": {"preset": "D1-chirp"}}));
    for seed in 1..=RUNS {
        training["seed"] = seed.into();
        server.submitted(&training).await;
    }
    let search = json!({"experiment_ids": ["1"], "order_by": ["attributes.start_time ASC"]});
    let found = names(&server, search).await;
    assert_eq!(found.len() as u64, RUNS);
}

#[tokio::test]
async fn labels_are_set_on_torqueds_own_runs_and_seen_everywhere() {
    let server = Server::with_small_pipeline().await;
    let run = "torqued-1";
    let tag = |key: &str, value: &str| json!({"run_id": run, "key": key, "value": value});
    let before = server.json("/v1/runs/1").await;
    let renamed = json!({"run_id": run, "run_name": "three seeds", "status": "FAILED"});
    let answer = post(&server, "runs/update", renamed).await.json();
    assert_eq!(answer["run_info"]["run_name"], "three seeds");
    assert_eq!(answer["run_info"]["status"], "FINISHED");
    let noted = tag("mlflow.note.content", "*sticks* at joint 3");
    assert_eq!(post(&server, "runs/set-tag", noted).await.status, 200);
    let tags = json!([{"key": "stage", "value": "lab"}, {"key": "baseline", "value": ""}]);
    let batch = json!({"run_id": run, "tags": tags});
    assert_eq!(post(&server, "runs/log-batch", batch).await.status, 200);
    assert_eq!(post(&server, "runs/set-tag", tag("stage", "field")).await.status, 200);
    let labelled = server.json("/v1/runs?tag=stage%3Dfield&text=sticks").await["runs"][0].clone();
    assert_eq!((&labelled["id"], &labelled["name"]), (&json!(1), &json!("three seeds")));
    assert_eq!(labelled["note"], "*sticks* at joint 3");
    assert_eq!(labelled["tags"], json!(["baseline", "stage=field"]));
    let page = server.get("/runs/1").await;
    for text in ["three seeds", "stage=field", "at joint 3"] {
        assert!(page.text().contains(text), "{text}");
    }
    let found = json!({"experiment_ids": ["1"], "filter": "tags.stage = 'field'"});
    assert_eq!(names(&server, found).await, ["three seeds"]);

    let message = post(&server, "runs/set-tag", tag("stage", "two words")).await;
    let message = refused(&message, 400, "INVALID_PARAMETER_VALUE");
    assert!(message.contains("stage=two words"), "{message}");
    for key in ["mlflow.runName", "mlflow.note.content", "stage", "baseline"] {
        let deleted = json!({"run_id": run, "key": key});
        assert_eq!(post(&server, "runs/delete-tag", deleted).await.status, 200, "{key}");
    }
    assert_eq!(server.json("/v1/runs/1").await, before);
    let again = post(&server, "runs/delete-tag", json!({"run_id": run, "key": "stage"})).await;
    refused(&again, 404, "RESOURCE_DOES_NOT_EXIST");
}

#[tokio::test]
async fn nothing_else_is_written_to_torqueds_own_runs() {
    let server = Server::with_small_pipeline().await;
    let run = "torqued-1";
    let metric = json!({"run_id": run, "key": "m", "value": 1, "timestamp": 1});
    for (path, body) in [
        ("runs/log-metric", metric),
        ("runs/log-parameter", json!({"run_id": run, "key": "p", "value": "1"})),
        ("runs/log-batch", json!({"run_id": run, "params": [{"key": "p", "value": "1"}]})),
        ("runs/set-tag", json!({"run_id": run, "key": "torqued.job", "value": "1"})),
        ("runs/delete-tag", json!({"run_id": run, "key": "mlflow.user"})),
        ("runs/delete", json!({"run_id": run})),
        ("experiments/delete", json!({"experiment_id": "1"})),
        ("experiments/update", json!({"experiment_id": "1", "new_name": "x"})),
    ] {
        let message = refused(&post(&server, path, body).await, 403, "PERMISSION_DENIED");
        assert!(message.contains("torqued's own"), "{message}");
    }
    let sent = put(&server, "1/torqued-1/artifacts/a.txt", b"a").await;
    refused(&sent, 403, "PERMISSION_DENIED");
}

#[tokio::test]
async fn a_client_logs_a_run_and_reads_it_back() {
    let server = Server::start().await;
    let made = posted(&server, "experiments/create", json!({"name": "arms"})).await;
    assert_eq!(made["experiment_id"], "2");
    let tags = json!([{"key": "mlflow.user", "value": "ada"}]);
    let create = json!({"experiment_id": "2", "run_name": "first", "user_id": "ada", "start_time": 5, "tags": tags});
    let run = posted(&server, "runs/create", create).await;
    let id = run["run"]["info"]["run_id"].as_str().unwrap().to_owned();
    let artifact_uri = format!("mlflow-artifacts:/2/{id}/artifacts");
    assert_eq!(run["run"]["info"]["artifact_uri"], artifact_uri);
    let batch = json!({
        "run_id": id,
        "metrics": [
            {"key": "loss", "value": 0.1, "timestamp": 9_223_372_036_854_775_807_i64, "step": 1},
            {"key": "loss", "value": "NaN", "timestamp": "12", "step": "2"},
            {"key": "best", "value": "-Infinity", "timestamp": 1},
        ],
        "params": [{"key": "lr", "value": "0.001"}],
        "tags": [{"key": "mlflow.runName", "value": "renamed"}],
    });
    posted(&server, "runs/log-batch", batch).await;
    let update = json!({"run_id": id, "status": "FINISHED", "end_time": 77});
    let updated = posted(&server, "runs/update", update).await;
    assert_eq!(updated["run_info"]["end_time"], 77);
    let found = got(&server, &format!("runs/get?run_id={id}&run_uuid={id}")).await["run"].clone();
    let info = &found["info"];
    assert_eq!((&info["run_name"], &info["status"]), (&json!("renamed"), &json!("FINISHED")));
    let expected = json!([
        {"key": "best", "value": "-Infinity", "timestamp": 1, "step": 0},
        {"key": "loss", "value": "NaN", "timestamp": 12, "step": 2},
    ]);
    assert_eq!(found["data"]["metrics"], expected);
    assert_eq!(found["data"]["params"], json!([{"key": "lr", "value": "0.001"}]));
    let history = got(&server, &format!("metrics/get-history?run_id={id}&metric_key=loss")).await;
    assert_eq!(history["metrics"][0]["timestamp"], 9_223_372_036_854_775_807_i64);
    let again = post(&server, "experiments/create", json!({"name": "arms"})).await;
    refused(&again, 400, "RESOURCE_ALREADY_EXISTS");
}

#[tokio::test]
async fn searches_filter_sort_and_turn_pages() {
    let server = Server::start().await;
    for (name, loss, optimizer) in [("a", 0.5, "adam"), ("b", 0.1, "sgd"), ("c", 0.3, "adam")] {
        let id = new_run(&server).await;
        let batch = json!({
            "run_id": id,
            "metrics": [{"key": "loss", "value": loss, "timestamp": 1}],
            "params": [{"key": "optimizer", "value": optimizer}],
            "tags": [{"key": "mlflow.runName", "value": name}],
        });
        posted(&server, "runs/log-batch", batch).await;
    }
    let all = json!({"experiment_ids": ["0"], "order_by": ["metrics.loss ASC"]});
    assert_eq!(names(&server, all.clone()).await, ["b", "c", "a"]);
    let mut some = all.clone();
    some["filter"] =
        json!("metrics.loss > 0.2 AND params.optimizer = 'adam' AND attributes.status = 'RUNNING'");
    assert_eq!(names(&server, some).await, ["c", "a"]);
    let mut liked = all.clone();
    liked["filter"] = json!("tags.mlflow.runName LIKE 'b%' AND run_name ILIKE 'B'");
    assert_eq!(names(&server, liked).await, ["b"]);
    let mut paged = all.clone();
    paged["max_results"] = json!(2);
    let first = posted(&server, "runs/search", paged.clone()).await;
    assert_eq!(first["runs"].as_array().unwrap().len(), 2);
    paged["page_token"] = first["next_page_token"].clone();
    assert_eq!(names(&server, paged).await, ["a"]);
    let mut bad = all;
    bad["filter"] = json!("metrics.loss > 'a'");
    let message = refused(&post(&server, "runs/search", bad).await, 400, "INVALID_PARAMETER_VALUE");
    assert_eq!(message, "filter is \"'a'\", allowed: a number, where the field is one");
    let experiments =
        posted(&server, "experiments/search", json!({"filter": "name LIKE 'torq%'"})).await;
    assert_eq!(experiments["experiments"][0]["experiment_id"], "1");
}

#[tokio::test]
async fn deleted_runs_are_found_when_asked_for() {
    let server = Server::start().await;
    let id = new_run(&server).await;
    posted(&server, "runs/delete", json!({"run_id": id})).await;
    let search = |view: &str| json!({"experiment_ids": ["0"], "run_view_type": view});
    assert_eq!(names(&server, search("ACTIVE_ONLY")).await.len(), 0);
    assert_eq!(names(&server, search("DELETED_ONLY")).await.len(), 1);
    let metric = json!({"run_id": id, "key": "m", "value": 1, "timestamp": 1});
    let message =
        refused(&post(&server, "runs/log-metric", metric).await, 400, "INVALID_PARAMETER_VALUE");
    assert_eq!(message, format!("run {id} is deleted; restore it first"));
    posted(&server, "runs/restore", json!({"run_id": id})).await;
    assert_eq!(names(&server, search("ALL")).await.len(), 1);
}

#[tokio::test]
async fn files_of_a_run_are_sent_listed_read_and_deleted() {
    let server = Server::start().await;
    let id = new_run(&server).await;
    let root = format!("0/{id}/artifacts");
    for (name, bytes) in [("a.txt", &b"hello"[..]), ("plots/loss.svg", b"<svg/>")] {
        assert_eq!(put(&server, &format!("{root}/{name}"), bytes).await.status, 200);
    }
    let files = got(&server, &format!("artifacts/list?run_id={id}")).await;
    let expected = json!([
        {"path": "a.txt", "is_dir": false, "file_size": 5}, {"path": "plots", "is_dir": true},
    ]);
    assert_eq!(files["files"], expected);
    let read = server.get(&format!("{ARTIFACTS}/{root}/plots/loss.svg")).await;
    assert_eq!(read.text(), "<svg/>");
    assert!(read.header("repr-digest").starts_with("sha-256="));
    for name in ["a.txt/b", "plots", "a/%2e%2e/b", ""] {
        let sent = put(&server, &format!("{root}/{name}"), b"x").await;
        refused(&sent, 400, "INVALID_PARAMETER_VALUE");
    }
    let elsewhere = put(&server, "0/models/m-1/artifacts/x", b"x").await;
    refused(&elsewhere, 404, "RESOURCE_DOES_NOT_EXIST");
    let path = format!("{ARTIFACTS}/{root}/plots");
    assert_eq!(server.request(Method::DELETE, &path, &[]).await.status, 200);
    let read = server.get(&format!("{ARTIFACTS}/{root}/plots/loss.svg")).await;
    refused(&read, 404, "RESOURCE_DOES_NOT_EXIST");
}

#[tokio::test]
async fn a_file_that_is_too_large_is_refused_and_leaves_nothing() {
    let options = Options { max_upload_bytes: 4, ..Options::default() };
    let server = Server::start_with(&options).await;
    let id = new_run(&server).await;
    let sent = put(&server, &format!("0/{id}/artifacts/a.txt"), b"hello").await;
    let message = refused(&sent, 413, "INVALID_PARAMETER_VALUE");
    assert!(message.contains("allowed: 4 bytes"), "{message}");
    let files = got(&server, &format!("artifacts/list?run_id={id}")).await;
    assert_eq!(files["files"], json!([]));
}

#[tokio::test]
async fn what_mlflow_refuses_is_refused_with_the_field_and_what_is_allowed() {
    let server = Server::start().await;
    let id = new_run(&server).await;
    let metric = |field: &str, value: Value| {
        let mut metric = json!({"key": "m", "value": 1, "timestamp": 1});
        metric[field] = value;
        json!({"run_id": id, "metrics": [metric]})
    };
    let param =
        |key: &str, value: &str| json!({"run_id": id, "params": [{"key": key, "value": value}]});
    let point = json!({"key": "m", "value": 1, "timestamp": 1});
    for (body, expected) in [
        (metric("value", json!("a")), "metrics[0].value is \"a\", allowed: a number"),
        (metric("value", Value::Null), "metrics[0].value is missing"),
        (
            metric("timestamp", json!(1.5)),
            "metrics[0].timestamp is \"1.5\", allowed: a whole number",
        ),
        (metric("timestamp", json!(-1)), "metrics[0].timestamp is \"-1\", allowed: milliseconds"),
        (metric("key", json!("../m")), "metrics[0].key is \"../m\", allowed: letters"),
        (param("a", &"x".repeat(6001)), "of 6001 characters, allowed: a text of 6000 characters"),
        (param(&"k".repeat(251), "x"), "allowed: a text of 250 characters"),
        (param("a", "\0"), "without NUL"),
        (
            json!({"run_id": id, "metrics": vec![point; 1001]}),
            "metrics is \"1001 items\", allowed: 1000",
        ),
        (json!({"run_id": id, "metrics": {}}), "metrics is \"{}\", allowed: a list"),
        (json!({"metrics": []}), "run_id is missing"),
        (json!([]), "the body is \"[]\", allowed: a JSON object"),
    ] {
        let answer = post(&server, "runs/log-batch", body).await;
        let message = refused(&answer, 400, "INVALID_PARAMETER_VALUE");
        assert!(message.contains(expected), "{message}");
    }
    posted(&server, "runs/log-batch", param("a", &"ä".repeat(6000))).await;
    let changed = post(&server, "runs/log-batch", param("a", "other")).await;
    refused(&changed, 400, "INVALID_PARAMETER_VALUE");
    let unknown = post(&server, "runs/log-batch", json!({"run_id": "no"})).await;
    let message = refused(&unknown, 404, "RESOURCE_DOES_NOT_EXIST");
    assert_eq!(message, "there is no run no");
}

#[tokio::test]
async fn guards_stand_before_these_paths_and_speak_as_mlflow_does() {
    let options = Options { token: Some("secret".to_owned()), ..Options::default() };
    let server = Server::start_with(&options).await;
    let path = format!("{TRACKING}/experiments/search");
    refused(&server.get(&path).await, 401, "UNAUTHENTICATED");
    let headers = [("authorization", "Bearer secret")];
    assert_eq!(server.request(Method::GET, &path, &headers).await.status, 200);
    let server = Server::start().await;
    let headers = [("origin", "https://evil.example"), ("host", "127.0.0.1:7070")];
    let answer = server.request(Method::POST, &path, &headers).await;
    refused(&answer, 403, "PERMISSION_DENIED");
    let absent = server.get(&format!("{TRACKING}/registered-models/search")).await;
    refused(&absent, 404, "ENDPOINT_NOT_FOUND");
    let wrong_method = server.get(&format!("{TRACKING}/runs/create")).await;
    refused(&wrong_method, 405, "ENDPOINT_NOT_FOUND");
    let broken = Request::post(path).header(HOST, "127.0.0.1:7070");
    let broken = broken.header("content-type", "application/json").body(Body::from("{")).unwrap();
    refused(&server.send(broken).await, 400, "INVALID_PARAMETER_VALUE");
}

#[tokio::test]
async fn the_page_shows_what_clients_logged() {
    let server = Server::start().await;
    let empty = server.get("/logged").await;
    assert!(empty.text().contains("There are no runs yet"), "{empty:?}");
    posted(&server, "experiments/create", json!({"name": "<b>arms"})).await;
    let create =
        json!({"experiment_id": "2", "run_name": "first <i>", "user_id": "ada", "start_time": 5});
    let run = posted(&server, "runs/create", create).await;
    let id = run["run"]["info"]["run_id"].as_str().unwrap().to_owned();
    let point = |key: &str, value: Value, step: i64| json!({"key": key, "value": value, "timestamp": 9, "step": step});
    let batch = json!({
        "run_id": id,
        "metrics": [
            point("loss", json!(0.5), -3), point("loss", json!("NaN"), 4), point("loss", json!(0.25), 7),
            point("train/accuracy", json!(0.75), 7),
        ],
        "params": [{"key": "lr", "value": "0.001"}],
        "tags": [{"key": "stage", "value": "lab"}],
    });
    posted(&server, "runs/log-batch", batch).await;
    let sent = put(&server, &format!("2/{id}/artifacts/plots/a%20b.txt"), b"text").await;
    assert_eq!(sent.status, 200, "{sent:?}");

    let list = server.get("/logged").await;
    let list = list.text();
    for part in ["first", "arms", "running", ">loss</a>", ">0.25<", ">train/accuracy</a>", ">0.75<"]
    {
        assert!(list.contains(part), "{part}: {list}");
    }
    assert!(!list.contains("<b>arms") && !list.contains("<i>"), "{list}");
    assert!(server.get("/runs").await.text().contains("href=\"./logged\""));
    for (filter, is_found) in [
        ("metrics.loss < 0.3 and params.lr = '0.001'", true),
        ("metrics.loss > 0.3", false),
        ("tags.stage = 'lab'", true),
    ] {
        let query: String = form_urlencoded::byte_serialize(filter.as_bytes()).collect();
        let found = server.get(&format!("/logged?filter={query}&columns=lr")).await;
        assert_eq!(found.text().contains(&id), is_found, "{filter}: {found:?}");
        assert_eq!(found.text().contains(">0.001<"), is_found, "{filter}: {found:?}");
    }
    let wrong = server.get("/logged?filter=loss").await;
    assert!(wrong.status == 400 && wrong.text().contains("allowed: metrics.KEY"), "{wrong:?}");
    let shown = server.get(&format!("/logged/{id}")).await;
    for part in ["by ada", "0.001", "stage", "<metadata>", "plots/a%20b.txt"] {
        assert!(shown.text().contains(part), "{part}: {}", shown.text());
    }
    // It renews itself as long as the run runs.
    let settles = "data-settled=\"for-good\"";
    assert!(shown.text().contains("id=\"latest\" data-live") && !shown.text().contains(settles));
    let other = server.get(&format!("/logged/{id}?metric=train%2Faccuracy")).await;
    assert!(other.text().contains("<title>train/accuracy</title>"), "{}", other.text());
    let unknown = server.get(&format!("/logged/{id}?metric=none")).await;
    assert!(unknown.status == 200 && unknown.text().contains("no data yet"), "{unknown:?}");
    let link = format!("{ARTIFACTS}/2/{id}/artifacts/plots/a%20b.txt");
    assert_eq!(server.get(&link).await.text(), "text");
    assert_eq!(server.get("/logged/none").await.status, 404);
    posted(&server, "runs/update", json!({"run_id": id, "status": "FINISHED"})).await;
    assert!(server.get(&format!("/logged/{id}")).await.text().contains(settles));
    posted(&server, "runs/delete", json!({"run_id": id})).await;
    assert!(server.get("/logged").await.text().contains("There are no runs yet"));
}
