//! The order of the pages of results: the answer in a sentence comes first, then what people noted, and few warnings.

use serde_json::json;

use crate::fixture::{Server, small_simulation};
use crate::labels::patch;

/// The places of parts on a page, which must be there.
async fn places<const N: usize>(server: &Server, path: &str, parts: [&str; N]) -> [usize; N] {
    let page = server.get(path).await;
    assert_eq!(page.status, 200, "{path}");
    parts.map(|part| {
        page.text().find(part).unwrap_or_else(|| panic!("{path}: {part}: {}", page.text()))
    })
}

#[tokio::test]
async fn a_note_stands_below_the_answer() {
    let server = Server::with_small_pipeline().await;
    for (item, path) in [
        ("runs/1", "/runs/1"),
        ("checkpoints/1", "/checkpoints/1"),
        ("datasets/1", "/datasets/1"),
        ("jobs/4", "/evaluations/4"),
        ("jobs/3", "/jobs/3"),
    ] {
        let note = json!({"note": "Ada looked at this."});
        assert_eq!(patch(&server, &format!("/v1/{item}"), &note).await.status, 200);
        let places =
            places(&server, path, ["class=\"answer\"", "<div class=\"said\">", "Lineage</h2>"])
                .await;
        assert!(places.is_sorted(), "{path}: {places:?}");
    }
}

#[tokio::test]
async fn a_dataset_says_what_it_has_in_a_sentence() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    let empty = server.get("/datasets/1").await;
    assert!(!empty.text().contains("class=\"answer\""), "{empty:?}");
    server.work().await;
    let answer = "10 trajectories of simulated arms with 7 joints, 6.667 s each at 60 Hz. \
                  3 of 13 draws were refused.";
    places(&server, "/datasets/1", [answer]).await;
}

/// Eleven warnings stood between an answer and its table.
#[tokio::test]
async fn more_than_three_warnings_are_folded() {
    let server = Server::start().await;
    let doubtful = |seed: u64| {
        let mut spec = small_simulation(seed);
        spec["robot"] = json!({"damping_nm_s_rad": vec![0.5; 7]});
        spec
    };
    let jobs: serde_json::Map<String, serde_json::Value> =
        (1..=5).map(|seed| (format!("data-{seed}"), doubtful(seed))).collect();
    let pipeline =
        server.submitted(&json!({"kind": "pipeline", "name": "five", "jobs": jobs})).await;
    assert_eq!(pipeline["warnings"].as_array().unwrap().len(), 15, "{pipeline}");
    let path = format!("/jobs/{}", pipeline["id"]);
    let parts =
        ["data-1.robot.damping", "<summary>12 more warnings</summary>", "data-2.robot.damping"];
    let places = places(&server, &path, parts).await;
    assert!(places.is_sorted(), "{places:?}");
}
