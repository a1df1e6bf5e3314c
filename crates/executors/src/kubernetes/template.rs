//! The operator's Job template, from which the workers' Jobs are made.

use k8s_openapi::api::batch::v1::Job;
use k8s_openapi::api::core::v1::{Container, PodSpec};

/// Why a template cannot be used.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "messages say what the variants mean")]
pub enum TemplateError {
    #[error("it is not a Job of batch/v1")]
    Unreadable(#[source] serde_saphyr::Error),
    #[error("it is not a Job of batch/v1, but {0}")]
    AnotherKind(String),
    #[error(
        "spec.template.spec.containers must have one container named `worker`, or only one \
         container"
    )]
    NoContainer,
    #[error(
        "no cluster is configured here: there is no kubeconfig and no service account of a Pod"
    )]
    NoCluster(#[source] kube::config::InferConfigError),
    #[error("the cluster's configuration cannot be used")]
    Client(#[source] kube::Error),
}

/// The name of the worker's container if there are several containers.
const WORKER: &str = "worker";

/// The Job of a template, in YAML.
///
/// # Errors
/// When the text is not one Job with a container for the worker.
pub fn read(yaml: &str) -> Result<Job, TemplateError> {
    let kind: serde_json::Value =
        serde_saphyr::from_str(yaml).map_err(TemplateError::Unreadable)?;
    let (version, name) = (&kind["apiVersion"], &kind["kind"]);
    if (version.as_str(), name.as_str()) != (Some("batch/v1"), Some("Job")) {
        return Err(TemplateError::AnotherKind(format!("{name} of {version}")));
    }
    let mut job: Job = serde_saphyr::from_str(yaml).map_err(TemplateError::Unreadable)?;
    let pod = job.spec.as_mut().and_then(|spec| spec.template.spec.as_mut());
    pod.and_then(container).ok_or(TemplateError::NoContainer)?;
    Ok(job)
}

/// The container of the worker.
pub fn container(pod: &mut PodSpec) -> Option<&mut Container> {
    match pod.containers.as_mut_slice() {
        [alone] => Some(alone),
        several => several.iter_mut().find(|container| container.name == WORKER),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_template_that_is_no_job_is_refused_by_saying_what_it_is() {
        let said = |yaml: &str| read(yaml).unwrap_err().to_string();
        assert!(said("kind: Pod\napiVersion: v1\n").contains("\"Pod\" of \"v1\""));
        assert!(said("apiVersion: batch/v1\nkind: Job\n").contains("containers"));
        assert!(said(": [").contains("not a Job"));
    }
}
