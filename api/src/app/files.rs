//! Files that the store holds, and how they are sent.

use axum::body::Body;
use serde::Serialize;
use spec::Digest;
use store::StoredObject;
use utoipa::ToSchema;

use crate::app::App;
use crate::download::FileInfo;
use crate::error::ApiError;

/// A file that can be downloaded.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct StoredFile {
    pub name: String,
    /// In bytes.
    pub size: u64,
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}

/// A file about to be sent.
#[derive(Clone, Debug)]
pub struct Download {
    pub info: FileInfo,
    path: String,
}

impl Download {
    pub fn new(name: String, media_type: &str, object: &StoredObject) -> Self {
        let info = FileInfo {
            name,
            media_type: media_type.to_owned(),
            size: object.size,
            sha256: object.sha256,
        };
        Self { info, path: object.path.clone() }
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
        let bytes = self.store.open_object(&file.path, Some(part)).await?;
        Ok(Body::from_stream(bytes.stream))
    }
}
