//! A server that reads its settings from a file, and its JSON logs.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::product::{Product, run_to_end, small_pipeline, torqued};

fn write(folder: &Path, text: &str) -> String {
    let path = folder.join("torqued.toml");
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[tokio::test]
async fn a_file_configures_a_server_where_no_flag_or_variable_does() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let text = format!(
        "# A server of the lab.\ndata = {:?}\nlisten = \"127.0.0.1:0\"\nworkers = 0\nmax_trajectories = 7\n\
         [time_limit]\ntrain = 3600\n",
        data.to_str().unwrap()
    );
    let file = write(folder.path(), &text);
    let mut command = torqued(&["serve", "--max-trajectories", "9"]);
    let product = Product::spawn(
        command.env("TORQUED_CONFIG", &file).env("TORQUED_TIME_LIMITS", "train=7200"),
    );
    assert!(data.join("torqued.sqlite").exists());
    let mut spec = small_pipeline()["jobs"]["train-set"].clone();
    spec["trajectories"] = json!(10);
    let (_, refused) = product.post("/v1/jobs", spec.to_string()).await;
    assert!(refused.to_string().contains("at most 9,"), "the flag stands: {refused}");
    let mut training = small_pipeline()["jobs"]["train"].clone();
    training["data"] = json!({"stream": {"preset": "D1-multisine", "samples": 60}});
    let job = product.submit(&training).await;
    assert_eq!(product.get(&format!("/v1/jobs/{job}")).await["time_limit_s"], 7200);
    assert!(product.get("/v1/workers").await["workers"].as_array().unwrap().is_empty());
}

#[test]
fn a_file_that_is_wrong_is_refused_with_its_name_the_key_and_what_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    for (text, words) in [
        ("max_conections = 64", "max_conections is not a key; did you mean max_connections?"),
        ("max_connections = 2", "max_connections is 2: allowed: 16 to 100000"),
        ("workers = ", "line 1 is not valid TOML"),
    ] {
        let file = write(folder.path(), text);
        let (code, _, errors) = run_to_end(&mut torqued(&["serve", "--config", &file]));
        assert_eq!(code, Some(2), "{errors}");
        assert!(errors.starts_with(&format!("error: {file}: {words}")), "{errors}");
    }
    let (code, _, errors) = run_to_end(&mut torqued(&["serve", "--config", "/no/such.toml"]));
    assert!(code == Some(2) && errors.contains("cannot read /no/such.toml"), "{errors}");
}

#[tokio::test]
async fn json_logs_name_the_request_and_the_task_of_every_line() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1"]);
    command.args(["--log-format", "json", "--log", "info,tower_http=debug", "--data"]);
    command.arg(folder.path().join("data")).stderr(fs::File::create(&log).unwrap());
    let product = Product::spawn(&mut command);
    let job = product.submit(&small_pipeline()["jobs"]["test-grid"]).await;
    product.succeeded(job).await;
    let answer = reqwest::Client::builder().no_proxy().build().unwrap();
    let answer = answer.get(format!("{}/v1/jobs", product.url)).header("x-request-id", "ours-7");
    assert_eq!(answer.send().await.unwrap().headers()["x-request-id"], "ours-7");
    product.end_by("TERM");

    let text = fs::read_to_string(&log).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let with = |key: &str, value: &Value| lines.iter().filter(|line| line[key] == *value).count();
    assert!(with("request", &json!("ours-7")) > 0, "{text}");
    let simulated = lines.iter().find(|line| line["message"] == "simulated and published");
    let simulated = simulated.unwrap_or_else(|| panic!("{text}"));
    assert_eq!(simulated["job"], job);
    assert_eq!((&simulated["task"], &simulated["epoch"]), (&json!("shard 00000"), &json!(1)));
    assert!(simulated["trajectories"] == 60 && simulated["level"] == "info", "{simulated}");
}
