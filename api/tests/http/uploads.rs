//! Uploads: complete, partial, too large, too slow, and repeated.

use std::convert::Infallible;
use std::time::Duration;

use api::Options;
use axum::body::{Body, Bytes};
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE, HOST};
use axum::http::{Request, StatusCode};
use futures::stream;
use serde_json::{Value, json};
use spec::{Digest, JobKind};
use store::{FileContent, ShardContents, object_path};

use crate::fixture::{Server, TestResponse, bytes_of, small_training};
use crate::robots::added;

const CSV: &[u8] = b"u1,u2\n1,2\n";

/// An import spec in an upload.
fn mapping() -> Value {
    let names = |prefix: &str| (1..=7).map(|i| format!("{prefix}{i}")).collect::<Vec<_>>();
    json!({"columns": {"u": names("u"), "q": names("q")}})
}

/// Percent-encoded, for a query.
fn encoded(text: &str) -> String {
    text.bytes().map(|byte| format!("%{byte:02X}")).collect()
}

fn path(spec: &Value) -> String {
    format!("/v1/datasets?spec={}&name=arm.csv", encoded(&spec.to_string()))
}

async fn send(server: &Server, path: &str, media_type: &str, body: Body) -> TestResponse {
    let request = Request::post(path).header(HOST, "127.0.0.1:7070");
    server.send(request.header(CONTENT_TYPE, media_type).body(body).unwrap()).await
}

pub async fn send_recordings(server: &Server) -> TestResponse {
    send(server, &path(&mapping()), "text/csv", Body::from(CSV)).await
}

/// A form with parts: name, further headers, content.
pub fn form(parts: &[(&str, &str, &[u8])]) -> Body {
    let mut body = Vec::new();
    for (name, more, content) in parts {
        let head = format!("--B\r\nContent-Disposition: form-data; name=\"{name}\"{more}\r\n\r\n");
        body.extend([head.as_bytes(), content, b"\r\n"].concat());
    }
    body.extend(b"--B--\r\n");
    Body::from(body)
}

pub const FORM: &str = "multipart/form-data; boundary=B";
const FILE: &str = "; filename=\"arm.csv\"\r\nContent-Type: text/csv";

/// The number of files in the server's folder that come from uploads, committed or not.
async fn kept(server: &Server) -> usize {
    server.store.newest_uploads(100).await.unwrap().len()
}

#[tokio::test]
async fn a_file_becomes_an_upload_and_an_import() {
    let server = Server::start().await;
    let answer = send(&server, &path(&mapping()), "text/csv", Body::from(CSV)).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
    let job = answer.json();
    assert_eq!(answer.header("location"), format!("/v1/jobs/{}", job["id"]));
    assert_eq!((&job["kind"], &job["state"]), (&json!("import"), &json!("queued")));
    assert_eq!(job["spec"]["file"], Digest::of(CSV).to_string());
    assert_eq!(job["spec"]["format"], "csv");
    assert_eq!(job["dataset"], 1);
    let upload = server.store.upload(Digest::of(CSV)).await.unwrap().unwrap();
    assert_eq!((upload.name.as_str(), upload.object.size), ("arm.csv", 10));
    assert_eq!(&server.store.read_object(&upload.object).await.unwrap()[..], CSV);
}

#[tokio::test]
async fn a_form_does_the_same_as_a_body() {
    let server = Server::start().await;
    let spec = mapping().to_string();
    let body = form(&[("spec", "", spec.as_bytes()), ("file", FILE, CSV)]);
    let answer = send(&server, "/v1/datasets", FORM, body).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
    let again = send(&server, &path(&mapping()), "text/csv", Body::from(CSV)).await;
    assert_eq!(again.status, StatusCode::OK, "{again:?}");
    assert_eq!(again.json()["id"], answer.json()["id"]);
    let upload = server.store.upload(Digest::of(CSV)).await.unwrap().unwrap();
    assert_eq!(upload.name, "arm.csv");
    let forced = format!("{}&force=true", path(&mapping()));
    let forced = send(&server, &forced, "text/csv", Body::from(CSV)).await;
    assert_eq!(forced.status, StatusCode::ACCEPTED);
    assert_ne!(forced.json()["id"], answer.json()["id"]);
    assert_eq!(kept(&server).await, 1);
}

