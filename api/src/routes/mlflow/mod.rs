//! The part of MLflow's REST API that its clients need to read torqued's runs and to log their own.
//!
//! These paths and their answers are MLflow's (`mlflow/protos/service.proto`,
//! `mlflow_artifacts.proto`). They pass all guards. They are not part of torqued's own API, so the
//! OpenAPI document leaves them out.

mod artifacts;
mod batches;
mod experiments;
mod runs;
mod searching;

use axum::http::{Method, Uri};
use axum::routing::{any, get, post};
use axum::{Json, Router};
use serde_json::{Value, json};

use crate::app::App;
use crate::mlflow::{ErrorCode, MlflowError, Request};

pub fn routes() -> Router<App> {
    let tracking = Router::new()
        .route("/experiments/create", post(experiments::create))
        .route("/experiments/get", get(experiments::show))
        .route("/experiments/get-by-name", get(experiments::show_named))
        .route("/experiments/search", get(experiments::search).post(experiments::search))
        .route("/experiments/update", post(experiments::rename))
        .route("/experiments/delete", post(experiments::delete))
        .route("/experiments/restore", post(experiments::restore))
        .route("/experiments/set-experiment-tag", post(experiments::set_tag))
        .route("/experiments/delete-experiment-tag", post(experiments::delete_tag))
        .route("/runs/create", post(runs::create))
        .route("/runs/get", get(runs::show))
        .route("/runs/search", post(runs::search))
        .route("/runs/update", post(runs::update))
        .route("/runs/delete", post(runs::delete))
        .route("/runs/restore", post(runs::restore))
        .route("/runs/log-metric", post(batches::log_metric))
        .route("/runs/log-parameter", post(batches::log_param))
        .route("/runs/log-batch", post(batches::log_batch))
        .route("/runs/set-tag", post(batches::set_tag))
        .route("/runs/delete-tag", post(batches::delete_tag))
        .route("/metrics/get-history", get(runs::history))
        .route("/artifacts/list", get(artifacts::list_of_run))
        .route("/logged-models/search", post(no_models));
    Router::new()
        .nest("/api/2.0/mlflow", tracking)
        .route("/api/2.0/mlflow-artifacts/artifacts", get(artifacts::list))
        .route(
            "/api/2.0/mlflow-artifacts/artifacts/{*path}",
            get(artifacts::file).put(artifacts::receive).delete(artifacts::delete),
        )
        .route("/api/{*path}", any(absent))
}

/// Answers with no logged models. Clients ask for them whenever they list the files of a run.
async fn no_models(_: Request) -> Json<Value> {
    Json(json!({"models": []}))
}

/// Answers for a missing endpoint. Clients then assume a server that is older than the endpoint.
async fn absent(method: Method, uri: Uri) -> MlflowError {
    let message = format!(
        "torqued does not have MLflow's {method} {}; docs/mlflow.md lists the paths that it has",
        uri.path()
    );
    MlflowError::refused(ErrorCode::EndpointNotFound, message)
}
