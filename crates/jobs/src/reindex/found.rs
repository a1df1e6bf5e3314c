//! Groups objects by their paths.

use std::collections::BTreeMap;

use store::{Epoch, FileContent, JobId, Store, StoreError};

use super::work::{FoundObjects, Written};
use super::{shards, trainings};

/// Objects, sorted by the information in their paths.
#[derive(Debug, Default)]
pub(super) struct Sorted {
    pub shards: BTreeMap<JobId, BTreeMap<Written, BTreeMap<FileContent, String>>>,
    /// The files of a checkpoint with their names.
    pub checkpoints: BTreeMap<JobId, BTreeMap<Written, BTreeMap<String, String>>>,
    uploads: Vec<String>,
}

/// Reads the descriptions that objects carry, and checks the digests that they state.
///
/// # Errors
/// When they cannot be listed. An object that cannot be read is left out.
pub async fn find_objects(store: &Store) -> Result<FoundObjects, StoreError> {
    let mut found = FoundObjects::default();
    let mut sorted = Sorted::default();
    for path in store.list_objects().await? {
        found.note_ids(&path);
        if !sorted.add(&path) {
            found.leave_out(path, "it does not describe itself");
        }
    }
    for path in std::mem::take(&mut sorted.uploads) {
        match store.find_object(&path).await {
            Ok(upload) => found.uploads.push(upload),
            Err(error) => found.leave_out(path, error.to_string()),
        }
    }
    shards::read(store, sorted.shards, &mut found).await;
    trainings::read(store, sorted.checkpoints, &mut found).await;
    Ok(found)
}

impl FoundObjects {
    /// Records the ids in a path. They are never assigned again, whatever happens to the object.
    fn note_ids(&mut self, path: &str) {
        let mut parts = path.split('/');
        let (kind, id) = (parts.next(), parts.next().and_then(|id| id.parse::<i64>().ok()));
        match (kind, id) {
            (Some("datasets" | "checkpoints"), Some(id)) => self.last_job = self.last_job.max(id),
            (Some("runs"), Some(id)) => self.last_run = self.last_run.max(id),
            _ => {}
        }
    }
}

impl Sorted {
    /// Returns false for the path of an object that does not describe itself.
    fn add(&mut self, path: &str) -> bool {
        let parts: Vec<&str> = path.split('/').collect();
        let added = match parts[..] {
            ["uploads", _] => {
                self.uploads.push(path.to_owned());
                Some(())
            }
            ["datasets", job, file] => self.add_shard(job, file, path),
            ["checkpoints", job, folder, file] => self.add_checkpoint(job, folder, file, path),
            _ => None,
        };
        added.is_some()
    }

    fn add_shard(&mut self, job: &str, file: &str, path: &str) -> Option<()> {
        let (written, content) = written(file.strip_suffix(".parquet")?, "shard-")?;
        let content = FileContent::ALL.into_iter().find(|known| known.as_str() == content)?;
        let of_job = self.shards.entry(JobId(job.parse().ok()?)).or_default();
        of_job.entry(written).or_default().insert(content, path.to_owned());
        Some(())
    }

    fn add_checkpoint(&mut self, job: &str, folder: &str, file: &str, path: &str) -> Option<()> {
        let (written, _) = written(folder, "step-")?;
        let of_job = self.checkpoints.entry(JobId(job.parse().ok()?)).or_default();
        of_job.entry(written).or_default().insert(file.to_owned(), path.to_owned());
        Some(())
    }
}

/// Reads number, epoch and rest of `PREFIX-NUMBER-eEPOCH-REST`, as [`store::object_path`] writes
/// it.
fn written<'a>(name: &'a str, prefix: &str) -> Option<(Written, &'a str)> {
    let (number, rest) = name.strip_prefix(prefix)?.split_once("-e")?;
    let (epoch, rest) = rest.split_once('-').unwrap_or((rest, ""));
    let epoch = Epoch(epoch.parse().ok()?);
    Some((Written { number: number.parse().ok()?, epoch }, rest))
}

#[cfg(test)]
mod tests {
    use store::object_path;

    use super::*;

    #[test]
    fn paths_say_again_what_they_were_made_of() {
        let mut sorted = Sorted::default();
        let written = Written { number: 7, epoch: Epoch(3) };
        let shard = object_path::shard(JobId(5), 7, Epoch(3), FileContent::Robots);
        let file = object_path::checkpoint(JobId(6), 7, Epoch(3), "model.safetensors");
        for path in [&shard, &file] {
            assert!(sorted.add(path), "{path}");
        }
        assert_eq!(sorted.shards[&JobId(5)][&written][&FileContent::Robots], shard);
        assert_eq!(sorted.checkpoints[&JobId(6)][&written]["model.safetensors"], file);
        for other in ["runs/3/x-e1-report.json", "datasets/5/notes.txt", "datasets/a/b/c", "x"] {
            assert!(!sorted.add(other), "{other}");
        }
    }
}
