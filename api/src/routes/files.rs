//! Answers with files.

use std::collections::BTreeMap;

use axum::body::Body;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use serde::Deserialize;
use utoipa::openapi::schema::SchemaType;
use utoipa::openapi::{
    self, ContentBuilder, HeaderBuilder, Object, RefOr, ResponseBuilder, ResponsesBuilder, Schema,
};
use utoipa::{IntoParams, IntoResponses, PartialSchema as _};

use crate::app::App;
use crate::app::files::Download;
use crate::download::FileResponse;
use crate::error::ApiError;

/// Parameters of a download.
#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct FileParameters {
    /// Whether a bucket should send a file that it holds: the answer is then 307 with the file's
    /// address there. A file that is not in a bucket is sent as usual.
    pub redirect: Option<bool>,
}

/// Sends a file like [`send`], or redirects to its bucket.
pub async fn send_or_redirect(
    app: &App,
    method: &Method,
    headers: &HeaderMap,
    file: Download,
    parameters: &FileParameters,
) -> Result<Response, ApiError> {
    if parameters.redirect == Some(true) {
        let answer = FileResponse::new(method, headers, &file.info)?;
        if !answer.is_known()
            && let Some(address) = app.address(&file, method).await?
        {
            return Ok(answer.redirected(&address));
        }
    }
    send(app, method, headers, file).await
}

/// Sends a file, or the requested part of it.
pub async fn send(
    app: &App,
    method: &Method,
    headers: &HeaderMap,
    file: Download,
) -> Result<Response, ApiError> {
    let answer = FileResponse::new(method, headers, &file.info)?;
    let body = match answer.part.clone() {
        Some(part) => app.read(&file, part).await?,
        None => {
            if method == Method::HEAD {
                app.look_up(&file).await?;
            }
            Body::empty()
        }
    };
    Ok(answer.with_body(body))
}

/// Defines the answers of a download with several media types.
macro_rules! downloads {
    ($($(#[$about:meta])* $name:ident $(or $redirect:ident)?: $($media_type:literal => $schema:ident),*;)*) => {$(
        $(#[$about])*
        pub struct $name;

        impl IntoResponses for $name {
            fn responses() -> BTreeMap<String, RefOr<openapi::Response>> {
                answers(&[$(($media_type, $schema())),*], &[$($redirect())?])
            }
        }
    )*};
}

downloads! {
    /// A file of a dataset.
    DatasetFile or elsewhere: "application/vnd.apache.parquet" => bytes, "application/json" => any;
    /// A file of a checkpoint.
    CheckpointFile or elsewhere: "application/octet-stream" => bytes, "application/json" => any;
    /// An artifact of a run.
    ArtifactFile or elsewhere:
        "application/json" => any, "image/svg+xml" => text, "text/csv" => text,
        "application/vnd.apache.parquet" => bytes, "application/octet-stream" => bytes;
    /// A file of a robot.
    RobotFile: "application/json" => any, "application/xml" => text, "image/svg+xml" => text;
    /// All files of a dataset or a checkpoint.
    TarFile: "application/x-tar" => bytes;
    /// The log of an attempt.
    LogFile: "text/plain" => text;
}

fn bytes() -> RefOr<Schema> {
    Vec::<u8>::schema()
}

fn text() -> RefOr<Schema> {
    String::schema()
}

fn any() -> RefOr<Schema> {
    Object::with_type(SchemaType::AnyValue).into()
}

/// The answer that [`send_or_redirect`] has in addition to those of [`send`].
fn elsewhere() -> (&'static str, openapi::Response) {
    let location = HeaderBuilder::new().schema(Some(String::schema()));
    let answer = ResponseBuilder::new()
        .description("With `redirect=true`: the bucket sends the file from the address in `Location`, which is valid for 15 minutes")
        .header("Location", location.build());
    ("307", answer.build())
}

fn answers(
    contents: &[(&str, RefOr<Schema>)],
    further: &[(&'static str, openapi::Response)],
) -> BTreeMap<String, RefOr<openapi::Response>> {
    let of = |description: &str| {
        let builder = ResponseBuilder::new().description(description);
        contents.iter().fold(builder, |builder, (media_type, schema)| {
            let content = ContentBuilder::new().schema(Some(schema.clone())).build();
            builder.content(*media_type, content)
        })
    };
    let empty = |description: &str| ResponseBuilder::new().description(description);
    let problem = |description: &str| {
        let schema = RefOr::Ref(openapi::Ref::from_schema_name("Problem"));
        let content = ContentBuilder::new().schema(Some(schema)).build();
        ResponseBuilder::new().description(description).content("application/problem+json", content)
    };
    let answers = ResponsesBuilder::new()
        .response("200", of("The file"))
        .response("206", of("The requested part"))
        .response("304", empty("The client has the file"))
        .response("412", problem("`If-Match` names another file"))
        .response("416", empty("The requested part lies beyond the end"));
    let further = further.iter().cloned();
    further
        .fold(answers, |answers, (status, answer)| answers.response(status, answer))
        .build()
        .into()
}
