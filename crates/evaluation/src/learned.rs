//! Checkpoints as predictors.

use std::sync::OnceLock;

use models::{ModelError, Sampling, TrainedModel, WarmStart};
use series::{JointMotion, Observed, SeriesView};

use crate::predictor::Answer;
use crate::{EvaluationError, Predictor, Samples};

/// A checkpoint as a predictor.
pub struct Learned<'a> {
    /// The name in tables and figures.
    pub name: String,
    /// The checkpoint.
    pub model: &'a TrainedModel,
    /// The sampling of a denoiser, with the key of all samples. The seed is one of a spec. Each
    /// question sets `samples` and `warm_start`.
    pub sampling: Sampling,
    /// Where the chain begins.
    pub start: Start,
    /// A shared place for the first, cold prediction. Predictors of the same model and sampling
    /// with shifted starts use it, so that only one of them computes it. It is for one [`Observed`]
    /// only.
    pub first: Option<&'a FirstPrediction>,
}

/// A prediction that is made once, see [`Learned::first`].
pub type FirstPrediction = OnceLock<Vec<f32>>;

/// The start of a denoiser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Noise.
    Cold,
    /// Its own prediction of `shift` samples ago, shifted in time, and denoised by `steps` levels:
    /// receding horizon. That prediction began with the one before, and so on back to the beginning
    /// of the recording, where the first one began with noise.
    Shifted {
        /// Samples between two predictions.
        shift: usize,
        /// Levels by which the shifted prediction is denoised.
        steps: u32,
    },
}

/// A checkpoint whose normalization takes its statistics from the horizon too, as in the paper's
/// code. It has access to the true horizon. So it is a separate predictor with its own name in
/// every table.
pub struct LeakyLearned<'a> {
    /// The name in tables and figures.
    pub name: String,
    /// The checkpoint.
    pub model: &'a TrainedModel,
    /// The recording, with the pre-roll of the observed window.
    pub scenarios: &'a SeriesView<'a>,
}

/// A denoiser that begins with the true horizon, noised to level `steps` - 1: the best possible
/// warm start. It has access to the true horizon, like [`LeakyLearned`].
pub struct OracleStarted<'a> {
    /// The name in tables and figures.
    pub name: String,
    /// The checkpoint.
    pub model: &'a TrainedModel,
    /// The sampler and its steps.
    pub sampling: Sampling,
    /// Steps of the chain.
    pub steps: u32,
    /// The recording, with the pre-roll of the observed window.
    pub scenarios: &'a SeriesView<'a>,
}

/// Samples of a patch, if the architecture predicts several samples at a time.
fn patch(model: &TrainedModel) -> Option<usize> {
    let patch = model.architecture().patch() as usize;
    (patch > 1).then_some(patch)
}

impl Predictor for Learned<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn patch(&self) -> Option<usize> {
        patch(self.model)
    }

    /// A gaussian head gives its mean, a denoiser its first sample.
    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        self.warm_start(observed)
            .and_then(|warm_start| self.ask(observed, warm_start, 1, 0))
            .map_err(|failure| failure.of(&self.name))
    }

    fn answer(&self, observed: &Observed<'_>, count: usize) -> Result<Answer, EvaluationError> {
        if !self.is_denoiser() {
            let positions = self.predict(observed)?;
            let samples = self.samples_around_mean(observed, count)?;
            return Ok(Answer { positions, samples, ..Answer::default() });
        }
        let count = count.max(1);
        self.warm_start(observed)
            .and_then(|warm_start| self.ask(observed, warm_start, count, 0))
            .map(|positions| Answer::of_samples(count, positions))
            .map_err(|failure| failure.of(&self.name))
    }

    fn torques(
        &self,
        observed: &Observed<'_>,
        _: &Answer,
        motions: &[JointMotion],
    ) -> Result<Option<Vec<Vec<f64>>>, EvaluationError> {
        let said = self.model.torques(observed, motions);
        let said = said.map_err(|source| Failure::from(source).of(&self.name))?;
        let widen = |torques: Vec<f32>| torques.into_iter().map(f64::from).collect();
        Ok(said.map(|robots| robots.into_iter().map(widen).collect()))
    }
}

