//! Metrics and readiness, in the view of a monitoring system.

use api::Options;
use spec::Resources;
use store::WorkerProcess;

use crate::fixture::{Server, small_simulation};
use crate::resources::worker;

/// The value of a line with this name and these labels, in any order.
fn value(metrics: &str, name: &str, labels: &[&str]) -> Option<f64> {
    let line = metrics.lines().find(|line| {
        let rest = line.strip_prefix(name);
        rest.is_some_and(|rest| rest.starts_with(['{', ' ']))
            && labels.iter().all(|label| line.contains(label))
    })?;
    line.rsplit(' ').next()?.parse().ok()
}

#[tokio::test]
async fn jobs_tasks_attempts_and_requests_are_counted() {
    let server = Server::with_small_pipeline().await;
    server.submitted(&small_simulation(7)).await;
    server.get("/v1/jobs/1").await;
    server.get("/v1/jobs/2").await;
    server.get("/v1/jobs/999").await;
    server.get("/nowhere").await;
    let answer = server.get("/metrics").await;
    assert_eq!(answer.status, 200);
    assert!(answer.header("content-type").starts_with("application/openmetrics-text"));
    let metrics = answer.text();
    assert!(metrics.ends_with("# EOF\n"), "{metrics}");
    let counted = |name: &str, labels: &[&str]| value(metrics, name, labels);
    assert_eq!(counted("torqued_jobs", &["kind=\"train\"", "state=\"succeeded\""]), Some(1.0));
    let queued = ["kind=\"simulate\"", "state=\"queued\""];
    assert_eq!(counted("torqued_jobs", &queued), Some(1.0));
    assert!(counted("torqued_tasks", &queued) > Some(0.0), "{metrics}");
    let succeeded = ["kind=\"evaluate\"", "outcome=\"succeeded\""];
    assert!(counted("torqued_attempts_total", &succeeded) > Some(0.0), "{metrics}");
    assert!(counted("torqued_queue_queued_tasks", &[]) > Some(0.0), "{metrics}");
    assert_eq!(counted("torqued_queue_paused", &[]), Some(0.0));
    assert_eq!(counted("torqued_workers", &["state=\"busy\""]), Some(0.0));
    assert!(counted("torqued_disk_free_bytes", &[]) > Some(0.0), "{metrics}");
    let requests = "torqued_http_request_duration_seconds_count";
    let job = "route=\"/v1/jobs/{id}\"";
    assert_eq!(counted(requests, &[job, "method=\"GET\"", "status=\"200\""]), Some(2.0));
    assert_eq!(counted(requests, &[job, "status=\"404\""]), Some(1.0));
    assert_eq!(counted(requests, &["route=\"none\"", "status=\"404\""]), Some(1.0));
}

#[tokio::test]
async fn resources_in_use_are_those_of_workers_with_a_task() {
    let server = Server::start().await;
    let idle = worker();
    let offers =
        Resources { cpus: Some(8), gpus: 2, memory_gb: Some(32.5), ..Resources::default() };
    let busy = WorkerProcess { name: "test-worker".to_owned(), offers, ..worker() };
    for process in [&idle, &busy] {
        server.store.register_worker(process).await.unwrap();
    }
    let amounts = async |names: [&str; 3]| {
        let answer = server.get("/metrics").await;
        names.map(|name| value(answer.text(), &format!("torqued_worker_{name}"), &[]).unwrap())
    };
    let [offered, in_use] =
        [["cpus", "gpus", "memory_bytes"], ["cpus_in_use", "gpus_in_use", "memory_in_use_bytes"]];
    assert_eq!(amounts(offered).await, [10.0, 3.0, 32.5e9]);
    assert_eq!(amounts(in_use).await, [0.0; 3]);
    server.submitted(&small_simulation(1)).await;
    server.claim().await.unwrap();
    assert_eq!(amounts(offered).await, [10.0, 3.0, 32.5e9]);
    assert_eq!(amounts(in_use).await, [8.0, 2.0, 32.5e9]);
}

#[tokio::test]
async fn metrics_need_the_token_and_readiness_does_not() {
    let options = Options { token: Some("secret".to_owned()), ..Options::default() };
    let server = Server::start_with(&options).await;
    server.get("/metrics").await.problem(401);
    assert_eq!(server.get("/readyz").await.json()["status"], "ready");
}

#[tokio::test]
async fn a_server_that_is_about_to_end_answers_and_says_so() {
    let mut app = None;
    let server = Server::start_app(&Options::default(), |started| {
        app = Some(started.clone());
        started
    })
    .await;
    assert_eq!(server.get("/readyz").await.status, 200);
    app.unwrap().announce_end();
    let problem = server.get("/readyz").await.problem(503);
    assert_eq!(problem["detail"], "this server is about to stop");
    assert_eq!(server.get("/healthz").await.status, 200);
    assert_eq!(server.get("/v1/jobs").await.status, 200);
}
