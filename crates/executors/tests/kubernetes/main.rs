//! Workers on Kubernetes, tested against an API server in this process. The states of Pods and Jobs
//! follow the documentation of Kubernetes 1.33; no real cluster was used.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod api_server;
mod endings;
mod lab;
mod servers;

use std::collections::BTreeSet;
use std::time::Duration;

use executors::prefix;
use serde_json::json;
use spec::Resources;
use store::{Placed, PlacementState, TaskState, WorkerProcess};

use api_server::Fault;
use lab::{Lab, look, terminated, usual};

#[tokio::test]
async fn tasks_that_wait_get_workers_up_to_the_maximum_and_no_need_is_asked_for_twice() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler(2).await;
    look(&mut autoscaler).await;
    assert_eq!(lab.server.jobs(), [""; 0]);
    lab.submit(1).await;
    for _ in 0..3 {
        look(&mut autoscaler).await;
        assert_eq!(lab.server.jobs().len(), 1);
    }
    lab.submit(5).await;
    for _ in 0..3 {
        look(&mut autoscaler).await;
        assert_eq!(lab.server.jobs().len(), 2);
    }
    let ours = prefix(&lab.store.identity().await.unwrap());
    assert!(lab.server.jobs().iter().all(|name| name.starts_with(&ours)));
    assert_eq!(lab.obstacle().await, None);
}

#[tokio::test]
async fn a_request_whose_answer_is_lost_is_not_repeated() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler(9).await;
    lab.submit(1).await;
    lab.server.set_fault(Some(Fault::LosesAnswers));
    look(&mut autoscaler).await;
    assert!(lab.obstacle().await.unwrap().contains("Kubernetes refuses (504): Timeout"));
    lab.server.set_fault(None);
    for _ in 0..3 {
        look(&mut autoscaler).await;
        assert_eq!(lab.server.jobs().len(), 1);
    }
    assert_eq!(lab.obstacle().await, None);
}

#[tokio::test]
async fn a_control_that_begins_anew_finds_its_workers_and_no_others() {
    let lab = Lab::new().await;
    lab.submit(2).await;
    look(&mut lab.autoscaler(9).await).await;
    assert_eq!(lab.server.jobs().len(), 2);
    look(&mut lab.autoscaler(9).await).await;
    assert_eq!(lab.server.jobs().len(), 2);

    let other = Lab::new().await;
    let other = Lab { server: lab.server.clone(), address: lab.address.clone(), ..other };
    other.submit(1).await;
    look(&mut other.autoscaler(9).await).await;
    assert_eq!(lab.server.jobs().len(), 3);
}

#[tokio::test]
async fn a_paused_queue_asks_for_nobody() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler(9).await;
    lab.submit(1).await;
    lab.store.pause_queue().await.unwrap();
    look(&mut autoscaler).await;
    assert_eq!(lab.server.jobs(), [""; 0]);
    lab.store.resume_queue().await.unwrap();
    look(&mut autoscaler).await;
    assert_eq!(lab.server.jobs().len(), 1);
}

#[tokio::test]
async fn workers_beyond_a_lower_maximum_are_let_go() {
    let lab = Lab::new().await;
    lab.submit(3).await;
    look(&mut lab.autoscaler(3).await).await;
    let before = lab.server.jobs();
    assert_eq!(before.len(), 3);
    let mut autoscaler = lab.autoscaler(1).await;
    for _ in 0..3 {
        look(&mut autoscaler).await;
    }
    let after = lab.server.jobs();
    assert_eq!(after.len(), 1);
    let gone = before.iter().find(|name| !after.contains(name)).unwrap();
    let Placed { state, reason, .. } = lab.placement(gone).await;
    assert_eq!(state, PlacementState::Ended);
    assert_eq!(reason.as_deref(), Some("was let go: there are more workers than allowed"));
}

