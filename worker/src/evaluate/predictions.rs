//! Files of predictions: imported datasets that answer the scenarios of another one.

use std::collections::BTreeMap;

use evaluation::{Answer, Given, Samples};
use series::{Series, SeriesView};
use spec::{DataSpec, EvaluateSpec, FilePredictions, SpecError};
use wire::{PredictorInfo, PredictorKind};

use super::recordings::{Answers, answers_of};
use crate::attempt::Attempt;
use crate::dataset::DatasetReader;
use crate::error::TaskError;
use crate::trajectories::TrajectorySource;

/// How far a torque of the file may be from that of the data, N·m: text has rounded digits, and a window one sample
/// off differs by more wherever the torques move.
const TORQUE_TOLERANCE_NM: f32 = 1e-4;

/// Predictions of a model that torqued does not know.
pub(super) struct PredictionFile {
    pub info: PredictorInfo,
    /// Its field in the spec.
    field: String,
    dataset: DatasetReader,
}

impl PredictionFile {
    /// All files of an evaluation, in its order.
    pub fn open_all(attempt: &Attempt, spec: &EvaluateSpec) -> Result<Vec<Self>, TaskError> {
        spec.predictions
            .iter()
            .enumerate()
            .map(|(i, prediction)| Self::open(attempt, i, prediction))
            .collect()
    }

    fn open(attempt: &Attempt, i: usize, predictions: &FilePredictions) -> Result<Self, TaskError> {
        let dataset = DatasetReader::open(attempt, &predictions.data)?;
        let file = match &dataset.spec {
            DataSpec::Import(import) => import.file,
            DataSpec::Simulation(_) => None,
        };
        let info = PredictorInfo {
            name: predictions.name.clone(),
            kind: PredictorKind::Predictions,
            told: Some("unknown, perhaps the horizon".to_owned()),
            digest: predictions.data.digest(),
            file,
            replicates: None,
            normalization: None,
            sampling: None,
            latency: None,
        };
        Ok(Self { info, field: format!("predictions[{i}].data"), dataset })
    }

    /// The answers to the scenarios of a cell, `first` the index of the first of them.
    ///
    /// # Errors
    /// [`TaskError::Unsuitable`] when the file has recordings that are no prediction of a trajectory of `data`, lacks
    /// one of these scenarios, or has other torques.
    pub fn answer(
        &self,
        spec: &EvaluateSpec,
        data: &TrajectorySource,
        scenarios: &SeriesView<'_>,
        first: u64,
    ) -> Result<Given, TaskError> {
        let answers = answers_of(&self.dataset.recordings()?, data.count());
        let answers = answers.map_err(|found| self.refused(found))?;
        let wanted = first..first + scenarios.robots() as u64;
        let samples = spec.samples as usize;
        let answers = Answers::of_scenarios(&answers, wanted.clone(), samples);
        let answers = answers.map_err(|found| self.refused(found))?;
        let start = (spec.rounds() + spec.context) as usize;
        let read = |places: &[u64]| -> Result<Vec<f32>, TaskError> {
            let predicted = self.read(places)?;
            self.check_torques(&predicted, scenarios, start, wanted.start)?;
            Ok(predicted.y().to_vec())
        };
        let positions = read(&answers.predictions)?;
        let mut drawn = Vec::with_capacity(answers.samples.len() * positions.len());
        for places in &answers.samples {
            drawn.extend(read(places)?);
        }
        let count = answers.samples.len();
        let samples = (count > 0).then_some(Samples { count, positions: drawn });
        let answer = Answer { positions, samples, ..Answer::default() };
        Ok(Given { name: self.info.name.clone(), answer })
    }

    /// The trajectories at `places` of the imported dataset, in this order.
    fn read(&self, places: &[u64]) -> Result<Series, TaskError> {
        let mut wanted: BTreeMap<u64, Vec<(usize, u64)>> = BTreeMap::new();
        for (k, &place) in places.iter().enumerate() {
            wanted.entry(place / self.dataset.block()).or_default().push((k, place));
        }
        let mut series = self.dataset.empty(places.len())?;
        let shape = self.dataset.shape(places.len());
        series.reshape(shape, self.dataset.spec.rate_hz())?;
        let row = shape.samples * shape.joints;
        for group in wanted.values() {
            let least = group.iter().map(|(_, place)| *place).min().unwrap_or_default();
            let most = group.iter().map(|(_, place)| *place).max().unwrap_or_default();
            let part = self.dataset.read(least..most + 1)?;
            let (u, y) = series.both_mut();
            for &(k, place) in group {
                // Both lie within one row group.
                let from = usize::try_from(place - least).unwrap_or_default() * row;
                u[k * row..(k + 1) * row].copy_from_slice(&part.u()[from..from + row]);
                y[k * row..(k + 1) * row].copy_from_slice(&part.y()[from..from + row]);
            }
        }
        Ok(series)
    }

    /// Refuses predictions for other torques than those of the scenarios' horizons, which begin at sample `start`.
    fn check_torques(
        &self,
        predicted: &Series,
        scenarios: &SeriesView<'_>,
        start: usize,
        first: u64,
    ) -> Result<(), TaskError> {
        let joints = scenarios.joints();
        let view = predicted.view();
        for robot in 0..scenarios.robots() {
            let asked = &scenarios.u(robot).values()[start * joints..];
            let pairs = view.u(robot).values().iter().zip(asked);
            let other = pairs.enumerate().find(|(_, (found, asked))| {
                let close = (**found - **asked).abs() <= TORQUE_TOLERANCE_NM;
                !close
            });
            if let Some((k, (found, asked))) = other {
                let (joint, step) = (k % joints + 1, start + k / joints);
                let trajectory = first + robot as u64;
                let value =
                    format!("u{joint} {found} N·m at step {step} of trajectory {trajectory}");
                let allowed = format!(
                    "the torque of the evaluation's data, which is {asked}: a prediction begins at step {start}"
                );
                return Err(self.refused((value, allowed)));
            }
        }
        Ok(())
    }

    fn refused(&self, (value, allowed): (String, String)) -> TaskError {
        let value = format!("{value}, of {:?}", self.info.name);
        SpecError::one(&self.field, value, allowed).into()
    }
}
