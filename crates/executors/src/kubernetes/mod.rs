//! Kubernetes, through its API: a worker is a Job of one Pod.
//!
//! A template that the operator writes has the lab's own parts of a Job (image, volumes, secrets,
//! service account). Labels say which store a Job belongs to, and an annotation says what its
//! worker offers.

mod job;
mod state;
mod template;

use std::future::Future;
use std::time::Duration;

use k8s_openapi::api::batch::v1::Job;
use k8s_openapi::api::core::v1::Pod;
use kube::api::{Api, DeleteParams, ListParams, PostParams};
use kube::{Client, Config};

use crate::{Ask, EngineError, PlacedWorker, WorkerCommand};
pub use template::TemplateError;

/// Requests workers of one store from Kubernetes.
#[derive(Debug)]
pub struct Kubernetes {
    /// The store's identity.
    store: String,
    command: WorkerCommand,
    template: Job,
    jobs: Api<Job>,
    pods: Api<Pod>,
}

/// Time limit for an answer.
const LIMIT: Duration = Duration::from_secs(15);

impl Kubernetes {
    /// Finds the cluster as `kubectl` does or, in a Pod, by its service account. Workers run in the
    /// namespace that the template names; otherwise in that of the configuration or the service
    /// account.
    ///
    /// # Errors
    /// When there is no configuration.
    pub async fn connect(
        store: String,
        command: WorkerCommand,
        template: &str,
    ) -> Result<Self, TemplateError> {
        let config = Config::infer().await.map_err(TemplateError::NoCluster)?;
        Self::with_config(store, command, template, config)
    }

    /// Like [`Self::connect`], for a cluster with a given configuration.
    ///
    /// # Errors
    /// When the template or the configuration cannot be used.
    pub fn with_config(
        store: String,
        command: WorkerCommand,
        template: &str,
        mut config: Config,
    ) -> Result<Self, TemplateError> {
        let template = template::read(template)?;
        // The autoscaler tries again, with its own pauses.
        config.default_retry = false;
        let namespace = template.metadata.namespace.clone();
        let namespace = namespace.unwrap_or_else(|| config.default_namespace.clone());
        let client = Client::try_from(config).map_err(TemplateError::Client)?;
        let jobs = Api::namespaced(client.clone(), &namespace);
        let pods = Api::namespaced(client, &namespace);
        Ok(Self { store, command, template, jobs, pods })
    }

    pub(crate) async fn workers(&self) -> Result<Vec<PlacedWorker>, EngineError> {
        let ours = ListParams::default().labels(&format!("{}={}", job::STORE, self.store));
        let jobs = within_limit(self.jobs.list(&ours)).await?;
        let pods = within_limit(self.pods.list(&ours)).await?;
        Ok(jobs.items.iter().filter_map(|job| state::worker(job, &pods.items)).collect())
    }

    pub(crate) async fn ask(&self, ask: &Ask) -> Result<String, EngineError> {
        let job = job::of(&self.template, &self.store, &self.command, ask);
        match within_limit(self.jobs.create(&PostParams::default(), &job)).await {
            // An earlier request arrived, but its answer was lost.
            Ok(_) | Err(EngineError::Refused { code: 409, .. }) => Ok(ask.name.clone()),
            Err(error) => Err(error),
        }
    }

    /// Deletes the Job. Its Pod has a grace period to give its task back.
    pub(crate) async fn let_go(&self, name: &str) -> Result<(), EngineError> {
        match within_limit(self.jobs.delete(name, &DeleteParams::background())).await {
            Ok(_) | Err(EngineError::Refused { code: 404, .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }
}

async fn within_limit<T>(
    request: impl Future<Output = Result<T, kube::Error>>,
) -> Result<T, EngineError> {
    match tokio::time::timeout(LIMIT, request).await {
        Ok(Ok(answer)) => Ok(answer),
        Ok(Err(kube::Error::Api(status))) => {
            let message = match status.message.as_str() {
                "" => status.reason.clone(),
                message => message.to_owned(),
            };
            Err(match status.code {
                401 => EngineError::Unauthorized { message },
                403 => EngineError::Forbidden { message },
                code => EngineError::Refused { code, message },
            })
        }
        Ok(Err(error)) => Err(EngineError::Kubernetes(Box::new(error))),
        Err(_) => Err(EngineError::KubernetesSilent { limit: LIMIT }),
    }
}