const TUESDAY: &[u8] = b"u1,u2\n3,4\n";
const TUESDAY_FILE: &str = "; filename=\"tuesday.csv\"\r\nContent-Type: text/csv";

#[tokio::test]
async fn the_files_of_a_form_become_one_dataset() {
    let server = Server::start().await;
    let send_form = async |spec: &Value, files: &[(&str, &str, &[u8])]| {
        let spec = spec.to_string();
        let parts = [&[("spec", "", spec.as_bytes())], files].concat();
        send(&server, "/v1/datasets", FORM, form(&parts)).await
    };
    let both = [("file", FILE, CSV), ("file", TUESDAY_FILE, TUESDAY)];
    let answer = send_form(&mapping(), &both).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
    let job = answer.json();
    let listed = json!([
        {"name": "arm", "file": Digest::of(CSV)}, {"name": "tuesday", "file": Digest::of(TUESDAY)},
    ]);
    assert_eq!((&job["spec"]["files"], &job["spec"]["file"]), (&listed, &Value::Null));
    assert_eq!(kept(&server).await, 2);
    let again = send_form(&mapping(), &both).await;
    assert_eq!((again.status, &again.json()["id"]), (StatusCode::OK, &job["id"]));

    // Only the one that the server does not have is named, and it is enough to send that one.
    let third = Digest::of(b"u1,u2\n5,6\n");
    let mut more = mapping();
    more["files"] = json!([listed[0], listed[1], {"name": "wednesday", "file": third}]);
    let mut known = more.clone();
    known["kind"] = json!("import");
    known["format"] = json!("csv");
    let missing = server.submit(&known).await.problem(422);
    assert_eq!(missing["violations"].as_array().unwrap().len(), 1, "{missing}");
    assert_eq!(missing["violations"][0]["field"], "files[2].file");
    let other = send_form(&more, &[("file", FILE, b"u1,u2\n7,8\n")]).await.problem(422);
    assert_eq!(other["violations"][0]["field"], "files", "{other}");
    let answer = send_form(&more, &[("file", FILE, b"u1,u2\n5,6\n")]).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
    assert_eq!(answer.json()["spec"]["files"], more["files"]);
}

#[tokio::test]
async fn the_page_says_whether_torques_contain_the_weight_of_the_arm() {
    let server = Server::start().await;
    let robot = added(&server).await["id"].to_string();
    let columns = json!({"u": ["u1", "u2"], "q": ["q1", "q2"]});
    let send_form = async |mapping: Value, gravity: &str| {
        let spec = mapping.to_string();
        let parts = [
            ("spec", "", spec.as_bytes()),
            ("robot", "", robot.as_bytes()),
            ("gravity", "", gravity.as_bytes()),
            ("file", FILE, &b"u1,u2,q1,q2\n1,1,0.1,0.1\n"[..]),
        ];
        send(&server, "/datasets", FORM, form(&parts)).await
    };
    let plain = json!({"columns": columns, "samples": 9});
    let mut own = plain.clone();
    own["robot"] = json!({"model": {"robot": robot.parse::<i64>().unwrap()}, "gravity": "off"});
    for (mapping, gravity, expected) in
        [(&plain, "", "off"), (&plain, "on", "on"), (&own, "compensated", "off")]
    {
        let answer = send_form(mapping.clone(), gravity).await;
        assert_eq!(answer.status, StatusCode::SEE_OTHER, "{answer:?}");
        let place = answer.header("location").split('?').next().unwrap().to_owned();
        let job = server.json(&format!("/v1{place}")).await;
        assert_eq!(job["spec"]["robot"]["gravity"], expected, "{job:#}");
        assert_eq!(job["spec"]["robot"]["model"]["name"], "lamp", "{job:#}");
    }
    let refused = send_form(json!({"columns": columns, "samples": 1}), "compensated").await;
    assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY);
    let chosen = "<option value=\"compensated\" selected>";
    assert!(refused.text().contains(chosen), "{refused:?}");
}

