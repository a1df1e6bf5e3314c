//! Workers on Kubernetes, tested against an API server in this process. The states of Pods and Jobs
//! follow the documentation of Kubernetes 1.33; no real cluster was used.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod api_server;

use std::collections::BTreeSet;
use std::time::Duration;

use executors::{Bounds, Control, Engine, Kubernetes, Settings, WorkerCommand, prefix};
use serde_json::{Value, json};
use spec::{Digest, Resources};
use store::{
    Access, AttemptOutcome, ClaimedTask, JobId, JobReuse, Labels, Location, NewJob, NewTask,
    Output, Page, PartReuse, Placed, PlacementState, Reuse, Store, Submission, TaskState,
    WorkerProcess,
};

use api_server::{ApiServer, Fault};

const TEMPLATE: &str = "
apiVersion: batch/v1
kind: Job
metadata: {namespace: lab}
spec:
  template:
    spec:
      containers: [{name: worker, image: lab/torqued:1, args: [worker]}]
";

/// The least that a worker offers.
fn usual() -> Resources {
    Resources { cpus: Some(4), memory_gb: Some(8.0), ..Resources::default() }
}

/// A store, and an API server from which workers for it are requested.
struct Lab {
    store: Store,
    _folder: tempfile::TempDir,
    server: ApiServer,
    address: String,
}

impl Lab {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let location = Location::in_folder(folder.path());
        Self::at(&location, folder).await
    }

    async fn at(location: &Location, folder: tempfile::TempDir) -> Self {
        let store = Store::open_at(location, Access::Server).await.unwrap();
        let (server, address) = ApiServer::start().await;
        Self { store, _folder: folder, server, address }
    }

    /// A control loop with short pauses.
    async fn control(&self, max: usize) -> Control {
        self.control_with(max, Duration::from_millis(1)).await
    }

    async fn control_with(&self, max: usize, look_every: Duration) -> Control {
        let command = WorkerCommand {
            program: "torqued".into(),
            store: Vec::new(),
            device: "cpu".to_owned(),
            gpu_device: "cuda".to_owned(),
            lease_seconds: 15,
            log: "info".to_owned(),
            idle_exit: Duration::from_secs(300),
            environment: Vec::new(),
        };
        let mut config = kube::Config::new(self.address.parse().unwrap());
        config.read_timeout = Some(Duration::from_secs(1));
        let identity = self.store.identity().await.unwrap();
        let kubernetes = Kubernetes::with_config(identity, command, TEMPLATE, config).unwrap();
        let usual = usual();
        let bounds = Bounds { min: 0, max };
        let settings = Settings { bounds, usual, look_every, version: "1".to_owned() };
        let engine = Engine::Kubernetes(Box::new(kubernetes));
        Control::new(self.store.clone(), engine, settings).await.unwrap()
    }

    /// Submits a job with this many tasks.
    async fn submit(&self, tasks: u32) -> JobId {
        self.submit_for(Resources::default(), tasks).await
    }

    /// Submits a job with this many tasks that each ask for `resources`.
    async fn submit_for(&self, resources: Resources, tasks: u32) -> JobId {
        let spec = json!({"kind": "count", "tasks": tasks});
        let task = |ordinal| NewTask {
            stage: 0,
            ordinal,
            label: format!("piece {ordinal}"),
            payload: Value::Null,
            total: 1,
        };
        let job = NewJob {
            name: "count".to_owned(),
            kind: "count".to_owned(),
            digest: Digest::of_json(&spec),
            spec,
            unit: "pieces".to_owned(),
            priority: 0,
            max_attempts: 3,
            time_limit_s: None,
            resources,
            not_before: None,
            output: Output::Nothing,
            reuse: JobReuse { whole: false, parts: PartReuse::Nothing },
            tasks: (0..tasks).map(task).collect(),
            needs: Vec::new(),
            reads: Vec::new(),
            checkpoints: Vec::new(),
            files: Vec::new(),
        };
        let submission = Submission {
            jobs: vec![job],
            pipeline: None,
            reuse: Reuse::SameDigest,
            idempotency: None,
            labels: Labels::default(),
        };
        self.store.submit(submission).await.unwrap().job
    }

    /// A requested worker that has the only task.
    async fn working(&self, control: &mut Control) -> (String, ClaimedTask) {
        look(control).await;
        let worker = self.server.jobs()[0].clone();
        let task =
            self.store.claim(&worker, &usual(), Duration::from_secs(3600)).await.unwrap().unwrap();
        self.server.set_pod(&worker, json!({"phase": "Running"}));
        look(control).await;
        (worker, task)
    }

    async fn placement(&self, worker: &str) -> Placed {
        let placements = self.store.placements().await.unwrap();
        placements.into_iter().find(|placement| placement.placed.worker == worker).unwrap().placed
    }

    async fn obstacle(&self) -> Option<String> {
        self.store.engine().await.unwrap().unwrap().obstacle
    }
}

