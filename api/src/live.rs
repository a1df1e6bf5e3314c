//! The interface to live predictions, with plain arrays.
//!
//! The code that computes models is not compiled into this crate. The server's composition passes
//! it in.

use std::sync::Arc;
use std::time::Duration;

use futures::future::BoxFuture;
use series::{JointMotion, Series};
use spec::{
    Digest, Given, JointDescription, Lengths, MAX_SAMPLING_RATE_HZ, Range, RobotDescription,
    SamplerSpec, SpecError,
};
use store::{Checkpoint, StoreError};
use thiserror::Error;
use wire::Warning;

/// The models of checkpoints, which stay loaded.
pub trait LiveModels: Send + Sync {
    /// The model of a checkpoint. It stays loaded at least as long as somebody holds it.
    fn load<'a>(
        &'a self,
        checkpoint: &'a Checkpoint,
    ) -> BoxFuture<'a, Result<Arc<dyn LiveModel>, LiveError>>;
}

/// A loaded model.
pub trait LiveModel: Send + Sync {
    /// Its shapes, its rate and its device.
    fn about(&self) -> &AboutModel;

    /// Predicts for a request with the shapes in [`AboutModel::at`] its rate. Dropping the future
    /// cancels the computation.
    fn predict(
        &self,
        question: Question,
        queue: LiveQueue,
    ) -> BoxFuture<'static, Result<LivePrediction, LiveError>>;

    /// Fits robots to contexts, which a sample of the horizon follows. Dropping the future cancels
    /// the computation. A model without equations of motion refuses it.
    fn fit(&self, _: Series, _: LiveQueue) -> BoxFuture<'static, Result<LiveFit, LiveError>> {
        Box::pin(async { Err(LiveError::says_no_torques()) })
    }

    /// An earlier fit, if it is remembered.
    fn remembered(&self, _: Digest) -> Option<LiveFit> {
        None
    }
}

/// A robot that explains a context. It says the torques that a motion takes, `[instant, joint]`, N·m.
pub type FittedRobot = Arc<dyn Fn(&JointMotion) -> Vec<f32> + Send + Sync>;

/// The robots that explain some contexts.
#[derive(Clone)]
pub struct LiveFit {
    /// The digest of everything that the fit depends on beside the model.
    pub digest: Digest,
    /// One for each context.
    pub robots: Vec<FittedRobot>,
    /// Warnings about the contexts.
    pub warnings: Vec<Warning>,
    /// Time until its turn came.
    pub queued: Duration,
    /// Time that the fit took; close to 0 if the same contexts were fitted before.
    pub computed: Duration,
}

/// The limits of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Positions, rad.
    pub position_rad: Range,
    /// The largest speed, rad/s.
    pub velocity_rad_s: f64,
    /// The largest torque, N·m.
    pub torque_nm: f64,
}

impl JointLimits {
    /// Those of each joint of a robot.
    pub fn of(robot: &RobotDescription) -> Arc<[Self]> {
        let of_joint = |joint: &JointDescription| Self {
            position_rad: joint.position_rad,
            velocity_rad_s: joint.velocity_rad_s,
            torque_nm: joint.torque_nm,
        };
        robot.joints.iter().map(of_joint).collect()
    }
}

/// The properties of a loaded model.
#[derive(Clone, Debug)]
pub struct AboutModel {
    /// Number of samples of its context.
    pub context: usize,
    /// Number of samples of its horizon.
    pub horizon: usize,
    /// Number of joints of the arm.
    pub joints: usize,
    /// Samples per second of its context and of its predictions.
    pub rate_hz: f64,
    /// The contexts and horizons that it answers, which say at which other rates it answers.
    pub lengths: Lengths,
    /// The series that it is given beside the positions of the context.
    pub given: Given,
    /// The limits of each joint of the arm that it is told; empty for a model that is told none.
    pub limits: Arc<[JointLimits]>,
    /// Whether it can give several answers to the same question.
    pub has_samples: bool,
    /// Its own sampler, of a model that removes noise.
    pub sampler: Option<SamplerSpec>,
    /// Whether its normalization looks into the horizon, so it cannot predict live.
    pub needs_future: bool,
    /// The device's name, as in `--device`.
    pub device: String,
    /// Number of threads that compute one prediction.
    pub threads: usize,
}

impl AboutModel {
    /// The same model, asked with `rate_hz` samples per second. Context and horizon last as long as
    /// before. `None` if it does not answer at this rate.
    pub fn at(&self, rate_hz: f64) -> Option<Self> {
        let multiple = self.lengths.multiple(self.rate_hz, rate_hz)?;
        (multiple == 1 || rate_hz <= MAX_SAMPLING_RATE_HZ).then(|| Self {
            context: multiple * self.context,
            horizon: multiple * self.horizon,
            rate_hz,
            ..self.clone()
        })
    }

    /// The rates at which it answers, in words.
    pub fn rates(&self) -> String {
        let multiples = match self.lengths {
            Lengths::Any => format!(", or a whole multiple of it up to {MAX_SAMPLING_RATE_HZ}"),
            _ => String::new(),
        };
        format!("{}, the checkpoint's rate{multiples}", self.rate_hz)
    }
}

