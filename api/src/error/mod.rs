//! Errors of requests.

use std::fmt::Display;
use std::time::Duration;

use axum::http::header::{CONTENT_TYPE, ETAG, RETRY_AFTER, UPGRADE, WWW_AUTHENTICATE};
use axum::http::{HeaderName, HeaderValue, Method};
use axum::response::{IntoResponse, Response};
use jobs::SubmissionError;
use spec::{JsonFault, SpecError, VALUE_BYTES, cut};
use store::StoreError;
use thiserror::Error;
use urdf::UrdfError;
use wire::{Dependent, JobState, Problem};

use crate::limits::{BODY_WITHIN, CONCURRENT_UPLOADS, REQUEST_TIMEOUT, STREAMS, UPLOAD_TIMEOUT};
use crate::live::LiveError;

mod kind;

const BEARER: &str = r#"Bearer realm="torqued""#;
const BASIC: &str = r#"Basic realm="torqued: the token as password""#;

#[derive(Debug, Error)]
pub enum ApiError {
    #[error("there is no {what} {id}")]
    NotFound { what: &'static str, id: String },

    #[error("nothing is at {path}; GET /v1/openapi.json lists every path")]
    NoRoute { path: String },

    #[error("{path} does not answer {method}; GET /v1/openapi.json lists every path")]
    Method { method: Method, path: String },

    #[error("{name} is {value:?}, allowed: {allowed}")]
    Parameter { name: String, value: String, allowed: String },

    #[error("the query cannot be read: {reason}")]
    Query { reason: String },

    #[error("the body is {found}; send JSON with Content-Type: application/json")]
    ContentType { found: String },

    #[error(
        "the body is {}; send a form (multipart/form-data) with the parts spec and file, or the \
         file itself with Content-Type: text/csv, application/vnd.apache.parquet, application/x-npz or \
         application/x-mcap",
        found
            .as_ref()
            .map_or("of no declared type".to_owned(), |kind| format!("declared as {kind}"))
    )]
    UploadType { found: Option<String> },

    #[error(
        "the body is {}; send a URDF with Content-Type: application/xml, or a description of a robot \
         with Content-Type: application/json",
        found
            .as_ref()
            .map_or("of no declared type".to_owned(), |kind| format!("declared as {kind}"))
    )]
    RobotType { found: Option<String> },

    #[error("the body is too large, allowed: {limit} bytes")]
    BodyTooLarge { limit: usize },

    #[error(
        "the file is too large, allowed: {limit} bytes; `serve --max-upload-bytes` sets the limit"
    )]
    UploadTooLarge { limit: u64 },

    #[error(
        "there is no room for the file: sent files take {used} bytes, allowed: {quota}; delete \
         some and empty the trash with `torqued gc`, or raise `serve --upload-quota-bytes`"
    )]
    UploadQuota { quota: u64, used: u64 },

    #[error(
        "the file did not arrive in time, allowed: {} s for its next bytes and {} h for all of it",
        stall.as_secs_f64(), UPLOAD_TIMEOUT.as_secs() / 3600
    )]
    UploadStalled { stall: Duration },

    #[error("{CONCURRENT_UPLOADS} files are being received, which is the limit; try again later")]
    UploadsCrowded,

    #[error("the form cannot be read: {reason}")]
    Form { reason: String },

    #[error("the body could not be read to its end: {reason}")]
    Body { reason: String },

    #[error("the body is not valid JSON: {0}")]
    Json(JsonFault),

    #[error("{0}")]
    Spec(SpecError),

    #[error(transparent)]
    Urdf(#[from] UrdfError),

    /// A prediction request, or data that came with it, was refused.
    #[error("{0}")]
    Question(SpecError),

    #[error("{0}")]
    Labels(SpecError),

    /// A token to be created was refused.
    #[error("{0}")]
    NewToken(SpecError),

    #[error("{}", live_message(.0))]
    Live(LiveError),

    #[error("this server has no models for live predictions")]
    NoModels,

    #[error("a stream is opened by a WebSocket handshake: {reason}")]
    Handshake { reason: String },

    #[error("{STREAMS} streams are open, which is the limit; try again later")]
    StreamsCrowded,

    #[error("as many streams of events are open as this server allows; try again later")]
    EventsCrowded,

    #[error("job {id} is {state}, which is final, so it cannot be cancelled")]
    AlreadyFinal { id: i64, state: JobState },

    #[error("job {id} is {state}; only failed and cancelled jobs can be retried")]
    NotFailed { id: i64, state: JobState },

    #[error(
        "dataset {id} lacks shards, because job {job}, which fills it, is {state}; it can be \
         verified when it is complete"
    )]
    DatasetIncomplete { id: i64, job: i64, state: JobState },

    #[error("{}", if *.offered { "the token is not valid: it is unknown, expired or revoked" } else {
        "this server requires a token; send Authorization: Bearer TOKEN"
    })]
    Unauthorized { offered: bool },

    #[error(
        "the token {token} has the scope {scope}, but this request needs {needed}; ask the \
         server's administrator for such a token"
    )]
    Scope { token: String, scope: wire::Scope, needed: wire::Scope },

    #[error("a page of another site may not change anything on this server")]
    CrossSite,

    #[error(
        "this server answers as localhost or 127.0.0.1, not as {name:?}; start it with a token to use other names"
    )]
    ForeignHost { name: String },

    #[error("the server is answering as many requests as it can; try again in a second")]
    Crowded,

    #[error(
        "this address sends too many requests; try again in {} s, or raise `serve \
         --max-requests-per-second`",
        whole_seconds(*wait)
    )]
    TooFast { wait: Duration },

    #[error("as many files are being sent as this server allows; try again later")]
    DownloadsCrowded,

    #[error(
        "this address has as many connections as one address may have; close some, or let the \
         server trust its proxy with `serve --trusted-proxy`"
    )]
    AddressCrowded,

    #[error(
        "too many logins with a wrong token from this address; try again in {} s",
        whole_seconds(*wait)
    )]
    TooManyFailures { wait: Duration },

    #[error("the header {name} comes more than once; send it once")]
    RepeatedHeader { name: HeaderName },

    #[error("the file is not the one in If-Match: its ETag is {tag}")]
    OtherFile { tag: String },

    #[error("this server is about to stop")]
    Ending,

    #[error("the body did not arrive within {} s", BODY_WITHIN.as_secs())]
    SlowBody,

    #[error("the answer took longer than {} s", REQUEST_TIMEOUT.as_secs())]
    Timeout,

    #[error("{}", store_message(.0))]
    Store(#[from] StoreError),

    /// The store's own message, except messages with paths.
    #[error("the database cannot be written: {}", match .0 {
        error @ (StoreError::DatabaseGone | StoreError::DatabaseBusy { .. }) => error.to_string(),
        _ => "the server's log says why".to_owned(),
    })]
    Unwritable(StoreError),

    /// A stored file is gone, or differs from what was written.
    #[error("{file} {}; {REMEDY}", harm(.source))]
    Damaged { file: String, source: Box<StoreError> },

    #[error(
        "shard {shard} of dataset {dataset} cannot be read: its files are missing or not those that \
         were written; POST /v1/datasets/{dataset}/verify says which"
    )]
    ShardUnreadable { dataset: i64, shard: u32, reason: String },

    #[error("writing an Arrow stream failed")]
    Arrow(#[from] arrow_schema::ArrowError),

    #[error("drawing a figure failed")]
    Figure(#[from] figures::FigureError),

    #[error("the system gives no random bits")]
    Random(#[from] getrandom::Error),

    #[error("rendering a page failed")]
    Page(#[from] askama::Error),

    #[error("an internal error of the server; its log has the details")]
    Internal,
}

/// Seconds for `Retry-After`, rounded up.
fn whole_seconds(wait: Duration) -> u64 {
    wait.as_secs() + u64::from(wait.subsec_nanos() > 0)
}

impl ApiError {
    pub fn not_found(what: &'static str, id: impl Display) -> Self {
        Self::NotFound { what, id: id.to_string() }
    }

    pub fn parameter(name: &str, value: impl Display, allowed: impl Into<String>) -> Self {
        let value = cut(value.to_string(), VALUE_BYTES);
        Self::Parameter { name: name.to_owned(), value, allowed: allowed.into() }
    }

    /// The error for a stored file that could not be read. `file` is its name in messages.
    pub fn reading(file: impl Display, error: StoreError) -> Self {
        if matches!(error, StoreError::DamagedObject { .. }) || error.is_missing_file() {
            return Self::Damaged { file: file.to_string(), source: Box::new(error) };
        }
        Self::Store(error)
    }

    /// The same error, with the fields of a spec or request as seen from an enclosing one.
    pub fn within(self, outer: &str) -> Self {
        match self {
            Self::Spec(error) => Self::Spec(error.within(outer)),
            Self::Question(error) => Self::Question(error.within(outer)),
            other => other,
        }
    }

    pub fn to_problem(&self) -> Problem {
        let (status, kind, title) = self.kind();
        let (violations, more_violations) = match self {
            Self::Spec(error)
            | Self::Question(error)
            | Self::Labels(error)
            | Self::NewToken(error)
            | Self::Urdf(UrdfError::Description(error)) => (error.violations.clone(), error.more),
            _ => (Vec::new(), 0),
        };
        let dependents = match self {
            Self::Store(StoreError::Needed { by, .. }) => {
                by.iter().filter_map(|job| dependent(job).ok()).collect()
            }
            _ => Vec::new(),
        };
        Problem {
            // A tag URI (RFC 4151). It is a name that does not look like the address of a page.
            kind: format!("tag:torqued,2026:{kind}"),
            title: title.to_owned(),
            status: status.as_u16(),
            detail: self.to_string(),
            violations,
            more_violations,
            dependents,
        }
    }

    /// The problem as the body of a response.
    pub fn to_json(&self) -> Response {
        // It has only strings and numbers, so serialization cannot fail. An empty body would still
        // have its status.
        let problem = self.to_problem();
        let body = serde_json::to_vec(&problem).unwrap_or_default();
        let mut response = (self.status(), body).into_response();
        // For middleware that answers in another format.
        response.extensions_mut().insert(problem);
        let media_type = HeaderValue::from_static("application/problem+json");
        response.headers_mut().insert(CONTENT_TYPE, media_type);
        response
    }

    /// Logs details that the answer leaves out.
    pub fn log(&self) {
        if let Self::ShardUnreadable { reason, .. } = self {
            tracing::error!(error = %self, reason, "a request failed");
        } else if self.status().is_server_error() {
            tracing::error!(error = spec::causes(self), "a request failed");
        }
    }

    /// Adds headers that do not depend on the body's format.
    pub fn add_headers(&self, response: &mut Response) {
        let headers = response.headers_mut();
        match self {
            Self::Unauthorized { .. } => {
                // There are two header lines instead of one list, because browsers do not look for
                // Basic after a comma.
                headers.append(WWW_AUTHENTICATE, HeaderValue::from_static(BEARER));
                headers.append(WWW_AUTHENTICATE, HeaderValue::from_static(BASIC));
            }
            Self::OtherFile { tag } => {
                // A tag is a digest in quotes.
                headers.extend(HeaderValue::try_from(tag).ok().map(|tag| (ETAG, tag)));
            }
            Self::TooFast { wait } | Self::TooManyFailures { wait } => {
                headers.insert(RETRY_AFTER, HeaderValue::from(whole_seconds(*wait)));
            }
            Self::Crowded
            | Self::UploadsCrowded
            | Self::DownloadsCrowded
            | Self::AddressCrowded
            | Self::StreamsCrowded
            | Self::EventsCrowded
            | Self::Live(
                LiveError::Queue { .. } | LiveError::Memory { .. } | LiveError::Full { .. },
            )
            | Self::Timeout => {
                headers.insert(RETRY_AFTER, HeaderValue::from_static("1"));
            }
            Self::Handshake { .. } => {
                headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
            }
            _ => {}
        }
    }
}

/// The remedy for a damaged file.
const REMEDY: &str = "restore it from a backup, or make it again: submit the spec of the job that made it with \
     `--force` (`?force=true`)";

/// A description of the damage to a file.
fn harm(error: &StoreError) -> String {
    match error {
        StoreError::DamagedObject { expected, found, .. } => {
            format!("is damaged: expected {expected}, found {found}")
        }
        _ => "is missing".to_owned(),
    }
}

fn live_message(error: &LiveError) -> String {
    match error {
        LiveError::Store(error) => store_message(error),
        error => error.to_string(),
    }
}

/// The part of a failure that callers may see. Paths and SQL are only logged.
fn store_message(error: &StoreError) -> String {
    match error {
        StoreError::NotFound { .. }
        | StoreError::IdempotencyConflict { .. }
        | StoreError::NeedNotMet { .. }
        | StoreError::TokenExists { .. }
        | StoreError::TooManyTokens { .. }
        | StoreError::FirstToken { .. }
        | StoreError::TooManyTags { .. }
        | StoreError::ExperimentTaken { .. }
        | StoreError::Deleted { .. }
        | StoreError::InTrash { .. }
        | StoreError::Purged { .. }
        | StoreError::NotDeleted { .. }
        | StoreError::OwnerDeleted { .. }
        | StoreError::NotEnded { .. }
        | StoreError::Needed { .. }
        | StoreError::InputDeleted { .. }
        | StoreError::FileDeleted { .. }
        | StoreError::ParamChanged { .. }
        | StoreError::DiskFull { .. } => error.to_string(),
        StoreError::DamagedObject { .. } => format!("{error}; {REMEDY}"),
        StoreError::Displaced { .. } => {
            "the place of this server's files has no store.json any more; nothing is written there \
             until the disk is mounted or the bucket is back"
                .to_owned()
        }
        _ => "an internal error of the server; its log has the details".to_owned(),
    }
}

/// A dependent job, in the API's form.
pub fn dependent(found: &store::Dependent) -> Result<Dependent, ApiError> {
    Ok(Dependent {
        id: found.job.0,
        kind: found.kind.parse()?,
        name: found.name.clone(),
        state: found.state,
        relation: found.relation,
    })
}

impl From<LiveError> for ApiError {
    fn from(error: LiveError) -> Self {
        match error {
            LiveError::Refused(error) => Self::Question(error),
            error => Self::Live(error),
        }
    }
}

impl From<SubmissionError> for ApiError {
    fn from(error: SubmissionError) -> Self {
        match error {
            SubmissionError::Json(error) => Self::Json(error),
            SubmissionError::Spec(error) => Self::Spec(error),
            SubmissionError::NotFailed { id, state } => Self::NotFailed { id: id.0, state },
            SubmissionError::Store(error) => Self::Store(error),
        }
    }
}

impl From<SpecError> for ApiError {
    fn from(error: SpecError) -> Self {
        Self::Spec(error)
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        self.log();
        let mut response = self.to_json();
        self.add_headers(&mut response);
        response
    }
}
