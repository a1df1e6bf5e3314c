//! Turns a question into positions, in chunks that fit in memory.

use burn::tensor::{Device, Tensor, TensorData};
use series::Observed;
use spec::ModelSpec;

use crate::ModelError;
use crate::architecture::{Ask, Draw, FittedRobot};
use crate::device::host_values;
use crate::diffusion::Step;
use crate::frame::Framing;
use crate::normalization::{Statistics, model_input};
use crate::randomness::{Noise, Purpose, generator};
use crate::sampling::Sampling;
use crate::sequence_model::SequenceModel;

/// Trajectories that are computed together. It bounds the memory of large questions.
const CHUNK: usize = 64;

/// A model with everything that its answers depend on.
pub(crate) struct Predictor<'a> {
    pub model: &'a SequenceModel,
    pub spec: &'a ModelSpec,
    pub framing: Framing,
    pub device: Device,
    /// Samples of the context with which answers begin ([`Ask::behind`]).
    pub behind: usize,
}

impl Predictor<'_> {
    /// Positions `[sample, robot, behind + horizon, joint]`, rad.
    pub fn answer(
        &self,
        observed: &Observed<'_>,
        statistics: &[Statistics],
        sampling: &Sampling,
        draw: Draw,
    ) -> Result<Vec<f32>, ModelError> {
        let robots = observed.robots();
        let values = (self.behind + observed.horizon()) * observed.joints();
        let steps = self.steps(sampling, observed)?;
        let samples = sampling.samples;
        let questions = samples.saturating_mul(robots);
        let mut answers = vec![0.0; questions.saturating_mul(values)];
        for first in (0..questions).step_by(CHUNK) {
            let chunk = first..(first + CHUNK).min(questions);
            // The trajectory and the sample's number of each row. Samples of a trajectory follow
            // each other, so that they share computations.
            let rows: Vec<(usize, usize)> =
                chunk.map(|question| (question / samples, question % samples)).collect();
            let found = self.rows(observed, statistics, sampling, draw, &steps, &rows)?;
            for (&(robot, sample), found) in rows.iter().zip(found.chunks_exact(values)) {
                answers[(sample * robots + robot) * values..][..values].copy_from_slice(found);
            }
        }
        Ok(answers)
    }

    /// The robots that explain the contexts. `None` for a model that predicts motions only.
    pub fn fit(
        &self,
        observed: &Observed<'_>,
        statistics: &[Statistics],
    ) -> Option<Vec<FittedRobot>> {
        let mut fitted = Vec::with_capacity(observed.robots());
        let robots: Vec<usize> = (0..observed.robots()).collect();
        for robots in robots.chunks(CHUNK) {
            let question = observed.pick(robots);
            let statistics = &statistics[robots[0]..robots[0] + robots.len()];
            let frames = self.framing.frames(&question, statistics);
            let seen = model_input(&question, statistics, &frames, &self.device);
            fitted.extend(self.model.fit(seen)?);
        }
        Some(fitted)
    }

    fn steps(&self, sampling: &Sampling, observed: &Observed<'_>) -> Result<Vec<Step>, ModelError> {
        let Some(process) = self.model.process() else {
            return match &sampling.warm_start {
                Some(_) => Err(not_a_denoiser("warm_start")),
                None if sampling.sampler.is_some() => Err(not_a_denoiser("sampler")),
                None => Ok(Vec::new()),
            };
        };
        let generation = self.spec.generation().ok_or(ModelError::NotGenerative)?;
        let own = self.spec.sampler().ok_or(ModelError::NotGenerative)?;
        let sampler = sampling.sampler.as_ref().unwrap_or(own);
        self.spec.check_sampler(sampler)?;
        let warm = match &sampling.warm_start {
            None => None,
            Some(warm) => {
                warm.check(observed, &generation)?;
                Some(warm.steps as usize)
            }
        };
        Ok(process.steps(sampler, warm))
    }

    fn rows(
        &self,
        observed: &Observed<'_>,
        statistics: &[Statistics],
        sampling: &Sampling,
        draw: Draw,
        steps: &[Step],
        rows: &[(usize, usize)],
    ) -> Result<Vec<f32>, ModelError> {
        let (context, horizon) = (observed.context(), observed.horizon());
        let joints = observed.joints();
        let robots: Vec<usize> = rows.iter().map(|&(robot, _)| robot).collect();
        let question = observed.pick(&robots);
        let statistics: Vec<Statistics> =
            robots.iter().map(|&robot| statistics[robot].clone()).collect();
        let frames = self.framing.frames(&question, &statistics);
        let warm = match &sampling.warm_start {
            None => None,
            Some(warm) => {
                let mut seen = Vec::with_capacity(rows.len() * horizon * joints);
                for (&robot, frame) in robots.iter().zip(&frames) {
                    frame.extend_seen(&warm.shifted(robot, horizon, joints), context, &mut seen);
                }
                let seen = TensorData::new(seen, [rows.len(), horizon, joints]);
                Some(Tensor::from_data(seen, &self.device))
            }
        };
        let mut noise = Noise::new(rows.iter().map(|&(robot, sample)| {
            let scenario = sampling.first_scenario.wrapping_add(robot as u64);
            generator(sampling.seed, Purpose::Sample, scenario, sample as u64)
        }));
        let seen = model_input(&question, &statistics, &frames, &self.device);
        let ask = Ask { steps, warm, noise: &mut noise, draw, behind: self.behind };
        let mut answer = host_values(self.model.answer(seen, ask))?;
        let rows = answer.chunks_exact_mut((self.behind + horizon) * joints);
        for (y, frame) in rows.zip(&frames) {
            frame.restore(y, context - self.behind);
        }
        Ok(answer)
    }
}

fn not_a_denoiser(field: &'static str) -> ModelError {
    let allowed = "left out, because this model is no denoiser".to_owned();
    ModelError::Sampling { field, value: "given".to_owned(), allowed }
}