/// A queue of predictions. Those of one queue are computed one after the other, and never wait for
/// those of the other queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LiveQueue {
    /// Predictions that a request asks for.
    Requests,
    /// Predictions on streams, which robots wait for.
    Streams,
}

/// A request for predictions.
#[derive(Clone, Debug)]
pub struct Question {
    /// Torques of context and horizon, and positions of the context.
    pub scenarios: Series,
    /// Number of samples per scenario, from a model that can give several. `None` for one
    /// prediction.
    pub samples: Option<usize>,
    /// `None` for the checkpoint's own sampler.
    pub sampler: Option<SamplerSpec>,
    /// The seed of all random numbers.
    pub seed: u64,
    /// An earlier prediction to start from; `None` starts from noise.
    pub previous: Option<Previous>,
}

/// An earlier prediction to start from, instead of noise.
#[derive(Clone, Debug)]
pub struct Previous {
    /// Joint positions `[scenarios, horizon, joints]`, rad.
    pub positions: Vec<f32>,
    /// Number of samples from that prediction to this one.
    pub shift: usize,
    /// Number of noise levels that are removed again.
    pub steps: u32,
}

/// The predictions for all scenarios of a [`Question`].
#[derive(Clone, Debug)]
pub struct LivePrediction {
    /// Joint positions `[samples, scenarios, horizon, joints]`, rad; all finite.
    pub positions: Vec<f32>,
    /// Number of samples per scenario; 1 for a single prediction.
    pub samples: usize,
    /// Warnings about the request and the prediction.
    pub warnings: Vec<Warning>,
    /// Time until its turn came.
    pub queued: Duration,
    /// Time that the computation took.
    pub computed: Duration,
}

impl LiveError {
    /// The refusal of a model without equations of motion.
    pub fn says_no_torques() -> Self {
        let allowed = "one with equations of motion, which say the torques of a motion: lagrangian";
        Self::Refused(SpecError::one("checkpoint", "a model that predicts motions only", allowed))
    }
}

/// Why there is no prediction.
#[derive(Debug, Error)]
pub enum LiveError {
    /// The model of this checkpoint cannot do this.
    #[error("{0}")]
    Refused(SpecError),

    /// Too many predictions are waiting.
    #[error("{waiting} predictions are waiting, which is the limit; try again later")]
    Queue {
        /// Number of predictions that are waiting.
        waiting: usize,
    },

    /// The questions that are waiting take too much memory.
    #[error("questions to models take all of {bytes} bytes of memory; try again later")]
    Memory {
        /// The limit of all questions together, in bytes.
        bytes: usize,
    },

    /// All loaded models are in use.
    #[error(
        "there is no room for another model: the models in use take all {models} places or {bytes} \
         bytes; try again later"
    )]
    Full {
        /// The largest number of loaded models.
        models: usize,
        /// The limit of their weights together, in bytes.
        bytes: u64,
    },

    /// The model takes more memory than all loaded models may.
    #[error("the model has {found} bytes, allowed: {bytes} for all loaded models together")]
    TooLarge {
        /// The size of its weights, in bytes.
        found: u64,
        /// The limit of all weights together, in bytes.
        bytes: u64,
    },

    /// The checkpoint's files or the device cannot be used.
    #[error("the model cannot be loaded: {reason}")]
    Unusable {
        /// The cause, in words.
        reason: String,
    },

    /// The computation failed.
    #[error("the model failed: {reason}")]
    Failed {
        /// The message of the model.
        reason: String,
    },

    /// The checkpoint's files could not be read.
    #[error("reading the checkpoint failed")]
    Store(#[from] StoreError),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(lengths: Lengths) -> AboutModel {
        AboutModel {
            context: 80,
            horizon: 40,
            joints: 6,
            rate_hz: 31.25,
            lengths,
            given: Given::Torques,
            limits: Arc::default(),
            has_samples: true,
            sampler: None,
            needs_future: false,
            device: "cpu".to_owned(),
            threads: 1,
        }
    }

    #[test]
    fn a_law_at_a_multiple_of_its_rate_has_as_many_times_the_rows() {
        let rows = |rate_hz: f64| {
            model(Lengths::Any).at(rate_hz).map(|about| (about.context, about.horizon))
        };
        assert_eq!(rows(31.25), Some((80, 40)));
        assert_eq!(rows(125.0), Some((320, 160)));
        assert_eq!(rows(1000.0), Some((2560, 1280)));
        for rate_hz in [0.0, 15.625, 100.0, 2000.0, -31.25, f64::NAN] {
            assert_eq!(rows(rate_hz), None, "{rate_hz}");
        }
        let rates = model(Lengths::Any).rates();
        assert_eq!(rates, "31.25, the checkpoint's rate, or a whole multiple of it up to 1000");
    }

    #[test]
    fn a_network_answers_at_its_own_rate_alone() {
        for lengths in [Lengths::Trained, Lengths::From(20)] {
            let network = model(lengths);
            assert!(network.at(31.25).is_some() && network.at(62.5).is_none());
            assert_eq!(network.rates(), "31.25, the checkpoint's rate");
        }
    }
}
