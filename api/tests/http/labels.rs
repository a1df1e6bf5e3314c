//! Names, notes and tags, and their effect in lists.

use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HOST};
use axum::http::{Method, Request};
use serde_json::{Value, json};

use crate::fixture::{Server, TestResponse, small_simulation, small_training};

const MERGE_PATCH: &str = "application/merge-patch+json";

const FORM: &str = "application/x-www-form-urlencoded";

async fn send(
    server: &Server,
    method: Method,
    path: &str,
    kind: &str,
    body: String,
) -> TestResponse {
    let request = Request::builder().method(method).uri(path).header(HOST, "127.0.0.1:7070");
    server.send(request.header(CONTENT_TYPE, kind).body(Body::from(body)).unwrap()).await
}

pub async fn patch(server: &Server, path: &str, change: &Value) -> TestResponse {
    send(server, Method::PATCH, path, MERGE_PATCH, change.to_string()).await
}

fn ids(page: &Value, list: &str) -> Vec<i64> {
    page[list].as_array().unwrap().iter().map(|item| item["id"].as_i64().unwrap()).collect()
}

#[tokio::test]
async fn labels_are_given_to_all_four_kinds_of_things_and_shown_in_lists() {
    let server = Server::with_small_pipeline().await;
    let change = json!({"name": "Näme", "note": "# A\n<b>", "tags": ["b", "a/1"]});
    for (path, list) in [
        ("/v1/jobs/1", "jobs"),
        ("/v1/runs/1", "runs"),
        ("/v1/datasets/1", "datasets"),
        ("/v1/checkpoints/1", "checkpoints"),
    ] {
        let before = server.json(path).await;
        let answer = patch(&server, path, &change).await;
        assert_eq!(answer.status, 200, "{answer:?}");
        let after = server.json(path).await;
        assert_eq!(answer.json(), after);
        let labels = (&after["name"], &after["note"], &after["tags"]);
        assert_eq!(labels, (&json!("Näme"), &json!("# A\n<b>"), &json!(["a/1", "b"])));
        assert_eq!(after["digest"], before["digest"]);
        let found = server.json(&format!("/v1/{list}?tag=b&tag=a/1&text=N%C3%84M")).await;
        let listed = found[list].as_array().unwrap();
        // Results of the job are also found by its labels.
        let listed = listed.iter().find(|item| item["id"] == 1).unwrap();
        assert_eq!((&listed["name"], &listed["tags"]), (&after["name"], &after["tags"]));

        let tags = json!({"add_tags": ["c"], "remove_tags": ["b"], "note": null});
        let changed = patch(&server, path, &tags).await.json();
        assert_eq!((&changed["tags"], changed.get("note")), (&json!(["a/1", "c"]), None));
        let gone = json!({"name": null, "tags": null});
        assert_eq!(patch(&server, path, &gone).await.json(), before);
    }
    let answer = send(&server, Method::PATCH, "/v1/jobs/1", "application/json", "{}".into()).await;
    assert_eq!(answer.status, 200);
    patch(&server, "/v1/runs/77", &json!({})).await.problem(404);
}

