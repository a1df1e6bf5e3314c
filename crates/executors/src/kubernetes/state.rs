//! The state of a worker, read from its Job and its Pod.

use k8s_openapi::api::batch::v1::{Job, JobCondition};
use k8s_openapi::api::core::v1::{
    ContainerState, ContainerStateTerminated, ContainerStatus, Pod, PodCondition, PodStatus,
};

use super::job::{JOB_NAME, RESOURCES, STAYS};
use crate::local::GAVE_UP;
use crate::resources::read;
use crate::{Cause, End, Phase, PlacedWorker};

/// Exit codes above this mean that a signal ended the program.
const SIGNALS: i32 = 128;

/// The worker of a Job; `None` for a Job that torqued did not make.
pub fn worker(job: &Job, pods: &[Pod]) -> Option<PlacedWorker> {
    let name = job.metadata.name.clone()?;
    let annotations = job.metadata.annotations.as_ref()?;
    let pod = pods.iter().find(|pod| job_of(pod) == Some(&name));
    let node = pod.and_then(|pod| pod.spec.as_ref()?.node_name.clone());
    Some(PlacedWorker {
        identifier: pod.and_then(|pod| pod.metadata.name.clone()).unwrap_or_else(|| name.clone()),
        name,
        resources: read(annotations.get(RESOURCES)?)?,
        stays: annotations.get(STAYS).is_some_and(|stays| stays == "true"),
        node,
        phase: phase(job, pod),
    })
}

fn job_of(pod: &Pod) -> Option<&String> {
    pod.metadata.labels.as_ref()?.get(JOB_NAME)
}

/// The phase of a worker. The Pod knows more than the Job, but may be gone already.
fn phase(job: &Job, pod: Option<&Pod>) -> Phase {
    let end_of_pod = pod.and_then(end_of_pod);
    if let Some(end) = end_of_job(job) {
        return Phase::Ended(end_of_pod.unwrap_or(end));
    }
    let Some(pod) = pod else {
        return if job.metadata.deletion_timestamp.is_some() {
            Phase::Ending(None)
        } else {
            Phase::Pending(Some("it has no Pod yet".to_owned()))
        };
    };
    if let Some(end) = end_of_pod {
        return Phase::Ended(end);
    }
    let status = pod.status.as_ref();
    if pod.metadata.deletion_timestamp.is_some() {
        let interrupted = status.and_then(disruption).map(|condition| {
            format!("is interrupted by Kubernetes: {}", text_of_condition(condition))
        });
        return Phase::Ending(interrupted);
    }
    match status.and_then(|status| status.phase.as_deref()) {
        Some("Running") => Phase::Running,
        Some("Unknown") => Phase::Ending(Some("its node does not answer".to_owned())),
        _ => Phase::Pending(status.and_then(waits_for)),
    }
}

fn end_of_job(job: &Job) -> Option<End> {
    let conditions = job.status.as_ref()?.conditions.as_ref()?;
    let is = |kind: &str| {
        conditions.iter().find(|condition| condition.type_ == kind && condition.status == "True")
    };
    if is("Complete").is_some() {
        return Some(End { cause: Cause::Finished, how: "ended".to_owned() });
    }
    let failed: &JobCondition = is("Failed")?;
    let message = failed.message.clone().unwrap_or_default();
    let end = |cause, how: &str| Some(End { cause, how: how.to_owned() });
    match failed.reason.as_deref() {
        Some("PodFailurePolicy") => {
            end(Cause::Interrupted, &format!("was interrupted by Kubernetes: {message}"))
        }
        Some("DeadlineExceeded") => {
            end(Cause::Died, "did not end within the activeDeadlineSeconds of its Job")
        }
        _ => end(Cause::Died, &format!("died: {message}")),
    }
}

