//! Receives files as the parts of a form, or one as the whole body. No file is ever whole in memory.

use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::{FromRequest, Request};
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use futures::StreamExt;
use futures::stream::BoxStream;
use multer::{Constraints, Field, Multipart, SizeLimit};
use serde::Deserialize;
use spec::FileFormat;
use tokio::time::{Instant, timeout_at};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::Query;
use crate::limits::{BODY_BYTES, UPLOAD_NAME_BYTES, UPLOAD_TIMEOUT};

/// Bytes of a form besides its files: boundaries, headers of the parts, the spec, and other texts.
const FORM_BYTES: u64 = 64 * 1024 + BODY_BYTES as u64;

/// Bytes of a text in a form, besides the spec.
const TEXT_BYTES: usize = 4 * 1024;

/// The parts of a form before its files.
struct Texts {
    allowed: &'static [&'static str],
    required: Option<&'static str>,
}

/// The parts of a program's form.
const OF_PROGRAM: Texts = Texts { allowed: &["spec"], required: Some("spec") };

/// The parts of the page's forms.
const OF_PAGE: Texts = Texts {
    allowed: &[
        "spec",
        "robot",
        "gravity",
        "name",
        "tags",
        "base",
        "tip",
        "lock",
        "mount",
        "nearest_physical",
    ],
    required: None,
};

/// The files of a form of the page, with its texts.
pub struct IncomingForm {
    /// The typed texts, by the inputs' names.
    pub texts: Vec<(String, String)>,
    /// The files.
    pub files: IncomingFiles,
}

/// Files that are being sent, one after the other, with the facts that are known before the first
/// byte of the one that is on its way.
pub struct IncomingFiles {
    /// The import spec as it was sent.
    pub spec: Bytes,
    /// The format that the media type of the file declares, if it does.
    pub format: Option<FileFormat>,
    /// The name that the sender gave the file.
    pub name: String,
    source: Source,
    allowance: Allowance,
}

/// A body that is received as a file, whatever it holds.
pub struct IncomingBytes {
    body: BodyStream,
    allowance: Allowance,
}

type BodyStream = BoxStream<'static, Result<Bytes, axum::Error>>;

/// How many bytes a sender may send, and how long to wait for them.
#[derive(Clone, Copy)]
struct Allowance {
    /// Bytes of the files that have arrived.
    received: u64,
    /// Bytes of all files.
    limit: u64,
    /// The longest wait for the next bytes.
    stall: Duration,
    /// The end of the wait for all of them.
    deadline: Instant,
}

#[expect(clippy::large_enum_variant, reason = "one exists per request on its way in")]
enum Source {
    Body(BodyStream),
    /// A part called `file`, and its form, in which only such parts follow.
    Form {
        file: Option<Field<'static>>,
        form: Multipart<'static>,
    },
}

#[derive(Deserialize)]
struct Parameters {
    spec: Option<String>,
    name: Option<String>,
}

impl FromRequest<App> for IncomingFiles {
    type Rejection = ApiError;

    async fn from_request(request: Request, app: &App) -> Result<Self, ApiError> {
        let allowance = Allowance::of(app);
        let limit = allowance.limit;
        let (mut parts, body) = request.into_parts();
        let parameters =
            <Query<Parameters> as axum::extract::FromRequestParts<App>>::from_request_parts(
                &mut parts, app,
            );
        let Query(parameters) = parameters.await?;
        let declared = parts.headers.get(CONTENT_TYPE);
        let declared = declared.map(|value| String::from_utf8_lossy(value.as_bytes()).into_owned());
        let essence = declared.as_deref().map(essence).unwrap_or_default();
        if essence == "multipart/form-data" {
            refuse_longer(&parts.headers, limit.saturating_add(FORM_BYTES), limit)?;
            if parameters.spec.is_some() || parameters.name.is_some() {
                let allowed = "left out: a form has them in its parts";
                return Err(ApiError::parameter("spec, name", "in the query", allowed));
            }
            let declared = declared.unwrap_or_default();
            let form = from_form(&declared, body, allowance, &OF_PROGRAM).await?;
            return Ok(form.files);
        }
        let Some(format) = format_of(&essence) else {
            return Err(ApiError::UploadType { found: declared });
        };
        refuse_longer(&parts.headers, limit, limit)?;
        let Some(spec) = parameters.spec else {
            let allowed = "the import spec as JSON, when the body is the file itself";
            return Err(ApiError::parameter("spec", "missing", allowed));
        };
        Ok(Self {
            spec: spec.into(),
            format: Some(format),
            name: usable(parameters.name.as_deref())?,
            source: Source::Body(body.into_data_stream().boxed()),
            allowance,
        })
    }
}