impl Learned<'_> {
    fn is_denoiser(&self) -> bool {
        self.model.architecture().sampler().is_some()
    }

    /// Draws `count` samples, at least 2, from a gaussian head.
    fn samples_around_mean(
        &self,
        observed: &Observed<'_>,
        count: usize,
    ) -> Result<Option<Samples>, EvaluationError> {
        if count < 2 || !self.model.is_generative() {
            return Ok(None);
        }
        let sampling = Sampling { samples: count, ..self.sampling.clone() };
        let positions = self.model.sample(observed, &sampling);
        let positions = positions.map_err(|source| Failure::from(source).of(&self.name))?;
        Ok(Some(Samples { count, positions }))
    }

    /// Predicts the window `back` steps before the last one. It has noise of its own, because
    /// predictions that continue each other would otherwise repeat the same noise.
    fn ask(
        &self,
        observed: &Observed<'_>,
        warm_start: Option<WarmStart>,
        samples: usize,
        back: usize,
    ) -> Result<Vec<f32>, Failure> {
        if !self.is_denoiser() {
            return Ok(self.model.predict(observed)?);
        }
        // Seeds of specs have 53 bits.
        let seed = self.sampling.seed ^ ((back as u64) << 53);
        let sampling = Sampling { samples, warm_start, seed, ..self.sampling.clone() };
        Ok(self.model.sample(observed, &sampling)?)
    }

    /// The prediction before this one, computed through all earlier ones.
    fn warm_start(&self, observed: &Observed<'_>) -> Result<Option<WarmStart>, Failure> {
        let Start::Shifted { shift, steps } = self.start else { return Ok(None) };
        let too_short = Failure::PreRoll { shift, pre_roll: observed.pre_roll() };
        let earlier = observed.pre_roll().checked_div(shift).filter(|&earlier| earlier > 0);
        let earlier = earlier.ok_or(too_short)?;
        let mut warm_start = None;
        for back in (1..=earlier).rev() {
            let Some(window) = observed.earlier(back * shift) else { break };
            let previous = match (self.first, warm_start) {
                (Some(first), None) => match first.get() {
                    Some(kept) => kept.clone(),
                    None => {
                        let made = self.ask(&window, None, 1, back)?;
                        first.get_or_init(|| made).clone()
                    }
                },
                (_, warm_start) => self.ask(&window, warm_start, 1, back)?,
            };
            warm_start = Some(WarmStart { previous, shift, steps });
        }
        Ok(warm_start)
    }
}

impl Predictor for LeakyLearned<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn patch(&self) -> Option<usize> {
        patch(self.model)
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let window = self.scenarios.window(observed.pre_roll()..self.scenarios.samples());
        let predicted = self.model.predict_with_leak(&window);
        predicted.map_err(|source| Failure::from(source).of(&self.name))
    }
}

impl Predictor for OracleStarted<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn patch(&self) -> Option<usize> {
        patch(self.model)
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        self.ask(observed, 1)
    }

    fn answer(&self, observed: &Observed<'_>, count: usize) -> Result<Answer, EvaluationError> {
        let count = count.max(1);
        Ok(Answer::of_samples(count, self.ask(observed, count)?))
    }
}

impl OracleStarted<'_> {
    fn ask(&self, observed: &Observed<'_>, samples: usize) -> Result<Vec<f32>, EvaluationError> {
        let first = observed.pre_roll() + observed.context();
        let previous = self.scenarios.window(first..self.scenarios.samples()).copy_true_y();
        let warm_start = Some(WarmStart { previous, shift: 0, steps: self.steps });
        let sampling = Sampling { samples, warm_start, ..self.sampling.clone() };
        let answer = self.model.sample(observed, &sampling);
        answer.map_err(|source| Failure::from(source).of(&self.name))
    }
}

/// The reason why a checkpoint has no answer.
enum Failure {
    Model(ModelError),
    PreRoll { shift: usize, pre_roll: usize },
}

impl From<ModelError> for Failure {
    fn from(source: ModelError) -> Self {
        Self::Model(source)
    }
}

impl Failure {
    fn of(self, predictor: &str) -> EvaluationError {
        let predictor = predictor.to_owned();
        match self {
            Self::Model(source) => EvaluationError::Model { predictor, source },
            Self::PreRoll { shift, pre_roll } => {
                EvaluationError::PreRoll { predictor, shift, pre_roll }
            }
        }
    }
}