/// Looks once, and waits until the next look is due.
async fn look(control: &mut Control) {
    let pause = control.look().await;
    tokio::time::sleep(pause).await;
}

#[tokio::test]
async fn tasks_that_wait_get_workers_up_to_the_maximum_and_no_need_is_asked_for_twice() {
    let lab = Lab::new().await;
    let mut control = lab.control(2).await;
    look(&mut control).await;
    assert_eq!(lab.server.jobs(), [""; 0]);
    lab.submit(1).await;
    for _ in 0..3 {
        look(&mut control).await;
        assert_eq!(lab.server.jobs().len(), 1);
    }
    lab.submit(5).await;
    for _ in 0..3 {
        look(&mut control).await;
        assert_eq!(lab.server.jobs().len(), 2);
    }
    let ours = prefix(&lab.store.identity().await.unwrap());
    assert!(lab.server.jobs().iter().all(|name| name.starts_with(&ours)));
    assert_eq!(lab.obstacle().await, None);
}

#[tokio::test]
async fn a_request_whose_answer_is_lost_is_not_repeated() {
    let lab = Lab::new().await;
    let mut control = lab.control(9).await;
    lab.submit(1).await;
    lab.server.set_fault(Some(Fault::LosesAnswers));
    look(&mut control).await;
    assert!(lab.obstacle().await.unwrap().contains("Kubernetes refuses (504): Timeout"));
    lab.server.set_fault(None);
    for _ in 0..3 {
        look(&mut control).await;
        assert_eq!(lab.server.jobs().len(), 1);
    }
    assert_eq!(lab.obstacle().await, None);
}

#[tokio::test]
async fn a_control_that_begins_anew_finds_its_workers_and_no_others() {
    let lab = Lab::new().await;
    lab.submit(2).await;
    look(&mut lab.control(9).await).await;
    assert_eq!(lab.server.jobs().len(), 2);
    look(&mut lab.control(9).await).await;
    assert_eq!(lab.server.jobs().len(), 2);

    let other = Lab::new().await;
    let other = Lab { server: lab.server.clone(), address: lab.address.clone(), ..other };
    other.submit(1).await;
    look(&mut other.control(9).await).await;
    assert_eq!(lab.server.jobs().len(), 3);
}

#[tokio::test]
async fn a_paused_queue_asks_for_nobody() {
    let lab = Lab::new().await;
    let mut control = lab.control(9).await;
    lab.submit(1).await;
    lab.store.pause_queue().await.unwrap();
    look(&mut control).await;
    assert_eq!(lab.server.jobs(), [""; 0]);
    lab.store.resume_queue().await.unwrap();
    look(&mut control).await;
    assert_eq!(lab.server.jobs().len(), 1);
}

#[tokio::test]
async fn workers_beyond_a_lower_maximum_are_let_go() {
    let lab = Lab::new().await;
    lab.submit(3).await;
    look(&mut lab.control(3).await).await;
    let before = lab.server.jobs();
    assert_eq!(before.len(), 3);
    let mut control = lab.control(1).await;
    for _ in 0..3 {
        look(&mut control).await;
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
    let mut control = lab.control(9).await;
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
        look(&mut control).await;
        let obstacle = lab.obstacle().await.unwrap();
        assert!(obstacle.contains(expected), "{fault:?}: {obstacle}");
    }
    assert_eq!(lab.server.jobs(), [""; 0]);
    lab.server.set_fault(None);
    while lab.server.jobs().is_empty() {
        look(&mut control).await;
    }
    assert_eq!(lab.server.jobs().len(), 1);
    assert_eq!(lab.obstacle().await, None);
}

