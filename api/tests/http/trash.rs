//! Deleting and restoring over HTTP, and on the page without scripts.

use axum::body::Body;
use axum::http::{Method, Request};
use futures::StreamExt;
use serde_json::{Value, json};
use store::{DeletionOrder, Item, ItemKind, Respect, Ripe};

use crate::fixture::{Server, TestResponse, small_pipeline, small_simulation, small_training};
use crate::labels::patch;

async fn delete(server: &Server, path: &str) -> TestResponse {
    server.request(Method::DELETE, path, &[]).await
}

async fn deleted(server: &Server, path: &str) -> Value {
    let answer = delete(server, &format!("{path}?force=true")).await;
    assert_eq!(answer.status, 200, "{path}: {answer:?}");
    answer.json()
}

#[tokio::test]
async fn what_is_deleted_is_answered_with_410_until_it_is_restored() {
    let server = Server::with_small_pipeline().await;
    for (kind, id, under) in [
        ("dataset", 1, "files/robots-00000.parquet"),
        ("dataset", 1, "tar"),
        ("checkpoint", 1, "files/config.json"),
        ("run", 1, "metrics/train/loss"),
        ("run", 2, "artifacts/report.json"),
        ("job", 3, "logs"),
        ("job", 4, "attempts"),
    ] {
        let path = format!("/v1/{kind}s/{id}");
        let before = server.json(&path).await;
        let answer = deleted(&server, &path).await;
        assert_eq!((&answer["kind"], &answer["id"]), (&json!(kind), &json!(id)));
        assert!(answer["purge_at"].as_str() > answer["deleted_at"].as_str());
        for path in [path.clone(), format!("{path}/{under}"), format!("{path}/dependents")] {
            let problem = server.get(&path).await.problem(410);
            let detail = problem["detail"].as_str().unwrap();
            assert!(detail.contains(&format!("`torqued undelete {kind} {id}`")), "{detail}");
        }
        delete(&server, &path).await.problem(410);
        let list = server.json(&format!("/v1/{kind}s")).await;
        let listed = list[format!("{kind}s")].as_array().unwrap();
        assert!(listed.iter().all(|item| item["id"] != id), "{kind} {id} is listed");
        let trash = server.json("/v1/trash").await;
        assert_eq!(
            (&trash["items"][0]["kind"], &trash["items"][0]["id"]),
            (&json!(kind), &json!(id))
        );
        let restored = server.post(&format!("{path}/restore")).await.json();
        assert_eq!(restored["along"], answer["along"]);
        assert_eq!(server.json(&path).await, before);
        server.post(&format!("{path}/restore")).await.problem(409);
        assert_eq!(server.json("/v1/trash").await["items"], json!([]));
    }
    delete(&server, "/v1/datasets/99").await.problem(404);
    server.get("/v1/trash?before=yesterday").await.problem(400);
}

#[tokio::test]
async fn what_depends_on_it_is_respected_and_shown() {
    let server = Server::with_small_pipeline().await;
    let shown = server.json("/v1/datasets/2/dependents").await;
    let readers: Vec<_> =
        shown["jobs"].as_array().unwrap().iter().map(|item| &item["id"]).collect();
    assert_eq!(readers, [3]);
    assert_eq!(shown["jobs"][0]["relation"], "reads");
    assert_eq!(shown["bytes"], server.json("/v1/datasets/2").await["bytes"]);
    let problem = delete(&server, "/v1/datasets/2").await.problem(409);
    assert_eq!(problem["dependents"], shown["jobs"]);
    assert!(problem["detail"].as_str().unwrap().contains("train job 3 (succeeded) reads it"));
    // A waiting training prevents the deletion, even with force.
    let spec = small_training(&json!({"dataset": 2}));
    let training = server.submit_to("/v1/jobs?force=true", &spec, &[]).await.json();
    let problem = delete(&server, "/v1/datasets/2?force=true").await.problem(409);
    let open = format!("train job {} (queued) reads it", training["id"]);
    assert!(problem["detail"].as_str().unwrap().contains(&open), "{problem}");
    delete(&server, &format!("/v1/jobs/{}", training["id"])).await.problem(409);
    let worker = server.claim().await.unwrap();
    delete(&server, "/v1/datasets/2?force=true").await.problem(409);
    server.finish(&worker).await;
    deleted(&server, "/v1/datasets/2").await;
}

