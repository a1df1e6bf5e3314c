//! The lineage on the pages: every page of a result leads to its inputs and its users.

use serde_json::json;

use crate::fixture::{Server, small_simulation};
use crate::labels;

/// The titles and the links of the boxes on a page; none without a lineage.
async fn boxes(server: &Server, path: &str) -> Vec<(String, String)> {
    let page = server.get(path).await;
    assert_eq!(page.status, 200, "{path}");
    let Some((_, lineage)) = page.text().split_once("class=\"lineage") else { return Vec::new() };
    let (lineage, _) = lineage.split_once("</svg>").unwrap();
    let mut boxes: Vec<(String, String)> = lineage
        .split("<a href=\"")
        .skip(1)
        .map(|node| {
            let (href, rest) = node.split_once('"').unwrap();
            let (_, title) = rest.split_once("<title>").unwrap();
            let (title, _) = title.split_once("</title>").unwrap();
            let place = href.trim_start_matches("../").trim_start_matches("./");
            (title.to_owned(), place.to_owned())
        })
        .collect();
    boxes.sort();
    boxes
}

#[tokio::test]
async fn every_page_of_a_pipeline_leads_to_its_other_results() {
    let server = Server::with_small_pipeline().await;
    let all = boxes(&server, "/jobs/5").await;
    let hrefs: Vec<&str> = all.iter().map(|(_, href)| href.as_str()).collect();
    assert!(hrefs.iter().any(|href| href.ends_with("datasets/1")), "{hrefs:?}");
    assert!(hrefs.iter().any(|href| href.ends_with("runs/1")), "{hrefs:?}");
    assert!(hrefs.iter().any(|href| href.ends_with("evaluations/4")), "{hrefs:?}");
    let titles = |boxes: &[(String, String)]| -> Vec<String> {
        boxes.iter().map(|(title, _)| title.clone()).collect()
    };
    for path in ["/datasets/1", "/runs/1", "/checkpoints/1", "/evaluations/4"] {
        let found = boxes(&server, path).await;
        assert!(found.len() > 1 && found.len() <= all.len(), "{path}: {found:?}");
        assert!(titles(&found).iter().all(|title| titles(&all).contains(title)), "{path}");
    }
    // The evaluation says what came out.
    assert!(titles(&all).iter().any(|title| title.contains("evaluate, ")), "{all:?}");
}

#[tokio::test]
async fn an_evaluation_of_a_checkpoint_by_its_id_follows_the_training() {
    let server = Server::with_small_pipeline().await;
    let later = json!({
        "kind": "evaluate", "data": {"dataset": 1}, "checkpoints": [{"checkpoint": 1}],
        "bootstrap": {"seed": 7},
    });
    let later = server.submitted(&later).await["id"].clone();
    server.work().await;
    let href = format!("evaluations/{later}");
    for path in ["/runs/1", "/checkpoints/1", "/datasets/2"] {
        let found = boxes(&server, path).await;
        assert!(found.iter().any(|(_, to)| to.ends_with(&href)), "{path}: {found:?}");
    }
    let found = boxes(&server, &format!("/evaluations/{later}")).await;
    for href in ["datasets/1", "datasets/2", "runs/1"] {
        assert!(found.iter().any(|(_, to)| to.ends_with(href)), "{href}: {found:?}");
    }
}

#[tokio::test]
async fn a_job_without_inputs_and_users_has_no_lineage() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    assert!(boxes(&server, "/jobs/1").await.is_empty());
}

/// The page of a run had its name, and its own box that of the job.
#[tokio::test]
async fn a_thing_has_one_name_on_all_pages() {
    let server = Server::with_small_pipeline().await;
    for run in [1, 2] {
        let name = json!({"name": format!("run {run} of Ada")});
        assert_eq!(labels::patch(&server, &format!("/v1/runs/{run}"), &name).await.status, 200);
    }
    for path in ["/runs/1", "/checkpoints/1", "/datasets/2", "/evaluations/4", "/jobs/5"] {
        let found = boxes(&server, path).await;
        for (name, href) in
            [("run 1 of Ada: train", "runs/1"), ("run 2 of Ada: eval", "evaluations/4")]
        {
            let is_there =
                |(title, to): &(String, String)| title.starts_with(name) && to.ends_with(href);
            assert!(found.iter().any(is_there), "{path}: {name}: {found:?}");
        }
    }
    for (path, title) in [
        ("/runs/1", "<h1>run 1 of Ada</h1>"),
        ("/evaluations/4", "<h1>run 2 of Ada</h1>"),
        ("/checkpoints/1", "<h1>run 1 of Ada, step 100</h1>"),
        ("/checkpoints/1/delete", "<h1>Delete run 1 of Ada, step 100?</h1>"),
        ("/evaluations", ">run 2 of Ada</a>"),
        ("/checkpoints", ">run 1 of Ada</a>"),
        // The job keeps its own.
        ("/jobs/3", "<h1>train</h1>"),
        ("/jobs/3/delete", "<h1>Delete train?</h1>"),
        ("/jobs/3/delete", ">run 1 of Ada</a>"),
    ] {
        let page = server.get(path).await;
        assert!(page.text().contains(title), "{path}: {title}: {}", page.text());
    }
}

#[tokio::test]
async fn a_dataset_has_its_own_name_which_is_text() {
    let server = Server::with_small_pipeline().await;
    let name = "<b>arms</b> with a payload that no box can hold";
    let answer = labels::patch(&server, "/v1/datasets/2", &json!({"name": name})).await;
    assert_eq!(answer.status, 200, "{answer:?}");
    let page = server.get("/runs/1").await;
    let page = page.text();
    assert!(!page.contains("<b>arms") && page.contains("with a payload that no box can hold: sim"));
    assert!(page.contains("that no box…</text>"), "{page}");
}
