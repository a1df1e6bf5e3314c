//! Uploads a file.

use std::io;
use std::path::Path;
use std::time::Duration;

use reqwest::{Body, Method, Url};
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use spec::{Digest, FileFormat};
use tokio::io::AsyncReadExt;
use tokio_util::io::ReaderStream;
use wire::{LabelChange, TextChange};

use super::{Client, ClientError, Reuse, Submitted};

/// Time limit of an upload, which the server has too.
const TIMEOUT: Duration = Duration::from_secs(6 * 60 * 60);

/// Number of bytes that are read from the disk at once.
const PIECE: usize = 256 * 1024;

impl Client {
    /// Imports `file` according to `spec`, which names its format. A file that the server already
    /// has is not sent again, because its digest is enough. `labels` are the parameters `name`,
    /// `note` and `tag` of the job. A job that existed before keeps its name and its note.
    pub async fn import(
        &self,
        file: &Path,
        spec: &Value,
        reuse: Reuse,
        labels: &[(&str, &str)],
    ) -> Result<Submitted, ClientError> {
        let unreadable = |reason| ClientError::File { path: file.to_owned(), reason };
        let mut known = spec.clone();
        known["kind"] = json!("import");
        known["file"] = json!(sha256(file).await.map_err(unreadable)?);
        match self.submit_labelled(known.to_string().into_bytes(), reuse, labels).await {
            Err(ClientError::Refused { fields, .. }) if fields == ["file"] => {}
            other => return other,
        }
        let submitted = self.send_file(file, spec, reuse).await?;
        if labels.is_empty() {
            return Ok(submitted);
        }
        let id = submitted.job.id;
        let existed = submitted.existed;
        self.label(&format!("/v1/jobs/{id}"), &change(labels, existed)).await?;
        Ok(Submitted { job: self.job(id).await?, existed })
    }

    async fn send_file(
        &self,
        path: &Path,
        spec: &Value,
        reuse: Reuse,
    ) -> Result<Submitted, ClientError> {
        let unreadable = |reason| ClientError::File { path: path.to_owned(), reason };
        let file = tokio::fs::File::open(path).await.map_err(unreadable)?;
        let size = file.metadata().await.map_err(unreadable)?.len();
        // The server has checked everything in the spec except the file.
        let format = FileFormat::deserialize(&spec["format"]);
        let media_type = format.map_or("application/octet-stream", FileFormat::media_type);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let mut parameters = vec![("spec", spec.to_string()), ("name", name.into_owned())];
        if reuse == Reuse::ComputeAnew {
            parameters.push(("force", "true".to_owned()));
        }
        let query = form_urlencoded(&parameters);
        let request = self
            .request(Method::POST, &format!("/v1/datasets?{query}"))
            .timeout(TIMEOUT)
            .header("content-type", media_type)
            .header("content-length", size)
            .body(Body::wrap_stream(ReaderStream::with_capacity(file, PIECE)));
        self.submitted(request).await
    }
}

/// The change of a job that gives it `labels`. A job that existed before gets only the tags.
fn change(labels: &[(&str, &str)], existed: bool) -> LabelChange {
    let mut change = LabelChange::default();
    for (key, text) in labels {
        let text = (*text).to_owned();
        match *key {
            "tag" => change.add_tags.push(text),
            "name" if !existed => change.name = TextChange::Set(text),
            "note" if !existed => change.note = TextChange::Set(text),
            _ => {}
        }
    }
    change
}

/// Encodes a query string.
fn form_urlencoded(parameters: &[(&str, String)]) -> String {
    // Any address works for appending a query.
    let url = Url::parse_with_params("http://localhost", parameters);
    url.ok().and_then(|url| url.query().map(str::to_owned)).unwrap_or_default()
}

/// The SHA-256 digest of a file.
pub(super) async fn sha256(path: &Path) -> io::Result<Digest> {
    let mut file = tokio::fs::File::open(path).await?;
    let mut digest = Sha256::new();
    let mut piece = vec![0; PIECE];
    loop {
        match file.read(&mut piece).await? {
            0 => return Ok(Digest::from_bytes(digest.finalize().into())),
            read => digest.update(&piece[..read]),
        }
    }
}
