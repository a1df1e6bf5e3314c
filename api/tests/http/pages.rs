//! The page in a browser without scripts.

use axum::http::Method;
use serde_json::{Value, json};
use store::NewArtifact;

use crate::fixture::{Server, followed, report, small_pipeline, small_simulation};
use crate::{robots, uploads};

pub async fn page(server: &Server, path: &str) -> String {
    let answer = server.get(path).await;
    assert_eq!(answer.status, 200, "{path}: {answer:?}");
    assert_eq!(answer.header("content-type"), "text/html; charset=utf-8");
    answer.text().to_owned()
}

/// The page's links began at the root of the host, so behind a proxy that shows the server below a
/// path they led to other programs.
#[tokio::test]
async fn every_link_of_every_page_leads_on_from_the_page_itself() {
    let server = Server::with_small_pipeline().await;
    robots::added(&server).await;
    let mut checked = 0;
    for path in [
        "/",
        "/?kind=train",
        "/jobs/1",
        "/jobs/5",
        "/jobs/1/delete",
        "/runs",
        "/runs/1",
        "/compare?run=1,2",
        "/predict?dataset=1&checkpoint=1",
        "/datasets",
        "/datasets/1",
        "/checkpoints",
        "/checkpoints/1",
        "/evaluations",
        "/evaluations/4",
        "/robots",
        "/robots/1",
        "/workers",
        "/trash",
        "/docs",
    ] {
        let page = page(&server, path).await;
        let (path, _) = path.split_once('?').unwrap_or((path, ""));
        for attribute in ["href", "src", "action", "data-events"] {
            for rest in page.split(&format!("{attribute}=\"")).skip(1) {
                let link = rest.split('"').next().unwrap().replace("&#38;", "&");
                assert!(!link.starts_with('/'), "{path}: {attribute} {link}");
                if link.starts_with(['?', '#']) || attribute != "href" {
                    continue;
                }
                let to = followed(path, link.split('#').next().unwrap());
                let status = server.get(&to).await.status;
                assert!(
                    status.is_success() || status.is_redirection(),
                    "{path}: {link} is {status}"
                );
                checked += 1;
            }
        }
    }
    assert!(checked > 200, "{checked}");
}

/// A path that a proxy adds is not known here, but it may tell.
#[tokio::test]
async fn commands_on_a_page_have_the_address_that_a_proxy_tells() {
    let server = Server::with_small_pipeline().await;
    let headers = [
        ("host", "127.0.0.1"),
        ("x-forwarded-proto", "https"),
        ("x-forwarded-prefix", "/torqued/"),
    ];
    let page = server.request(Method::GET, "/checkpoints/1", &headers).await;
    assert!(page.text().contains("https://127.0.0.1/torqued/v1/checkpoints/1/"), "{page:?}");
}

#[tokio::test]
async fn an_empty_server_explains_the_first_command() {
    let server = Server::start().await;
    let page = page(&server, "/").await;
    assert!(page.contains("No experiments yet"));
    assert!(page.contains("http://127.0.0.1:7070/v1/jobs"));
}

#[tokio::test]
async fn a_pipeline_is_listed_once_with_its_jobs_and_results() {
    let server = Server::start().await;
    server.submitted(&small_pipeline()).await;
    server.work().await;
    server.submitted(&small_simulation(3)).await;
    let page = page(&server, "/").await;
    assert_eq!(page.matches("<article").count(), 2, "{page}");
    for text in [
        "quickstart",
        "train-set",
        "last validation RMSE",
        "robomorph 1.18°",
        "least-squares 1.31°",
    ] {
        assert!(page.contains(text), "{text} is not in {page}");
    }
    assert!(page.contains("Cancel"));
}

#[tokio::test]
async fn experiments_are_listed_page_by_page_and_by_state() {
    let server = Server::start().await;
    for seed in 1..=23 {
        server.submitted(&small_simulation(seed)).await;
    }
    let first = page(&server, "/").await;
    assert_eq!(first.matches("<article").count(), 20);
    let (_, older) = first.split_once("href=\"./?cursor=").expect("a link to older experiments");
    let older = format!("/?cursor={}", older.split('"').next().unwrap());
    let second = page(&server, &older).await;
    assert_eq!(second.matches("<article").count(), 3);
    let failed = page(&server, "/?state=failed").await;
    assert!(failed.contains("No experiment matches"));
}

