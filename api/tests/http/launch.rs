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
    let dataset = server.json("/v1/datasets/1").await;
    let again = format!("launch?job={}", dataset["job"]);
    assert!(server.get("/datasets/1").await.text().contains(&again));
    for (path, status) in [("/launch?job=99", 404), ("/launch?preset=none", 404)] {
        assert_eq!(server.get(path).await.status, status, "{path}");
    }
}

#[tokio::test]
async fn results_lead_to_forms_of_jobs_that_go_on_from_them() {
    let server = Server::with_small_pipeline().await;
    crate::robots::added(&server).await;
    let mut simulation = small_simulation(7);
    simulation["robot"]["gravity"] = json!("on");
    simulation["samples"] = json!(400);
    simulation["trajectories"] = json!(1);
    server.submitted(&simulation).await;
    server.work().await;
    let jobs = server.json("/v1/jobs").await["jobs"].as_array().unwrap().len();
    let with_weight = server.json("/v1/datasets").await["datasets"][0]["id"].clone();
    let mut launched = 0;
    for (path, words) in [
        ("/datasets/1".to_owned(), &["Train on it", "Evaluate on it"][..]),
        (format!("/datasets/{with_weight}"), &["Identify its arm"]),
        ("/checkpoints/1".to_owned(), &["Evaluate it", "Fine-tune it"]),
        ("/robots/1".to_owned(), &["Simulate arms like it"]),
    ] {
        let page = server.get(&path).await.text().to_owned();
        assert_eq!(page.contains("Identify its arm"), words.contains(&"Identify its arm"));
        for words in words {
            let (before, _) = page.split_once(&format!("\">{words}</a>")).expect(words);
            let (_, from) = before.rsplit_once("launch?from=").unwrap();
            let form = server.get(&format!("/launch?from={from}")).await;
            assert!(form.text().contains(&words.to_lowercase()), "{words}: {}", form.text());
            let body = form_urlencoded::Serializer::new(String::new())
                .append_pair("from", &from.replace("&#58;", ":"))
                .finish();
            let request = Request::post("/jobs").header("host", "127.0.0.1:7070");
            let request = request.header("content-type", "application/x-www-form-urlencoded");
            let answer = server.send(request.body(body.into()).unwrap()).await;
            assert_eq!(answer.status, 303, "{words}: {}", answer.text());
            launched += 1;
        }
    }
    let all = server.json("/v1/jobs").await["jobs"].as_array().unwrap().len();
    assert_eq!(all, jobs + launched, "each is a job of its own");
    for from in ["dataset:1:eat", "dataset:x:train", "checkpoint:1:train", "dataset"] {
        assert_eq!(server.get(&format!("/launch?from={from}")).await.status, 400, "{from}");
    }
    assert_eq!(server.get("/launch?from=robot:9:simulate").await.status, 404);
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

async fn post(server: &Server, fields: &[(&str, &str)]) -> crate::fixture::TestResponse {
    let mut form = form_urlencoded::Serializer::new(String::new());
    form.extend_pairs(fields);
    let request =
        Request::builder().method(Method::POST).uri("/jobs").header("host", "127.0.0.1:7070");
    let request = request.header("content-type", "application/x-www-form-urlencoded");
    server.send(request.body(form.finish().into()).unwrap()).await
}

#[tokio::test]
async fn a_form_of_fields_submits_what_the_same_json_would() {
    let server = Server::with_small_pipeline().await;
    let page = server.get("/launch?job=1").await.text().to_owned();
    let trajectories = server.json("/v1/jobs/1").await["spec"]["trajectories"].to_string();
    let placeholder = format!("placeholder=\"{trajectories}\"");
    for part in [
        "name=\"set:trajectories\"",
        &placeholder,
        "value=\"job:1\"",
        "name=\"sweep\"",
        "<summary>excitation (",
    ] {
        assert!(page.contains(part), "{part}: {page}");
    }
    // A pipeline has a part for each of its jobs, and no sweep.
    let page = server.get("/launch?preset=two-models").await.text().to_owned();
    assert!(page.contains("name=\"set:jobs.train.steps\"") && !page.contains("name=\"sweep\""));

    // Nothing is typed: the job that is there.
    let same = post(&server, &[("from", "job:1"), ("set:trajectories", "")]).await;
    assert_eq!((same.status.as_u16(), same.header("location")), (303, "/jobs/1?again=1"));
    assert!(server.get("/jobs/1?again=1").await.text().contains("was submitted before"));
    let fields = [
        ("from", "job:1"),
        ("set:trajectories", "40"),
        ("set:shard_trajectories", "40"),
        ("tags", "a"),
    ];
    let new = post(&server, &fields).await;
    assert_eq!(new.status, 303, "{new:?}");
    let job = server.json(&format!("/v1{}", new.header("location"))).await;
    let mut expected = server.json("/v1/jobs/1").await["spec"].clone();
    (expected["trajectories"], expected["shard_trajectories"]) = (json!(40), json!(40));
    assert_eq!((&job["spec"], &job["tags"]), (&expected, &json!(["a"])));

    let preset = [("from", "preset:two-models"), ("set:jobs.train.steps", "7"), ("show", "1")];
    let shown = post(&server, &preset).await;
    assert_eq!(shown.status, 200, "{shown:?}");
    assert!(shown.text().contains("&#34;steps&#34;: 7") && shown.text().contains("value=\"7\""));

    let sweep = [
        ("from", "job:1"),
        ("sweep", "seed"),
        ("values", "11, 12"),
        ("set:trajectories", "40"),
        ("set:shard_trajectories", "40"),
    ];
    let sweep = post(&server, &sweep).await;
    assert_eq!(sweep.status, 303, "{sweep:?}");
    let members = server.json(&format!("/v1{}", sweep.header("location"))).await["members"].clone();
    assert_eq!(members.as_array().unwrap().len(), 2, "{members}");
}

#[tokio::test]
async fn a_sweep_shows_the_value_of_each_job_and_compares_its_runs() {
    let server = Server::with_small_pipeline().await;
    let training = server.json("/v1/runs/1").await["job"].clone();
    let from = format!("job:{training}");
    let sweep = [("from", from.as_str()), ("sweep", "steps"), ("values", "120, 140")];
    let sweep = post(&server, &sweep).await;
    assert_eq!(sweep.status, 303, "{sweep:?}");
    let members = server.json(&format!("/v1{}", sweep.header("location"))).await["members"].clone();
    let mut runs = Vec::new();
    for member in members.as_array().unwrap() {
        runs.push(server.json(&format!("/v1/jobs/{}", member["job"])).await["run"].to_string());
    }
    let comparison = format!("compare?run={}", runs.join(","));
    for path in ["/", sweep.header("location")] {
        let page = server.get(path).await.text().to_owned();
        for part in ["<td class=\"col-swept\">steps 120</td>", ">steps 140</td>", &comparison] {
            assert!(page.contains(part), "{path}: {part}: {page}");
        }
    }
    let pipeline = server.get("/jobs/5").await.text().to_owned();
    assert!(!pipeline.contains("col-swept") && !pipeline.contains("compare?run="), "{pipeline}");
}

#[tokio::test]
async fn what_is_wrong_stands_beside_its_input_which_keeps_its_text() {
    let server = Server::with_small_pipeline().await;
    let fields = [
        ("from", "job:1"),
        ("set:trajectories", "-3"),
        ("set:rate_hz", "\"><b>x"),
        ("name", "mine"),
    ];
    let refused = post(&server, &fields).await;
    assert_eq!(refused.status, 422);
    let page = refused.text();
    assert!(page.contains("value=\"-3\"") && page.contains("value=\"mine\""), "{page}");
    assert!(!page.contains("<b>x") && page.matches("class=\"wrong\"").count() == 2, "{page}");
    for (fields, status) in [
        (vec![("from", "job:99")], 404),
        (vec![("from", "preset:none")], 404),
        (vec![("from", "file:x")], 400),
        (vec![("name", "x")], 400),
        (vec![("from", "job:1"), ("set:colour", "red")], 422),
        (vec![("from", "job:1"), ("sweep", "paint.colour"), ("values", "1")], 422),
        (vec![("from", "job:1"), ("sweep", "seed"), ("values", " , ")], 422),
    ] {
        let refused = post(&server, &fields).await;
        assert_eq!(refused.status, status, "{fields:?}: {refused:?}");
    }
    assert_eq!(server.json("/v1/jobs").await["jobs"].as_array().unwrap().len(), 5);
}

#[tokio::test]
async fn a_job_of_each_kind_is_begun_without_a_preset() {
    for server in [Server::start().await, Server::with_small_pipeline().await] {
        let page = server.get("/launch").await.text().to_owned();
        for words in ["Simulate", "Train", "Evaluate", "Identify", "Control", "Import"] {
            assert!(page.contains(&format!(">{words}</a>")), "{words}: {page}");
        }
        let beginnings: Vec<String> = page
            .split("launch?from=")
            .skip(1)
            .map(|rest| rest.split('"').next().unwrap().replace("&#58;", ":"))
            .collect();
        assert!(beginnings.len() >= 4, "{beginnings:?}");
        for from in beginnings {
            let form = server.get(&format!("/launch?from={from}")).await;
            assert!(form.text().contains("Fields of the spec"), "{from}: {form:?}");
            let sent = post(&server, &[("from", &from)]).await;
            assert_eq!(sent.status, 303, "{from}: {}", sent.text());
        }
        assert_eq!(server.get("/launch?from=new:pipeline").await.status, 400);
    }
}

#[tokio::test]
async fn checkpoints_are_listed_and_typed_by_their_ids() {
    let server = Server::with_small_pipeline().await;
    let form = server.get("/launch?from=dataset:2:evaluate").await;
    for part in ["list=\"checkpoints\"", "<option value=\"1\">1 robomorph"] {
        assert!(form.text().contains(part), "{part}: {}", form.text());
    }
    let fields = [
        ("from", "dataset:2:evaluate"),
        ("set:checkpoints", "1"),
        ("set:context", "320"),
        ("show", "1"),
    ];
    let shown = post(&server, &fields).await;
    assert!(shown.text().contains("&#34;checkpoint&#34;: 1"), "{}", shown.text());
    assert_eq!(post(&server, &fields[..3]).await.status, 303);
}

/// A finished job was renamed for everybody when somebody launched the same under another name.
#[tokio::test]
async fn an_equal_job_keeps_its_name_and_is_run_again_by_a_button() {
    let server = Server::with_small_pipeline().await;
    let before = server.json("/v1/jobs/1").await;
    let typed = [("from", "job:1"), ("name", "another <name>"), ("tags", "a b")];
    let same = post(&server, &typed).await;
    let path = same.header("location");
    assert_eq!(
        (same.status.as_u16(), path),
        (303, "/jobs/1?again=1&name=another+%3Cname%3E&tags=a+b")
    );
    let after = server.json("/v1/jobs/1").await;
    assert_eq!((&after["name"], &after["tags"]), (&before["name"], &before["tags"]));
    let page = server.get(path).await.text().to_owned();
    for part in ["Run it again", "name=\"force\"", "value=\"another &#60;name&#62;\""] {
        assert!(page.contains(part), "{part}: {page}");
    }
    let again = post(&server, &[&typed[..], &[("force", "1")]].concat()).await;
    assert_eq!(again.status, 303);
    assert_ne!(again.header("location"), "/jobs/1");
    let job = server.json(&format!("/v1{}", again.header("location"))).await;
    assert_eq!((&job["name"], &job["tags"]), (&json!("another <name>"), &json!(["a", "b"])));
    assert_eq!(job["digest"], before["digest"]);
}
