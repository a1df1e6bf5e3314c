//! Files that the store holds, and how they are sent.

use axum::body::{Body, Bytes};
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
    /// An object of the store, by its path.
    Stored(String),
    /// Here.
    Made(Bytes),
}

impl Download {
    pub fn new(name: String, media_type: &str, object: &StoredObject) -> Self {
        let info = FileInfo {
            name,
            media_type: media_type.to_owned(),
            size: object.size,
            sha256: object.sha256,
        };
        Self { info, content: Content::Stored(object.path.clone()) }
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
    /// The bytes of `part` of a file, read as they are sent.
    pub async fn read(
        &self,
        file: &Download,
        part: std::ops::Range<u64>,
    ) -> Result<Body, ApiError> {
        if part.is_empty() {
            return Ok(Body::empty());
        }
        match &file.content {
            Content::Stored(path) => {
                let bytes = self.store.open_object(path, Some(part)).await?;
                Ok(Body::from_stream(bytes.stream))
            }
            Content::Made(bytes) => {
                let position = |at: u64| usize::try_from(at).unwrap_or(usize::MAX).min(bytes.len());
                Ok(Body::from(bytes.slice(position(part.start)..position(part.end))))
            }
        }
    }
}
