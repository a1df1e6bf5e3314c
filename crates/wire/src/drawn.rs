//! The scenarios that an evaluation draws, as its artifact `predictions.json` lists them.

use serde::{Deserialize, Serialize};
use spec::{Digest, Family};

use crate::{Checkpoint, PredictorKind};

/// The figures of single predictions that an evaluation has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DrawnPredictions {
    /// The predictor with the smallest mean RMSE, a checkpoint if there is one. The scenarios are
    /// its worst, its median and its best one.
    pub model: String,
    /// The predictors in the figures: the model, other checkpoints, baselines.
    pub predictors: Vec<DrawnPredictor>,
    /// The scenarios, the worst one first.
    pub scenarios: Vec<DrawnScenario>,
}

impl DrawnPredictions {
    /// The predictor that is a checkpoint. Two trainings by one spec may have other weights, for
    /// example those of two versions.
    pub fn predictor_of(&self, checkpoint: &Checkpoint) -> Option<&DrawnPredictor> {
        let has_its_weights = |it: &DrawnPredictor| {
            it.weights
                .is_none_or(|weights| checkpoint.files.iter().any(|file| file.sha256 == weights))
        };
        let is_it = |it: &&DrawnPredictor| {
            it.digest == Some(checkpoint.digest)
                && it.step == Some(checkpoint.step)
                && has_its_weights(it)
        };
        self.predictors.iter().find(is_it)
    }
}

/// A predictor whose predictions are drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DrawnPredictor {
    /// The name in tables and figures.
    pub name: String,
    /// Whether a baseline, a checkpoint or a file of predictions answers.
    pub kind: PredictorKind,
    /// The digest of the spec that a checkpoint was trained by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
    /// The optimizer steps of a checkpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<u64>,
    /// SHA-256 of a checkpoint's weights. Lists before 2026-11-30 lack it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<Digest>,
}

/// A scenario that is drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DrawnScenario {
    /// Its place among all scenarios.
    pub rank: ScenarioRank,
    /// The artifact with its figure; `.csv` in place of `.svg` has the numbers.
    pub figure: String,
    /// The excitation family of its cell. Missing for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// The frequency of its cell, Hz. Missing for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise that was added to the positions of the context, rad.
    #[serde(default)]
    pub position_noise_rad: f64,
    /// Index in the data.
    pub trajectory: u64,
    /// The joint with the largest error of the model, counted from 1.
    pub joint: usize,
    /// RMSE of the model, mean over joints.
    pub rmse_deg: f64,
}

/// The place of a scenario among all that the model answered, by its RMSE.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScenarioRank {
    /// The largest RMSE.
    Worst,
    /// The RMSE in the middle.
    Median,
    /// The smallest RMSE.
    Best,
}

impl ScenarioRank {
    /// The word in JSON.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Worst => "worst",
            Self::Median => "median",
            Self::Best => "best",
        }
    }
}
