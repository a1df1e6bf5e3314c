//! The Job of a worker, made from the template.

use std::collections::BTreeMap;

use k8s_openapi::api::batch::v1::{
    Job, JobSpec, PodFailurePolicy, PodFailurePolicyOnPodConditionsPattern, PodFailurePolicyRule,
};
use k8s_openapi::api::core::v1::{Container, EnvVar};
use k8s_openapi::apimachinery::pkg::api::resource::Quantity;

use spec::Resources;

use super::template::container;
use crate::resources::written;
use crate::{Ask, SERVERS_TOKEN, WorkerCommand};

/// The label with the store that a Job or a Pod belongs to.
pub const STORE: &str = "torqued/store";

/// The annotation with the resources of a worker.
pub const RESOURCES: &str = "torqued/resources";

/// The annotation of a worker that keeps running when it finds no task.
pub const STAYS: &str = "torqued/stays";

/// The prefix of the labels of nodes that stand for tags.
const TAG: &str = "torqued/";

/// The label that Kubernetes gives the Pods of a Job.
pub const JOB_NAME: &str = "batch.kubernetes.io/job-name";

/// The resource that counts GPUs, unless the template names another one.
const GPU: &str = "nvidia.com/gpu";

/// How long a worker may take to give its task back. A checkpoint of a large model takes seconds.
const GRACE_SECONDS: i64 = 60;

/// How long a Job is shown after its end.
const SHOWN_SECONDS: i32 = 3600;

/// Makes the Job of a worker from the template.
pub fn of(template: &Job, store: &str, command: &WorkerCommand, ask: &Ask) -> Job {
    let mut job = template.clone();
    job.metadata.name = Some(ask.name.clone());
    job.metadata.generate_name = None;
    label(&mut job.metadata.labels, store);
    let annotations = job.metadata.annotations.get_or_insert_default();
    annotations.insert(RESOURCES.to_owned(), written(&ask.resources));
    annotations.insert(STAYS.to_owned(), ask.stays.to_string());

    let spec = job.spec.get_or_insert_default();
    once(spec);
    label(&mut spec.template.metadata.get_or_insert_default().labels, store);
    let pod = spec.template.spec.get_or_insert_default();
    pod.restart_policy = Some("Never".to_owned());
    pod.termination_grace_period_seconds.get_or_insert(GRACE_SECONDS);
    let tags = ask.resources.tags.iter();
    let selected = tags.map(|tag| (format!("{TAG}{tag}"), "true".to_owned()));
    pod.node_selector.get_or_insert_default().extend(selected);
    if let Some(container) = container(pod) {
        run(container, command, ask);
    }
    job
}

/// Runs a worker only once, because the server decides whether another is needed. A Pod that an
/// outside cause ended fails its Job with that reason, which outlives the Pod.
fn once(spec: &mut JobSpec) {
    spec.backoff_limit = Some(0);
    spec.completions = Some(1);
    spec.parallelism = Some(1);
    spec.ttl_seconds_after_finished.get_or_insert(SHOWN_SECONDS);
    let disrupted = PodFailurePolicyOnPodConditionsPattern {
        type_: "DisruptionTarget".to_owned(),
        status: "True".to_owned(),
    };
    let rule = PodFailurePolicyRule {
        action: "FailJob".to_owned(),
        on_pod_conditions: Some(vec![disrupted]),
        ..PodFailurePolicyRule::default()
    };
    spec.pod_failure_policy.get_or_insert(PodFailurePolicy { rules: vec![rule] });
}

fn label(labels: &mut Option<BTreeMap<String, String>>, store: &str) {
    labels.get_or_insert_default().insert(STORE.to_owned(), store.to_owned());
}

