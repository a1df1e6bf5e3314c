//! Trainings: one model, learned from one dataset or stream.

mod early_stop;
mod init;
mod inputs;
mod mixture;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::kind::{KindSpec, from_fields};
use crate::schema::Components;
use crate::{
    CheckpointRef, DataSources, DataSpec, Doubt, Execution, Given, Length, Lengths, ModelSpec,
    Product, Reference, Referred, SpecError, preset, stream,
};

pub use early_stop::{EarlyStopSpec, ValidationMetric};

/// Trains one model on one dataset or stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainSpec {
    /// The trajectories: a dataset, a stream of new robots, or a list of up to 16 of them. Every
    /// batch then has trajectories of each.
    pub data: DataSources,
    /// The share of each source of `data` in every batch, relative to the others. Default: equal
    /// shares. They are rounded to whole trajectories.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data_weights: Option<Vec<f64>>,
    /// The model and its sizes, or a preset of them.
    pub model: ModelSpec,
    /// The series that the model is given beside the positions of the context.
    #[serde(default, skip_serializing_if = "Given::is_torques")]
    pub given: Given,
    /// The checkpoint whose weights the training begins with, of a model with the same fields.
    /// Default: weights from `seed`. Steps and the optimizer begin anew.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub init: Option<CheckpointRef>,
    /// Parameters that keep the weights of `init`, by the beginnings of their names: a part of the
    /// network such as `encoder_blocks`, or one inside it such as `encoder_blocks.0.attention`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub frozen: Vec<String>,
    /// Number of samples that the model is given (the paper's m). The rest of the trajectory is the
    /// horizon.
    #[serde(default = "defaults::context")]
    pub context: u32,
    /// How u and y are scaled. Default: `context`, or `none` for a model that computes in N·m and
    /// rad.
    #[serde(default)]
    pub normalization: Normalization,
    /// The learning rate and the other numbers of AdamW.
    #[serde(default)]
    pub optimizer: OptimizerSpec,
    /// Number of trajectories per optimizer step.
    #[serde(default = "defaults::batch_size")]
    pub batch_size: u32,
    /// Number of parts of a batch that are computed one after the other. Their gradients are added,
    /// so the step is the same up to rounding and needs less memory. Divides `batch_size`.
    #[serde(default = "defaults::one", skip_serializing_if = "crate::omitted::is_one")]
    pub gradient_accumulation: u32,
    /// Keeps a moving average of the weights, which is evaluated in their place; `null` does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ema: Option<EmaSpec>,
    /// Weights of each joint's position error in the loss; `null` is 1 for all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss_weights: Option<Vec<f64>>,
    /// Number of optimizer steps, unless `early_stop` ends the training earlier.
    pub steps: u64,
    /// Seed of initial weights and batch order, 0 to 2^53 - 1. With `init`, of the order alone.
    #[serde(default)]
    pub seed: u64,
    /// Share of trajectories for validation: the last ones, which are never trained on. A stream
    /// has no last ones. Unless this is 0, it is validated with robots that the training never
    /// reaches.
    #[serde(default = "defaults::validation_fraction")]
    pub validation_fraction: f64,
    /// Number of steps between validations. The training is also validated at its end.
    #[serde(default = "defaults::validate_every_steps")]
    pub validate_every_steps: u64,
    /// Largest number of validation trajectories, taken from the beginning of those kept for
    /// validation.
    #[serde(default = "defaults::validation_trajectories")]
    pub validation_trajectories: u32,
    /// Largest number of these that are used for a denoiser's `validation/rmse_deg`, taken from the
    /// beginning. Each costs as many passes of the network as `model.sampler` has steps.
    #[serde(default = "defaults::sampled_trajectories")]
    pub sampled_trajectories: u32,
    /// The metric that compares validations. The best checkpoint has the lowest value.
    #[serde(default)]
    pub monitor: ValidationMetric,
    /// Ends the training when its validations no longer improve; `null` does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub early_stop: Option<EarlyStopSpec>,
    /// Number of steps between two checkpoints; `null` leaves it to `checkpoint_every_seconds`.
    #[serde(default = "defaults::checkpoint_every_steps")]
    pub checkpoint_every_steps: Option<u64>,
    /// Longest time without a checkpoint, s; `null` leaves it to `checkpoint_every_steps`. It
    /// decides when a checkpoint is written, but not what it contains.
    #[serde(default = "defaults::checkpoint_every_seconds")]
    pub checkpoint_every_seconds: Option<u32>,
    /// Number of newest checkpoints to keep, besides the best and the final one.
    #[serde(default = "defaults::keep_checkpoints")]
    pub keep_checkpoints: u32,
    /// How the job is executed. It is not part of the digest.
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// A training that another job refers to, and its data.
#[derive(Clone, Copy, Debug)]
pub struct Training<'a> {
    /// Its spec.
    pub spec: &'a TrainSpec,
    /// The first data that it is trained on. Others have the same shape and rate.
    pub data: &'a DataSpec,
}

