//! Damaged files: they are never sent as if they were intact.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use api::{App, Options};
use axum::http::Method;
use serde_json::Value;
use store::{CheckpointId, NewArtifact, StoredObject};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use crate::fixture::{Server, bytes_of, small_simulation, small_training};

const SMALL: &str = "/v1/checkpoints/1/files/model.safetensors";
const LARGE: &str = "/v1/runs/1/artifacts/large.bin";

/// Large enough to be sent in several pieces.
const BYTES: usize = 1_000_000;

/// A server with a large file among those of a run, and the object that holds it.
async fn with_large_file() -> (Server, StoredObject) {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    server.work().await;
    server.submitted(&small_training(&serde_json::json!({"dataset": data["dataset"]}))).await;
    let task = server.claim().await.unwrap();
    let bytes = bytes_of(BYTES, 3);
    let media_type = "application/octet-stream";
    let artifact = NewArtifact { name: "large.bin", media_type, bytes };
    server.store.put_artifact(task.fence, artifact).await.unwrap();
    let object = server.store.artifact(task.run.unwrap(), "large.bin").await.unwrap().object;
    (server, object)
}

/// The file of an object that the test will damage.
async fn small_file(server: &Server) -> PathBuf {
    let checkpoint = server.store.checkpoint(CheckpointId(1)).await.unwrap();
    server.object(&checkpoint.file("model.safetensors").unwrap().path)
}

fn flip(path: &PathBuf, position: usize) {
    let mut bytes = std::fs::read(path).unwrap();
    bytes[position] ^= 1;
    std::fs::write(path, bytes).unwrap();
}

fn check(problem: &Value, words: &[&str]) {
    assert_eq!(problem["type"], "tag:torqued,2026:damaged");
    let detail = problem["detail"].as_str().unwrap();
    for word in words {
        assert!(detail.contains(word), "{word} is not in {detail}");
    }
}

/// Regression: all bytes of a damaged file were sent under the original's digest.
#[tokio::test]
async fn a_damaged_file_is_never_sent_to_its_end() {
    let (server, object) = with_large_file().await;
    let path = server.object(&object.path);
    flip(&path, BYTES / 2);
    let (status, body) = server.download(LARGE).await;
    assert_eq!(status, 200, "the beginning is sent while the rest is read");
    assert!(body.is_err());

    // The damage is known from then on.
    for range in [None, Some("bytes=0-9"), Some("bytes=0-")] {
        let headers: Vec<_> = range.iter().map(|range| ("range", *range)).collect();
        let problem = server.request(Method::GET, LARGE, &headers).await.problem(500);
        check(&problem, &["large.bin of run 1 is damaged", "expected SHA-256", "--force"]);
    }
    assert_eq!(server.request(Method::HEAD, LARGE, &[]).await.status, 500);

    tokio::time::sleep(Duration::from_millis(20)).await;
    flip(&path, BYTES / 2);
    assert_eq!(server.get(LARGE).await.body, bytes_of(BYTES, 3), "restored");
}

#[tokio::test]
async fn a_connection_is_cut_before_the_last_bytes_of_a_damaged_file() {
    let (server, object) = with_large_file().await;
    flip(&server.object(&object.path), 0);
    let app = App::new(server.store.clone(), &Options::default());
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(api::serve(listener, app, std::future::pending()));
    let mut connection = TcpStream::connect(address).await.unwrap();
    let request = format!("GET {LARGE} HTTP/1.1\r\nHost: {address}\r\n\r\n");
    connection.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    // An error also means that the end does not arrive.
    let _ = connection.read_to_end(&mut answer).await;
    let text = String::from_utf8_lossy(&answer);
    let (head, _) = text.split_once("\r\n\r\n").unwrap();
    assert!(head.contains(&format!("content-length: {BYTES}")), "{head}");
    assert!(answer.len() - head.len() < BYTES, "{} bytes came", answer.len());
}

#[tokio::test]
async fn a_small_file_that_is_damaged_is_answered_with_a_problem() {
    let server = Server::with_small_pipeline().await;
    flip(&small_file(&server).await, 4999);
    let problem = server.get(SMALL).await.problem(500);
    check(&problem, &["model.safetensors of checkpoint 1 is damaged"]);
    assert_eq!(server.get("/v1/checkpoints/1/files/config.json").await.status, 200);
}

#[tokio::test]
async fn a_file_of_another_size_or_none_is_refused_before_its_first_byte() {
    let server = Server::with_small_pipeline().await;
    let path = small_file(&server).await;
    let bytes = std::fs::read(&path).unwrap();
    let refused = async |words: &[&str]| {
        for range in ["bytes=0-", "bytes=0-9", "bytes=4990-"] {
            check(
                &server.request(Method::GET, SMALL, &[("range", range)]).await.problem(500),
                words,
            );
        }
        check(&server.get(SMALL).await.problem(500), words);
        assert_eq!(server.request(Method::HEAD, SMALL, &[]).await.status, 500);
    };
    std::fs::write(&path, &bytes[..4000]).unwrap();
    refused(&["model.safetensors of checkpoint 1", "expected 5000 bytes, found 4000 bytes"]).await;
    std::fs::write(&path, [&bytes[..], b"more"].concat()).unwrap();
    refused(&["expected 5000 bytes, found 5004 bytes"]).await;
    std::fs::remove_file(&path).unwrap();
    refused(&["model.safetensors of checkpoint 1 is missing"]).await;
}

#[tokio::test]
async fn a_part_of_a_damaged_file_is_refused_once_all_of_it_was_read() {
    let (server, object) = with_large_file().await;
    flip(&server.object(&object.path), BYTES - 1);
    let part = async || server.request(Method::GET, LARGE, &[("range", "bytes=100-199")]).await;
    let first = part().await;
    assert_eq!((first.status.as_u16(), first.body), (206, bytes_of(BYTES, 3).slice(100..200)));
    let started = Instant::now();
    let refused = loop {
        let answer = part().await;
        if answer.status != 206 {
            break answer;
        }
        assert!(started.elapsed() < Duration::from_secs(30), "it is never checked");
        tokio::time::sleep(Duration::from_millis(5)).await;
    };
    check(&refused.problem(500), &["large.bin of run 1 is damaged"]);
}

/// Regression: one damaged report broke the front page.
#[tokio::test]
async fn a_damaged_report_is_named_on_its_own_page_and_spoils_no_list() {
    let server = Server::with_small_pipeline().await;
    let report = server.store.artifact(store::RunId(2), "report.json").await.unwrap();
    flip(&server.object(&report.object.path), 3);
    check(&server.get("/v1/evaluations/4").await.problem(500), &["report.json of run 2"]);
    for path in ["/", "/jobs/5", "/evaluations"] {
        let list = server.get(path).await;
        assert_eq!(list.status, 200, "{path}");
        // The list does not read the report.
        assert!(list.text().contains("robomorph 1.18°"), "{path}");
    }
    assert_eq!(server.get("/v1/evaluations").await.status, 200);
}