#[tokio::test]
async fn every_page_of_a_finished_experiment_is_there() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    server.work().await;
    let job = page(&server, &format!("/jobs/{}", pipeline["id"])).await;
    assert!(job.contains("quickstart") && job.contains("train-set"));
    let run = page(&server, "/runs/1").await;
    assert!(run.contains("<svg") && run.contains("validation/rmse_deg"));
    let answer = server.get("/runs/2").await;
    assert_eq!((answer.status.as_u16(), answer.header("location")), (303, "/evaluations/4"));
    let evaluation = page(&server, "/evaluations/4").await;
    for text in [
        "/v1/runs/2/artifacts/rmse-multisine.svg",
        "not clear",
        "out of distribution",
        "[1.10, 1.27]",
    ] {
        assert!(evaluation.contains(text), "{text} is not in {evaluation}");
    }
    let dataset = page(&server, "/datasets/1").await;
    assert!(dataset.contains("pl.read_parquet") && dataset.contains("robots-00000.parquet"));
    for text in ["dataset.json", "position of joint 7", "spectrum.svg", "Not verified yet"] {
        assert!(dataset.contains(text), "{text} is not in {dataset}");
    }
    let checkpoint = page(&server, "/checkpoints/1").await;
    assert!(checkpoint.contains("load_file") && checkpoint.contains("model.safetensors"));
}

#[tokio::test]
async fn a_run_without_a_page_of_its_own_is_shown_with_its_job() {
    let server = Server::start().await;
    let robots = json!({"preset": "D1-multisine", "trajectories": 1});
    let spec = json!({"kind": "control", "data": {"stream": robots}, "robots": 1});
    let job = server.submitted(&spec).await;
    let task = server.claim().await.unwrap();
    let table = NewArtifact { name: "robot-00.csv", media_type: "text/csv", bytes: "t".into() };
    server.store.put_artifact(task.fence, table).await.unwrap();

    let path = format!("/jobs/{}", job["id"]);
    let answer = server.get(&format!("/runs/{}", job["run"])).await;
    assert_eq!((answer.status.as_u16(), answer.header("location")), (303, path.as_str()));
    let page = page(&server, &path).await;
    assert!(page.contains("/artifacts/robot-00.csv"), "{page}");
}

#[tokio::test]
async fn every_link_of_every_page_leads_somewhere() {
    let server = Server::start().await;
    server.submitted(&small_pipeline()).await;
    server.work().await;
    let mut open = vec!["/".to_owned()];
    let mut seen = std::collections::BTreeSet::new();
    while let Some(path) = open.pop() {
        if !seen.insert(path.clone()) {
            continue;
        }
        let answer = server.get(&path).await;
        assert_eq!(answer.status, 200, "{path}");
        if !answer.header("content-type").starts_with("text/html") {
            continue;
        }
        for attribute in ["href=\"", "src=\""] {
            for link in answer.text().split(attribute).skip(1) {
                let link = link.split('"').next().unwrap().replace("&#38;", "&");
                if let Some(place) = link.strip_prefix('#') {
                    assert!(answer.text().contains(&format!("id=\"{place}\"")), "{path}: {link}");
                    continue;
                }
                let (folder, _) = path.split_once('?').unwrap_or((&path, ""));
                open.push(followed(folder, &link));
            }
        }
    }
    assert!(seen.len() > 30, "{seen:?}");
}

#[tokio::test]
async fn trajectories_are_turned_over_by_links_that_end_at_the_ends() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    assert!(!page(&server, "/datasets/1").await.contains("trajectories/0/figure.svg"));
    server.work().await;
    let links = async |path: &str| {
        let page = page(&server, path).await;
        let link = |rel: &str| {
            let (_, rest) = page.split_once(&format!("rel=\"{rel}\" href=\""))?;
            Some(rest.split('"').next().unwrap().to_owned())
        };
        (link("prev"), link("next"))
    };
    let to = |index: u64| Some(format!("../datasets/1?trajectory={index}#trajectory"));
    assert_eq!(links("/datasets/1").await, (None, to(1)));
    assert_eq!(links("/datasets/1?trajectory=5").await, (to(4), to(6)));
    assert_eq!(links("/datasets/1?trajectory=9").await, (to(8), None));
    let beyond = page(&server, "/datasets/1?trajectory=10").await;
    assert!(beyond.contains("There is no trajectory 10 in dataset 1: there are 0 to 9"));
    assert_eq!(server.get("/datasets/1?trajectory=x").await.status, 400);
}