/// How a Pod ended; `None` while it lives.
fn end_of_pod(pod: &Pod) -> Option<End> {
    let status = pod.status.as_ref()?;
    let has_failed = match status.phase.as_deref()? {
        "Succeeded" => false,
        "Failed" => true,
        _ => return None,
    };
    let message = status.message.clone().unwrap_or_default();
    let end = |cause, how: String| Some(End { cause, how });
    match (status.reason.as_deref(), disruption(status)) {
        // A worker that takes more than it requested may do so because of its task.
        (Some("Evicted"), _) => end(Cause::Died, format!("was evicted: {}", message.trim())),
        (Some("NodeLost" | "NodeShutdown"), _) => end(Cause::Died, "lost its node".to_owned()),
        (_, Some(condition)) if is_lost_node(condition) => {
            end(Cause::Died, format!("lost its node: {}", text_of_condition(condition)))
        }
        // The worker may have given its task back and ended normally.
        (_, Some(condition)) => end(
            Cause::Interrupted,
            format!("was interrupted by Kubernetes: {}", text_of_condition(condition)),
        ),
        // Its attempt was ended before.
        (_, None) if has_failed && gave_up(status) => {
            end(Cause::Finished, "ended because its task did not".to_owned())
        }
        (_, None) if has_failed => end(Cause::Died, death(status)),
        (_, None) => end(Cause::Finished, "ended".to_owned()),
    }
}

/// The end of the worker's container: the first container that did not end normally.
fn failure(status: &PodStatus) -> Option<&ContainerStateTerminated> {
    let containers = status.container_statuses.iter().flatten();
    let mut ended =
        containers.filter_map(|container| container.state.as_ref()?.terminated.as_ref());
    ended.find(|state| state.exit_code != 0)
}

/// Whether the worker ended itself because its task did not end.
fn gave_up(status: &PodStatus) -> bool {
    failure(status).is_some_and(|state| state.exit_code == i32::from(GAVE_UP))
}

/// Why the worker's container died.
fn death(status: &PodStatus) -> String {
    let Some(death) = failure(status) else {
        let why = status.message.as_deref().or(status.reason.as_deref());
        return format!("died: {}", why.unwrap_or("Kubernetes gives no reason"));
    };
    if death.reason.as_deref() == Some("OOMKilled") {
        return "ran out of the memory that Kubernetes gave it (OOMKilled)".to_owned();
    }
    if death.exit_code > SIGNALS {
        return format!("died: signal {}", death.exit_code - SIGNALS);
    }
    format!("died: exit code {}", death.exit_code)
}

/// The condition that says why Kubernetes ended a healthy Pod.
fn disruption(status: &PodStatus) -> Option<&PodCondition> {
    let mut conditions = status.conditions.iter().flatten();
    conditions.find(|condition| condition.type_ == "DisruptionTarget" && condition.status == "True")
}

fn is_lost_node(condition: &PodCondition) -> bool {
    matches!(condition.reason.as_deref(), Some("DeletionByTaintManager" | "DeletionByPodGC"))
}

fn text_of_condition(condition: &PodCondition) -> String {
    match (&condition.reason, &condition.message) {
        (Some(reason), Some(message)) if !message.is_empty() => format!("{reason}, {message}"),
        (Some(reason), _) => reason.clone(),
        (None, message) => message.clone().unwrap_or_default(),
    }
}

/// Why a Pod does not run yet.
fn waits_for(status: &PodStatus) -> Option<String> {
    let unscheduled = status
        .conditions
        .iter()
        .flatten()
        .find(|condition| condition.type_ == "PodScheduled" && condition.status == "False");
    if let Some(condition) = unscheduled {
        return Some(text_of_condition(condition));
    }
    let containers =
        status.init_container_statuses.iter().chain(&status.container_statuses).flatten();
    containers.filter_map(waiting).next()
}

fn waiting(container: &ContainerStatus) -> Option<String> {
    let ContainerState { waiting, .. } = container.state.as_ref()?;
    let waiting = waiting.as_ref()?;
    let reason = waiting.reason.clone()?;
    Some(match &waiting.message {
        Some(message) => format!("{reason}: {message}"),
        None => reason,
    })
}
