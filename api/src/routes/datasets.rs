//! Datasets: uploads of recordings, and verifications.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::LOCATION;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use spec::ImportSpec;
use store::Labels;
use utoipa::{IntoParams, ToSchema};
use wire::Job;

use crate::app::App;
use crate::app::submission::Reuse;
use crate::error::ApiError;
use crate::extract::{IdempotencyKey, Path, Query};
use crate::upload::IncomingFiles;

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "`IncomingFiles` reads spec and name; here they are documented")]
pub struct UploadParameters {
    /// If the body is the file itself: the import spec as JSON. It may leave out `kind`, `file` and
    /// `format`.
    spec: Option<String>,
    /// If the body is the file itself: the file's name.
    name: Option<String>,
    /// Import again, even if the same file was imported in the same way before.
    #[serde(default)]
    force: bool,
}

/// A form with files: first the spec, then every file in a part of its own.
#[derive(ToSchema)]
#[expect(dead_code, reason = "a shape for the document; `IncomingFiles` reads it")]
pub struct UploadForm {
    /// The import spec. It may leave out `kind`, `file` and, if the media type or the name of the
    /// part `file` tells it, `format`. With several files, `files` is filled in: each name is that of a part without its
    /// extension. If the spec lists `files`, those that the server has need not be sent.
    spec: ImportSpec,
    /// A file. The part may be repeated.
    #[schema(value_type = String, format = Binary)]
    file: Vec<u8>,
}

/// Upload recordings as CSV, Parquet, NumPy arrays or MCAP, and import them as a dataset.
///
/// A form may have several files, which are alike: together they become one dataset. Each file is
/// stored under its digest, so `POST /v1/jobs` can import it again in another way. If
/// an import with the same digest exists, done or not, the answer is 200 with that job.
#[utoipa::path(
    post,
    path = "/v1/datasets",
    tag = "datasets",
    security((), ("token" = ["submit"])),
    params(
        UploadParameters,
        (
            "Idempotency-Key" = Option<String>,
            Header,
            min_length = 1,
            max_length = 255,
            pattern = "^[ -~]+$",
            description = "A repeated request with the same key, spec and file gets the same job",
        ),
    ),
    request_body(content(
        (UploadForm = "multipart/form-data"),
        (Vec<u8> = "text/csv"),
        (Vec<u8> = "application/vnd.apache.parquet"),
        (Vec<u8> = "application/x-npz"),
        (Vec<u8> = "application/x-mcap"),
    )),
    responses(
        (status = 202, body = Job, headers(("Location" = String))),
        (status = 200, body = Job, description = "The import exists already"),
    ),
)]
pub async fn create(
    State(app): State<App>,
    Query(parameters): Query<UploadParameters>,
    IdempotencyKey(key): IdempotencyKey,
    files: IncomingFiles,
) -> Result<Response, ApiError> {
    let reuse = if parameters.force { Reuse::Never } else { Reuse::SameDigest };
    let submitted = app.import(files, reuse, key, Labels::default()).await?;
    let status = if submitted.created { StatusCode::ACCEPTED } else { StatusCode::OK };
    let location = format!("/v1/jobs/{}", submitted.job.id);
    Ok((status, [(LOCATION, location)], Json(submitted.job)).into_response())
}

/// Verify a dataset: make every shard again and compare it.
///
/// Each request makes a new job. The dataset shows the result.
#[utoipa::path(
    post,
    path = "/v1/datasets/{id}/verify",
    tag = "datasets",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    responses((status = 202, body = Job, headers(("Location" = String)))),
)]
pub async fn verify(State(app): State<App>, Path(id): Path<i64>) -> Result<Response, ApiError> {
    let job = app.verify(id).await?;
    let location = format!("/v1/jobs/{}", job.id);
    Ok((StatusCode::ACCEPTED, [(LOCATION, location)], Json(job)).into_response())
}