#[tokio::test]
async fn an_engine_that_refuses_or_is_away_is_told_and_waited_for() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler(9).await;
    lab.submit(1).await;
    let forbidden = "jobs.batch is forbidden: User \"system:serviceaccount:lab:torqued\" cannot create resource \"jobs\"";
    for (fault, expected) in [
        (Fault::Refuses(401, "Unauthorized"), "does not accept the credentials (401)"),
        (
            Fault::Refuses(403, forbidden),
            "does not allow the request (403): jobs.batch is forbidden",
        ),
        (Fault::Refuses(429, "too many requests"), "refuses (429): too many requests"),
        (Fault::Refuses(500, "etcdserver: leader changed"), "refuses (500): etcdserver"),
        (Fault::Hangs, "no workers can be requested: the request to Kubernetes failed"),
        (
            Fault::RefusesJobs(403, "exceeded quota: compute"),
            "no more workers can be requested: Kubernetes does not allow",
        ),
    ] {
        lab.server.set_fault(Some(fault));
        look(&mut autoscaler).await;
        let obstacle = lab.obstacle().await.unwrap();
        assert!(obstacle.contains(expected), "{fault:?}: {obstacle}");
    }
    assert_eq!(lab.server.jobs(), [""; 0]);
    lab.server.set_fault(None);
    while lab.server.jobs().is_empty() {
        look(&mut autoscaler).await;
    }
    assert_eq!(lab.server.jobs().len(), 1);
    assert_eq!(lab.obstacle().await, None);
}

/// The program has only one crypto provider, so nobody has to choose.
#[tokio::test]
async fn a_cluster_behind_tls_is_asked_by_tls() {
    let lab = Lab::new().await;
    let lab = Lab { address: lab.address.replace("http://", "https://"), ..lab };
    let mut autoscaler = lab.autoscaler(1).await;
    look(&mut autoscaler).await;
    let obstacle = lab.obstacle().await.unwrap();
    assert!(
        obstacle.contains("no workers can be requested: the request to Kubernetes failed"),
        "{obstacle}"
    );
}

#[tokio::test]
async fn why_a_worker_waits_is_in_its_record() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler(1).await;
    lab.submit(1).await;
    look(&mut autoscaler).await;
    let worker = lab.server.jobs()[0].clone();
    for (status, expected) in [
        (
            json!({"phase": "Pending", "conditions": [{
                "type": "PodScheduled", "status": "False", "reason": "Unschedulable",
                "lastProbeTime": null, "lastTransitionTime": "2026-11-24T06:10:53Z",
                "message": "0/3 nodes are available: 3 Insufficient memory.",
            }]}),
            "Unschedulable, 0/3 nodes are available: 3 Insufficient memory.",
        ),
        (
            json!({"phase": "Pending", "containerStatuses": [{
                "name": "worker", "image": "lab/torqued:1", "imageID": "", "ready": false,
                "restartCount": 0, "started": false,
                "state": {"waiting": {
                    "reason": "ImagePullBackOff",
                    "message": "Back-off pulling image \"lab/torqued:1\"",
                }},
            }]}),
            "ImagePullBackOff: Back-off pulling image \"lab/torqued:1\"",
        ),
    ] {
        lab.server.set_pod(&worker, status);
        look(&mut autoscaler).await;
        let placed = lab.placement(&worker).await;
        assert_eq!(placed.state, PlacementState::Pending);
        assert_eq!(placed.reason.as_deref(), Some(expected));
    }
    lab.server.set_pod(&worker, json!({"phase": "Running"}));
    look(&mut autoscaler).await;
    let placed = lab.placement(&worker).await;
    assert_eq!((placed.state, placed.node.as_deref()), (PlacementState::Running, Some("node-3")));
    assert_eq!(placed.identifier, Some(format!("{worker}-x7k2p")));
}