#[tokio::test]
async fn the_page_takes_recordings_of_a_robot() {
    let server = Server::start().await;
    let robot = added(&server).await["id"].to_string();
    let columns = json!({"u": ["u1", "u2"], "q": ["q1", "q2"]});
    let spec = json!({"columns": columns, "samples": 9}).to_string();
    let unnamed = "; filename=\"log.csv\"\r\nContent-Type: application/octet-stream";
    let log = ("file", unnamed, &b"u1,u2,q1,q2\n1,1,0.1,0.1\n"[..]);
    let send_form = async |spec: &str, robot: &str| {
        let parts = [
            ("spec", "", spec.as_bytes()),
            ("robot", "", robot.as_bytes()),
            ("name", "", b"<mine>"),
            ("tags", "", b"lab a"),
            log,
        ];
        send(&server, "/datasets", FORM, form(&parts)).await
    };
    let answer = send_form(&spec, &robot).await;
    assert_eq!(answer.status, StatusCode::SEE_OTHER, "{answer:?}");
    let job = server.json(&format!("/v1{}", answer.header("location"))).await;
    assert_eq!((&job["name"], &job["tags"]), (&json!("<mine>"), &json!(["a", "lab"])));
    assert_eq!(job["spec"]["robot"]["model"]["name"], "lamp", "{job:#}");
    let again = send_form(&spec, &robot).await;
    let asked = "?again=1&name=%3Cmine%3E&tags=lab+a";
    assert!(again.header("location").ends_with(asked), "{again:?}");

    // The form keeps its texts, and its fault stands above it.
    let refused = send_form(&spec.replace('9', "1"), &robot).await;
    assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY);
    for part in ["<code>samples</code> is 1", "&#60;mine&#62;", "selected>my lamp", "lab a"] {
        assert!(refused.text().contains(part), "{part}: {}", refused.text());
    }
    for (spec, robot, part) in [("{", "", "a JSON object"), (&spec, "99", "robot.model.robot")] {
        let refused = send_form(spec, robot).await;
        assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY, "{refused:?}");
        assert!(refused.text().contains(part), "{part}: {}", refused.text());
    }
    let no_form = send(&server, "/datasets", "text/csv", Body::from(CSV)).await;
    assert_eq!(no_form.status, StatusCode::BAD_REQUEST, "{no_form:?}");
    let long = form(&[("name", "", &[b'a'; 5000]), log]);
    let long = send(&server, "/datasets", FORM, long).await;
    assert_eq!(long.status, StatusCode::PAYLOAD_TOO_LARGE, "{long:?}");
    assert!(long.text().contains("4096"), "{}", long.text());
    let foreign = form(&[("colour", "", b"red"), log]);
    let foreign = send(&server, "/datasets", FORM, foreign).await;
    assert_eq!(foreign.status, StatusCode::BAD_REQUEST, "{foreign:?}");
}

#[tokio::test]
async fn files_that_cannot_be_one_dataset_are_refused() {
    let server = Server::start().await;
    let refused = async |spec: &Value, files: &[(&str, &str, &[u8])], field: &str| {
        let spec = spec.to_string();
        let parts = [&[("spec", "", spec.as_bytes())], files].concat();
        let problem = send(&server, "/v1/datasets", FORM, form(&parts)).await.problem(422);
        assert_eq!(problem["violations"][0]["field"], field, "{problem}");
    };
    let tuesday = ("file", TUESDAY_FILE, TUESDAY);
    refused(&mapping(), &[("file", FILE, CSV), ("file", FILE, TUESDAY)], "files.name").await;
    refused(&mapping(), &[("file", FILE, CSV), ("file", TUESDAY_FILE, CSV)], "files.file").await;
    refused(&mapping(), &[tuesday, ("file", FILE, b"")], "file").await;
    let parquet = "; filename=\"b.parquet\"\r\nContent-Type: application/vnd.apache.parquet";
    refused(&mapping(), &[tuesday, ("file", parquet, CSV)], "format").await;
    let mut spec = mapping();
    spec["file"] = json!(Digest::of(CSV));
    spec["files"] = json!([{"name": "tuesday", "file": Digest::of(TUESDAY)}]);
    refused(&spec, &[tuesday], "files").await;
    spec.as_object_mut().unwrap().remove("file");
    spec["files"][0]["name"] = json!("");
    refused(&spec, &[tuesday], "files[0].name").await;
    assert!(server.json("/v1/jobs").await["jobs"].as_array().unwrap().is_empty());
}

