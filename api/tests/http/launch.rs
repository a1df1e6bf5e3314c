//! The page that submits specs.

use axum::http::{Method, Request};
use serde_json::json;

use crate::fixture::{Server, small_simulation};

fn form(spec: &str, name: &str) -> String {
    let mut form = form_urlencoded::Serializer::new(String::new());
    form.append_pair("spec", spec).append_pair("name", name).append_pair("tags", "a b");
    form.finish()
}

#[tokio::test]
async fn a_preset_and_an_earlier_job_are_a_beginning() {
    let server = Server::with_small_pipeline().await;
    let page = server.get("/launch").await;
    assert_eq!(page.status, 200);
    for preset in ["quickstart", "panda-real"] {
        assert!(page.text().contains(&format!("launch?preset={preset}")), "{}", page.text());
    }
    assert!(!page.text().contains("preset=lagrangian-tiny"), "a model is no job");
    let preset = server.get("/launch?preset=quickstart").await;
    assert!(preset.text().contains("train-lagrangian"), "{}", preset.text());
    // The text of a job is its spec, which is the same job when it is submitted again.
    let job = server.json("/v1/jobs/1").await;
    let page = server.get("/launch?job=1").await.text().to_owned();
    let text = page.split("<textarea").nth(1).unwrap();
    let text = text.split_once('>').unwrap().1.split("</textarea>").next().unwrap();
    let text = text.replace("&#34;", "\"").replace("&#x2F;", "/").replace("&#38;", "&");
    let spec: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(spec, job["spec"]);
    assert!(server.get("/jobs/1").await.text().contains("launch?job=1"));
    for (path, status) in [("/launch?job=99", 404), ("/launch?preset=none", 404)] {
        assert_eq!(server.get(path).await.status, status, "{path}");
    }
}

#[tokio::test]
async fn a_spec_is_submitted_and_a_refused_one_stays_with_what_is_wrong() {
    let server = Server::start().await;
    let send = async |spec: &str, name: &str| {
        let request =
            Request::builder().method(Method::POST).uri("/jobs").header("host", "127.0.0.1:7070");
        let request = request.header("content-type", "application/x-www-form-urlencoded");
        server.send(request.body(form(spec, name).into()).unwrap()).await
    };
    let spec = small_simulation(1).to_string();
    let answer = send(&spec, "mine").await;
    assert_eq!((answer.status.as_u16(), answer.header("location")), (303, "/jobs/1"));
    let job = server.json("/v1/jobs/1").await;
    assert_eq!((&job["name"], &job["tags"]), (&json!("mine"), &json!(["a", "b"])));

    let mut wrong = small_simulation(1);
    wrong["trajectories"] = json!(-3);
    wrong["colour"] = json!("red");
    let refused = send(&wrong.to_string(), "mine").await;
    assert_eq!(refused.status, 422);
    for part in ["<code>trajectories</code>", "<code>colour</code>", "red", "value=\"mine\""] {
        assert!(refused.text().contains(part), "{part}: {}", refused.text());
    }
    let broken = send("{\"kind\": ", "").await;
    assert_eq!(broken.status, 400);
    assert!(broken.text().contains("role=\"alert\""), "{}", broken.text());
    let long = send(&spec, &"n".repeat(300)).await;
    assert!(long.status.is_client_error() && long.text().contains("name"), "{}", long.text());
    assert_eq!(server.json("/v1/jobs").await["jobs"].as_array().unwrap().len(), 1);
}
