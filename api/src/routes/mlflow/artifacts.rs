//! Files of runs: lists them for `artifacts/list`, and handles requests for `mlflow-artifacts:`
//! URIs.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use serde_json::{Value, json};

use super::runs::run;
use crate::app::App;
use crate::app::mlflow::{ArtifactPlace, artifact_name};
use crate::extract::Path;
use crate::mlflow::{MlflowError, Request, limits};
use crate::routes::files::send;
use crate::upload::IncomingBytes;

type MlflowResult = Result<Json<Value>, MlflowError>;

/// Bytes of a path that also names an experiment and a run.
const PATH: usize = 2 * limits::ARTIFACT_NAME;

/// Lists files with paths that begin at the run.
pub async fn list_of_run(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let name = fields.text("path", PATH)?.unwrap_or_default();
    let place =
        ArtifactPlace { run: run(fields)?, name: artifact_name(name.trim_end_matches('/'))? };
    let root = app.mlflow_run(&place.run).await?.info.artifact_uri;
    Ok(Json(json!({"root_uri": root, "files": app.list_artifacts(&place).await?})))
}

/// Lists files with paths that begin at the listed folder.
pub async fn list(State(app): State<App>, request: Request) -> MlflowResult {
    let path = request.fields().required_text("path", PATH)?;
    let mut files = app.list_artifacts(&ArtifactPlace::parse(path)?).await?;
    for file in &mut files {
        file.path = file.path.rsplit('/').next().unwrap_or_default().to_owned();
    }
    Ok(Json(json!({"files": files})))
}

pub async fn file(
    State(app): State<App>,
    Path(path): Path<String>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, MlflowError> {
    let file = app.mlflow_artifact(&ArtifactPlace::parse(&path)?).await?;
    Ok(send(&app, &method, &headers, file).await?)
}

pub async fn receive(
    State(app): State<App>,
    Path(path): Path<String>,
    bytes: IncomingBytes,
) -> MlflowResult {
    app.receive_artifact(&ArtifactPlace::parse(&path)?, bytes).await?;
    Ok(Json(json!({})))
}

pub async fn delete(State(app): State<App>, Path(path): Path<String>) -> MlflowResult {
    app.delete_artifacts(&ArtifactPlace::parse(&path)?).await?;
    Ok(Json(json!({})))
}