#[tokio::test]
async fn a_file_that_is_known_is_imported_by_its_digest() {
    let server = Server::start().await;
    let mut spec = mapping();
    spec["kind"] = json!("import");
    spec["format"] = json!("csv");
    spec["file"] = json!(Digest::of(CSV));
    let unknown = server.submit(&spec).await.problem(422);
    assert_eq!(unknown["violations"][0]["field"], "file");
    assert!(unknown["detail"].as_str().unwrap().contains("POST /v1/datasets"), "{unknown}");

    send(&server, &path(&mapping()), "text/csv", Body::from(CSV)).await;
    assert_eq!(server.submit(&spec).await.status, StatusCode::OK);
    spec["samples"] = json!(100);
    assert_eq!(server.submit(&spec).await.status, StatusCode::CREATED);
    spec["file"] = json!("0".repeat(64));
    let unknown = server.submit(&spec).await.problem(422);
    assert!(unknown["detail"].as_str().unwrap().contains("(arm.csv)"), "{unknown}");
    let pipeline = json!({"kind": "pipeline", "name": "p", "jobs": {"own": spec}});
    let unknown = server.submit(&pipeline).await.problem(422);
    assert_eq!(unknown["violations"][0]["field"], "jobs.own.file");
}

#[tokio::test]
async fn a_spec_that_cannot_be_accepted_is_refused_before_the_file() {
    let server = Server::start().await;
    let never = || Body::from_stream(stream::pending::<Result<Bytes, Infallible>>());
    let refused = async |spec: Value, field: &str| {
        let problem = send(&server, &path(&spec), "text/csv", never()).await.problem(422);
        assert_eq!(problem["violations"][0]["field"], field, "{problem}");
    };
    let with = |field: &str, value: Value| {
        let mut spec = mapping();
        spec[field] = value;
        spec
    };
    refused(with("samples", json!(1)), "samples").await;
    refused(with("colums", json!({})), "colums").await;
    refused(with("kind", json!("simulate")), "kind").await;
    refused(with("format", json!("parquet")), "format").await;
    refused(json!([]), "").await;
    refused(json!({}), "columns").await;
    let no_spec = send(&server, "/v1/datasets", "text/csv", never()).await.problem(400);
    assert!(no_spec["detail"].as_str().unwrap().contains("spec"), "{no_spec}");
    send(&server, "/v1/datasets?spec=%7B", "text/csv", never()).await.problem(400);
    let other = send(&server, &path(&mapping()), "image/png", never()).await.problem(415);
    assert!(other["detail"].as_str().unwrap().contains("text/csv"), "{other}");
    assert_eq!(kept(&server).await, 0);
}

#[tokio::test]
async fn a_file_of_another_digest_than_its_spec_says_is_refused() {
    let server = Server::start().await;
    let mut spec = mapping();
    spec["file"] = json!("0".repeat(64));
    let problem = send(&server, &path(&spec), "text/csv", Body::from(CSV)).await.problem(422);
    assert_eq!(problem["violations"][0]["field"], "file");
    assert!(problem["detail"].as_str().unwrap().contains(&Digest::of(CSV).to_string()));
    let problem = send(&server, &path(&mapping()), "text/csv", Body::empty()).await.problem(422);
    assert!(problem["detail"].as_str().unwrap().contains("empty"));
    assert_eq!(kept(&server).await, 0);
}