#[tokio::test]
async fn clients_of_mlflow_see_what_a_run_is_called() {
    let server = Server::with_small_pipeline().await;
    let job = server.json("/v1/runs/1").await["job"].clone();
    patch(&server, &format!("/v1/jobs/{job}"), &json!({"tags": ["of-job"]})).await;
    let change = json!({"name": "Named", "note": "Said", "tags": ["own"]});
    patch(&server, "/v1/runs/1", &change).await;
    let search = json!({"experiment_ids": ["1"], "filter": "tags.torqued.tags LIKE '%own%'"});
    let found = server.submit_to("/api/2.0/mlflow/runs/search", &search, &[]).await.json();
    let run = &found["runs"][0];
    assert_eq!(run["info"]["run_name"], "Named");
    let tags = run["data"]["tags"].as_array().unwrap();
    let value = |key: &str| tags.iter().find(|tag| tag["key"] == key).unwrap()["value"].clone();
    assert_eq!(value("mlflow.note.content"), "Said");
    assert_eq!(value("torqued.tags"), "own of-job");
    assert_eq!(found["runs"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn labels_that_cannot_be_are_refused_with_every_reason() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    let wrong = json!({"name": "a\nb", "note": "", "tags": ["ä"], "add_tags": ["a"]});
    let problem = patch(&server, "/v1/jobs/1", &wrong).await.problem(422);
    let fields: Vec<&Value> = problem["violations"]
        .as_array()
        .unwrap()
        .iter()
        .map(|violation| &violation["field"])
        .collect();
    assert_eq!(fields, ["name", "note", "tags[0]", "add_tags"]);
    let typo = patch(&server, "/v1/jobs/1", &json!({"tag": ["a"]})).await.problem(422);
    assert!(typo["detail"].as_str().unwrap().contains("tag"), "{typo}");
    for refused in [&problem, &typo] {
        assert_eq!(refused["title"], "The name, note, tags or aliases are not allowed");
    }
    let spaced =
        server.submit_to("/v1/jobs?tag=a%20b", &small_simulation(1), &[]).await.problem(422);
    assert_eq!(spaced["violations"][0]["field"], "tag");
    patch(&server, "/v1/jobs/1", &json!(["a"])).await.problem(422);
    let many: Vec<String> = (0..32).map(|i| format!("t{i}")).collect();
    assert_eq!(patch(&server, "/v1/jobs/1", &json!({"tags": many})).await.status, 200);
    let problem = patch(&server, "/v1/jobs/1", &json!({"add_tags": ["more"]})).await.problem(409);
    assert!(problem["detail"].as_str().unwrap().contains("33 tags, allowed: 32"), "{problem}");
    let longest = json!({"name": "ä".repeat(200), "note": "x".repeat(10_000)});
    assert_eq!(patch(&server, "/v1/jobs/1", &longest).await.status, 200);
    send(&server, Method::PATCH, "/v1/jobs/1", "text/plain", "{}".into()).await.problem(415);
}

#[tokio::test]
async fn a_submission_is_labelled_beside_its_spec() {
    let server = Server::start().await;
    let spec = small_simulation(1);
    let plain = server.submitted(&small_simulation(2)).await;
    let path = "/v1/jobs?name=My%20run&note=Why%3F&tag=x&tag=y";
    let answer = server.submit_to(path, &spec, &[]).await;
    assert_eq!(answer.status, 201, "{answer:?}");
    let job = answer.json();
    let labels = (&job["name"], &job["note"], &job["tags"]);
    assert_eq!(labels, (&json!("My run"), &json!("Why?"), &json!(["x", "y"])));
    assert_ne!(job["name"], plain["name"]);
    // Only the spec decides whether two jobs are the same.
    let again = server.submit_to("/v1/jobs?name=Other&tag=z", &spec, &[]).await;
    assert_eq!(again.status, 200);
    let again = again.json();
    assert_eq!((&again["id"], &again["digest"]), (&job["id"], &job["digest"]));
    assert_eq!((&again["name"], &again["tags"]), (&json!("My run"), &json!(["x", "y", "z"])));
    let refused = server.submit_to("/v1/jobs?tag=a%20b", &small_simulation(3), &[]).await;
    refused.problem(422);
    assert_eq!(ids(&server.json("/v1/jobs").await, "jobs").len(), 2);
    // A job that is retried keeps its name.
    server.post("/v1/jobs/2/cancel").await;
    let retried = server.post("/v1/jobs/2/retry").await;
    let retried = retried.json();
    assert_eq!((&retried["name"], &retried["tags"]), (&again["name"], &again["tags"]));
}

#[tokio::test]
async fn every_list_is_read_through_by_its_cursor_in_every_order() {
    let server = Server::with_small_pipeline().await;
    for list in ["jobs", "runs", "datasets", "checkpoints", "evaluations"] {
        let document = server.json("/v1/openapi.json").await;
        let parameters = &document["paths"][format!("/v1/{list}")]["get"]["parameters"];
        let sort = parameters
            .as_array()
            .unwrap()
            .iter()
            .find(|parameter| parameter["name"] == "sort")
            .unwrap();
        let all = ids(&server.json(&format!("/v1/{list}")).await, list);
        assert!(!all.is_empty(), "{list}");
        for order in sort["schema"]["enum"].as_array().unwrap() {
            let path = format!("/v1/{list}?limit=1&sort={}", order.as_str().unwrap());
            let (mut seen, mut address) = (Vec::new(), path.clone());
            loop {
                let page = server.json(&address).await;
                seen.extend(ids(&page, list));
                let Some(next) = page["next"].as_str() else { break };
                address = format!("{path}&cursor={next}");
            }
            seen.sort_unstable_by(|a, b| b.cmp(a));
            assert_eq!(seen, all, "{path}");
        }
        let first = server.json(&format!("/v1/{list}?limit=1")).await;
        if let Some(next) = first["next"].as_str() {
            let other = if list == "jobs" { "runs" } else { "jobs" };
            let answer = server.get(&format!("/v1/{other}?cursor={next}")).await;
            let detail = answer.problem(400)["detail"].to_string();
            assert!(detail.contains(&format!("this one is of {list}")), "{detail}");
        }
    }
}

/// A list has the best first, and last the items without an error.
#[tokio::test]
async fn lists_are_sorted_by_quality() {
    let server = Server::with_small_pipeline().await;
    let mut trainings = Vec::new();
    for (seed, steps) in [(1, 60), (2, 20)] {
        let mut spec = small_training(&json!({"dataset": 1}));
        spec["seed"] = json!(seed);
        trainings.push(server.submitted(&spec).await["run"].as_i64().unwrap());
        let task = server.claim().await.unwrap();
        server.train_to(&task, steps, false).await;
    }
    let first = server.json("/v1/runs?kind=train&sort=created&limit=1").await;
    let (pipelines, [longer, shorter]) = (ids(&first, "runs")[0], [trainings[0], trainings[1]]);
    let best_first = server.json("/v1/runs?sort=rmse").await;
    assert_eq!(ids(&best_first, "runs")[..3], [pipelines, longer, shorter]);
    let worst_first = server.json("/v1/runs?sort=-rmse").await;
    assert_eq!(ids(&worst_first, "runs")[..3], [shorter, longer, pipelines]);
    for unmeasured in [&best_first, &worst_first] {
        assert_eq!(unmeasured["runs"][3]["kind"], "evaluate");
    }
    let answer = server.get("/v1/datasets?sort=rmse").await;
    let detail = answer.problem(400)["detail"].to_string();
    assert!(detail.contains("sort is \\\"rmse\\\", allowed: created, -created, name,"), "{detail}");
}

#[tokio::test]
async fn pages_of_lists_link_to_their_orders() {
    let server = Server::with_small_pipeline().await;
    for (page, orders) in [
        ("/", "created -finished name -priority"),
        ("/runs", "created -finished name rmse"),
        ("/datasets", "created name -trajectories"),
        ("/checkpoints", "created -step rmse"),
        ("/evaluations", "created -finished name -priority rmse"),
    ] {
        let first = server.get(page).await;
        for order in orders.split(' ') {
            assert!(first.text().contains(&format!("?sort={order}\"")), "{order}: {first:?}");
        }
        let sorted = server.get(&format!("{page}?sort=name&text=a")).await;
        if orders.contains("name") {
            let text = sorted.text();
            assert!(text.contains("sort=-name") && text.contains("name \u{2191}"), "{sorted:?}");
            assert!(text.contains("name=\"sort\" value=\"name\""), "the form keeps the order");
        }
    }
    let checkpoints = server.get("/checkpoints").await;
    assert!(checkpoints.text().contains("placeholder=\"Tags, aliases\""), "{checkpoints:?}");
    let runs = server.get("/runs?sort=rmse").await;
    assert!(runs.text().contains("<th class=\"number\">Last validation RMSE</th>"), "{runs:?}");
    assert_eq!(server.get("/datasets?sort=rmse").await.status, 400);
}

#[tokio::test]
async fn what_a_list_does_not_have_is_refused() {
    let server = Server::start().await;
    for query in [
        "jobs?sort=steps",
        "jobs?state=complete",
        "runs?kind=trian",
        "datasets?state=queued",
        "checkpoints?kind=train",
        "evaluations?kind=train",
        "runs?tag=a%20b",
        "runs?text=",
        "runs?text=%00",
        "runs?since=yesterday",
        "jobs?cursor=1",
        "jobs?limit=1&limit=2",
        "jobs?before=9223372036854775808",
    ] {
        server.get(&format!("/v1/{query}")).await.problem(400);
    }
    let none = server.json("/v1/jobs?since=2000-01-01T00:00:00Z&until=2000-01-02T00:00:00%2B01:00");
    assert_eq!(none.await, json!({"jobs": [], "next": null}));
}

#[tokio::test]
async fn the_page_filters_and_changes_labels_by_plain_forms() {
    let server = Server::with_small_pipeline().await;
    for (path, word) in [
        ("/jobs/5", "quickstart"),
        ("/runs/1", "train"),
        ("/datasets/1", "dataset 1"),
        ("/checkpoints/1", "checkpoint 1"),
    ] {
        assert!(server.get(path).await.text().contains(word), "{path}");
        let fields = "shown=&name=%3Ci%3ENamed&tags=a%2F1+b%2C+c&note=line%0D%0A%3Cscript%3E";
        let answer = send(&server, Method::POST, path, FORM, fields.to_owned()).await;
        assert_eq!((answer.status.as_u16(), answer.header("location")), (303, path));
        let shown = server.json(&format!("/v1{path}")).await;
        assert_eq!(shown["tags"], json!(["a/1", "b", "c"]));
        assert_eq!(
            (&shown["name"], &shown["note"]),
            (&json!("<i>Named"), &json!("line\n<script>"))
        );
        let page = server.get(path).await;
        assert!(page.text().contains("a/1"), "{path}");
        for unsafe_text in ["<i>Named", "<script>"] {
            let inside = page.text().split("<main").nth(1).unwrap();
            assert!(!inside.contains(unsafe_text), "{path}: {unsafe_text} is not escaped");
        }
        let fields = "shown=%3Ci%3ENamed&name=%3Ci%3ENamed&tags=&note=";
        send(&server, Method::POST, path, FORM, fields.to_owned()).await;
        let shown = server.json(&format!("/v1{path}")).await;
        assert_eq!((&shown["name"], &shown["tags"]), (&json!("<i>Named"), &json!([])));
        let wrong =
            send(&server, Method::POST, path, FORM, "shown=&name=&tags=%C3%A4&note=".into());
        assert_eq!(wrong.await.status, 422);
    }
    server.submitted(&small_simulation(9)).await;
    let listed = async |query: &str| {
        server.get(&format!("/?{query}")).await.text().matches("<article").count()
    };
    assert_eq!(listed("").await, 2);
    assert_eq!(listed("text=&tag=&kind=").await, 2);
    assert_eq!(listed("text=named&kind=pipeline").await, 1);
    assert_eq!(listed("kind=simulate&state=queued").await, 1);
    assert_eq!(listed("tag=absent").await, 0);
    let page = server.get("/?text=named&kind=pipeline").await;
    let failed = "href=\"./?text=named&#38;kind=pipeline&#38;state=failed\"";
    assert!(page.text().contains(failed), "{page:?}");
}

#[tokio::test]
async fn an_alias_is_taken_in_the_place_of_a_checkpoints_id() {
    let server = Server::with_small_pipeline().await;
    let change = json!({"add_aliases": ["champion", "v1.2"], "add_tags": ["a"]});
    let answer = patch(&server, "/v1/checkpoints/1", &change).await;
    assert_eq!(answer.status, 200, "{answer:?}");
    assert_eq!(answer.json()["aliases"], json!(["champion", "v1.2"]));
    let by_id = server.json("/v1/checkpoints/1").await;
    assert_eq!(server.json("/v1/checkpoints/champion").await, by_id);
    for path in ["files/config.json", "tar", "dependents"] {
        let [alias, id] = ["v1.2", "1"].map(|name| format!("/v1/checkpoints/{name}/{path}"));
        let (alias, id) = (server.get(&alias).await, server.get(&id).await);
        assert_eq!((alias.status, &alias.body), (id.status, &id.body), "{path}");
    }
    assert_eq!(ids(&server.json("/v1/checkpoints?tag=champion").await, "checkpoints"), [1]);
    let page = server.get("/checkpoints/champion").await;
    assert!(page.status == 200 && page.text().contains(">@champion<"), "{page:?}");
    assert!(server.get("/checkpoints").await.text().contains("champion, v1.2"));

    // The form takes one away and gives another.
    let form = "shown=&name=&tags=a&note=&shown_aliases=champion+v1.2&aliases=v1.2+next";
    let posted = send(&server, Method::POST, "/checkpoints/v1.2", FORM, form.to_owned()).await;
    assert_eq!(posted.status, 303, "{posted:?}");
    assert_eq!(server.json("/v1/checkpoints/1").await["aliases"], json!(["next", "v1.2"]));

    let problem = server.get("/v1/checkpoints/champion").await.problem(404);
    assert!(problem["detail"].as_str().unwrap().contains("alias \"champion\""), "{problem}");
    let browser = [("accept", "text/html,application/xhtml+xml")];
    let page = server.request(Method::GET, "/checkpoints/champion", &browser).await;
    assert!(page.status == 404 && page.text().contains("champion"), "{page:?}");
    server.get("/v1/checkpoints/7b").await.problem(400);
    server.get("/v1/runs/champion").await.problem(400);
    let change = json!({"add_aliases": ["7"], "remove_aliases": ["a/b"]});
    let problem = patch(&server, "/v1/checkpoints/1", &change).await.problem(422);
    assert_eq!(problem["violations"].as_array().unwrap().len(), 2, "{problem}");
    let problem = patch(&server, "/v1/runs/1", &json!({"add_aliases": ["champion"]})).await;
    assert!(problem.problem(422)["detail"].as_str().unwrap().contains("add_aliases"));
}

#[tokio::test]
async fn a_spec_may_name_an_alias_and_keeps_what_it_stood_for() {
    let server = Server::with_small_pipeline().await;
    let spec = json!({
        "kind": "evaluate", "data": {"dataset": 2}, "checkpoints": [{"alias": "champion"}],
        "baselines": ["hold-last"],
    });
    let problem = server.submit(&spec).await.problem(422);
    let violation = &problem["violations"][0];
    assert_eq!(violation["field"], "checkpoints[0].alias", "{problem}");
    assert!(violation["allowed"].as_str().unwrap().contains("no checkpoint has one yet"));
    let change = json!({"add_aliases": ["champion"]});
    assert_eq!(patch(&server, "/v1/checkpoints/1", &change).await.status, 200);
    let stored = server.submitted(&spec).await["spec"]["checkpoints"][0].clone();
    assert!(stored.get("alias").is_none() && stored.to_string().contains("digest"), "{stored}");
    let other =
        json!({"kind": "evaluate", "data": {"dataset": 2}, "checkpoints": [{"alias": "x"}]});
    let problem = server.submit(&other).await.problem(422);
    assert_eq!(problem["violations"][0]["allowed"], "one of champion", "{problem}");
}

#[tokio::test]
async fn an_alias_tells_nothing_to_those_without_the_token() {
    let options = api::Options { token: Some("secret".to_owned()), ..api::Options::default() };
    let server = Server::start_with(&options).await;
    server.get("/v1/checkpoints/champion").await.problem(401);
}

/// The form was gone, and the page was as wide as the tag.
#[tokio::test]
async fn a_refused_form_of_labels_is_shown_again_as_it_was_typed() {
    let server = Server::with_small_pipeline().await;
    let long = "t".repeat(200);
    let form = format!("shown=&name=Mine&tags=a+{long}&note=Why&shown_aliases=&aliases=next+7");
    let refused = send(&server, Method::POST, "/checkpoints/1", FORM, form).await;
    assert_eq!(refused.status, 422);
    let page = refused.text();
    for part in [
        "<h1>Name, tags and note of checkpoint 1</h1>",
        &format!("value=\"a {long}\""),
        "value=\"Mine\"",
        "value=\"next 7\"",
        ">Why</textarea>",
        "allowed: 1 to 64 letters, digits and . _ - : / @ + =",
        "7 is not allowed; allowed: 1 to 64 letters",
        "href=\"../checkpoints/1\"",
    ] {
        assert!(page.contains(part), "{part}: {page}");
    }
    assert!(!page.contains("prediction request"), "{page}");
    let kept = server.json("/v1/checkpoints/1").await;
    assert_eq!(kept["tags"], json!([]));
    assert!(kept.get("aliases").is_none_or(|aliases| *aliases == json!([])), "{kept}");
    let gone =
        send(&server, Method::POST, "/runs/99", FORM, "shown=&name=&tags=&note=".into()).await;
    assert!(gone.status == 404 && gone.text().contains("href=\"../runs/99\""), "{gone:?}");
}

#[tokio::test]
async fn an_alias_that_comes_from_another_checkpoint_is_told() {
    let server = Server::with_small_pipeline().await;
    let training = server.submitted(&small_training(&json!({"dataset": 1}))).await;
    server.work().await;
    let training = server.json(&format!("/v1/jobs/{}", training["id"])).await;
    let other = format!("/checkpoints/{}", training["checkpoints"][0]);
    let form = "shown=&name=&tags=&note=&shown_aliases=&aliases=champion";
    let first = send(&server, Method::POST, "/checkpoints/1", FORM, form.to_owned()).await;
    assert_eq!(first.header("location"), "/checkpoints/1");
    let second = send(&server, Method::POST, &other, FORM, form.to_owned()).await;
    assert_eq!(second.header("location"), format!("{other}?moved=champion:1"));
    let page = server.get(second.header("location")).await;
    assert!(page.text().contains("@champion stood for checkpoint 1 before."), "{page:?}");
    let plain = server.get("/checkpoints/1?moved=champion:2").await;
    assert!(!plain.text().contains("stood for"), "it has no such alias");
}
