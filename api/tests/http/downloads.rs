//! Downloads: whole, in part, not again, and only their headers.

use std::io::Read;

use axum::http::Method;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde_json::json;
use spec::Digest;

use crate::fixture::{Server, bytes_of};

const FILE: &str = "/v1/checkpoints/1/files/model.safetensors";

#[tokio::test]
async fn every_file_that_is_listed_downloads_with_the_digest_that_is_stated() {
    let server = Server::with_small_pipeline().await;
    let mut files = Vec::new();
    for id in 1..=2 {
        let dataset = server.json(&format!("/v1/datasets/{id}")).await;
        files.extend(dataset["files"].as_array().unwrap().clone());
    }
    files.extend(server.json("/v1/checkpoints/1").await["files"].as_array().unwrap().clone());
    for id in 1..=2 {
        files.extend(
            server.json(&format!("/v1/runs/{id}")).await["artifacts"].as_array().unwrap().clone(),
        );
    }
    assert_eq!(files.len(), 6 + 2 + 2 + 3);
    for file in files {
        let answer = server.get(file["url"].as_str().unwrap()).await;
        assert_eq!(answer.status, 200, "{file}");
        let digest = Digest::of(&answer.body);
        assert_eq!(file["sha256"], digest.to_string());
        assert_eq!(file["size"], answer.body.len());
        assert_eq!(answer.header("content-length"), answer.body.len().to_string());
        assert_eq!(answer.header("etag"), format!("\"{digest}\""));
        let repr = format!("sha-256=:{}:", BASE64.encode(digest.as_bytes()));
        assert_eq!(answer.header("repr-digest"), repr);
        assert!(answer.header("content-disposition").contains(file["name"].as_str().unwrap()));
    }
}

#[tokio::test]
async fn the_description_of_a_dataset_names_its_columns_and_the_digests_of_its_files() {
    let server = Server::with_small_pipeline().await;
    let answer = server.get("/v1/datasets/1/files/dataset.json").await;
    assert_eq!(answer.header("content-type"), "application/json");
    let description = answer.json();
    let dataset = server.json("/v1/datasets/1").await;
    assert_eq!(description["digest"], dataset["digest"]);
    assert_eq!((&description["complete"], &description["samples"]), (&json!(true), &json!(400)));
    let column = &description["columns"]["trajectories"][2];
    assert_eq!((&column["name"], &column["unit"]), (&json!("u1"), &json!("N·m")));
    let described: Vec<_> = description["shards"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|shard| shard["files"].as_array().unwrap())
        .map(|file| (&file["name"], &file["sha256"]))
        .collect();
    let listed: Vec<_> = dataset["files"].as_array().unwrap()[1..]
        .iter()
        .map(|file| (&file["name"], &file["sha256"]))
        .collect();
    assert_eq!(described, listed);

    let path = "/v1/datasets/1/files/dataset.json";
    let part = server.request(Method::GET, path, &[("range", "bytes=10-19")]).await;
    assert_eq!((part.status.as_u16(), &part.body[..]), (206, &answer.body[10..20]));
}

#[tokio::test]
async fn a_download_is_taken_up_where_it_broke_off() {
    let server = Server::with_small_pipeline().await;
    let whole = bytes_of(5000, 7);
    let tag = server.get(FILE).await.header("etag").to_owned();
    let headers = [("range", "bytes=1234-"), ("if-range", tag.as_str())];
    let rest = server.request(Method::GET, FILE, &headers).await;
    assert_eq!(rest.status, 206);
    assert_eq!(rest.header("content-range"), "bytes 1234-4999/5000");
    assert_eq!(rest.body, whole[1234..]);

    let headers = [("range", "bytes=1234-"), ("if-range", "\"another\"")];
    let changed = server.request(Method::GET, FILE, &headers).await;
    assert_eq!((changed.status.as_u16(), changed.body), (200, whole));
}

#[tokio::test]
async fn a_part_beyond_the_end_is_refused_with_the_size() {
    let server = Server::with_small_pipeline().await;
    let answer = server.request(Method::GET, FILE, &[("range", "bytes=5000-")]).await;
    assert_eq!(answer.status, 416);
    assert_eq!(answer.header("content-range"), "bytes */5000");
    assert!(answer.body.is_empty());
}

#[tokio::test]
async fn several_parts_at_once_are_answered_with_the_whole() {
    let server = Server::with_small_pipeline().await;
    let answer = server.request(Method::GET, FILE, &[("range", "bytes=0-1,4-5")]).await;
    assert_eq!((answer.status.as_u16(), answer.body.len()), (200, 5000));
}

#[tokio::test]
async fn a_file_that_the_caller_has_is_not_sent_again() {
    let server = Server::with_small_pipeline().await;
    let tag = server.get(FILE).await.header("etag").to_owned();
    let answer = server.request(Method::GET, FILE, &[("if-none-match", &tag)]).await;
    assert_eq!((answer.status.as_u16(), answer.body.len()), (304, 0));
    assert_eq!(answer.header("etag"), tag);
}