#[tokio::test]
async fn a_file_beyond_the_limit_is_refused_with_it() {
    let options = Options { max_upload_bytes: 1000, ..Options::default() };
    let server = Server::start_with(&options).await;
    let large = bytes_of(1001, 0);
    // As a stream, without a declared length.
    let pieces = [large.slice(..600), large.slice(600..)].map(Ok::<_, Infallible>);
    let body = Body::from_stream(stream::iter(pieces));
    let problem = send(&server, &path(&mapping()), "text/csv", body).await.problem(413);
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("1000") && detail.contains("--max-upload-bytes"), "{detail}");
    // With a declared length, and without any bytes.
    let request = Request::post(path(&mapping()))
        .header(HOST, "127.0.0.1:7070")
        .header(CONTENT_TYPE, "text/csv")
        .header(CONTENT_LENGTH, "5000000000")
        .body(Body::from_stream(stream::pending::<Result<Bytes, Infallible>>()));
    server.send(request.unwrap()).await.problem(413);
    let spec = mapping().to_string();
    let body = form(&[("spec", "", spec.as_bytes()), ("file", FILE, &large)]);
    send(&server, "/v1/datasets", FORM, body).await.problem(413);
    assert_eq!(kept(&server).await, 0);
    let exact = Body::from(large.slice(1..));
    let answer = send(&server, &path(&mapping()), "text/csv", exact).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED);
}

#[tokio::test]
async fn a_body_that_breaks_off_leaves_nothing() {
    let server = Server::start().await;
    let pieces = || {
        let broken = std::io::Error::other("connection reset");
        stream::iter([Ok(Bytes::from(vec![b'1'; 100_000])), Err(broken)])
    };
    let answer = send(&server, &path(&mapping()), "text/csv", Body::from_stream(pieces())).await;
    answer.problem(400);
    let spec = mapping().to_string();
    let whole = form(&[("spec", "", spec.as_bytes()), ("file", FILE, CSV)]);
    let whole = http_body_util::BodyExt::collect(whole).await.unwrap().to_bytes();
    for cut in [10, 60, whole.len() - 30, whole.len() - 8] {
        let answer = send(&server, "/v1/datasets", FORM, Body::from(whole.slice(..cut))).await;
        assert!([400, 422].contains(&answer.status.as_u16()), "{cut}: {answer:?}");
        answer.problem(answer.status.as_u16());
    }
    assert_eq!(kept(&server).await, 0);
    assert!(server.json("/v1/jobs").await["jobs"].as_array().unwrap().is_empty());
}

#[tokio::test]
async fn a_file_that_stops_coming_is_given_up() {
    let upload_stall = Duration::from_millis(50);
    let server = Server::start_with(&Options { upload_stall, ..Options::default() }).await;
    let first = stream::iter([Ok::<_, Infallible>(Bytes::from_static(CSV))]);
    let body = Body::from_stream(futures::StreamExt::chain(first, stream::pending()));
    let problem = send(&server, &path(&mapping()), "text/csv", body).await.problem(408);
    assert!(problem["detail"].as_str().unwrap().contains("0.05 s"), "{problem}");
    assert_eq!(kept(&server).await, 0);
}

#[tokio::test]
async fn a_form_has_the_spec_and_then_the_file() {
    let server = Server::start().await;
    let spec = mapping().to_string();
    let spec = ("spec", "", spec.as_bytes());
    let file = ("file", FILE, CSV);
    let other = ("other", "", CSV);
    for (parts, expected) in [
        (&[file, spec][..], "instead of part \"spec\""),
        (&[spec][..], "instead of part \"file\""),
        (&[spec, other][..], "unknown field received: \"other\""),
        (&[spec, file, spec][..], "instead of part \"file\" or the end"),
        (&[][..], "instead of part \"spec\""),
    ] {
        let problem = send(&server, "/v1/datasets", FORM, form(parts)).await.problem(400);
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(expected), "{detail}");
    }
    send(&server, "/v1/datasets", "multipart/form-data", form(&[])).await.problem(400);
    let both = send(&server, &path(&mapping()), FORM, form(&[spec, file])).await;
    both.problem(400);
    assert_eq!(kept(&server).await, 1, "the file before the part that is no file");
}