#[tokio::test]
async fn a_spec_that_refers_to_what_was_deleted_is_refused_and_one_that_made_it_is_done_again() {
    let server = Server::start().await;
    let simulation = server.submitted(&small_simulation(1)).await;
    server.work().await;
    deleted(&server, "/v1/datasets/1").await;
    let by_id = server.submit(&small_training(&json!({"dataset": 1}))).await.problem(422);
    let value = by_id["violations"][0]["value"].as_str().unwrap();
    assert!(value.starts_with("1: dataset 1 was deleted on "), "{by_id}");
    let by_digest = small_training(&json!({"digest": simulation["digest"]}));
    let problem = server.submit(&by_digest).await.problem(422);
    let value = problem["violations"][0]["value"].as_str().unwrap();
    assert!(value.contains("whose results were deleted"), "{problem}");
    // If it is restored, it is reused. If it is deleted, it is made again.
    server.post("/v1/datasets/1/restore").await;
    assert_eq!(server.submit(&small_simulation(1)).await.status, 200);
    deleted(&server, "/v1/datasets/1").await;
    let anew = server.submit(&small_simulation(1)).await;
    assert_eq!(anew.status, 201);
    server.work().await;
    assert_eq!(server.submit(&by_digest).await.status, 201);
}

/// The file stays open, or the bucket's answer continues, until the object itself is deleted
/// permanently. Even then, a download that has begun is sent to its end.
#[tokio::test]
async fn a_download_that_has_begun_outlives_the_deletion_and_the_purge() {
    let server = Server::with_small_pipeline().await;
    let dataset = server.json("/v1/datasets/1").await;
    let file = dataset["files"].as_array().unwrap().iter().max_by_key(|file| file["size"].as_u64());
    let file = file.unwrap();
    let request = Request::get(file["url"].as_str().unwrap()).header("host", "localhost");
    let answer = server.answer(request.body(Body::empty()).unwrap()).await;
    let mut body = answer.into_body().into_data_stream();
    let mut received = body.next().await.unwrap().unwrap().to_vec();
    deleted(&server, "/v1/datasets/1").await;
    let purged = server.store.purge(Ripe::After(std::time::Duration::ZERO)).await.unwrap();
    assert_eq!(purged.len(), 1);
    while let Some(bytes) = body.next().await {
        received.extend(bytes.unwrap());
    }
    assert_eq!(file["sha256"], spec::Digest::of(&received).to_string());
    let problem = server.get("/v1/datasets/1").await.problem(410);
    assert!(problem["detail"].as_str().unwrap().contains("purged from the trash"), "{problem}");
    server.post("/v1/datasets/1/restore").await.problem(410);
}

#[tokio::test]
async fn the_trash_is_read_page_by_page() {
    let server = Server::start().await;
    for seed in 1..=5 {
        server.submitted(&small_simulation(seed)).await;
    }
    server.work().await;
    let order = DeletionOrder {
        respect: Respect::All,
        keep: std::time::Duration::from_secs(60),
        reason: Some("failed jobs are kept for 3 days"),
    };
    for id in 1..=5 {
        server.store.delete(Item::new(ItemKind::Dataset, id), &order).await.unwrap();
    }
    let (mut path, mut ids) = ("/v1/trash?limit=2".to_owned(), Vec::new());
    loop {
        let page = server.json(&path).await;
        for item in page["items"].as_array().unwrap() {
            assert_eq!(item["reason"], "failed jobs are kept for 3 days");
            ids.push(item["id"].as_i64().unwrap());
        }
        let Some(next) = page["next"].as_str() else { break };
        path = format!("/v1/trash?limit=2&before={next}");
    }
    ids.sort_unstable();
    assert_eq!(ids, [1, 2, 3, 4, 5]);
}

