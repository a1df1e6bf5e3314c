//! Submits, shows and cancels jobs.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::LOCATION;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use spec::JobSpec;
use utoipa::IntoParams;
use wire::{Attempts, Job, Tasks};

use crate::app::paging::TaskPaging;
use crate::app::submission::{Reuse, Submitted};
use crate::app::{App, labels};
use crate::error::ApiError;
use crate::extract::{IdempotencyKey, JsonBytes, Path, Query, QueryPairs};
use crate::routes::lists::{ListParameters, TagParameters};

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct SubmitParameters {
    /// Compute everything again, even if it was done before.
    #[serde(default)]
    force: bool,
    /// The job's name, which replaces the one in its spec. An existing job keeps a name that
    /// somebody gave it.
    #[param(min_length = 1, max_length = 200)]
    name: Option<String>,
    /// A note on the job, in Markdown. An existing job keeps its note.
    #[param(min_length = 1, max_length = 10_000)]
    note: Option<String>,
}

/// Submit a spec.
///
/// If a job with the same digest exists, done or not, the answer is 200 with that job. Name, note
/// and tags are not part of the spec and do not change the digest.
#[utoipa::path(
    post,
    path = "/v1/jobs",
    tag = "jobs",
    security((), ("token" = ["submit"])),
    params(
        SubmitParameters,
        TagParameters,
        (
            "Idempotency-Key" = Option<String>,
            Header,
            min_length = 1,
            max_length = 255,
            pattern = "^[ -~]+$",
            description = "A repeated request with the same key and spec gets the same job",
        ),
    ),
    request_body = JobSpec,
    responses(
        (status = 201, body = Job, headers(("Location" = String))),
        (status = 200, body = Job, description = "The job exists already"),
    ),
)]
pub async fn submit(
    State(app): State<App>,
    Query(parameters): Query<SubmitParameters>,
    pairs: QueryPairs,
    IdempotencyKey(key): IdempotencyKey,
    JsonBytes(body): JsonBytes,
) -> Result<Response, ApiError> {
    let SubmitParameters { force, name, note } = parameters;
    let reuse = if force { Reuse::Never } else { Reuse::SameDigest };
    let labels = labels::submitted(name, note, pairs.tags())?;
    Ok(answer(app.submit(body, reuse, key, labels).await?))
}

fn answer(submitted: Submitted) -> Response {
    let status = if submitted.created { StatusCode::CREATED } else { StatusCode::OK };
    let location = format!("/v1/jobs/{}", submitted.job.id);
    (status, [(LOCATION, location)], Json(submitted.job)).into_response()
}

/// Submit the spec of a failed or cancelled job again.
///
/// Completed parts are not done again: the jobs of a pipeline, and the cells of an evaluation.
#[utoipa::path(
    post,
    path = "/v1/jobs/{id}/retry",
    tag = "jobs",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    responses(
        (status = 201, body = Job, headers(("Location" = String))),
        (status = 200, body = Job, description = "The spec is being retried already"),
    ),
)]
pub async fn retry(State(app): State<App>, Path(id): Path<i64>) -> Result<Response, ApiError> {
    Ok(answer(app.retry(id).await?))
}

/// Cancel a job, or a pipeline with all its jobs that no other pipeline needs.
#[utoipa::path(
    post,
    path = "/v1/jobs/{id}/cancel",
    tag = "jobs",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    responses((status = 200, body = Job)),
)]
pub async fn cancel(State(app): State<App>, Path(id): Path<i64>) -> Result<Json<Job>, ApiError> {
    Ok(Json(app.cancel(id).await?))
}

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct TaskParameters {
    /// Largest number of tasks, 1 to 500; 50 by default.
    limit: Option<u32>,
    /// Only tasks that run after this one. Pass the `next` of the page before.
    after: Option<i64>,
}

/// List a job's tasks, in the order in which they run. Workers lease tasks.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/tasks",
    tag = "jobs",
    params(("id" = i64, Path), TaskParameters),
    responses((status = 200, body = Tasks)),
)]
pub async fn tasks(
    State(app): State<App>,
    Path(id): Path<i64>,
    Query(parameters): Query<TaskParameters>,
) -> Result<Json<Tasks>, ApiError> {
    let paging = TaskPaging::new(parameters.limit, parameters.after)?;
    Ok(Json(app.tasks(id, paging).await?))
}

/// List the attempts at a job's tasks, newest first: which worker, from when to when, and how each
/// ended.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/attempts",
    tag = "jobs",
    params(("id" = i64, Path), ListParameters),
    responses((status = 200, body = Attempts)),
)]
pub async fn attempts(
    State(app): State<App>,
    Path(id): Path<i64>,
    Query(page): Query<ListParameters>,
) -> Result<Json<Attempts>, ApiError> {
    Ok(Json(app.attempts(id, page.paging()?).await?))
}
