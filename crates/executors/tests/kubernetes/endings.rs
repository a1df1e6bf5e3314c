//! How workers end, and what it costs their tasks.

use serde_json::{Value, json};
use store::{AttemptOutcome, Page, Placed, PlacementState, TaskState};

use crate::lab::{Lab, look, terminated};

/// A Pod that failed with a condition that names the cause.
fn disrupted(reason: &str, message: &str) -> Value {
    json!({"phase": "Failed", "conditions": [{
        "type": "DisruptionTarget", "status": "True", "reason": reason, "message": message,
        "lastProbeTime": null, "lastTransitionTime": "2026-11-24T06:10:53Z",
    }], "containerStatuses": [terminated(143, "Error")]})
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
        let mut autoscaler = lab.autoscaler(1).await;
        let job = lab.submit(1).await;
        let (worker, task) = lab.working(&mut autoscaler).await;
        lab.server.set_pod(&worker, disrupted(reason, message));
        look(&mut autoscaler).await;
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
        let mut autoscaler = lab.autoscaler(1).await;
        lab.submit(1).await;
        let (worker, task) = lab.working(&mut autoscaler).await;
        lab.server.set_pod(&worker, status);
        look(&mut autoscaler).await;
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
    let mut autoscaler = lab.autoscaler(1).await;
    let job = lab.submit(1).await;
    let (worker, task) = lab.working(&mut autoscaler).await;
    // It gave its task back in time.
    lab.store.release(task.fence).await.unwrap();
    lab.server.delete_pod(&worker);
    lab.server.end_job(&worker, &interrupted);
    look(&mut autoscaler).await;
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
        let mut autoscaler = lab.autoscaler(1).await;
        lab.submit(1).await;
        let (worker, task) = lab.working(&mut autoscaler).await;
        lab.store.complete(task.fence, None).await.unwrap();
        lab.server.delete_pod(&worker);
        lab.server.end_job(&worker, &condition);
        look(&mut autoscaler).await;
        let Placed { state, reason, .. } = lab.placement(&worker).await;
        assert_eq!((state, reason.as_deref()), (PlacementState::Ended, Some(expected)));
    }
}