impl FromRequest<App> for IncomingForm {
    type Rejection = ApiError;

    async fn from_request(request: Request, app: &App) -> Result<Self, ApiError> {
        let allowance = Allowance::of(app);
        let limit = allowance.limit;
        let (parts, body) = request.into_parts();
        refuse_longer(&parts.headers, limit.saturating_add(FORM_BYTES), limit)?;
        let declared = parts.headers.get(CONTENT_TYPE).and_then(|value| value.to_str().ok());
        from_form(declared.unwrap_or_default(), body, allowance, &OF_PAGE).await
    }
}

/// The media type without its parameters.
fn essence(declared: &str) -> String {
    declared.split(';').next().unwrap_or("").trim().to_ascii_lowercase()
}

fn format_of(essence: &str) -> Option<FileFormat> {
    FileFormat::ALL.into_iter().find(|format| format.media_type() == essence)
}

/// Refuses a body that is too long before it is received, if its length is declared.
fn refuse_longer(headers: &HeaderMap, allowed: u64, limit: u64) -> Result<(), ApiError> {
    let length = headers.get(CONTENT_LENGTH).and_then(|length| length.to_str().ok());
    match length.and_then(|length| length.parse::<u64>().ok()) {
        Some(length) if length > allowed => Err(ApiError::UploadTooLarge { limit }),
        _ => Ok(()),
    }
}

fn usable(name: Option<&str>) -> Result<String, ApiError> {
    let name = name.unwrap_or("upload");
    if name.is_empty() || name.len() > UPLOAD_NAME_BYTES || name.chars().any(char::is_control) {
        let allowed = format!("1 to {UPLOAD_NAME_BYTES} bytes without control characters");
        return Err(ApiError::parameter("name", format!("{} bytes", name.len()), allowed));
    }
    Ok(name.to_owned())
}

async fn from_form(
    declared: &str,
    body: Body,
    allowance: Allowance,
    texts: &Texts,
) -> Result<IncomingForm, ApiError> {
    let limit = allowance.limit;
    let boundary = multer::parse_boundary(declared).map_err(|error| form_error(&error, limit))?;
    let sizes = SizeLimit::new()
        .whole_stream(limit.saturating_add(FORM_BYTES))
        .per_field(TEXT_BYTES as u64)
        .for_field("spec", BODY_BYTES as u64)
        .for_field("file", limit);
    let allowed = [texts.allowed, &["file"]].concat();
    let constraints = Constraints::new().size_limit(sizes).allowed_fields(allowed);
    let stream = body.into_data_stream();
    let mut form = Multipart::with_constraints(stream, boundary, constraints);
    let mut read: Vec<(String, Bytes)> = Vec::new();
    let file = loop {
        let missing = texts.required.filter(|name| read.iter().all(|(known, _)| known != name));
        let expected = format!("part {:?}", missing.unwrap_or("file"));
        let part = next_part(&mut form, allowance).await?;
        let name = part.as_ref().and_then(Field::name).unwrap_or_default().to_owned();
        let is_known = read.iter().any(|(known, _)| *known == name);
        match part {
            Some(part) if name == "file" && missing.is_none() => break part,
            Some(part) if name != "file" && !is_known => {
                let text = allowance.wait(part.bytes()).await?;
                read.push((name, text.map_err(|error| form_error(&error, limit))?));
            }
            other => return Err(wrong_part(&expected, other.as_ref())),
        }
    };
    let (format, name) = facts(&file)?;
    let spec = read.iter().find(|(known, _)| known == "spec").map(|(_, text)| text.clone());
    let text = |bytes: Bytes| String::from_utf8_lossy(&bytes).into_owned();
    let files = IncomingFiles {
        spec: spec.unwrap_or_default(),
        format,
        name,
        source: Source::Form { file: Some(file), form },
        allowance,
    };
    Ok(IncomingForm { texts: read.into_iter().map(|(name, it)| (name, text(it))).collect(), files })
}

/// The format of a form's file, which its media type or else its name declares, and its name.
fn facts(file: &Field<'static>) -> Result<(Option<FileFormat>, String), ApiError> {
    let name = usable(file.file_name().filter(|name| !name.is_empty()))?;
    let declared = file.content_type().and_then(|declared| format_of(declared.essence_str()));
    Ok((declared.or_else(|| FileFormat::of_name(&name)), name))
}

async fn next_part(
    form: &mut Multipart<'static>,
    allowance: Allowance,
) -> Result<Option<Field<'static>>, ApiError> {
    allowance.wait(form.next_field()).await?.map_err(|error| form_error(&error, allowance.limit))
}

