//! Files that the store holds, and how they are sent.

use axum::body::{Body, Bytes};
use futures::stream::{self, StreamExt, TryStreamExt};
use spec::Digest;
use store::StoredObject;

use crate::app::App;
use crate::download::FileInfo;
use crate::error::ApiError;

/// A file about to be sent.
#[derive(Clone, Debug)]
pub struct Download {
    pub info: FileInfo,
    content: Content,
}

/// Where the bytes of a file are.
#[derive(Clone, Debug)]
enum Content {
    /// In the store. `file` says which file it is to a reader.
    Stored { object: StoredObject, file: String },
    /// Here.
    Made(Bytes),
}

impl Download {
    /// `file` names it where it is damaged, e.g. `config.json of checkpoint 7`.
    pub fn new(name: String, media_type: &str, object: &StoredObject, file: String) -> Self {
        let info = FileInfo {
            name,
            media_type: media_type.to_owned(),
            size: object.size,
            sha256: object.sha256,
        };
        Self { info, content: Content::Stored { object: object.clone(), file } }
    }

    /// A file that is made when it is asked for.
    pub fn made(name: String, media_type: &str, bytes: Vec<u8>) -> Self {
        let info = FileInfo {
            name,
            media_type: media_type.to_owned(),
            size: bytes.len() as u64,
            sha256: Digest::of(&bytes),
        };
        Self { info, content: Content::Made(bytes.into()) }
    }
}

impl App {
    /// The bytes of `part` of a file, read as they are sent. The body of a whole file that turns out damaged ends with
    /// an error before its last bytes, so that nobody takes it for the file.
    ///
    /// # Errors
    /// [`ApiError::Damaged`] when the file is known to be, or shows it in its first piece.
    pub async fn read(
        &self,
        file: &Download,
        part: std::ops::Range<u64>,
    ) -> Result<Body, ApiError> {
        if part.is_empty() {
            return Ok(Body::empty());
        }
        match &file.content {
            Content::Stored { object, file } => {
                let place = self.download_place()?;
                let failed = |error| ApiError::reading(file, error);
                let opened = self.store.open_object(object, Some(part)).await.map_err(failed)?;
                // The place is free again when the body is sent or given up.
                let mut pieces = opened.stream.inspect_ok(move |_| {
                    let _held = &place;
                });
                // With the first piece in hand, a small file that is damaged is still answered with a problem.
                let first = pieces.try_next().await.map_err(failed)?;
                Ok(Body::from_stream(stream::iter(first.map(Ok)).chain(pieces)))
            }
            Content::Made(bytes) => {
                let position = |at: u64| usize::try_from(at).unwrap_or(usize::MAX).min(bytes.len());
                Ok(Body::from(bytes.slice(position(part.start)..position(part.end))))
            }
        }
    }

    /// Looks whether the bytes of a file could be sent, as a request for its headers alone wants to know.
    ///
    /// # Errors
    /// [`ApiError::Damaged`] when the file is missing or known to be damaged.
    pub async fn look_up(&self, file: &Download) -> Result<(), ApiError> {
        match &file.content {
            Content::Stored { object, file } => {
                let found = self.store.look_up_object(object).await;
                found.map_err(|error| ApiError::reading(file, error))
            }
            Content::Made(_) => Ok(()),
        }
    }
}
