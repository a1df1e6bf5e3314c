//! Server-sent events, followed by the program.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::product::{Product, small_pipeline, torqued};

/// A running command that prints one document per line.
struct Follower {
    process: Child,
    output: BufReader<ChildStdout>,
}

impl Follower {
    fn start(arguments: &[&str]) -> Self {
        let mut command = torqued(arguments);
        let mut process = command.stdout(Stdio::piped()).spawn().unwrap();
        let output = BufReader::new(process.stdout.take().unwrap());
        Self { process, output }
    }

    fn next(&mut self) -> Value {
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line:?}"))
    }

    /// The rest of its output, and its exit code.
    fn rest(mut self) -> (Vec<Value>, Option<i32>) {
        let mut text = String::new();
        self.output.read_to_string(&mut text).unwrap();
        let lines = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        (lines, self.process.wait().unwrap().code())
    }
}

fn serve(data: &Path, address: &str, workers: &str) -> Product {
    let mut command = torqued(&["serve", "--listen", address, "--workers", workers, "--data"]);
    Product::spawn(command.arg(data))
}

#[tokio::test]
async fn watch_and_events_go_on_when_a_server_was_killed() {
    let data = tempfile::tempdir().unwrap();
    let product = serve(data.path(), "127.0.0.1:0", "0");
    let url = product.url.clone();
    let job = product.submit(&small_pipeline()["jobs"]["train-set"]).await.to_string();
    let mut watch = Follower::start(&["watch", &job, "--json", "--server", &url]);
    let mut events =
        Follower::start(&["events", "--job", &job, "--after", "0", "--json", "--server", &url]);
    assert_eq!(watch.next()["state"], "queued");
    let first = events.next();
    assert_eq!((&first["event"], &first["state"]), (&"job".into(), &"queued".into()));

    // During a pause no request is made.
    tokio::time::sleep(Duration::from_secs(2)).await;
    let metrics = String::from_utf8(product.download("/metrics").await).unwrap();
    let counted = metrics.lines().filter(|line| line.contains(r#"route="/v1/jobs/{id}""#));
    let asked: f64 = counted
        .filter(|line| line.starts_with("torqued_http_request_duration_seconds_count"))
        .map(|line| line.rsplit(' ').next().unwrap().parse::<f64>().unwrap())
        .sum();
    assert!((1.0..=2.0).contains(&asked), "{asked} questions:\n{metrics}");

    product.end_by("KILL");
    let _product = serve(data.path(), url.strip_prefix("http://").unwrap(), "1");
    let (lines, code) = watch.rest();
    assert_eq!((&lines.last().unwrap()["state"], code), (&"succeeded".into(), Some(0)));
    let (lines, code) = events.rest();
    assert_eq!(code, Some(0));
    let kept: Vec<&Value> =
        [&first].into_iter().chain(&lines).filter(|event| event["id"].is_i64()).collect();
    let ids: Vec<i64> = kept.iter().map(|event| event["id"].as_i64().unwrap()).collect();
    assert!(ids.is_sorted_by(|a, b| a < b), "each once: {ids:?}");
    assert!(lines.iter().all(|event| event["event"] != "gap"), "{lines:?}");
    let last = kept.last().unwrap();
    assert_eq!((&last["event"], &last["state"]), (&"job".into(), &"succeeded".into()));
    let end = lines.last().unwrap();
    assert_eq!((&end["event"], &end["state"]), (&"end".into(), &"succeeded".into()));
}