fn wrong_part(expected: &str, found: Option<&Field<'static>>) -> ApiError {
    let found = match found {
        None => "nothing".to_owned(),
        Some(part) => format!("part {:?}", part.name().unwrap_or_default()),
    };
    let reason = format!("{found} came instead of {expected}; send spec, then every file");
    ApiError::Form { reason }
}

fn form_error(error: &multer::Error, limit: u64) -> ApiError {
    match error {
        multer::Error::StreamSizeExceeded { .. } => ApiError::UploadTooLarge { limit },
        multer::Error::FieldSizeExceeded { field_name: Some(field), .. } if field == "file" => {
            ApiError::UploadTooLarge { limit }
        }
        multer::Error::FieldSizeExceeded { field_name: Some(field), .. } if field != "spec" => {
            ApiError::BodyTooLarge { limit: TEXT_BYTES }
        }
        multer::Error::FieldSizeExceeded { .. } => ApiError::BodyTooLarge { limit: BODY_BYTES },
        error => ApiError::Form { reason: error.to_string() },
    }
}

impl IncomingFiles {
    /// Goes on to the next file, after the end of this one. Returns false if there is none.
    ///
    /// # Errors
    /// When it does not arrive in time, or something else arrives.
    pub async fn next_file(&mut self) -> Result<bool, ApiError> {
        let Source::Form { file, form } = &mut self.source else { return Ok(false) };
        let part = match next_part(form, self.allowance).await? {
            None => return Ok(false),
            Some(part) if part.name() == Some("file") => part,
            other => return Err(wrong_part("part \"file\" or the end", other.as_ref())),
        };
        (self.format, self.name) = facts(&part)?;
        *file = Some(part);
        Ok(true)
    }

    /// The whole file, which has at most `most` bytes.
    ///
    /// # Errors
    /// As [`Self::next`].
    pub async fn read(&mut self, most: usize) -> Result<Bytes, ApiError> {
        let mut whole = Vec::new();
        while let Some(piece) = self.next().await? {
            whole.extend_from_slice(&piece);
            if whole.len() > most {
                return Err(ApiError::BodyTooLarge { limit: most });
            }
        }
        Ok(whole.into())
    }

    /// The next bytes of the file; `None` at its end.
    ///
    /// # Errors
    /// When they do not arrive in time, are cut off, or are too many.
    pub async fn next(&mut self) -> Result<Option<Bytes>, ApiError> {
        let allowance = &mut self.allowance;
        let file = match &mut self.source {
            Source::Body(body) => return allowance.next_of(body).await,
            Source::Form { file, .. } => file,
        };
        let Some(part) = file else { return Ok(None) };
        let piece = allowance.wait(part.chunk()).await?;
        let piece = piece.map_err(|error| form_error(&error, allowance.limit))?;
        if piece.is_none() {
            // A form returns no other part while one is held.
            *file = None;
        }
        allowance.count(piece)
    }
}

impl FromRequest<App> for IncomingBytes {
    type Rejection = ApiError;

    async fn from_request(request: Request, app: &App) -> Result<Self, ApiError> {
        let allowance = Allowance::of(app);
        refuse_longer(request.headers(), allowance.limit, allowance.limit)?;
        let body = request.into_body().into_data_stream().boxed();
        Ok(Self { body, allowance })
    }
}

impl IncomingBytes {
    /// The next bytes; `None` at the end.
    ///
    /// # Errors
    /// When they do not arrive in time, are cut off, or are too many.
    pub async fn next(&mut self) -> Result<Option<Bytes>, ApiError> {
        self.allowance.next_of(&mut self.body).await
    }
}

impl Allowance {
    fn of(app: &App) -> Self {
        let options = app.options();
        let deadline = Instant::now() + UPLOAD_TIMEOUT;
        Self { received: 0, limit: options.max_upload_bytes, stall: options.upload_stall, deadline }
    }

    async fn wait<T>(self, next: impl Future<Output = T>) -> Result<T, ApiError> {
        let until = self.deadline.min(Instant::now() + self.stall);
        timeout_at(until, next).await.map_err(|_| ApiError::UploadStalled { stall: self.stall })
    }

    /// The next bytes of a body.
    async fn next_of(&mut self, body: &mut BodyStream) -> Result<Option<Bytes>, ApiError> {
        let piece = self.wait(body.next()).await?.transpose();
        self.count(piece.map_err(|error| ApiError::Body { reason: error.to_string() })?)
    }

    /// The bytes that have arrived, unless they are too many.
    fn count(&mut self, piece: Option<Bytes>) -> Result<Option<Bytes>, ApiError> {
        self.received += piece.as_ref().map_or(0, |piece| piece.len() as u64);
        match self.received > self.limit {
            true => Err(ApiError::UploadTooLarge { limit: self.limit }),
            false => Ok(piece),
        }
    }
}