#[tokio::test]
async fn an_import_tells_what_became_of_the_file() {
    let server = Server::start().await;
    let job = uploads::send_recordings(&server).await.json();
    server.work().await;
    let row = page(&server, "/").await;
    assert!(row.contains("3 trajectories") && row.contains("/datasets/1"), "{row}");
    let dataset = page(&server, "/datasets/1?trajectory=2").await;
    let texts = [
        "cut from recordings",
        "2 of them too short",
        "samples in no trajectory",
        "Begins",
        "line 9 to line 99: column",
    ];
    for text in texts {
        assert!(dataset.contains(text), "{text} is not in {dataset}");
    }
    assert!(!dataset.contains("Draws kept"), "{dataset}");
    let tasks = server.json(&format!("/v1/jobs/{}/tasks", job["id"])).await;
    let counts = &tasks["tasks"][0]["result"]["import"];
    assert_eq!((&counts["recordings"], &counts["rows"]), (&json!(5), &json!(1700)));
    let robot = server.json("/v1/datasets/1/trajectories/2").await["robot"].clone();
    assert_eq!((&robot["trajectory"], &robot["first_row"]), (&json!(2), &json!(23)));
}

#[tokio::test]
async fn what_is_doubtful_in_a_spec_is_told_with_the_job() {
    let server = Server::start().await;
    let mut spec = small_simulation(1);
    spec["robot"] = json!({"damping_nm_s_rad": vec![0.5; 7]});
    let job = server.submitted(&spec).await;
    let warning = job["warnings"][0].as_str().unwrap();
    assert!(warning.starts_with("robot.damping_nm_s_rad is "), "{warning}");
    let page = page(&server, &format!("/jobs/{}", job["id"])).await;
    assert!(page.contains("class=\"warning aside\">robot.damping_nm_s_rad is "), "{page}");
    assert_eq!(server.submitted(&small_simulation(2)).await["warnings"], json!([]));
}

#[tokio::test]
async fn the_dataset_of_a_failed_import_says_that_its_import_failed() {
    let server = Server::start().await;
    uploads::send_recordings(&server).await;
    server.fail_next("line 7 has no number").await;
    let dataset = page(&server, "/datasets/1").await;
    assert!(dataset.contains("The import failed: "), "{dataset}");
    assert!(dataset.contains("line 7 has no number") && !dataset.contains("building"), "{dataset}");
    let list = page(&server, "/datasets").await;
    assert!(list.contains("import failed") && !list.contains("building"), "{list}");
}

#[tokio::test]
async fn every_list_is_filtered_by_name_and_turned_over_page_by_page() {
    let server = Server::with_small_pipeline().await;
    for (path, name, cell) in [
        ("/datasets", "train-set", "complete"),
        ("/runs", "train", "loss"),
        ("/checkpoints", "train", "robomorph"),
        ("/evaluations", "evaluate", "robomorph 1.18°"),
    ] {
        let all = page(&server, path).await;
        assert!(all.contains(&format!("href=\".{path}\" aria-current=\"page\"")), "{all}");
        let (_, rows) = all.split_once("<tbody>").expect("a table");
        assert!(rows.contains(name), "{path}: {rows}");
        assert!(cell == "loss" || rows.contains(cell), "{path}: {rows}");
        let none = page(&server, &format!("{path}?text=no+such+name&tag=")).await;
        assert!(none.contains("Nothing matches the filter") && none.contains("no such name"));
        assert_eq!(server.get(&format!("{path}?cursor=7")).await.status, 400);
    }
    let some = page(&server, "/datasets?text=train").await;
    assert!(some.contains("train-set") && !some.contains("test-grid"), "{some}");

    let first = page(&server, "/datasets?limit=1&text=t").await;
    let (_, older) = first.split_once("rel=\"next\" href=\"").expect("a link to older datasets");
    let older = older.split('"').next().unwrap().replace("&#38;", "&");
    let older = followed("/datasets", &older);
    let second = page(&server, &older).await;
    assert!(first.contains("test-grid") != second.contains("test-grid"), "{first} {second}");
    assert!(older.contains("text=t") && second.contains("value=\"t\""), "{older}");
}

