//! Files that the bucket serves directly.

use reqwest::header::{ETAG, LOCATION, RANGE};
use reqwest::redirect::Policy;
use reqwest::{Client, StatusCode};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use crate::product::{Product, torqued};
use crate::s3_server::{Asked, S3Server};

/// A server with a dataset, and the dataset's files.
async fn files_of(mut command: std::process::Command) -> (Product, Vec<Value>) {
    let product = Product::spawn(&mut command);
    let spec = json!({"preset": "D1-chirp", "trajectories": 8, "samples": 60});
    let job = product.submit(&spec).await;
    let job = product.succeeded(job).await;
    let dataset = product.get(&format!("/v1/datasets/{}", job["dataset"])).await;
    (product, dataset["files"].as_array().unwrap().clone())
}

#[tokio::test]
async fn a_bucket_sends_a_file_to_whoever_asks_to_be_redirected() {
    let bucket = S3Server::start();
    let folder = tempfile::tempdir().unwrap();
    let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1"]);
    command.arg("--data").arg(folder.path()).envs(bucket.variables());
    command.env("TORQUED_OBJECTS", S3Server::url("arm").to_string());
    let (product, files) = files_of(command).await;
    let http = Client::builder().redirect(Policy::none()).build().unwrap();
    // The server makes dataset.json on request, so it is not in a bucket.
    let (stored, made): (Vec<Value>, Vec<Value>) =
        files.into_iter().partition(|file| file["name"] != "dataset.json");
    assert_eq!((stored.len(), made.len()), (2, 1));
    let url = format!("{}{}?redirect=true", product.url, made[0]["url"].as_str().unwrap());
    assert_eq!(http.get(url).send().await.unwrap().status(), StatusCode::OK);
    for file in stored {
        let url = format!("{}{}", product.url, file["url"].as_str().unwrap());
        let redirected = http.get(format!("{url}?redirect=true")).send().await.unwrap();
        assert_eq!(redirected.status(), StatusCode::TEMPORARY_REDIRECT, "{redirected:?}");
        assert_eq!(redirected.headers()[ETAG], format!("\"{}\"", file["sha256"].as_str().unwrap()));
        let address = redirected.headers()[LOCATION].to_str().unwrap().to_owned();
        assert!(address.starts_with(&bucket.endpoint()) && address.contains("X-Amz-Expires=900"));
        assert_eq!(redirected.bytes().await.unwrap().len(), 0);

        let asked = bucket.count(Asked::Get);
        let bytes = http.get(&address).send().await.unwrap().bytes().await.unwrap();
        assert_eq!(bucket.count(Asked::Get), asked + 1);
        assert_eq!(hex(&Sha256::digest(&bytes)), file["sha256"]);
        let part = http.get(&address).header(RANGE, "bytes=4-11").send().await.unwrap();
        assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
        assert_eq!(part.bytes().await.unwrap(), bytes[4..12]);
        let forged = address.replacen("X-Amz-Expires=900", "X-Amz-Expires=90000", 1);
        assert_eq!(http.get(forged).send().await.unwrap().status(), StatusCode::FORBIDDEN);

        let known = http.get(format!("{url}?redirect=true")).header("if-none-match", "*");
        assert_eq!(known.send().await.unwrap().status(), StatusCode::NOT_MODIFIED);
        for query in ["", "?redirect=false"] {
            let sent = http.get(format!("{url}{query}")).send().await.unwrap();
            assert_eq!(sent.status(), StatusCode::OK);
            assert_eq!(sent.bytes().await.unwrap(), bytes);
        }
    }
}

#[tokio::test]
async fn a_folder_sends_the_bytes_whatever_is_asked() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1"]);
    command.arg("--data").arg(folder.path());
    let (product, files) = files_of(command).await;
    let url = format!("{}{}?redirect=true", product.url, files[0]["url"].as_str().unwrap());
    let sent = reqwest::get(url).await.unwrap();
    assert_eq!(sent.status(), StatusCode::OK);
    assert_eq!(hex(&Sha256::digest(sent.bytes().await.unwrap())), files[0]["sha256"]);
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