/// The program has only one crypto provider, so nobody has to choose.
#[tokio::test]
async fn a_cluster_behind_tls_is_asked_by_tls() {
    let lab = Lab::new().await;
    let lab = Lab { address: lab.address.replace("http://", "https://"), ..lab };
    let mut control = lab.control(1).await;
    look(&mut control).await;
    let obstacle = lab.obstacle().await.unwrap();
    assert!(
        obstacle.contains("no workers can be requested: the request to Kubernetes failed"),
        "{obstacle}"
    );
}

#[tokio::test]
async fn why_a_worker_waits_is_in_its_record() {
    let lab = Lab::new().await;
    let mut control = lab.control(1).await;
    lab.submit(1).await;
    look(&mut control).await;
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
        look(&mut control).await;
        let placed = lab.placement(&worker).await;
        assert_eq!(placed.state, PlacementState::Pending);
        assert_eq!(placed.reason.as_deref(), Some(expected));
    }
    lab.server.set_pod(&worker, json!({"phase": "Running"}));
    look(&mut control).await;
    let placed = lab.placement(&worker).await;
    assert_eq!((placed.state, placed.node.as_deref()), (PlacementState::Running, Some("node-3")));
    assert_eq!(placed.identifier, Some(format!("{worker}-x7k2p")));
}

/// A Pod that failed with a condition that names the cause.
fn disrupted(reason: &str, message: &str) -> Value {
    json!({"phase": "Failed", "conditions": [{
        "type": "DisruptionTarget", "status": "True", "reason": reason, "message": message,
        "lastProbeTime": null, "lastTransitionTime": "2026-11-24T06:10:53Z",
    }], "containerStatuses": [terminated(143, "Error")]})
}

fn terminated(exit_code: i32, reason: &str) -> Value {
    json!({
        "name": "worker", "image": "lab/torqued:1", "imageID": "", "ready": false,
        "restartCount": 0, "started": false,
        "state": {"terminated": {
            "exitCode": exit_code, "reason": reason, "startedAt": "2026-11-24T06:10:53Z",
            "finishedAt": "2026-11-24T06:12:07Z", "containerID": "containerd://9f",
        }},
    })
}

#[tokio::test]
async fn a_worker_that_kubernetes_interrupts_loses_no_attempt() {
    for (reason, message) in [
        (
            "PreemptionByScheduler",
            "default-scheduler: preempting to accommodate a higher priority pod",
        ),
        ("EvictionByEvictionAPI", "Eviction API: evicting"),
        ("TerminationByKubelet", "Pod was terminated in response to imminent node shutdown."),
    ] {
        let lab = Lab::new().await;
        let mut control = lab.control(1).await;
        let job = lab.submit(1).await;
        let (worker, task) = lab.working(&mut control).await;
        lab.server.set_pod(&worker, disrupted(reason, message));
        look(&mut control).await;
        let task = lab.store.task(task.fence.task).await.unwrap();
        assert_eq!(
            (task.state, task.attempt, task.error),
            (TaskState::Queued, 0, None),
            "{reason}"
        );
        let attempts = lab.store.attempts(job, Page::default()).await.unwrap();
        assert_eq!(attempts[0].outcome, Some(AttemptOutcome::Released));
        let expected =
            format!("worker {worker} was interrupted by Kubernetes: {reason}, {message}");
        assert_eq!(attempts[0].reason.as_ref(), Some(&expected));
        assert_eq!(lab.placement(&worker).await.state, PlacementState::Ended);
    }
}