impl Training<'_> {
    /// The context and the trajectory length of the training.
    pub(crate) fn length(&self) -> Length {
        Length { context: self.spec.context, samples: self.data.samples() }
    }
}

/// The source of the mean and standard deviation of u and y.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Normalization {
    /// Each trajectory's own context, per channel.
    #[default]
    Context,
    /// The training trajectories of the dataset, per channel. The values are fixed.
    Dataset,
    /// Each trajectory's own context *and horizon*, as in the paper's code. This leaks the future.
    PaperLeaky,
    /// No normalization: a model sees N·m and rad.
    None,
}

impl Normalization {
    /// The default normalization of a model.
    pub fn default_for(model: &ModelSpec) -> Self {
        if model.is_physical() { Self::None } else { Self::default() }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Context => "context",
            Self::Dataset => "dataset",
            Self::PaperLeaky => "paper-leaky",
            Self::None => "none",
        }
    }
}

/// AdamW with optional linear warmup, followed by a cosine decay to a fraction of the learning
/// rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OptimizerSpec {
    /// The largest learning rate, after the warmup.
    pub learning_rate: f64,
    /// The last learning rate as a fraction of the largest, 0 to 1.
    pub final_learning_rate_ratio: f64,
    /// Number of steps in which the learning rate grows linearly from 0.
    pub warmup_steps: u64,
    /// Decay of the moving averages of the gradient and of its square.
    #[schema(min_items = 2, max_items = 2)]
    pub betas: [f64; 2],
    /// Added to the square root of the second moment; 1e-8 as in PyTorch.
    pub epsilon: f64,
    /// Decoupled decay of the weights; 0 makes it Adam.
    pub weight_decay: f64,
    /// Largest global norm of the gradient; `null` does not clip.
    pub gradient_clip_norm: Option<f64>,
}

impl Default for OptimizerSpec {
    fn default() -> Self {
        Self {
            learning_rate: 6e-4,
            final_learning_rate_ratio: 0.1,
            warmup_steps: 0,
            betas: [0.9, 0.95],
            epsilon: 1e-8,
            weight_decay: 0.0,
            gradient_clip_norm: None,
        }
    }
}

/// Exponential moving average of the weights. Its decay grows as a power of the steps: after n
/// steps it is min(`decay`, 1 - n^-`power`), which is the warm-up of diffusion policy's code.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EmaSpec {
    /// The largest decay, 0 to 1.
    pub decay: f64,
    /// The power of the number of steps.
    pub power: f64,
}

impl Default for EmaSpec {
    fn default() -> Self {
        Self { decay: 0.9999, power: 0.75 }
    }
}

impl Check for EmaSpec {
    fn check(&self, violations: &mut Violations) {
        violations.within("decay", self.decay, 0.0..=0.999_999);
        violations.within("power", self.power, 0.1..=2.0);
    }
}

mod defaults {
    pub const fn one() -> u32 {
        1
    }
    pub const fn context() -> u32 {
        320
    }
    pub const fn batch_size() -> u32 {
        64
    }
    pub const fn validation_fraction() -> f64 {
        0.1
    }
    pub const fn validate_every_steps() -> u64 {
        200
    }
    pub const fn validation_trajectories() -> u32 {
        512
    }
    pub const fn sampled_trajectories() -> u32 {
        64
    }
    #[expect(clippy::unnecessary_wraps, reason = "the default of a field that may be null")]
    pub const fn checkpoint_every_steps() -> Option<u64> {
        Some(200)
    }
    #[expect(clippy::unnecessary_wraps, reason = "the default of a field that may be null")]
    pub const fn checkpoint_every_seconds() -> Option<u32> {
        Some(600)
    }
    pub const fn keep_checkpoints() -> u32 {
        2
    }
}

impl KindSpec for TrainSpec {
    fn read(
        mut fields: Map<String, Value>,
        mut found: SpecError,
        schemas: &Components,
    ) -> Result<Self, SpecError> {
        stream::make_endless(&mut fields);
        let fields = preset::resolve_model(fields, &mut found);
        let is_given = fields.contains_key("normalization");
        let mut spec: Self = from_fields(fields, found, schemas)?;
        if !is_given {
            spec.normalization = Normalization::default_for(&spec.model);
        }
        Ok(spec)
    }

    fn makes() -> Option<Product> {
        Some(Product::Checkpoints)
    }

    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        let init = self.init.as_mut().map(|checkpoint| Reference {
            field: "init".to_owned(),
            to: Referred::Checkpoint(checkpoint),
        });
        self.data.references("data").into_iter().chain(init).collect()
    }

    fn doubts(&self) -> Vec<Doubt> {
        let sources = self.data.in_field("data");
        sources.iter().flat_map(|(field, source)| source.doubts(field)).collect()
    }
}

