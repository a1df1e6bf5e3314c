//! Server-sent events.

use std::convert::Infallible;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::sse::{Event as Message, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures::{Stream, StreamExt, stream};
use serde::Deserialize;
use store::EventKind;
use utoipa::IntoParams;

use crate::access::Credentials;
use crate::app::App;
use crate::app::events::{EventReader, Subject};
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::limits::EVENT_RETRY;

/// The header in which a client that connects again sends the id of its last event.
const LAST_EVENT_ID: &str = "Last-Event-ID";

const IDS: &str = "the id of an event, or 0";

/// Makes nginx pass each event on at once.
const UNBUFFERED: (HeaderName, HeaderValue) =
    (HeaderName::from_static("x-accel-buffering"), HeaderValue::from_static("no"));

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct EventsParameters {
    /// Only events of this kind.
    #[param(inline)]
    kind: Option<EventKind>,
    /// Begin with stored events that have a larger id; 0 for all stored events. `Last-Event-ID`
    /// takes precedence.
    after: Option<i64>,
}

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct PlaceParameters {
    /// Begin with stored events that have a larger id; 0 for all stored events. `Last-Event-ID`
    /// takes precedence.
    after: Option<i64>,
}

/// Follow the events of all jobs, from now on or after a given event. The stream ends when the
/// server stops.
#[utoipa::path(
    get,
    path = "/v1/events",
    tag = "events",
    params(
        EventsParameters,
        ("Last-Event-ID" = Option<i64>, Header, description = "The id of the last event that was received"),
    ),
    responses((
        status = 200,
        body = String,
        content_type = "text/event-stream",
        description = "Messages: `event` is the kind, `data` is an `Event`, and `id` is the id of a stored event",
    )),
)]
pub async fn all(
    State(app): State<App>,
    Query(EventsParameters { kind, after }): Query<EventsParameters>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    open(&app, Subject::Everything { kind }, after, &headers).await
}

/// Follow the events of a job, or of a pipeline and its jobs. The stream begins with the job's
/// progress and ends when the job ends.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/events",
    tag = "events",
    params(
        ("id" = i64, Path),
        PlaceParameters,
        ("Last-Event-ID" = Option<i64>, Header, description = "The id of the last event that was received"),
    ),
    responses((
        status = 200,
        body = String,
        content_type = "text/event-stream",
        description = "Messages: `event` is the kind, `data` is an `Event`, and `id` is the id of a stored event",
    )),
)]
pub async fn of_job(
    State(app): State<App>,
    Path(id): Path<i64>,
    Query(PlaceParameters { after }): Query<PlaceParameters>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    open(&app, Subject::Job(id), after, &headers).await
}

/// Follow the events of the run's job.
#[utoipa::path(
    get,
    path = "/v1/runs/{id}/events",
    tag = "events",
    params(
        ("id" = i64, Path),
        PlaceParameters,
        ("Last-Event-ID" = Option<i64>, Header, description = "The id of the last event that was received"),
    ),
    responses((
        status = 200,
        body = String,
        content_type = "text/event-stream",
        description = "Messages: `event` is the kind, `data` is an `Event`, and `id` is the id of a stored event",
    )),
)]
pub async fn of_run(
    State(app): State<App>,
    Path(id): Path<i64>,
    Query(PlaceParameters { after }): Query<PlaceParameters>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    open(&app, Subject::Run(id), after, &headers).await
}

async fn open(
    app: &App,
    subject: Subject,
    after: Option<i64>,
    headers: &HeaderMap,
) -> Result<Response, ApiError> {
    let after = match last_event(headers)? {
        Some(id) => Some(id),
        None => place("after", after)?,
    };
    let reader = app.event_reader(subject, after, Credentials::of(headers)).await?;
    let keep_alive = KeepAlive::new().interval(app.options().event_heartbeat);
    let stream = Sse::new(messages(reader)).keep_alive(keep_alive);
    Ok(([UNBUFFERED], stream).into_response())
}

/// The id in the header. An empty header means no id; browsers send it before the first event.
fn last_event(headers: &HeaderMap) -> Result<Option<i64>, ApiError> {
    let Some(value) = headers.get(LAST_EVENT_ID) else { return Ok(None) };
    let text = String::from_utf8_lossy(value.as_bytes());
    if text.trim().is_empty() {
        return Ok(None);
    }
    let id = text.trim().parse().map_err(|_| ApiError::parameter(LAST_EVENT_ID, &text, IDS))?;
    place(LAST_EVENT_ID, Some(id))
}

fn place(name: &str, id: Option<i64>) -> Result<Option<i64>, ApiError> {
    match id {
        Some(id) if id < 0 => Err(ApiError::parameter(name, id, IDS)),
        id => Ok(id),
    }
}

fn messages(reader: EventReader) -> impl Stream<Item = Result<Message, Infallible>> + Send {
    let retry = Message::default().retry(EVENT_RETRY);
    let events = stream::unfold(reader, |mut reader| async move {
        let event = reader.next().await?;
        Some((message(&event), reader))
    });
    stream::once(async { retry }).chain(events).map(Ok)
}

fn message(event: &wire::Event) -> Message {
    // Every document of the API can be written as JSON.
    let data = serde_json::to_string(event).unwrap_or_default();
    let message = Message::default().event(event.name()).data(data);
    match event.id() {
        Some(id) => message.id(id.to_string()),
        None => message,
    }
}