#[tokio::test]
async fn a_worker_that_died_costs_an_attempt_and_the_reason_is_known() {
    let evicted = json!({
        "phase": "Failed", "reason": "Evicted",
        "message": "The node was low on resource: memory. Container worker was using 9Gi, request is 8000M. ",
    });
    let taint = "Taint manager: deleting due to NoExecute taint";
    for (status, expected) in [
        (
            json!({"phase": "Failed", "containerStatuses": [terminated(137, "OOMKilled")]}),
            "ran out of the memory that Kubernetes gave it (OOMKilled)",
        ),
        (
            json!({"phase": "Failed", "containerStatuses": [terminated(139, "Error")]}),
            "died: signal 11",
        ),
        (
            json!({"phase": "Failed", "containerStatuses": [terminated(1, "Error")]}),
            "died: exit code 1",
        ),
        (evicted, "was evicted: The node was low on resource: memory."),
        (disrupted("DeletionByTaintManager", taint), "lost its node: DeletionByTaintManager"),
        (json!({"phase": "Failed", "reason": "NodeLost"}), "lost its node"),
    ] {
        let lab = Lab::new().await;
        let mut control = lab.control(1).await;
        lab.submit(1).await;
        let (worker, task) = lab.working(&mut control).await;
        lab.server.set_pod(&worker, status);
        look(&mut control).await;
        let task = lab.store.task(task.fence.task).await.unwrap();
        assert_eq!((task.state, task.attempt), (TaskState::Queued, 1), "{expected}");
        let error = task.error.unwrap();
        assert!(error.contains(&format!("worker {worker} {expected}")), "{error}");
        assert!(error.ends_with("(attempt 1 of 3)"), "{error}");
        let reason = lab.placement(&worker).await.reason.unwrap();
        assert!(reason.starts_with(expected), "{reason}");
    }
}

#[tokio::test]
async fn a_job_says_how_a_worker_ended_whose_pod_is_gone() {
    let interrupted = json!({
        "type": "Failed", "status": "True", "reason": "PodFailurePolicy",
        "lastProbeTime": "2026-11-24T06:12:07Z", "lastTransitionTime": "2026-11-24T06:12:07Z",
        "message": "Pod lab/torqued-x7k2p has condition DisruptionTarget matching FailJob rule at index 0",
    });
    let lab = Lab::new().await;
    let mut control = lab.control(1).await;
    let job = lab.submit(1).await;
    let (worker, task) = lab.working(&mut control).await;
    // It gave its task back in time.
    lab.store.release(task.fence).await.unwrap();
    lab.server.delete_pod(&worker);
    lab.server.end_job(&worker, &interrupted);
    look(&mut control).await;
    let attempts = lab.store.attempts(job, Page::default()).await.unwrap();
    let reason = attempts[0].reason.as_deref().unwrap();
    assert!(reason.contains("was interrupted by Kubernetes: Pod lab/"), "{reason}");

    for (condition, expected) in [
        (json!({"type": "Complete", "status": "True"}), "ended"),
        (
            json!({"type": "Failed", "status": "True", "reason": "DeadlineExceeded"}),
            "did not end within the activeDeadlineSeconds of its Job",
        ),
        (
            json!({"type": "Failed", "status": "True", "reason": "BackoffLimitExceeded", "message": "Job has reached the specified backoff limit"}),
            "died: Job has reached the specified backoff limit",
        ),
    ] {
        let lab = Lab::new().await;
        let mut control = lab.control(1).await;
        lab.submit(1).await;
        let (worker, task) = lab.working(&mut control).await;
        lab.store.complete(task.fence, None).await.unwrap();
        lab.server.delete_pod(&worker);
        lab.server.end_job(&worker, &condition);
        look(&mut control).await;
        let Placed { state, reason, .. } = lab.placement(&worker).await;
        assert_eq!((state, reason.as_deref()), (PlacementState::Ended, Some(expected)));
    }
}

#[tokio::test]
async fn a_job_that_somebody_deletes_is_recorded_as_gone_and_left_to_its_lease() {
    let lab = Lab::new().await;
    let mut control = lab.control(1).await;
    lab.submit(1).await;
    let (worker, task) = lab.working(&mut control).await;
    let http = kube::Client::try_from(kube::Config::new(lab.address.parse().unwrap())).unwrap();
    let jobs: kube::Api<k8s_openapi::api::batch::v1::Job> = kube::Api::namespaced(http, "lab");
    jobs.delete(&worker, &kube::api::DeleteParams::default()).await.unwrap();
    look(&mut control).await;
    let Placed { state, reason, .. } = lab.placement(&worker).await;
    assert_eq!(state, PlacementState::Ended);
    assert_eq!(reason.as_deref(), Some("is gone, and Kubernetes does not say why"));
    assert_eq!(lab.store.task(task.fence.task).await.unwrap().state, TaskState::Running);
}