#[tokio::test]
async fn an_evaluation_and_its_checkpoint_show_the_predictions_that_were_drawn() {
    let server = Server::start().await;
    server.submitted(&small_pipeline()).await;
    let mut report = server.claim().await.unwrap();
    while !(report.kind == "evaluate" && report.stage == 1) {
        server.finish(&report).await;
        report = server.claim().await.unwrap();
    }
    let checkpoint = server.json("/v1/checkpoints/1").await;
    let scenario = |rank: &str, joint: u64| {
        json!({
            "rank": rank, "figure": format!("prediction-{rank}.svg"), "family": "multisine",
            "frequency_hz": 0.3, "trajectory": 17, "joint": joint, "rmse_deg": 2.5,
        })
    };
    let put = async |name: &'static str, text: String| {
        let artifact = NewArtifact { name, media_type: "text/plain", bytes: text.into() };
        server.store.put_artifact(report.fence, artifact).await.unwrap();
    };
    let put_list = async |weights: &Value| {
        let list = json!({
            "model": "robomorph",
            "predictors": [
                {
                    "name": "robomorph", "kind": "checkpoint", "digest": checkpoint["digest"],
                    "step": 100, "weights": weights,
                },
                {"name": "arx", "kind": "baseline"},
            ],
            "scenarios": [scenario("worst", 4), scenario("median", 2)],
        });
        put("predictions.json", list.to_string()).await;
    };
    put("prediction-worst.svg", "<svg/>".to_owned()).await;
    // Those of another training by the same spec.
    put_list(&checkpoint["digest"]).await;
    assert!(!page(&server, "/checkpoints/1").await.contains("prediction-median.svg"));
    put_list(&checkpoint["files"][0]["sha256"]).await;
    let path = format!("/evaluations/{}", report.job);
    assert!(!page(&server, &path).await.contains("<figure>"), "it has no report yet");
    server.finish(&report).await;
    let evaluation = page(&server, &path).await;
    for text in [
        "src=\"../v1/runs/2/artifacts/prediction-worst.svg\"",
        "Worst scenario: multisine 0.3 Hz, trajectory 17, joint 4. RMSE of robomorph over all joints: 2.50°",
        "href=\"../v1/runs/2/artifacts/prediction-median.csv\"",
    ] {
        assert!(evaluation.contains(text), "{text} is not in {evaluation}");
    }
    assert_eq!(evaluation.matches("prediction-worst.svg\" width").count(), 1, "{evaluation}");
    let shown = page(&server, "/checkpoints/1").await;
    assert!(shown.contains("prediction-median.svg") && shown.contains(&path), "{shown}");
}

/// Evaluations of earlier versions left no headline as their result.
#[tokio::test]
async fn a_list_reads_the_report_of_an_evaluation_without_a_headline() {
    let server = Server::start().await;
    server.submitted(&small_pipeline()).await;
    let mut last = server.claim().await.unwrap();
    while !(last.kind == "evaluate" && last.stage == 1) {
        server.finish(&last).await;
        last = server.claim().await.unwrap();
    }
    let bytes = report().to_string().into();
    let artifact = NewArtifact { name: "report.json", media_type: "application/json", bytes };
    server.store.put_artifact(last.fence, artifact).await.unwrap();
    server.store.complete(last.fence, None).await.unwrap();
    for path in ["/", "/evaluations"] {
        assert!(page(&server, path).await.contains("robomorph 1.18°"), "{path}");
    }
}

#[tokio::test]
async fn pages_of_evaluations_without_drawn_predictions_are_as_before() {
    let server = Server::with_small_pipeline().await;
    assert!(!page(&server, "/evaluations/4").await.contains("beside the truth"));
    assert!(!page(&server, "/checkpoints/1").await.contains("beside the truth"));
}

