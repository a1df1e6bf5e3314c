//! The part of Kubernetes' API that workers need, in this process. It keeps Jobs, gives each a
//! waiting Pod, and answers as Kubernetes does or as a test tells it to.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use axum::extract::{Path, Query, Request, State};
use axum::http::StatusCode;
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{delete, get};
use axum::{Json, Router};
use serde_json::{Value, json};

#[derive(Clone, Default)]
pub struct ApiServer {
    world: Arc<Mutex<World>>,
}

#[derive(Default)]
struct World {
    jobs: Vec<Value>,
    pods: Vec<Value>,
    fault: Option<Fault>,
    /// Verb and resource of every request.
    asked: BTreeSet<(String, String)>,
}

/// A fault of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Every request is refused.
    Refuses(u16, &'static str),
    /// New Jobs are refused.
    RefusesJobs(u16, &'static str),
    /// New Jobs are made, but the answers are lost.
    LosesAnswers,
    /// No request is answered.
    Hangs,
}

/// A selection by labels of the form `NAME=VALUE`.
#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct Selection {
    label_selector: Option<String>,
}

impl ApiServer {
    /// Listens on a free port. Returns the address.
    pub async fn start() -> (Self, String) {
        let server = Self::default();
        let jobs = "/apis/batch/v1/namespaces/{namespace}/jobs";
        let router = Router::new()
            .route(jobs, get(list_jobs).post(create_job))
            .route(&format!("{jobs}/{{name}}"), delete(delete_job))
            .route("/api/v1/namespaces/{namespace}/pods", get(list_pods))
            .layer(middleware::from_fn_with_state(server.clone(), faults))
            .with_state(server.clone());
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        tokio::spawn(async move { axum::serve(listener, router).await.unwrap() });
        (server, address)
    }

    pub fn set_fault(&self, fault: Option<Fault>) {
        self.world().fault = fault;
    }

    /// Names of the Jobs, in order of creation.
    pub fn jobs(&self) -> Vec<String> {
        let name = |job: &Value| job["metadata"]["name"].as_str().unwrap().to_owned();
        self.world().jobs.iter().map(name).collect()
    }

    /// The Job as it was requested.
    pub fn job(&self, name: &str) -> Value {
        let world = self.world();
        world.jobs.iter().find(|job| job["metadata"]["name"] == name).unwrap().clone()
    }

    pub fn asked(&self) -> BTreeSet<(String, String)> {
        self.world().asked.clone()
    }

    /// Gives the Pod of a Job a status, and a node.
    pub fn set_pod(&self, job: &str, status: Value) {
        let mut world = self.world();
        let pod =
            world.pods.iter_mut().find(|pod| pod["metadata"]["labels"][JOB_NAME] == job).unwrap();
        pod["spec"]["nodeName"] = "node-3".into();
        pod["status"] = status;
    }

    /// Deletes the Pod of a Job, as a preemption does in the end.
    pub fn delete_pod(&self, job: &str) {
        self.world().pods.retain(|pod| pod["metadata"]["labels"][JOB_NAME] != job);
    }

    /// Ends a Job with a condition.
    pub fn end_job(&self, job: &str, condition: &Value) {
        let mut world = self.world();
        let job = world.jobs.iter_mut().find(|known| known["metadata"]["name"] == job).unwrap();
        job["status"] = json!({"conditions": [condition]});
    }

    fn world(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap()
    }
}

pub const JOB_NAME: &str = "batch.kubernetes.io/job-name";

async fn faults(State(server): State<ApiServer>, request: Request, next: Next) -> Response {
    let path = request.uri().path().to_owned();
    let resource = if path.contains("/pods") { "pods" } else { "jobs" };
    let verb = match request.method().as_str() {
        "POST" => "create",
        "DELETE" => "delete",
        _ => "list",
    };
    server.world().asked.insert((verb.to_owned(), resource.to_owned()));
    let fault = server.world().fault;
    match fault {
        Some(Fault::Refuses(code, message)) => status(code, message),
        Some(Fault::RefusesJobs(code, message)) if verb == "create" => status(code, message),
        Some(Fault::LosesAnswers) if verb == "create" => {
            next.run(request).await;
            status(504, "Timeout: request did not complete within the allotted timeout")
        }
        Some(Fault::Hangs) => {
            tokio::time::sleep(Duration::from_secs(3600)).await;
            status(500, "never heard")
        }
        _ => next.run(request).await,
    }
}

/// An error in Kubernetes' format.
fn status(code: u16, message: &str) -> Response {
    let reason = match code {
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "NotFound",
        409 => "AlreadyExists",
        429 => "TooManyRequests",
        504 => "Timeout",
        _ => "InternalError",
    };
    let body = json!({
        "kind": "Status", "apiVersion": "v1", "metadata": {}, "status": "Failure",
        "message": message, "reason": reason, "code": code,
    });
    (StatusCode::from_u16(code).unwrap(), Json(body)).into_response()
}

async fn list_jobs(
    State(server): State<ApiServer>,
    Query(selection): Query<Selection>,
) -> Json<Value> {
    let items = selected(&server.world().jobs, &selection);
    Json(
        json!({"kind": "JobList", "apiVersion": "batch/v1", "metadata": {"resourceVersion": "1042"}, "items": items}),
    )
}

async fn list_pods(
    State(server): State<ApiServer>,
    Query(selection): Query<Selection>,
) -> Json<Value> {
    let items = selected(&server.world().pods, &selection);
    Json(
        json!({"kind": "PodList", "apiVersion": "v1", "metadata": {"resourceVersion": "1042"}, "items": items}),
    )
}

fn selected(items: &[Value], selection: &Selection) -> Vec<Value> {
    let selector = selection.label_selector.as_deref().unwrap();
    let (label, value) = selector.split_once('=').unwrap();
    items.iter().filter(|item| item["metadata"]["labels"][label] == value).cloned().collect()
}

async fn create_job(
    State(server): State<ApiServer>,
    Path(namespace): Path<String>,
    Json(mut job): Json<Value>,
) -> Response {
    let mut world = server.world();
    let name = job["metadata"]["name"].as_str().unwrap().to_owned();
    if world.jobs.iter().any(|known| known["metadata"]["name"] == name) {
        return status(409, &format!("jobs.batch {name:?} already exists"));
    }
    job["metadata"]["namespace"] = namespace.into();
    job["metadata"]["uid"] = "6f2c8c7e-0000-4000-8000-000000000000".into();
    job["status"] = json!({"active": 1, "ready": 0, "startTime": "2026-11-24T06:10:53Z"});
    let mut labels = job["spec"]["template"]["metadata"]["labels"].clone();
    labels[JOB_NAME] = name.clone().into();
    let pod = json!({
        "metadata": {"name": format!("{name}-x7k2p"), "labels": labels},
        "spec": job["spec"]["template"]["spec"],
        "status": {"phase": "Pending"},
    });
    world.jobs.push(job.clone());
    world.pods.push(pod);
    (StatusCode::CREATED, Json(job)).into_response()
}

async fn delete_job(
    State(server): State<ApiServer>,
    Path((_, name)): Path<(String, String)>,
) -> Response {
    let mut world = server.world();
    let before = world.jobs.len();
    world.jobs.retain(|job| job["metadata"]["name"] != name);
    world.pods.retain(|pod| pod["metadata"]["labels"][JOB_NAME] != name);
    if world.jobs.len() == before {
        return status(404, &format!("jobs.batch {name:?} not found"));
    }
    Json(json!({"kind": "Status", "apiVersion": "v1", "metadata": {}, "status": "Success"}))
        .into_response()
}