impl Check for TrainSpec {
    fn check(&self, violations: &mut Violations) {
        self.check_mixture(violations);
        violations.part("model", &self.model);
        if self.model.is_physical() && self.normalization != Normalization::None {
            let allowed = "none, for a model that computes in N·m and rad";
            violations.add("normalization", self.normalization.name(), allowed);
        }
        if self.given == Given::References && self.model.is_physical() {
            let allowed =
                format!("torques for a {}, which moves arms by them", self.model.architecture());
            violations.add("given", self.given, allowed);
        }
        let residual = self.model.residual();
        if !residual.fits(self.given) {
            let allowed = match self.given {
                Given::Torques => "a path that torques give, or none",
                Given::References => "reference or none, because an integrator needs torques",
            };
            violations.add("model.residual", residual.name(), allowed);
        }
        self.check_frozen(violations);
        violations.within("context", self.context, 1..=9_999);
        violations.part("optimizer", &self.optimizer);
        violations.within("batch_size", self.batch_size, 1..=4096);
        violations.within("gradient_accumulation", self.gradient_accumulation, 1..=4096);
        if self.gradient_accumulation > 0
            && !self.batch_size.is_multiple_of(self.gradient_accumulation)
        {
            violations.add(
                "gradient_accumulation",
                self.gradient_accumulation,
                format!("a divisor of batch_size, which is {}", self.batch_size),
            );
        }
        if let Some(ema) = &self.ema {
            violations.part("ema", ema);
        }
        if let Some(weights) = &self.loss_weights {
            violations.all_within("loss_weights", weights, &(0.0..=1e6));
            if weights.iter().all(|&weight| weight == 0.0) {
                violations.add("loss_weights", "0 for every joint", "one above 0 at least");
            }
        }
        violations.within("steps", self.steps, 1..=10_000_000);
        violations.seed("seed", self.seed);
        violations.within("validation_fraction", self.validation_fraction, 0.0..=0.5);
        self.check_validation(violations);
        self.check_checkpoints(violations);
        violations.part("execution", &self.execution);
        let patch = self.model.patch();
        if patch > 0 && !self.context.is_multiple_of(patch) {
            violations.add(
                "context",
                self.context,
                format!("a multiple of model.patch, which is {patch}"),
            );
        }
        if let Lengths::From(least) = self.model.lengths()
            && least > self.context
        {
            let allowed = format!("at most context, which is {}", self.context);
            violations.add("model.least_context", least, allowed);
        }
        if self.optimizer.warmup_steps > self.steps {
            violations.add(
                "optimizer.warmup_steps",
                self.optimizer.warmup_steps,
                format!("at most steps, which is {}", self.steps),
            );
        }
    }
}

impl TrainSpec {
    fn check_validation(&self, violations: &mut Violations) {
        violations.within("validate_every_steps", self.validate_every_steps, 1..=10_000_000);
        violations.within("validation_trajectories", self.validation_trajectories, 1..=100_000);
        violations.within("sampled_trajectories", self.sampled_trajectories, 1..=100_000);
        if let Some(early_stop) = &self.early_stop {
            violations.part("early_stop", early_stop);
            if self.validation_fraction == 0.0 {
                let allowed = "above 0 with early_stop, which needs validations";
                violations.add("validation_fraction", self.validation_fraction, allowed);
            }
        }
    }

    fn check_checkpoints(&self, violations: &mut Violations) {
        if let Some(steps) = self.checkpoint_every_steps {
            violations.within("checkpoint_every_steps", steps, 1..=10_000_000);
        }
        if let Some(seconds) = self.checkpoint_every_seconds {
            violations.within("checkpoint_every_seconds", seconds, 1..=1_000_000);
        }
        if self.checkpoint_every_steps.is_none() && self.checkpoint_every_seconds.is_none() {
            let allowed = "a number, here or in checkpoint_every_seconds";
            violations.add("checkpoint_every_steps", "null", allowed);
        }
        violations.within("keep_checkpoints", self.keep_checkpoints, 1..=1000);
    }
}

impl Check for OptimizerSpec {
    fn check(&self, violations: &mut Violations) {
        violations.within("learning_rate", self.learning_rate, 1e-9..=1.0);
        violations.within("final_learning_rate_ratio", self.final_learning_rate_ratio, 0.0..=1.0);
        violations.all_within("betas", &self.betas, &(0.0..=0.999_999));
        violations.within("epsilon", self.epsilon, 1e-12..=0.1);
        violations.within("weight_decay", self.weight_decay, 0.0..=1.0);
        if let Some(norm) = self.gradient_clip_norm {
            violations.within("gradient_clip_norm", norm, 1e-6..=1e6);
        }
    }
}
