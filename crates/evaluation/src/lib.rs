//! Evaluation of predictors: baselines, metrics, intervals, closed loops, reports.
//!
//! All predictors are compared on the same scenarios. A predictor gets [`series::Observed`], which
//! has the torques of all samples, or the references of a controller in their place, but only the
//! positions of the context. So it cannot see the positions that it predicts.

#![warn(missing_docs)]

mod baselines;
mod bootstrap;
mod cell;
pub mod control;
mod error;
mod examples;
mod figure;
mod given;
mod horizons;
mod learned;
pub mod metrics;
mod predictor;
mod report;
mod rows;
mod scores;

pub use baselines::{
    Arx, BaseParameters, ConstantVelocity, DampedIntegrator, FittedDamping, FollowReference,
    HoldLast, Identification, JointEkf, KnownController, LeastSquares, NominalArm, Oracle,
    Simulated, baseline, prior_knowledge,
};
pub use cell::{
    CellResult, Failure, PredictorErrors, Rollouts, Scoring, evaluate_cell, measured_jitter_deg,
    measured_left_limits, within_torque_limits,
};
pub use error::EvaluationError;
pub use examples::{Example, Examples, examples};
pub use figure::{
    DrawnAnswer, calibration_figure, colour_of, crps_figure, horizon_figure, latency_figure,
    prediction_figure, rmse_figure, sampler_steps_figure,
};
pub use given::Given;
pub use horizons::ErrorHorizon;
pub use learned::{FirstPrediction, LeakyLearned, Learned, OracleStarted, Start};
pub use metrics::rmse_deg;
pub use predictor::{Answer, Predictor, Samples};
pub use report::{Setting, summarize, trained_on, trained_on_together};
pub use rows::Row;
pub use scores::{Measure, ScenarioErrors};
