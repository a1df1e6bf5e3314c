//! Evaluations: the predictors, their task and the scores.

mod cells;
mod check;
mod default_grid;
mod inputs;
mod kind;
mod predictions;
mod sampler;
mod spec;

pub use cells::ScenarioCell;
pub use predictions::FilePredictions;
pub use sampler::{EvaluationSampler, SamplerSteps, SamplingRun, Start};
pub use spec::{Baseline, Bootstrap, EvaluateSpec, LatencySpec};