#[tokio::test]
async fn a_job_that_somebody_deletes_is_recorded_as_gone_and_left_to_its_lease() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler(1).await;
    lab.submit(1).await;
    let (worker, task) = lab.working(&mut autoscaler).await;
    let http = kube::Client::try_from(kube::Config::new(lab.address.parse().unwrap())).unwrap();
    let jobs: kube::Api<k8s_openapi::api::batch::v1::Job> = kube::Api::namespaced(http, "lab");
    jobs.delete(&worker, &kube::api::DeleteParams::default()).await.unwrap();
    look(&mut autoscaler).await;
    let Placed { state, reason, .. } = lab.placement(&worker).await;
    assert_eq!(state, PlacementState::Ended);
    assert_eq!(reason.as_deref(), Some("is gone, and Kubernetes does not say why"));
    assert_eq!(lab.store.task(task.fence.task).await.unwrap().state, TaskState::Running);
}

#[tokio::test]
async fn workers_that_die_before_they_begin_are_told_and_not_asked_for_again_at_once() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler_with(1, Duration::from_secs(3600)).await;
    lab.submit(1).await;
    autoscaler.look().await;
    let worker = lab.server.jobs()[0].clone();
    lab.server.set_pod(
        &worker,
        json!({"phase": "Failed", "containerStatuses": [terminated(127, "StartError")]}),
    );
    for _ in 0..3 {
        autoscaler.look().await;
    }
    assert_eq!(lab.server.jobs().len(), 1);
    let obstacle = lab.obstacle().await.unwrap();
    let expected =
        format!("workers of Kubernetes end before they begin: {worker} died: exit code 127");
    assert_eq!(obstacle, expected);
}

#[tokio::test]
async fn no_more_is_asked_of_kubernetes_than_the_role_allows() {
    let lab = Lab::new().await;
    lab.submit(2).await;
    look(&mut lab.autoscaler(2).await).await;
    look(&mut lab.autoscaler(1).await).await;
    let pair = |verb: &str, resource: &str| (verb.to_owned(), resource.to_owned());
    let expected = [
        pair("create", "jobs"),
        pair("delete", "jobs"),
        pair("list", "jobs"),
        pair("list", "pods"),
    ];
    assert_eq!(lab.server.asked(), BTreeSet::from(expected));
}

#[tokio::test]
async fn a_need_that_kubernetes_refuses_holds_up_no_other() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler_with(1, Duration::from_secs(3600)).await;
    lab.submit_for(Resources { gpus: 8, ..Resources::default() }, 3).await;
    lab.server.set_fault(Some(Fault::RefusesJobs(403, "exceeded quota: gpus")));
    autoscaler.look().await;
    assert!(lab.obstacle().await.unwrap().contains("exceeded quota: gpus"));
    lab.server.set_fault(None);
    lab.submit(1).await;
    autoscaler.look().await;
    assert_eq!(lab.server.jobs().len(), 1);
    let job = lab.server.job(&lab.server.jobs()[0]);
    let offer = &job["metadata"]["annotations"]["torqued/resources"];
    assert_eq!(offer, "cpus=4;gpus=0;memory_mb=8000;tags=");
    assert!(lab.obstacle().await.unwrap().contains("exceeded quota: gpus"));
}

#[tokio::test]
async fn a_worker_that_is_drained_is_replaced_once_it_has_no_task() {
    let lab = Lab::new().await;
    let mut autoscaler = lab.autoscaler(1).await;
    lab.submit(2).await;
    let (worker, task) = lab.working(&mut autoscaler).await;
    let process = WorkerProcess {
        name: worker.clone(),
        host: "node-3".to_owned(),
        pid: 1,
        version: "1".to_owned(),
        device: "cpu".to_owned(),
        threads: 4,
        offers: usual(),
    };
    lab.store.register_worker(&process).await.unwrap();
    lab.store.drain_worker(&worker).await.unwrap();
    look(&mut autoscaler).await;
    assert_eq!(lab.server.jobs(), std::slice::from_ref(&worker), "it ends its task first");
    lab.store.complete(task.fence, None).await.unwrap();
    for _ in 0..3 {
        look(&mut autoscaler).await;
    }
    let jobs = lab.server.jobs();
    assert!(jobs.len() == 1 && jobs[0] != worker, "{jobs:?}");
    let reason = lab.placement(&worker).await.reason;
    assert_eq!(reason.as_deref(), Some("was let go: it is drained"));
}