#[tokio::test]
async fn specifications_are_folded_away() {
    let server = Server::with_small_pipeline().await;
    for path in ["/jobs/1", "/datasets/1", "/runs/1", "/evaluations/4", "/checkpoints/1"] {
        let page = page(&server, path).await;
        let (_, folded) = page.split_once("<details id=\"specification\">").expect(path);
        assert!(folded.contains("<summary>Specification") && folded.contains("<pre>{"), "{path}");
    }
}

#[tokio::test]
async fn what_is_written_into_a_spec_cannot_become_markup() {
    let server = Server::start().await;
    let name = "<script>alert(1)</script>";
    let spec = json!({"kind": "pipeline", "name": name, "jobs": {"a": small_simulation(1)}});
    let id = server.submitted(&spec).await["id"].clone();
    for path in ["/".to_owned(), format!("/jobs/{id}")] {
        assert!(!page(&server, &path).await.contains("<script>alert"), "{path}");
    }
}

#[tokio::test]
async fn a_reader_is_told_in_html_what_is_wrong() {
    let server = Server::start().await;
    let browser = [("accept", "text/html,application/xhtml+xml")];
    for (path, status) in [("/jobs/7", 404), ("/jobs/x", 400), ("/runs/7", 404), ("/nothing", 404)]
    {
        let answer = server.request(Method::GET, path, &browser).await;
        assert_eq!(answer.status.as_u16(), status, "{path}");
        assert!(answer.header("content-type").starts_with("text/html"), "{path}");
    }
}

#[tokio::test]
async fn the_style_sheet_is_sent_once() {
    let server = Server::start().await;
    let first = server.get("/static/page.css").await;
    let tag = first.header("etag").to_owned();
    let again = server.request(Method::GET, "/static/page.css", &[("if-none-match", &tag)]).await;
    assert_eq!((again.status.as_u16(), again.body.len()), (304, 0));
}

#[tokio::test]
async fn the_api_is_shown_by_files_of_this_server_alone() {
    let server = Server::start().await;
    let answer = server.get("/docs").await;
    let policy = answer.header("content-security-policy");
    assert!(policy.contains("script-src 'self';") && policy.contains("style-src 'self';"));
    assert!(policy.contains("img-src 'self' data:;") && !policy.contains("unsafe"), "{policy}");
    let first = server.get("/").await;
    assert!(!first.header("content-security-policy").contains("data:"));
    assert!(first.text().contains("href=\"./docs\""));

    let page = page(&server, "/docs").await;
    assert!(!page.contains("http://") && !page.contains("https://"), "{page}");
    assert!(!page.contains("<style") && !page.contains(" style="), "{page}");
    let references = page.split(['"', '\'']).filter_map(|text| text.strip_prefix('.'));
    let references = references.filter(|text| text.starts_with('/'));
    let files: Vec<&str> = references
        .filter(|reference| reference.ends_with(".js") || reference.ends_with(".css"))
        .collect();
    assert!(files.contains(&"/docs/swagger-ui-bundle.js"), "{files:?}");
    for file in files {
        let answer = server.get(file).await;
        let media_type = if file.ends_with(".js") { "text/javascript" } else { "text/css" };
        assert_eq!(answer.header("content-type"), format!("{media_type}; charset=utf-8"));
        assert_eq!(answer.status, 200, "{file}");
        let tag = answer.header("etag").to_owned();
        let known = server.request(Method::GET, file, &[("if-none-match", &tag)]).await;
        assert_eq!(known.status, 304, "{file}");
    }
    for file in ["index.html", "swagger-initializer.js", "..%2f..%2fCargo.toml"] {
        server.get(&format!("/docs/{file}")).await.problem(404);
    }
}

#[tokio::test]
async fn a_dataset_has_the_same_state_in_the_list_and_on_its_page() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    assert!(page(&server, "/datasets/1").await.contains("<span class=\"badge queued\">queued<"));
    server.work().await;
    for path in ["/datasets", "/datasets/1"] {
        let page = page(&server, path).await;
        assert!(page.contains("<span class=\"badge succeeded\">complete<"), "{path}: {page}");
    }
}
