//! Exports a dataset in LeRobot's format v3.0. Each trajectory is an episode, with the positions of
//! all joints in `observation.state` and their torques in `action`.
//! <https://huggingface.co/docs/lerobot/lerobot-dataset-v3>

use std::path::Path;

use anyhow::{Context, ensure};
use serde_json::Value;
use store::DatasetDescription;
use wire::{Dataset, DatasetFile, DatasetState, FileKind, StoredFile};

use super::Done;
use super::lerobot_meta as meta;
use super::lerobot_shard::{Features, convert};
use crate::client::Client;

/// Largest number of files in a folder, as in LeRobot.
pub const FILES_PER_CHUNK: u32 = 1000;

/// The folder for shards until they are converted.
const DOWNLOADS: &str = "downloads";

/// Returns `meta/info.json`.
pub async fn export(client: &Client, id: i64, out: &Path, done: &Done) -> anyhow::Result<Value> {
    let dataset: Dataset = client.get(&format!("/v1/datasets/{id}")).await?;
    ensure!(
        dataset.state == DatasetState::Complete,
        "dataset {id} is {}; it can be exported when it is complete",
        dataset.state
    );
    let downloads = out.join(DOWNLOADS);
    std::fs::create_dir_all(&downloads)
        .with_context(|| format!("cannot create {}", downloads.display()))?;
    let description = description(client, &dataset, &downloads).await?;
    let mut features = Features::of(&description.columns.trajectories)?;
    let shards: Vec<&DatasetFile> =
        dataset.files.iter().filter(|file| file.content == FileKind::Trajectories).collect();
    done.begin(shards.iter().map(|shard| shard.size).sum());
    for shard in shards {
        let ordinal = shard.shard.context("a table of trajectories belongs to no shard")?;
        let file = stored(shard);
        client.fetch(&file, &downloads, |_| {}).await?;
        let from = downloads.join(&file.name);
        let to = meta::data_file(out, ordinal);
        let timing = meta::Timing { samples: description.samples, rate_hz: description.rate_hz };
        features =
            tokio::task::spawn_blocking(move || convert(&from, &to, timing, features)).await??;
        done.add(shard.size);
    }
    let info = meta::write(out, &dataset.name, &description, &features)?;
    std::fs::remove_dir_all(&downloads)
        .with_context(|| format!("cannot delete {}", downloads.display()))?;
    Ok(info)
}

async fn description(
    client: &Client,
    dataset: &Dataset,
    downloads: &Path,
) -> anyhow::Result<DatasetDescription> {
    let file = dataset.files.iter().find(|file| file.content == FileKind::Description);
    let file =
        file.context("the dataset has no dataset.json; another version of torqued made it")?;
    client.fetch(&stored(file), downloads, |_| {}).await?;
    let text = std::fs::read(downloads.join(&file.name))?;
    serde_json::from_slice(&text).context("dataset.json is of another version of torqued")
}

fn stored(file: &DatasetFile) -> StoredFile {
    StoredFile {
        name: file.name.clone(),
        size: file.size,
        sha256: file.sha256,
        url: file.url.clone(),
    }
}
