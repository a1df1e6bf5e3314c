//! The description of a checkpoint, `config.json`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use spec::{EmaSpec, Given, ModelSpec, Range};

use super::CONFIG_FILE;
use crate::architecture::Extents;
use crate::memory::parameter_count;
use crate::normalization::Normalizer;
use crate::ranges::DataRanges;
use crate::{DeviceDescription, ModelError};

/// The version of the format. Every change that an older torqued would misread raises it. Readers
/// refuse every other version, since no other was released.
pub const FORMAT_VERSION: u32 = 2;

/// The burn release that computes the models. Readers of old checkpoints may need it.
const BURN_VERSION: &str = "0.22.1";

/// The content of a checkpoint's `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckpointConfig {
    /// The version of the format, [`super::FORMAT_VERSION`] for new checkpoints.
    pub format_version: u32,
    /// The architecture and its sizes.
    pub model: ModelSpec,
    /// Samples the model is given.
    pub context: u32,
    /// Samples the model predicts.
    pub horizon: u32,
    /// Context and horizon together.
    pub samples: u32,
    /// Joints of the arm. The file leaves the field out when there are seven.
    #[serde(default = "seven", skip_serializing_if = "is_seven")]
    pub joints: usize,
    /// Samples per second of the training data.
    pub rate_hz: f64,
    /// The normalization, with its statistics where these are fixed.
    pub normalizer: Normalizer,
    /// Number of parameters.
    pub parameters: u64,
    /// Optimizer steps taken.
    pub step: u64,
    /// The seed of the training.
    pub seed: u64,
    /// Digest of the training's spec.
    pub spec_digest: String,
    /// Digest of the spec of the training's dataset, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dataset_digest: Option<String>,
    /// The signals that the model is given beside the positions of the context.
    #[serde(default, skip_serializing_if = "Given::is_torques")]
    pub given: Given,
    /// The checkpoint whose weights the training began with, of a fine-tuning.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub init: Option<Origin>,
    /// Ranges of all training data so far, those of `init` included. Checkpoints from before these were recorded have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ranges: Option<DataRanges>,
    /// Limits of each joint's position, rad, of the robot that the training's data describes. Empty
    /// where they are not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub limits_rad: Vec<Range>,
    /// How the parameters were averaged, where they are an average of the weights. The weights
    /// themselves are then in the optimizer's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ema: Option<EmaSpec>,
    /// The newest value of each metric.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, f64>,
    /// The device that computed the checkpoint, if torqued opened it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceDescription>,
    /// The versions that wrote the checkpoint.
    pub versions: Versions,
}

const fn seven() -> usize {
    7
}

const fn is_seven(joints: &usize) -> bool {
    *joints == seven()
}

/// A checkpoint that a fine-tuning began from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Digest of its training's spec.
    pub spec_digest: String,
    /// Optimizer steps of that training.
    pub step: u64,
}

/// The programs that made the checkpoint.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// Version of torqued.
    pub torqued: String,
    /// Version of burn.
    pub burn: String,
}

impl Versions {
    pub(crate) fn current() -> Self {
        Self { torqued: env!("CARGO_PKG_VERSION").to_owned(), burn: BURN_VERSION.to_owned() }
    }
}

impl CheckpointConfig {
    /// Reads `config.json`.
    ///
    /// # Errors
    /// Any other input than the JSON of a consistent config of this format version.
    pub fn parse(bytes: &[u8]) -> Result<Self, ModelError> {
        let damaged = |reason| ModelError::CheckpointFile { file: CONFIG_FILE, reason };
        let value: serde_json::Value = serde_json::from_slice(bytes)
            .map_err(|error| damaged(format!("is not JSON: {error}")))?;
        // The version is checked first, because a newer version may have changed all other fields.
        let version = value.get("format_version").and_then(serde_json::Value::as_u64);
        match version {
            None => return Err(damaged("has no format_version".to_owned())),
            Some(found) if found > u64::from(FORMAT_VERSION) => {
                let supported = FORMAT_VERSION;
                return Err(ModelError::NewerCheckpoint { file: CONFIG_FILE, found, supported });
            }
            Some(found) if found < u64::from(FORMAT_VERSION) => {
                return Err(damaged(format!(
                    "has format_version {found}, the first that was released is {FORMAT_VERSION}"
                )));
            }
            Some(_) => {}
        }
        let config: Self =
            serde_json::from_value(value).map_err(|error| damaged(error.to_string()))?;
        config.check().map_err(damaged)?;
        Ok(config)
    }

    pub(crate) fn to_json(&self) -> Result<Vec<u8>, ModelError> {
        let mut json = serde_json::to_vec_pretty(self).map_err(|error| {
            ModelError::CheckpointFile { file: CONFIG_FILE, reason: error.to_string() }
        })?;
        json.push(b'\n');
        Ok(json)
    }

    pub(crate) fn extents(&self) -> Extents {
        Extents { context: self.context, horizon: self.horizon, joints: self.joints }
    }

    fn check(&self) -> Result<(), String> {
        let Extents { horizon, .. } = Extents::new(self.context, self.samples, self.joints)
            .map_err(|error| error.to_string())?;
        if self.horizon != horizon {
            let found = self.horizon;
            return Err(format!("horizon is {found}, expected {horizon}, samples - context"));
        }
        self.model.check_options().map_err(|error| error.to_string())?;
        let parameters =
            parameter_count(&self.model, self.extents()).map_err(|error| error.to_string())?;
        if self.parameters != parameters {
            let found = self.parameters;
            return Err(format!("parameters is {found}, expected {parameters} for this model"));
        }
        if !(self.rate_hz.is_finite() && self.rate_hz > 0.0) {
            return Err(format!("rate_hz is {}, expected a positive number", self.rate_hz));
        }
        if !self.ranges.as_ref().is_none_or(|ranges| ranges.is_usable(self.joints)) {
            let joints = self.joints;
            return Err(format!("ranges needs finite [min, max] of {joints} joints, min first"));
        }
        if ![0, self.joints].contains(&self.limits_rad.len()) {
            let (found, joints) = (self.limits_rad.len(), self.joints);
            return Err(format!("limits_rad has {found} ranges, expected {joints}, one per joint"));
        }
        match &self.normalizer {
            Normalizer::Dataset(statistics) if !statistics.is_usable(self.joints) => Err(format!(
                "normalizer needs a finite mean and a deviation above 0 for each of {} joints",
                self.joints
            )),
            _ => Ok(()),
        }
    }
}
