//! Live predictions with a checkpoint.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use series::interpolated_quantile;
use spec::SpecError;
use store::{Checkpoint, CheckpointFile, CheckpointId};
use wire::{
    PredictedQuantile, PredictedScenario, PredictingModel, Prediction, PredictionLatency,
    PredictionRequest, PredictionSampling,
};

use crate::app::App;
use crate::app::questions::{answers_to, numbers_of, question};
use crate::error::ApiError;
use crate::limits::ASKED_NUMBERS;
use crate::live::{AboutModel, LiveError, LiveModel, LivePrediction, LiveQueue};

/// A checkpoint's model, kept loaded for a request or a stream.
#[derive(Clone)]
pub struct HeldModel {
    pub resource: PredictingModel,
    pub model: Arc<dyn LiveModel>,
    /// Its shapes at the rate that it is asked at.
    pub about: AboutModel,
}

impl HeldModel {
    /// The model asked at `rate_hz`, or at the checkpoint's own rate.
    ///
    /// # Errors
    /// [`ApiError::Question`] if it does not answer at this rate.
    pub fn at(&self, rate_hz: Option<f64>) -> Result<Self, ApiError> {
        let own = self.model.about();
        let about = match rate_hz {
            None => own.clone(),
            Some(rate_hz) => own.at(rate_hz).ok_or_else(|| {
                let error = SpecError::one("rate_hz", rate_hz.to_string(), own.rates());
                ApiError::Question(error)
            })?,
        };
        let resource = PredictingModel { rate_hz: about.rate_hz, ..self.resource.clone() };
        Ok(Self { resource, model: Arc::clone(&self.model), about })
    }
}

impl App {
    /// # Errors
    /// When the checkpoint does not exist, or its model cannot be loaded or used.
    /// [`ApiError::Damaged`] when a file of it is damaged.
    pub(crate) async fn held_model(&self, checkpoint: i64) -> Result<HeldModel, ApiError> {
        let models = self.models.as_ref().ok_or(ApiError::NoModels)?;
        let row = self.store.checkpoint(CheckpointId(checkpoint)).await?;
        let model = models.load(&row).await.map_err(|error| not_loaded(&row, error))?;
        let about = model.about().clone();
        if about.needs_future {
            let allowed = "one whose normalization does not look into the horizon";
            let error = SpecError::one("checkpoint", "trained with paper-leaky", allowed);
            return Err(ApiError::Question(error));
        }
        let resource = PredictingModel {
            checkpoint,
            digest: row.digest,
            weights: row.file("model.safetensors").map(|file| file.sha256),
            rate_hz: about.rate_hz,
            device: about.device.clone(),
            threads: about.threads,
        };
        Ok(HeldModel { resource, model, about })
    }

    /// The answer to a [`PredictionRequest`], a [`Prediction`] as JSON.
    ///
    /// # Errors
    /// Like [`App::held_model`]. [`ApiError::Question`] with everything that is wrong with the
    /// request.
    pub(crate) async fn predict(&self, checkpoint: i64, body: Bytes) -> Result<Vec<u8>, ApiError> {
        let bytes = body.len();
        let request: PredictionRequest = self.read_body(body, ApiError::Question).await?;
        let asked = Instant::now();
        let held = self.held_model(checkpoint).await?.at(request.rate_hz)?;
        let HeldModel { resource, model, about } = held;
        let load = milliseconds(asked.elapsed());
        let (size, horizon) = (answers_to(&request), about.horizon);
        let sampling = request.sampling.clone();
        let input = question_bytes(size, &about);
        let _memory = self.checks.memory(input)?;
        // Numbers are copied some sixteen times as fast as they are read from JSON.
        let work = bytes.max(input / 16);
        let question = self.checks.run(work, move || question(&request, &about)).await?;
        let prediction = model.predict(question, LiveQueue::Requests).await?;
        let written = prediction.answered_bytes(&sampling);
        let write = move || {
            let answers = prediction.answers(size, horizon, &sampling).collect();
            let queue = milliseconds(prediction.queued);
            let compute = milliseconds(prediction.computed);
            let latency_ms = PredictionLatency { load, queue, compute };
            let warnings = prediction.warnings;
            let answer = Prediction { model: resource, scenarios: answers, latency_ms, warnings };
            // It has only strings and finite numbers, so this cannot fail.
            serde_json::to_vec(&answer).map_err(|_| ApiError::Internal)
        };
        self.checks.run(written, write).await
    }
}

/// Bytes of the model's input for `size` answers. More than the limit are refused before they are
/// there.
fn question_bytes(size: usize, about: &AboutModel) -> usize {
    numbers_of(size, about).min(ASKED_NUMBERS) * size_of::<f32>()
}

