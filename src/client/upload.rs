//! Uploads files of recordings.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use futures::TryFutureExt;
use reqwest::header::{CONTENT_TYPE, HeaderMap, HeaderValue};
use reqwest::multipart::{Form, Part};
use reqwest::{Body, Method};
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use spec::{Digest, FileFormat, LISTED_VIOLATIONS};
use tokio::io::AsyncReadExt;
use tokio_util::io::ReaderStream;
use wire::{LabelChange, TextChange};

use super::{Client, ClientError, Reuse, Submitted};

/// Time limit of an upload, which the server has too.
const TIMEOUT: Duration = Duration::from_secs(6 * 60 * 60);

/// Number of bytes that are read from the disk at once.
const PIECE: usize = 256 * 1024;

/// A file of recordings, as an import reads it.
pub struct RecordedFile {
    /// Its path.
    pub path: PathBuf,
    /// The name of its recordings, if there are several files.
    pub name: Option<String>,
}

impl RecordedFile {
    /// Names files by their names, with as many of their folders as it takes to tell them apart.
    /// The names have no extensions where files differ without them. A single file needs no name.
    pub fn named(paths: &[PathBuf]) -> Vec<Self> {
        let stems: Vec<PathBuf> = paths.iter().map(|path| path.with_extension("")).collect();
        let names = endings(&stems).or_else(|| endings(paths));
        let name = |at: usize| match &names {
            _ if paths.len() == 1 => None,
            Some(names) => Some(names[at].clone()),
            // The server refuses equal names.
            None => Some(paths[at].to_string_lossy().into_owned()),
        };
        let named = paths.iter().enumerate();
        named.map(|(at, path)| Self { path: path.clone(), name: name(at) }).collect()
    }

    /// States the files of an import, with their digests.
    pub fn state(files: &[Self], digests: &[Digest], spec: &mut Value) {
        let Some(fields) = spec.as_object_mut() else { return };
        fields.remove("file");
        fields.remove("files");
        let each = files.iter().zip(digests);
        let listed: Vec<Value> = each
            .filter_map(|(file, digest)| {
                file.name.as_ref().map(|name| json!({"name": name, "file": digest}))
            })
            .collect();
        match digests {
            [only] if listed.is_empty() => fields.insert("file".to_owned(), json!(only)),
            _ => fields.insert("files".to_owned(), listed.into()),
        };
    }
}

/// The shortest ending of each path that no other one has. `None` if two are equal.
fn endings(paths: &[PathBuf]) -> Option<Vec<String>> {
    let shortest = |path: &PathBuf| {
        (1..=path.components().count()).find_map(|parts| {
            let name = ending(path, parts);
            let same = paths.iter().filter(|other| ending(other, parts) == name);
            (same.count() == 1).then_some(name)
        })
    };
    paths.iter().map(shortest).collect()
}

/// The last parts of a path.
fn ending(path: &Path, parts: usize) -> String {
    let all: Vec<_> = path.components().collect();
    let kept: PathBuf = all[all.len().saturating_sub(parts)..].iter().collect();
    kept.to_string_lossy().into_owned()
}

impl Client {
    /// Imports `files` according to `spec`, which names their format. Files that the server already
    /// has are not sent again, because their digests are enough. `labels` are the parameters `name`,
    /// `note` and `tag` of the job. A job that existed before keeps its name and its note.
    pub async fn import(
        &self,
        files: &[RecordedFile],
        spec: &Value,
        reuse: Reuse,
        labels: &[(&str, &str)],
    ) -> Result<Submitted, ClientError> {
        let mut spec = spec.clone();
        spec["kind"] = json!("import");
        let mut digests = Vec::new();
        for RecordedFile { path, .. } in files {
            let unreadable = |reason| ClientError::File { path: path.clone(), reason };
            digests.push(sha256(path).await.map_err(unreadable)?);
        }
        RecordedFile::state(files, &digests, &mut spec);
        let unsent = match self.submit_labelled(spec.to_string().into_bytes(), reuse, labels).await
        {
            Err(ClientError::Refused { fields, .. }) if is_of_files(&fields) => {
                unsent(files, &fields)
            }
            other => return other,
        };
        let submitted = self.send_files(&unsent, &spec, reuse).await?;
        if labels.is_empty() {
            return Ok(submitted);
        }
        let id = submitted.job.id;
        let existed = submitted.existed;
        self.label(&format!("/v1/jobs/{id}"), &change(labels, existed)).await?;
        Ok(Submitted { job: self.job(id).await?, existed })
    }

    async fn send_files(
        &self,
        files: &[&RecordedFile],
        spec: &Value,
        reuse: Reuse,
    ) -> Result<Submitted, ClientError> {
        // The server has checked everything in the spec except the files.
        let format = FileFormat::deserialize(&spec["format"]);
        let media_type = format.map_or("application/octet-stream", FileFormat::media_type);
        let headers = HeaderMap::from_iter([(CONTENT_TYPE, HeaderValue::from_static(media_type))]);
        let mut form = Form::new().text("spec", spec.to_string());
        for RecordedFile { path, .. } in files {
            let unreadable = |reason| ClientError::File { path: path.clone(), reason };
            let size = tokio::fs::metadata(path).await.map_err(unreadable)?.len();
            // Each is opened when those before it are sent.
            let content = tokio::fs::File::open(path.clone())
                .map_ok(|file| ReaderStream::with_capacity(file, PIECE))
                .try_flatten_stream();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let part = Part::stream_with_length(Body::wrap_stream(content), size).file_name(name);
            form = form.part("file", part.headers(headers.clone()));
        }
        let force = if reuse == Reuse::ComputeAnew { "?force=true" } else { "" };
        let request = self.request(Method::POST, &format!("/v1/datasets{force}"));
        self.submitted(request.timeout(TIMEOUT).multipart(form)).await
    }
}

/// Whether a spec was refused for nothing but files that the server does not have.
fn is_of_files(fields: &[String]) -> bool {
    let is_file = |field: &String| {
        field == "file" || (field.starts_with("files[") && field.ends_with("].file"))
    };
    !fields.is_empty() && fields.iter().all(is_file)
}

/// The files that the server does not have: all of them if the answer may list only some.
fn unsent<'a>(files: &'a [RecordedFile], fields: &[String]) -> Vec<&'a RecordedFile> {
    let is_unsent = |i: usize| {
        files.len() == 1
            || fields.len() >= LISTED_VIOLATIONS
            || fields.contains(&format!("files[{i}].file"))
    };
    files.iter().enumerate().filter(|(i, _)| is_unsent(*i)).map(|(_, file)| file).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_as_shortly_as_they_differ() {
        let names = |paths: &[&str]| {
            let paths: Vec<PathBuf> = paths.iter().map(PathBuf::from).collect();
            let named = RecordedFile::named(&paths).into_iter();
            named.map(|file| file.name.unwrap_or_default()).collect::<Vec<_>>()
        };
        assert_eq!(names(&["/logs/monday.csv"]), [""]);
        assert_eq!(names(&["/logs/monday.csv", "tue.v2.csv"]), ["monday", "tue.v2"]);
        let twins = ["/a/1/log.csv", "/a/2/log.csv", "/b/other.csv"];
        assert_eq!(names(&twins), ["1/log", "2/log", "other"]);
        assert_eq!(names(&["a/log.csv", "a/log.txt"]), ["log.csv", "log.txt"]);
        assert_eq!(names(&["run-0.1", "run-0.2"]), ["run-0.1", "run-0.2"]);
        let same = ["log.csv", "log.csv"];
        assert_eq!(names(&same), same, "the server refuses them");
    }
}