/// Adds the parts of a container that differ between workers. The template says what is run, and
/// with which database and objects.
fn run(container: &mut Container, command: &WorkerCommand, ask: &Ask) {
    let arguments = container.args.get_or_insert_with(|| vec!["worker".to_owned()]);
    arguments.extend(command.flags_of(ask));
    let variables = container.env.get_or_insert_default();
    for (name, value) in &command.environment {
        if !variables.iter().any(|variable| variable.name == *name) {
            let value = Some(value.clone());
            variables.push(EnvVar { name: name.clone(), value, value_from: None });
        }
    }
    // The template's Secret is often the server's, too. A variable hides that of a Secret.
    variables.retain(|variable| variable.name != SERVERS_TOKEN);
    let (name, value) = (SERVERS_TOKEN.to_owned(), Some(String::new()));
    variables.push(EnvVar { name, value, value_from: None });
    let resources = container.resources.get_or_insert_default();
    let Resources { cpus, gpus, .. } = &ask.resources;
    let megabytes = ask.resources.megabytes();
    let requests = resources.requests.get_or_insert_default();
    requests.insert("cpu".to_owned(), Quantity(cpus.unwrap_or(1).to_string()));
    let limits = resources.limits.get_or_insert_default();
    if megabytes > 0 {
        let memory = Quantity(format!("{megabytes}M"));
        requests.insert("memory".to_owned(), memory.clone());
        limits.insert("memory".to_owned(), memory);
    }
    if *gpus > 0 {
        // The template's limits may name the GPU resource of another maker.
        let gpu = limits.keys().find(|name| name.ends_with("/gpu")).cloned();
        limits.insert(gpu.unwrap_or_else(|| GPU.to_owned()), Quantity(gpus.to_string()));
    }
}

/// The template's Pod may hold anything. These tests check what a worker's Job always has.
#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::kubernetes::template;

    const TEMPLATE: &str = "
apiVersion: batch/v1
kind: Job
metadata: {name: ignored, namespace: lab}
spec:
  template:
    spec:
      containers:
        - name: worker
          image: lab/torqued:1
          args: [worker, --data, /data]
          resources: {limits: {amd.com/gpu: 0}}
        - {name: proxy, image: lab/proxy}
";

    fn command() -> WorkerCommand {
        WorkerCommand {
            program: "torqued".into(),
            store: Vec::new(),
            device: "cpu".to_owned(),
            gpu_device: "cuda".to_owned(),
            lease_seconds: 15,
            log: "info".to_owned(),
            idle_exit: Duration::from_secs(300),
            environment: vec![("MIMALLOC_PURGE_DELAY".to_owned(), "-1".to_owned())],
        }
    }

    #[test]
    fn a_job_is_the_template_with_what_is_the_workers_own() {
        let template = template::read(TEMPLATE).unwrap();
        let tags = ["fast".to_owned()].into();
        let resources = Resources { cpus: Some(4), gpus: 1, memory_gb: Some(8.0), tags };
        let ask = Ask { name: "torqued-ab-1".to_owned(), resources, stays: false };
        let job = serde_json::to_value(of(&template, "ab", &command(), &ask)).unwrap();
        assert_eq!(job["metadata"]["name"], "torqued-ab-1");
        assert_eq!(job["metadata"]["labels"][STORE], "ab");
        assert_eq!(job["metadata"]["annotations"][RESOURCES], written(&ask.resources));
        let spec = &job["spec"];
        assert_eq!((&spec["backoffLimit"], &spec["completions"]), (&0.into(), &1.into()));
        assert_eq!(spec["podFailurePolicy"]["rules"][0]["action"], "FailJob");
        let pod = &spec["template"]["spec"];
        assert_eq!(spec["template"]["metadata"]["labels"][STORE], "ab");
        assert_eq!(
            (&pod["restartPolicy"], &pod["terminationGracePeriodSeconds"]),
            (&"Never".into(), &60.into())
        );
        assert_eq!(pod["nodeSelector"]["torqued/fast"], "true");
        let worker = &pod["containers"][0];
        let arguments: Vec<&str> =
            worker["args"].as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
        assert_eq!(
            arguments.join(" "),
            "worker --data /data --name torqued-ab-1 --threads 4 --device cuda --lease-seconds 15 --log info \
             --gpus 1 --memory-gb 8 --tag fast --idle-exit 300"
        );
        let limits = serde_json::json!({"amd.com/gpu": "1", "memory": "8000M"});
        assert_eq!(worker["resources"]["limits"], limits);
        assert_eq!(
            worker["resources"]["requests"],
            serde_json::json!({"cpu": "4", "memory": "8000M"})
        );
        assert_eq!(worker["env"][0]["name"], "MIMALLOC_PURGE_DELAY");
        let no_token = serde_json::json!({"name": "TORQUED_TOKEN", "value": ""});
        assert_eq!(worker["env"][1], no_token);
        assert_eq!(pod["containers"][1]["args"], serde_json::Value::Null);
    }
}