/// Why the model of `checkpoint` was not loaded. Names the damaged file, if there is one.
fn not_loaded(checkpoint: &Checkpoint, error: LiveError) -> ApiError {
    let LiveError::Store(error) = error else { return error.into() };
    let is_of = |file: &&CheckpointFile| error.object_path() == Some(file.object.path.as_str());
    match checkpoint.files.iter().find(is_of) {
        Some(file) => {
            ApiError::reading(format!("{} of checkpoint {}", file.name, checkpoint.id), error)
        }
        None => ApiError::Live(LiveError::Store(error)),
    }
}

pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

impl LivePrediction {
    /// The predictions for all `size` scenarios.
    pub fn answers(
        &self,
        size: usize,
        horizon: usize,
        sampling: &PredictionSampling,
    ) -> impl Iterator<Item = PredictedScenario> {
        (0..size).map(move |index| self.of(index, size, horizon, sampling))
    }

    /// About the bytes of the answer as JSON.
    pub fn answered_bytes(&self, sampling: &PredictionSampling) -> usize {
        self.positions.len() * (1 + sampling.quantiles.len()) * 10
    }

    /// The prediction for scenario `index` of `size`.
    pub fn of(
        &self,
        index: usize,
        size: usize,
        horizon: usize,
        sampling: &PredictionSampling,
    ) -> PredictedScenario {
        let row = self.positions.len() / (self.samples * size).max(1);
        let joints = row / horizon.max(1);
        let rows = |positions: &[f32]| rows(positions, joints);
        let samples: Vec<&[f32]> =
            self.positions.chunks_exact(row).skip(index).step_by(size.max(1)).collect();
        let mut means = Vec::with_capacity(row);
        let mut quantiles = vec![Vec::with_capacity(row); sampling.quantiles.len()];
        let mut values = vec![0.0; samples.len()];
        for position in 0..row {
            for (value, sample) in values.iter_mut().zip(&samples) {
                *value = f64::from(sample[position]);
            }
            means.push(narrow(mean(&values)));
            if !quantiles.is_empty() {
                // Sorted once for all quantiles.
                values.sort_unstable_by(f64::total_cmp);
            }
            for (positions, quantile) in quantiles.iter_mut().zip(&sampling.quantiles) {
                positions.push(narrow(interpolated_quantile(&values, *quantile)));
            }
        }
        let quantiles = sampling
            .quantiles
            .iter()
            .zip(&quantiles)
            .map(|(&quantile, positions)| PredictedQuantile { quantile, y: rows(positions) });
        PredictedScenario {
            y: match samples[..] {
                [only] => rows(only),
                _ => rows(&means),
            },
            quantiles: quantiles.collect(),
            samples: sampling
                .return_samples
                .then(|| samples.iter().map(|sample| rows(sample)).collect()),
        }
    }
}

/// One row per step of the horizon, or per instant.
pub fn rows(positions: &[f32], joints: usize) -> Vec<Vec<f32>> {
    positions.chunks_exact(joints.max(1)).map(<[f32]>::to_vec).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[expect(clippy::cast_possible_truncation, reason = "positions and torques are f32")]
pub const fn narrow(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOINTS: usize = 7;

    fn sampling(quantiles: &[f64], return_samples: bool) -> PredictionSampling {
        PredictionSampling {
            quantiles: quantiles.to_vec(),
            return_samples,
            ..PredictionSampling::default()
        }
    }

    /// Sample k of scenario s predicts 10 s + k² everywhere, over a horizon of 2.
    fn prediction(samples: u8, size: u8) -> LivePrediction {
        let positions = (0..samples)
            .flat_map(|k| (0..size).map(move |s| f32::from(10 * s) + f32::from(k * k)))
            .flat_map(|value| [value; 2 * JOINTS])
            .collect();
        let none = Duration::ZERO;
        LivePrediction {
            positions,
            samples: samples.into(),
            warnings: Vec::new(),
            queued: none,
            computed: none,
        }
    }

    #[test]
    fn of_several_samples_the_mean_is_told_and_quantiles_are_interpolated() {
        // The samples of the second scenario are 0, 1, 4, 9, 16, each plus 10.
        let told = prediction(5, 2).of(1, 2, 2, &sampling(&[0.0, 0.5, 0.875, 1.0], true));
        assert_eq!(told.y, [[16.0; JOINTS]; 2]);
        let quantiles: Vec<(f64, f32)> =
            told.quantiles.iter().map(|quantile| (quantile.quantile, quantile.y[1][3])).collect();
        assert_eq!(quantiles, [(0.0, 10.0), (0.5, 14.0), (0.875, 22.5), (1.0, 26.0)]);
        let samples: Vec<f32> = told.samples.unwrap().iter().map(|sample| sample[0][0]).collect();
        assert_eq!(samples, [10.0, 11.0, 14.0, 19.0, 26.0]);
    }

    #[test]
    fn one_answer_is_told_as_it_is() {
        let mut one = prediction(1, 1);
        one.positions[8] = 0.1;
        let told = one.of(0, 1, 2, &sampling(&[], false));
        assert_eq!((told.y[1][1], told.y[1][0]), (0.1, 0.0));
        assert_eq!((told.quantiles.len(), told.samples), (0, None));
    }
}
