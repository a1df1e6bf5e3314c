//! The files of a run, sent through the MLflow server to where it keeps them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::{Deserialize, Serialize};
use spec::Digest;
use wire::StoredFile;

use super::entities::Run;
use super::server::MlflowServer;
use super::source;
use crate::client::Client;

/// The file that says which bytes the others have. It is written last, and holds the whole run as `/v1/runs/ID` has it.
pub const MANIFEST: &str = "torqued.json";

/// Whether files are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    Sent,
    LeftOut,
}

#[derive(Serialize)]
struct Manifest<'a> {
    run: &'a wire::Run,
    /// SHA-256 by name.
    files: BTreeMap<&'a str, Digest>,
}

#[derive(Default, Deserialize)]
struct Sent {
    #[serde(default)]
    files: BTreeMap<String, Digest>,
}

/// A folder for one file at a time, deleted at the end.
struct Scratch(PathBuf);

impl Scratch {
    fn new(run: &Run) -> anyhow::Result<Self> {
        let name = format!("torqued-export-{}-{}", std::process::id(), run.info.run_id);
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
        Ok(Self(folder))
    }

    fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Sends the files that are missing or differ; returns how many.
pub async fn send(
    client: &Client,
    server: &MlflowServer,
    run: &wire::Run,
    there: &Run,
) -> anyhow::Result<usize> {
    let place = server.files_url(&there.info.artifact_uri)?;
    let files = source::files(client, run).await?;
    let sizes = sizes(server, there, &files).await?;
    let before = match sizes.contains_key(MANIFEST) {
        true => server.file(&place, MANIFEST).await?,
        false => Vec::new(),
    };
    let sent: Sent = serde_json::from_slice(&before).unwrap_or_default();
    let is_there = |name: &str, file: &StoredFile| {
        sent.files.get(name) == Some(&file.sha256)
            && sizes.get(name).is_some_and(|size| *size == i64::try_from(file.size).ok())
    };
    let scratch = Scratch::new(there)?;
    let mut count = 0;
    for (name, file) in files.iter().filter(|(name, file)| !is_there(name, file)) {
        client.fetch(file, scratch.path(), |_| {}).await?;
        let path = scratch.path().join(&file.name);
        server.send_file(&place, name, &path).await?;
        std::fs::remove_file(&path).with_context(|| format!("cannot delete {}", path.display()))?;
        count += 1;
    }
    let files = files.iter().map(|(name, file)| (name.as_str(), file.sha256)).collect();
    let manifest = serde_json::to_vec_pretty(&Manifest { run, files })?;
    if manifest != before {
        server.send_bytes(&place, MANIFEST, manifest).await?;
    }
    Ok(count)
}

/// Sizes of what MLflow has in the folders of these files, by name.
async fn sizes(
    server: &MlflowServer,
    there: &Run,
    files: &[(String, StoredFile)],
) -> anyhow::Result<BTreeMap<String, Option<i64>>> {
    let folder = |name: &str| name.rsplit_once('/').map_or("", |(folder, _)| folder).to_owned();
    let mut folders: BTreeSet<String> = files.iter().map(|(name, _)| folder(name)).collect();
    folders.insert(String::new());
    let mut sizes = BTreeMap::new();
    for folder in folders {
        let found = server.files(&there.info.run_id, &folder).await?;
        let found = found.into_iter().filter(|file| !file.is_dir);
        sizes.extend(found.map(|file| (file.path, file.file_size)));
    }
    Ok(sizes)
}
