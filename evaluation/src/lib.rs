//! How well a predictor answers: baselines, metrics, intervals, reports.
//!
//! Everything here compares predictors on the same scenarios. A predictor is handed
//! [`Observed`], which holds the torques of all samples but the positions of the context only, so
//! that it cannot see what it is asked for.

mod baselines;
mod bootstrap;
mod cell;
mod error;
mod figure;
mod learned;
mod metrics;
mod predictor;
mod report;

pub use baselines::{DampedIntegrator, HoldLast, LeastSquares, baseline};
pub use bootstrap::{Interval, stratified_mean};
pub use cell::{CellResult, PredictorErrors, evaluate_cell};
pub use error::EvaluationError;
pub use figure::rmse_figure;
pub use learned::{LeakyLearned, Learned};
pub use metrics::rmse_deg;
pub use predictor::{Observed, Predictor, Scenarios};
pub use report::{
    CellSummary, GroupSummary, PairedDifference, PredictorInfo, PredictorKind, PredictorSummary,
    Report, TrainedOn, summarize,
};
