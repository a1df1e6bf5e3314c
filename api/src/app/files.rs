//! Sends files from the store.

use std::ops::Range;

use axum::BoxError;
use axum::body::{Body, Bytes};
use axum::http::Method;
use futures::stream::{self, BoxStream, StreamExt, TryStreamExt};
use spec::Digest;
use store::{SignedFor, StoredObject};

use crate::app::App;
use crate::app::archive::{Archive, Content, Member};
use crate::download::{FileInfo, Identity};
use crate::error::ApiError;
use crate::limits::SIGNED_FOR;

/// A file about to be sent.
#[derive(Clone, Debug)]
pub struct Download {
    pub info: FileInfo,
    source: Source,
}

/// The source of a file's bytes.
#[derive(Clone, Debug)]
enum Source {
    One(Content),
    Many(Archive),
}

impl Download {
    /// A stored file. `file` names it in errors, e.g. `config.json of checkpoint 7`.
    pub fn new(name: String, media_type: &str, object: &StoredObject, file: String) -> Self {
        let info = FileInfo {
            name,
            media_type: media_type.to_owned(),
            size: object.size,
            identity: Identity::Bytes(object.sha256),
        };
        Self { info, source: Source::One(Content::Stored { object: object.clone(), file }) }
    }

    /// A file that is made on request.
    pub fn made(name: String, media_type: &str, bytes: Vec<u8>) -> Self {
        let info = FileInfo {
            name,
            media_type: media_type.to_owned(),
            size: bytes.len() as u64,
            identity: Identity::Bytes(Digest::of(&bytes)),
        };
        Self { info, source: Source::One(Content::Made(bytes.into())) }
    }

    /// A tar of the files of the thing called `name`, such as `dataset-3`, in a folder of that
    /// name.
    ///
    /// # Errors
    /// [`ApiError::Internal`] when a name is too long for a tar. None of ours is.
    pub fn tar(name: &str, files: Vec<Member>) -> Result<Self, ApiError> {
        let archive = Archive::new(name, files).map_err(|error| {
            tracing::error!("cannot put {name} into a tar: {error}");
            ApiError::Internal
        })?;
        let info = FileInfo {
            name: format!("{name}.tar"),
            media_type: "application/x-tar".to_owned(),
            size: archive.size,
            identity: Identity::Parts(archive.digest),
        };
        Ok(Self { info, source: Source::Many(archive) })
    }

    /// The contents that overlap `part`, with the overlapping bytes of each.
    fn parts(&self, part: Range<u64>) -> Vec<(Content, Range<u64>)> {
        match &self.source {
            Source::One(content) => vec![(content.clone(), part)],
            Source::Many(archive) => archive.parts(part).collect(),
        }
    }

    /// Whether all of it is in memory, so that sending it reads nothing.
    fn is_made(&self) -> bool {
        matches!(self.source, Source::One(Content::Made(_)))
    }
}

impl App {
    /// The bytes of `part` of a file, which are read while they are sent. If a whole file turns out
    /// to be damaged, its body ends with an error before the last bytes, so nobody takes it for the
    /// file. In a tar, the body ends before the last bytes of the damaged file.
    ///
    /// # Errors
    /// [`ApiError::Damaged`] when the damage is known, or the first piece shows it.
    pub(crate) async fn read(&self, file: &Download, part: Range<u64>) -> Result<Body, ApiError> {
        if part.is_empty() {
            return Ok(Body::empty());
        }
        let mut parts = file.parts(part).into_iter();
        let Some((content, range)) = parts.next() else { return Ok(Body::empty()) };
        let place = if file.is_made() { None } else { Some(self.places.download()?) };
        // The first piece is read before answering, so a small damaged file still gets a problem as
        // its answer.
        let mut pieces = self.open(&content, range).await?;
        let first = pieces.try_next().await?;
        let app = self.clone();
        let others = stream::iter(parts)
            .then(move |(content, range)| {
                let app = app.clone();
                async move { app.open(&content, range).await }
            })
            .try_flatten();
        let pieces = stream::iter(first.map(Ok)).chain(pieces).chain(others);
        // The permit is released when the body is sent or dropped.
        let pieces = pieces.map_err(BoxError::from).inspect_ok(move |_| {
            let _held = &place;
        });
        Ok(Body::from_stream(pieces))
    }

    async fn open(
        &self,
        content: &Content,
        range: Range<u64>,
    ) -> Result<BoxStream<'static, Result<Bytes, ApiError>>, ApiError> {
        match content {
            Content::Stored { object, file } => {
                let file = file.clone();
                let failed = move |error| ApiError::reading(&file, error);
                let opened = self.store.open_object(object, Some(range)).await;
                Ok(opened.map_err(&failed)?.stream.map_err(failed).boxed())
            }
            Content::Made(bytes) => {
                let position = |at: u64| usize::try_from(at).unwrap_or(usize::MAX).min(bytes.len());
                let bytes = bytes.slice(position(range.start)..position(range.end));
                Ok(stream::iter([Ok(bytes)]).boxed())
            }
        }
    }

    /// A URL at which anybody can get the file from its bucket, for [`SIGNED_FOR`]. `None` if the
    /// file is not in a bucket.
    ///
    /// # Errors
    /// [`ApiError::Damaged`] when the file is missing or known to be damaged.
    pub(crate) async fn address(
        &self,
        file: &Download,
        method: &Method,
    ) -> Result<Option<String>, ApiError> {
        let Source::One(Content::Stored { object, file }) = &file.source else { return Ok(None) };
        let method = if method == Method::HEAD { SignedFor::Head } else { SignedFor::Get };
        let signed = self.store.signed_url(object, method, SIGNED_FOR).await;
        signed.map_err(|error| ApiError::reading(file, error))
    }

    /// Checks that a file can be sent, for requests that only want its headers.
    ///
    /// # Errors
    /// [`ApiError::Damaged`] when the file is missing or known to be damaged.
    pub(crate) async fn look_up(&self, file: &Download) -> Result<(), ApiError> {
        for (content, _) in file.parts(0..file.info.size) {
            if let Content::Stored { object, file } = content {
                let found = self.store.look_up_object(&object).await;
                found.map_err(|error| ApiError::reading(&file, error))?;
            }
        }
        Ok(())
    }
}
