//! Predictions of a checkpoint, for whoever waits for them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;
use spec::{Digest, JOINTS, SpecError};
use statistics::interpolated_quantile;
use store::CheckpointId;
use utoipa::ToSchema;

use crate::app::App;
use crate::app::questions::{PredictionRequest, PredictionSampling, Row};
use crate::error::ApiError;
use crate::live::{Answer, Lane, LiveModel};

/// What a checkpoint predicts.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Prediction {
    #[serde(flatten)]
    pub model: PredictingModel,
    /// Of each scenario, in their order.
    pub scenarios: Vec<PredictedScenario>,
    pub latency_ms: PredictionLatency,
}

/// Which model, and where it is computed.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct PredictingModel {
    pub checkpoint: i64,
    /// Of the training's spec.
    pub digest: Digest,
    /// Of the file of the weights.
    pub weights: Option<Digest>,
    pub rate_hz: f64,
    /// As `serve --device` takes it.
    #[schema(example = "cpu")]
    pub device: String,
    /// That compute one prediction.
    pub threads: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct PredictedScenario {
    /// Joint positions of the horizon `[horizon][7]`, rad: of several samples their mean.
    #[schema(value_type = Vec<Vec<f32>>)]
    pub y: Vec<Row>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub quantiles: Vec<PredictedQuantile>,
    /// `[samples][horizon][7]`, rad, if they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Vec<Vec<f32>>>>)]
    pub samples: Option<Vec<Vec<Row>>>,
}

/// Of each position apart, over the samples, with linear interpolation between them.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct PredictedQuantile {
    pub quantile: f64,
    /// Joint positions `[horizon][7]`, rad.
    #[schema(value_type = Vec<Vec<f32>>)]
    pub y: Vec<Row>,
}

/// Where the time went, ms.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
pub struct PredictionLatency {
    /// Until the model was loaded; next to nothing when it was before.
    pub load: f64,
    /// Until the computation's turn came.
    pub queue: f64,
    pub compute: f64,
}

/// A checkpoint's model, held for a question or for a stream of them.
#[derive(Clone)]
pub struct HeldModel {
    pub resource: PredictingModel,
    pub model: Arc<dyn LiveModel>,
}

impl App {
    /// # Errors
    /// When there is no such checkpoint, or its model cannot be loaded or asked.
    pub async fn held_model(&self, checkpoint: i64) -> Result<HeldModel, ApiError> {
        let models = self.models.as_ref().ok_or(ApiError::NoModels)?;
        let row = self.store.checkpoint(CheckpointId(checkpoint)).await?;
        let model = models.load(&row).await?;
        let about = model.about();
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
        Ok(HeldModel { resource, model })
    }

    /// # Errors
    /// As [`App::held_model`]; [`ApiError::Question`] with everything that cannot be asked so.
    pub async fn predict(
        &self,
        checkpoint: i64,
        request: &PredictionRequest,
    ) -> Result<Prediction, ApiError> {
        let asked = Instant::now();
        let HeldModel { resource, model } = self.held_model(checkpoint).await?;
        let load = milliseconds(asked.elapsed());
        let question = request.question(model.about())?;
        let answer = model.predict(question, Lane::Requests).await?;
        let horizon = model.about().horizon;
        let size = request.scenarios.len();
        let scenarios =
            (0..size).map(|index| answer.of(index, size, horizon, &request.sampling)).collect();
        let queue = milliseconds(answer.queued);
        let compute = milliseconds(answer.computed);
        let latency_ms = PredictionLatency { load, queue, compute };
        Ok(Prediction { model: resource, scenarios, latency_ms })
    }
}

pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

impl Answer {
    /// What is told of scenario `index` of `size`.
    pub fn of(
        &self,
        index: usize,
        size: usize,
        horizon: usize,
        sampling: &PredictionSampling,
    ) -> PredictedScenario {
        let row = horizon * JOINTS;
        let samples: Vec<&[f32]> =
            self.positions.chunks_exact(row).skip(index).step_by(size.max(1)).collect();
        let over_samples = |of: &dyn Fn(&mut [f64]) -> f64| {
            let mut values = vec![0.0; samples.len()];
            let positions: Vec<f32> = (0..row)
                .map(|position| {
                    for (value, sample) in values.iter_mut().zip(&samples) {
                        *value = f64::from(sample[position]);
                    }
                    narrow(of(&mut values))
                })
                .collect();
            rows(&positions)
        };
        let quantiles = sampling.quantiles.iter().map(|&quantile| PredictedQuantile {
            quantile,
            y: over_samples(&|values| {
                values.sort_unstable_by(f64::total_cmp);
                interpolated_quantile(values, quantile)
            }),
        });
        PredictedScenario {
            y: match samples[..] {
                [only] => rows(only),
                _ => over_samples(&|values| mean(values)),
            },
            quantiles: quantiles.collect(),
            samples: sampling
                .return_samples
                .then(|| samples.iter().map(|sample| rows(sample)).collect()),
        }
    }
}

fn rows(positions: &[f32]) -> Vec<Row> {
    positions.as_chunks().0.to_vec()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[expect(clippy::cast_possible_truncation, reason = "positions are f32")]
const fn narrow(position: f64) -> f32 {
    position as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampling(quantiles: &[f64], return_samples: bool) -> PredictionSampling {
        PredictionSampling {
            quantiles: quantiles.to_vec(),
            return_samples,
            ..PredictionSampling::default()
        }
    }

    /// Sample k of scenario s predicts 10 s + k² everywhere, over a horizon of 2.
    fn answer(samples: u8, size: u8) -> Answer {
        let positions = (0..samples)
            .flat_map(|k| (0..size).map(move |s| f32::from(10 * s) + f32::from(k * k)))
            .flat_map(|value| [value; 2 * JOINTS])
            .collect();
        let none = Duration::ZERO;
        Answer { positions, samples: samples.into(), queued: none, computed: none }
    }

    #[test]
    fn of_several_samples_the_mean_is_told_and_quantiles_are_interpolated() {
        // 0, 1, 4, 9, 16 and 10 more in the second scenario.
        let told = answer(5, 2).of(1, 2, 2, &sampling(&[0.0, 0.5, 0.875, 1.0], true));
        assert_eq!(told.y, [[16.0; JOINTS]; 2]);
        let quantiles: Vec<(f64, f32)> =
            told.quantiles.iter().map(|it| (it.quantile, it.y[1][3])).collect();
        assert_eq!(quantiles, [(0.0, 10.0), (0.5, 14.0), (0.875, 22.5), (1.0, 26.0)]);
        let samples: Vec<f32> = told.samples.unwrap().iter().map(|it| it[0][0]).collect();
        assert_eq!(samples, [10.0, 11.0, 14.0, 19.0, 26.0]);
    }

    #[test]
    fn one_answer_is_told_as_it_is() {
        let mut one = answer(1, 1);
        one.positions[8] = 0.1;
        let told = one.of(0, 1, 2, &sampling(&[], false));
        assert_eq!((told.y[1][1], told.y[1][0]), (0.1, 0.0));
        assert_eq!((told.quantiles.len(), told.samples), (0, None));
    }
}
