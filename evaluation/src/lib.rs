//! How well a predictor answers: baselines, metrics, intervals, reports.
//!
//! Everything here compares predictors on the same scenarios. A predictor is handed
//! [`series::Observed`], which holds the torques of all samples but the positions of the context only, so
//! that it cannot see what it is asked for.

mod baselines;
mod bootstrap;
mod cell;
pub mod control;
mod error;
mod examples;
mod figure;
mod learned;
pub mod metrics;
mod predictor;
mod report;
mod rows;
mod scores;

pub use baselines::{
    Arx, DampedIntegrator, FittedDamping, HoldLast, Identification, LeastSquares, NominalArm,
    baseline,
};
pub use bootstrap::stratified_mean;
pub use cell::{
    CellResult, Failure, PredictorErrors, Rollouts, Scoring, evaluate_cell, measured_jitter_deg,
    measured_left_limits, within_torque_limits,
};
pub use error::EvaluationError;
pub use examples::{Example, Examples, examples};
pub use figure::{
    DrawnAnswer, calibration_figure, crps_figure, horizon_figure, latency_figure,
    prediction_figure, rmse_figure, sampler_steps_figure,
};
pub use learned::{FirstPrediction, LeakyLearned, Learned, OracleStarted, Start};
pub use metrics::rmse_deg;
pub use predictor::{Answer, Predictor, Samples};
pub use report::{Setting, paired_difference, summarize, trained_on};
pub use rows::{MEASURES, Measure, Row};
pub use scores::{
    CALIBRATION, ContinuityErrors, INTERVALS, IntervalErrors, Jitter, PerJoint, SampleErrors,
    ScenarioErrors, ScoredAs,
};