/// Before, a download went on with the bytes of another file.
#[tokio::test]
async fn a_file_or_tar_that_is_not_the_demanded_one_is_not_sent() {
    let server = Server::with_small_pipeline().await;
    for path in [FILE, "/v1/datasets/1/tar", "/v1/checkpoints/1/tar"] {
        let tag = server.get(path).await.header("etag").to_owned();
        for method in [Method::GET, Method::HEAD] {
            let other = [("range", "bytes=0-9"), ("if-match", "\"other\"")];
            let refused = server.request(method.clone(), path, &other).await;
            assert_eq!((refused.status.as_u16(), refused.header("etag")), (412, tag.as_str()));
        }
        let same = [("range", "bytes=0-9"), ("if-match", tag.as_str())];
        let part = server.request(Method::GET, path, &same).await;
        assert_eq!((part.status.as_u16(), part.body.len()), (206, 10));
    }
    let other = [("if-match", "\"other\"")];
    let refused = server.request(Method::GET, FILE, &other).await.problem(412);
    assert!(refused["detail"].as_str().unwrap().contains("its ETag is \""), "{refused}");
}

#[tokio::test]
async fn head_tells_what_get_would_send() {
    let server = Server::with_small_pipeline().await;
    let head = server.request(Method::HEAD, FILE, &[]).await;
    assert_eq!((head.status.as_u16(), head.body.len()), (200, 0));
    assert_eq!(head.header("content-length"), "5000");
    assert_eq!(head.header("accept-ranges"), "bytes");
    let missing = server.request(Method::HEAD, "/v1/checkpoints/9/files/x", &[]).await;
    assert_eq!(missing.status, 404);
}

#[tokio::test]
async fn the_loss_curve_is_drawn_and_its_numbers_are_there() {
    let server = Server::with_small_pipeline().await;
    let train = server.json("/v1/jobs?kind=train").await["jobs"][0].clone();
    let svg = server.get(&format!("/v1/runs/{}/figures/loss.svg", train["run"])).await;
    assert_eq!(svg.header("content-type"), "image/svg+xml");
    assert!(svg.text().starts_with("<svg") && svg.text().contains("validation"));
    let csv = server.get(&format!("/v1/runs/{}/figures/loss.csv", train["run"])).await;
    assert_eq!(csv.text().lines().count(), 1 + 100 + 10);
}

/// Paths and bytes of the files of a tar.
fn unpacked(tar: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut archive = tar::Archive::new(tar);
    let entry = |entry: std::io::Result<tar::Entry<'_, &[u8]>>| {
        let mut entry = entry.unwrap();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        (entry.path().unwrap().to_str().unwrap().to_owned(), bytes)
    };
    archive.entries().unwrap().map(entry).collect()
}

#[tokio::test]
async fn a_tar_has_every_file_under_the_name_of_its_dataset_or_checkpoint() {
    let server = Server::with_small_pipeline().await;
    for thing in ["dataset", "checkpoint"] {
        let path = format!("/v1/{thing}s/1");
        let answer = server.get(&format!("{path}/tar")).await;
        assert_eq!(answer.status, 200);
        assert_eq!(answer.header("content-type"), "application/x-tar");
        assert_eq!(answer.header("content-length"), answer.body.len().to_string());
        assert!(answer.header("content-disposition").contains(&format!("{thing}-1.tar")));
        assert!(!answer.headers.contains_key("repr-digest"), "nobody has read the bytes");
        let mut expected = Vec::new();
        for file in server.json(&path).await["files"].as_array().unwrap() {
            let name = format!("{thing}-1/{}", file["name"].as_str().unwrap());
            let bytes = server.get(file["url"].as_str().unwrap()).await.body;
            expected.push((name, bytes.to_vec()));
        }
        assert_eq!(unpacked(&answer.body), expected);
        assert_eq!(server.get(&format!("{path}/tar")).await.body, answer.body);
    }
    server.get("/v1/datasets/9/tar").await.problem(404);
}

#[tokio::test]
async fn a_tar_is_taken_up_where_it_broke_off_and_not_sent_again() {
    const TAR: &str = "/v1/checkpoints/1/tar";
    let server = Server::with_small_pipeline().await;
    let whole = server.get(TAR).await;
    let tag = whole.header("etag").to_owned();
    let head = server.request(Method::HEAD, TAR, &[]).await;
    assert_eq!(head.header("content-length"), whole.body.len().to_string());
    for begin in [0, 511, 512, 1700, whole.body.len() - 1] {
        let range = format!("bytes={begin}-");
        let headers = [("range", range.as_str()), ("if-range", tag.as_str())];
        let rest = server.request(Method::GET, TAR, &headers).await;
        assert_eq!((rest.status.as_u16(), &rest.body[..]), (206, &whole.body[begin..]), "{begin}");
    }
    let again = server.request(Method::GET, TAR, &[("if-none-match", &tag)]).await;
    assert_eq!((again.status.as_u16(), again.body.len()), (304, 0));
}
