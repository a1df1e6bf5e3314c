//! The errors of evaluations.

use thiserror::Error;

/// Why an evaluation has no result.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum EvaluationError {
    #[error("predictor {predictor} gave {got} values, expected {expected}")]
    WrongLength { predictor: String, got: usize, expected: usize },
    #[error("predictor {predictor} failed")]
    Model { predictor: String, source: models::ModelError },
    #[error(
        "predictor {predictor} begins with its own prediction of {shift} samples ago, but the \
         recording has {pre_roll} samples before the window; allowed: shifts of 1 sample or more \
         that the recording covers"
    )]
    PreRoll { predictor: String, shift: usize, pre_roll: usize },
    #[error("the forecast of {failed} of {plans} plans has positions that are not finite")]
    NotFinite { failed: usize, plans: usize },
    #[error("predictor {predictor} predicts motions and says no torques")]
    SaysNoTorques { predictor: String },
    #[error(
        "{after_s:.2} s after control began, {lost}: joint {joint} was {off_rad:.3} rad off its reference"
    )]
    LostReference { lost: dynamics::LostTrack, joint: usize, off_rad: f64, after_s: f64 },
    #[error(transparent)]
    Dynamics(#[from] dynamics::DynamicsError),
    #[error(transparent)]
    Shape(#[from] series::ShapeError),
    #[error("cell {0} of the evaluation has no result")]
    MissingCell(usize),
}