#[tokio::test]
async fn the_page_asks_shows_what_depends_and_brings_back() {
    let server = Server::with_small_pipeline().await;
    let text = async |path: &str| {
        let answer = server.get(path).await;
        assert_eq!(answer.status, 200, "{path}: {answer:?}");
        answer.text().to_owned()
    };
    for path in ["/datasets/1", "/checkpoints/1", "/runs/1", "/jobs/3", "/evaluations/4"] {
        let path = path.replace("evaluations", "jobs");
        let page = text(&format!("{path}/delete")).await;
        assert!(page.contains("Keep it") && page.contains(&format!("action=\"../..{path}/delete")));
    }
    assert!(text("/datasets/1").await.contains("href=\"../datasets/1/delete\""));
    let question = text("/datasets/1/delete").await;
    assert!(question.contains("reads it") && question.contains("?force=true"), "{question}");
    let form = server.post("/datasets/1/delete?force=true").await;
    assert_eq!((form.status.as_u16(), form.header("location")), (303, "/trash"));
    assert!(text("/trash").await.contains("action=\"./datasets/1/restore\""));
    let gone = server.get("/datasets/1").await;
    assert_eq!(gone.status, 410);
    for part in ["torqued undelete dataset 1", "action=\"../datasets/1/restore\"", "/trash\""] {
        assert!(gone.text().contains(part), "{part}: {}", gone.text());
    }
    let form = server.post("/datasets/1/restore").await;
    assert_eq!((form.status.as_u16(), form.header("location")), (303, "/datasets/1"));
    text("/datasets/1").await;
    // A pipeline is deleted with its jobs. An item that an open job needs is kept.
    let question = text("/jobs/5/delete").await;
    assert!(question.contains("dataset 1") && !question.contains("?force=true"), "{question}");
    server.submitted(&small_training(&json!({"dataset": 1}))).await;
    server.submit_to("/v1/jobs?force=true", &small_pipeline(), &[]).await;
    server.submit_to("/v1/jobs?force=true", &small_training(&json!({"dataset": 1})), &[]).await;
    let question = text("/datasets/1/delete").await;
    assert!(
        question.contains("has not ended")
            && !question.contains("<form method=\"post\" action=\"../../datasets")
    );
}

#[tokio::test]
async fn the_question_says_what_people_call_the_thing_and_what_goes_with_it() {
    let server = Server::with_small_pipeline().await;
    let named = json!({"name": "the good one", "add_aliases": ["champion"]});
    assert_eq!(patch(&server, "/v1/checkpoints/1", &named).await.status, 200);
    assert_eq!(patch(&server, "/v1/jobs/5", &json!({"name": "night run"})).await.status, 200);
    let dataset = server.json("/v1/datasets/1").await;
    for (path, parts) in [
        ("/checkpoints/1", &["the good one", "@champion", "robomorph, step"][..]),
        ("/jobs/5", &["night run", "pipeline of 4 jobs", "@champion", "href=\"../../datasets/1\""]),
        ("/datasets/1", &[dataset["name"].as_str().unwrap(), " trajectories"]),
        ("/runs/1", &["train"]),
    ] {
        let page = server.get(&format!("{path}/delete")).await;
        for part in parts {
            assert!(page.text().contains(part), "{path}: {part}: {}", page.text());
        }
    }
}

/// The trash showed the name of before the renaming, and `simulate-98f7…` for labelled data.
#[tokio::test]
async fn the_trash_shows_the_names_that_users_gave() {
    let server = Server::with_small_pipeline().await;
    for (path, name) in [
        ("/v1/datasets/1", "arms with payload 1 kg"),
        ("/v1/jobs/5", "night run"),
        ("/v1/runs/2", "the first test"),
    ] {
        assert_eq!(patch(&server, path, &json!({"name": name})).await.status, 200);
    }
    let training = server.json("/v1/runs/1").await["name"].as_str().unwrap().to_owned();
    let step = server.json("/v1/checkpoints/1").await["step"].clone();
    let of_checkpoint = format!("{training}, step {step}");
    let simulation = format!("jobs/{}", server.json("/v1/datasets/1").await["job"]);
    let own_name = server.json(&format!("/v1/{simulation}")).await["name"].clone();
    for (path, name) in [
        ("runs/2", "the first test"),
        ("checkpoints/1", &*of_checkpoint),
        ("datasets/1", "arms with payload 1 kg"),
        // A job keeps its name, and the trash says what its dataset is called.
        (&*simulation, own_name.as_str().unwrap()),
        ("jobs/5", "night run"),
    ] {
        let question = server.get(&format!("/{path}/delete")).await;
        let heading = format!("<h1>Delete {name}?</h1>");
        assert!(question.text().contains(&heading), "{path}: {}", question.text());
        deleted(&server, &format!("/v1/{path}")).await;
        assert_eq!(server.json("/v1/trash").await["items"][0]["name"], name, "{path}");
        assert!(server.get("/trash").await.text().contains(name), "{path}");
        if path == simulation {
            let trash = server.json("/v1/trash").await;
            assert_eq!(trash["items"][0]["result_name"], "arms with payload 1 kg");
            assert!(server.get("/trash").await.text().contains(", with arms with payload 1 kg"));
        }
        server.post(&format!("/v1/{path}/restore")).await;
    }
}
