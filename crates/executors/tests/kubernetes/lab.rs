//! A store, and an API server in this process from which workers for it are requested.

use std::time::Duration;

use executors::{Autoscaler, Bounds, Engine, Kubernetes, Settings, WorkerCommand};
use serde_json::{Value, json};
use spec::{Execution, Resources};
use store::{
    Access, ClaimedTask, JobId, JobReuse, Location, NewJob, NewTask, PartReuse, Placed, Store,
    Submission,
};

use crate::api_server::ApiServer;

pub const TEMPLATE: &str = "
apiVersion: batch/v1
kind: Job
metadata: {namespace: lab}
spec:
  template:
    spec:
      containers: [{name: worker, image: lab/torqued:1, args: [worker]}]
";

/// The least that a worker offers.
pub fn usual() -> Resources {
    Resources { cpus: Some(4), memory_gb: Some(8.0), ..Resources::default() }
}

/// A store, and an API server from which workers for it are requested.
pub struct Lab {
    pub store: Store,
    pub _folder: tempfile::TempDir,
    pub server: ApiServer,
    pub address: String,
}

impl Lab {
    pub async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let location = Location::in_folder(folder.path());
        Self::at(&location, folder).await
    }

    pub async fn at(location: &Location, folder: tempfile::TempDir) -> Self {
        let store = Store::open_at(location, Access::Server).await.unwrap();
        let (server, address) = ApiServer::start().await;
        Self { store, _folder: folder, server, address }
    }

    /// An autoscaler with short pauses.
    pub async fn autoscaler(&self, max: usize) -> Autoscaler {
        self.autoscaler_with(max, Duration::from_millis(1)).await
    }

    pub async fn autoscaler_with(&self, max: usize, look_every: Duration) -> Autoscaler {
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
        Autoscaler::new(self.store.clone(), engine, settings).await.unwrap()
    }

    /// Submits a job with this many tasks.
    pub async fn submit(&self, tasks: u32) -> JobId {
        self.submit_for(Resources::default(), tasks).await
    }

    /// Submits a job with this many tasks that each ask for `resources`.
    pub async fn submit_for(&self, resources: Resources, tasks: u32) -> JobId {
        let spec = json!({"kind": "count", "tasks": tasks});
        let task = |ordinal| NewTask {
            stage: 0,
            ordinal,
            label: format!("piece {ordinal}"),
            payload: Value::Null,
            total: 1,
        };
        let job = NewJob {
            execution: Execution { resources, ..Execution::default() },
            reuse: JobReuse { whole: false, parts: PartReuse::Nothing },
            tasks: (0..tasks).map(task).collect(),
            ..NewJob::new("count", spec)
        };
        self.store.submit(Submission::of(job)).await.unwrap().job
    }

    /// A requested worker that has the only task.
    pub async fn working(&self, autoscaler: &mut Autoscaler) -> (String, ClaimedTask) {
        look(autoscaler).await;
        let worker = self.server.jobs()[0].clone();
        let task =
            self.store.claim(&worker, &usual(), Duration::from_secs(3600)).await.unwrap().unwrap();
        self.server.set_pod(&worker, json!({"phase": "Running"}));
        look(autoscaler).await;
        (worker, task)
    }

    pub async fn placement(&self, worker: &str) -> Placed {
        let placements = self.store.placements().await.unwrap();
        placements.into_iter().find(|placement| placement.placed.worker == worker).unwrap().placed
    }

    pub async fn obstacle(&self) -> Option<String> {
        self.store.engine().await.unwrap().unwrap().obstacle
    }
}

/// Looks once, and waits until the next look is due.
pub async fn look(autoscaler: &mut Autoscaler) {
    let pause = autoscaler.look().await;
    tokio::time::sleep(pause).await;
}

/// The status of a container that has ended.
pub fn terminated(exit_code: i32, reason: &str) -> Value {
    json!({
        "name": "worker", "image": "lab/torqued:1", "imageID": "", "ready": false,
        "restartCount": 0, "started": false,
        "state": {"terminated": {
            "exitCode": exit_code, "reason": reason, "startedAt": "2026-11-24T06:10:53Z",
            "finishedAt": "2026-11-24T06:12:07Z", "containerID": "containerd://9f",
        }},
    })
}
