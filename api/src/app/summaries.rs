//! The summary of a dataset in a few numbers.

use spec::{Column, DataSpec, JobSpec};
use store::{DatasetId, ShardSummary, Spectrum};
use wire::{ChannelSummary, SpectrumSummary, Summary};

use crate::app::App;
use crate::error::ApiError;

impl App {
    /// # Errors
    /// When there is no such dataset.
    pub(crate) async fn summary(&self, dataset: i64) -> Result<Summary, ApiError> {
        let row = self.store.dataset(DatasetId(dataset)).await?;
        let shards = self.store.shards(row.id).await?;
        let ShardSummary { trajectories: summarized, channels, spectra, arms, .. } =
            self.store.dataset_summary(row.id).await?.unwrap_or_default();
        let trajectories: u64 = shards.iter().map(|shard| shard.contents.count).sum();
        let spec = serde_json::from_value::<JobSpec>(row.spec).ok();
        let data = spec.as_ref().and_then(DataSpec::of);
        let columns = data.as_ref().map(DataSpec::trajectory_columns).unwrap_or_default();
        let of_robots = data.as_ref().map(DataSpec::table_columns).unwrap_or_default();
        Ok(Summary {
            dataset,
            trajectories,
            first: shards.first().map_or(0, |shard| shard.contents.first),
            samples: trajectories * u64::from(row.samples),
            rejected: shards.iter().map(|shard| shard.contents.rejected).sum(),
            summarized,
            channels: channels.into_iter().map(|channel| described(channel, &columns)).collect(),
            spectra: spectra.into_iter().map(spectrum).collect(),
            arms: arms.into_iter().map(|arm| described(arm, &of_robots)).collect(),
        })
    }
}

fn described(channel: store::ChannelSummary, columns: &[Column]) -> ChannelSummary {
    let column = columns.iter().find(|column| column.name == channel.name);
    ChannelSummary {
        unit: column.and_then(|column| column.unit.clone()),
        about: column.map(|column| column.about.clone()),
        name: channel.name,
        min: channel.min,
        max: channel.max,
        mean: channel.mean,
        std: channel.std,
    }
}

fn spectrum(row: Spectrum) -> SpectrumSummary {
    let unit = match row.signal.as_str() {
        "u" => "(N·m)²/Hz",
        _ => "rad²/Hz",
    };
    SpectrumSummary {
        signal: row.signal,
        joint: row.joint,
        unit: unit.to_owned(),
        trajectories: row.trajectories,
        step_hz: row.step_hz,
        density: row.density,
    }
}
