//! What a dataset holds, in a few numbers.

use serde::Serialize;
use spec::{Column, DataSpec, JobSpec};
use store::{DatasetId, ShardSummary, Spectrum};
use utoipa::ToSchema;

use crate::app::App;
use crate::error::ApiError;

/// Counts, ranges and spectra over the shards that are finished.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Summary {
    pub dataset: i64,
    /// In the shards that are finished.
    pub trajectories: u64,
    /// Index of the first of them.
    pub first: u64,
    /// Of all those trajectories together.
    pub samples: u64,
    /// Draws refused on the way to those trajectories.
    pub rejected: u64,
    /// Trajectories that channels and spectra tell of: all, unless another version of torqued made
    /// them.
    pub summarized: u64,
    pub channels: Vec<ChannelSummary>,
    pub spectra: Vec<SpectrumSummary>,
}

/// All samples of a channel.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct ChannelSummary {
    #[schema(example = "q1")]
    pub name: String,
    #[schema(example = "rad")]
    pub unit: Option<String>,
    pub about: Option<String>,
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    /// Standard deviation.
    pub std: f64,
}

/// Mean one-sided power spectral density over the seven joints and some trajectories of each
/// shard, with means removed and a Hann window.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct SpectrumSummary {
    /// `u` or `q`.
    #[schema(example = "q")]
    pub signal: String,
    #[schema(example = "rad²/Hz")]
    pub unit: String,
    /// Trajectories that it is the mean of.
    pub trajectories: u64,
    /// Distance of the bands; the first is at 0 Hz.
    pub step_hz: f64,
    #[schema(value_type = Vec<f64>)]
    pub density: Vec<f32>,
}

impl App {
    /// # Errors
    /// When there is no such dataset.
    pub async fn summary(&self, dataset: i64) -> Result<Summary, ApiError> {
        let row = self.store.dataset(DatasetId(dataset)).await?;
        let shards = self.store.shards(row.id).await?;
        let ShardSummary { trajectories: summarized, channels, spectra, .. } =
            self.store.dataset_summary(row.id).await?.unwrap_or_default();
        let trajectories: u64 = shards.iter().map(|shard| shard.count).sum();
        let spec = serde_json::from_value::<JobSpec>(row.spec).ok();
        let data = spec.as_ref().and_then(DataSpec::of);
        let columns = data.map(|data| data.trajectory_columns()).unwrap_or_default();
        Ok(Summary {
            dataset,
            trajectories,
            first: shards.first().map_or(0, |shard| shard.first),
            samples: trajectories * u64::from(row.samples),
            rejected: shards.iter().map(|shard| shard.rejected).sum(),
            summarized,
            channels: channels.into_iter().map(|channel| described(channel, &columns)).collect(),
            spectra: spectra.into_iter().map(SpectrumSummary::from).collect(),
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

impl From<Spectrum> for SpectrumSummary {
    fn from(spectrum: Spectrum) -> Self {
        let unit = match spectrum.signal.as_str() {
            "u" => "(N·m)²/Hz",
            _ => "rad²/Hz",
        };
        Self {
            signal: spectrum.signal,
            unit: unit.to_owned(),
            trajectories: spectrum.trajectories,
            step_hz: spectrum.step_hz,
            density: spectrum.density,
        }
    }
}