#[tokio::test]
async fn workers_that_die_before_they_begin_are_told_and_not_asked_for_again_at_once() {
    let lab = Lab::new().await;
    let mut control = lab.control_with(1, Duration::from_secs(3600)).await;
    lab.submit(1).await;
    control.look().await;
    let worker = lab.server.jobs()[0].clone();
    lab.server.set_pod(
        &worker,
        json!({"phase": "Failed", "containerStatuses": [terminated(127, "StartError")]}),
    );
    for _ in 0..3 {
        control.look().await;
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
    look(&mut lab.control(2).await).await;
    look(&mut lab.control(1).await).await;
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
    let mut control = lab.control_with(1, Duration::from_secs(3600)).await;
    lab.submit_for(Resources { gpus: 8, ..Resources::default() }, 3).await;
    lab.server.set_fault(Some(Fault::RefusesJobs(403, "exceeded quota: gpus")));
    control.look().await;
    assert!(lab.obstacle().await.unwrap().contains("exceeded quota: gpus"));
    lab.server.set_fault(None);
    lab.submit(1).await;
    control.look().await;
    assert_eq!(lab.server.jobs().len(), 1);
    let job = lab.server.job(&lab.server.jobs()[0]);
    let offer = &job["metadata"]["annotations"]["torqued/resources"];
    assert_eq!(offer, "cpus=4;gpus=0;memory_mb=8000;tags=");
    assert!(lab.obstacle().await.unwrap().contains("exceeded quota: gpus"));
}

#[tokio::test]
async fn a_worker_that_is_drained_is_replaced_once_it_has_no_task() {
    let lab = Lab::new().await;
    let mut control = lab.control(1).await;
    lab.submit(2).await;
    let (worker, task) = lab.working(&mut control).await;
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
    look(&mut control).await;
    assert_eq!(lab.server.jobs(), std::slice::from_ref(&worker), "it ends its task first");
    lab.store.complete(task.fence, None).await.unwrap();
    for _ in 0..3 {
        look(&mut control).await;
    }
    let jobs = lab.server.jobs();
    assert!(jobs.len() == 1 && jobs[0] != worker, "{jobs:?}");
    let reason = lab.placement(&worker).await.reason;
    assert_eq!(reason.as_deref(), Some("was let go: it is drained"));
}

mod postgres {
    use testbed::Cluster;
    use tokio_util::sync::CancellationToken;

    use super::*;

    /// Waits until the cluster of a lab has received a request.
    async fn is_asked(lab: &Lab) {
        while lab.server.asked().is_empty() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    /// Each server has a cluster of its own, so the test sees which one requests workers.
    #[tokio::test]
    async fn of_two_servers_one_asks_for_workers_and_the_other_does_when_it_ends() {
        let database = Cluster::shared().database();
        let server = async || {
            let folder = tempfile::tempdir().unwrap();
            let location = Location {
                database: Some(database.url().parse().unwrap()),
                ..Location::in_folder(folder.path())
            };
            Lab::at(&location, folder).await
        };
        let (first, second) = (server().await, server().await);
        let stop = CancellationToken::new();
        let look_every = Duration::from_millis(20);
        let asking = tokio::spawn(first.control_with(1, look_every).await.run(stop.clone()));
        is_asked(&first).await;
        let waiting = second.control_with(1, look_every).await;
        let waiting = tokio::spawn(waiting.run(CancellationToken::new()));
        tokio::time::sleep(20 * look_every).await;
        assert_eq!(second.server.asked(), BTreeSet::new());
        stop.cancel();
        asking.await.unwrap();
        is_asked(&second).await;
        waiting.abort();
        let _ = waiting.await;
        first.store.close().await;
        second.store.close().await;
    }
}