#[tokio::test]
async fn an_idempotency_key_names_one_upload() {
    let server = Server::start().await;
    let send = async |body: &'static [u8]| {
        let request = Request::post(format!("{}&force=true", path(&mapping())))
            .header(HOST, "127.0.0.1:7070")
            .header(CONTENT_TYPE, "text/csv")
            .header("idempotency-key", "7b6a");
        server.send(request.body(Body::from(body)).unwrap()).await
    };
    let first = send(CSV).await.json();
    assert_eq!(send(CSV).await.json()["id"], first["id"]);
    send(b"u1,u2\n3,4\n").await.problem(422);
}

#[tokio::test]
async fn an_imported_dataset_can_be_trained_on_and_evaluated_on() {
    let server = Server::start().await;
    send(&server, &path(&mapping()), "text/csv", Body::from(CSV)).await;
    let task = server.claim().await.unwrap();
    assert_eq!((task.kind.as_str(), task.total), (JobKind::Import.as_str(), 0));
    let file = async |content: FileContent| {
        let path = object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
        server.store.put_object(&path, bytes_of(1000, content as u8)).await.unwrap()
    };
    let shard = ShardContents {
        first: 0,
        count: 12,
        rejected: 0,
        trajectories: file(FileContent::Trajectories).await,
        robots: file(FileContent::Robots).await,
    };
    server.store.commit_import(task.fence, &shard, &json!({})).await.unwrap();

    let dataset = server.json("/v1/datasets/1").await;
    assert_eq!((&dataset["trajectories"], &dataset["state"]), (&json!(12), &json!("complete")));
    assert_eq!(dataset["files"][1]["rows"], 12 * 400);
    assert_eq!(server.get("/datasets/1").await.status, StatusCode::OK);
    assert_eq!(server.get("/jobs/1").await.status, StatusCode::OK);
    let job = server.json("/v1/jobs/1").await;
    assert_eq!((&job["progress"]["done"], &job["progress"]["total"]), (&json!(12), &json!(12)));

    let training = server.submit(&small_training(&json!({"dataset": 1}))).await;
    assert_eq!(training.status, StatusCode::CREATED, "{training:?}");
    let mut larger = small_training(&json!({"dataset": 1}));
    larger["batch_size"] = json!(12);
    let problem = server.submit(&larger).await.problem(422);
    assert_eq!(problem["violations"][0]["value"], "12", "{problem}");
    let allowed = "at most the number of training trajectories, which is 11";
    assert_eq!(problem["violations"][0]["allowed"], allowed);
    let evaluation = json!({"kind": "evaluate", "data": {"dataset": 1}});
    let evaluation = server.submit(&evaluation).await;
    assert_eq!(evaluation.status, StatusCode::CREATED, "{evaluation:?}");
}

#[tokio::test]
async fn the_quota_counts_every_file_that_is_kept_and_names_itself() {
    let room_for_one = CSV.len() as u64 + 4;
    let options = Options { upload_quota_bytes: Some(room_for_one), ..Options::default() };
    let server = Server::start_with(&options).await;
    assert!(send_recordings(&server).await.status.is_success());
    let more = Body::from("u1,u2\n3,4\n5,6\n");
    let problem = send(&server, &path(&mapping()), "text/csv", more).await.problem(413);
    assert_eq!(problem["type"], "tag:torqued,2026:upload-quota");
    let detail = problem["detail"].as_str().unwrap();
    let (quota, used) = (room_for_one.to_string(), CSV.len().to_string());
    assert!(detail.contains(&quota) && detail.contains(&used), "{detail}");
    assert_eq!(kept(&server).await, 1);
    let metrics = server.get("/metrics").await;
    assert!(metrics.text().contains(&format!("torqued_sent_bytes {used}")));
    assert!(metrics.text().contains(&format!("torqued_sent_quota_bytes {quota}")));
}
