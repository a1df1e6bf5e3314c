//! Paths of results on this machine's disk, for the user who runs the server on it.

use std::path::{Path, PathBuf};

use anyhow::Context;
use store::{CheckpointId, DatasetId, JobId, StoredObject};

use super::Server;

impl Server {
    /// The folder of a dataset's Parquet files.
    pub async fn dataset_folder(&self, dataset: i64) -> anyhow::Result<PathBuf> {
        let shards = self.store.shards(DatasetId(dataset)).await?;
        let shard = shards.first().with_context(|| format!("dataset {dataset} has no shards"))?;
        Ok(self.folder_of(&shard.contents.trajectories))
    }

    /// The folder of a checkpoint's files.
    pub async fn checkpoint_folder(&self, checkpoint: i64) -> anyhow::Result<PathBuf> {
        let checkpoint = self.store.checkpoint(CheckpointId(checkpoint)).await?;
        let file = checkpoint.files.first().context("the checkpoint has no files")?;
        Ok(self.folder_of(&file.object))
    }

    /// A file that an evaluation made.
    pub async fn artifact_file(&self, evaluation: i64, name: &str) -> anyhow::Result<PathBuf> {
        let run = self.store.run_of_job(JobId(evaluation)).await?;
        let artifact = self.store.artifact(run.id, name).await?;
        Ok(self.path_of(&artifact.object))
    }

    fn path_of(&self, object: &StoredObject) -> PathBuf {
        let data = self.data.canonicalize().unwrap_or_else(|_| self.data.clone());
        data.join("objects").join(&object.path)
    }

    fn folder_of(&self, object: &StoredObject) -> PathBuf {
        let path = self.path_of(object);
        path.parent().map_or_else(|| path.clone(), Path::to_path_buf)
    }
}
