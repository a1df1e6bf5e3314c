use thiserror::Error;

#[derive(Debug, Error)]
pub enum EvaluationError {
    #[error("predictor {predictor} gave {got} values, {expected} were asked for")]
    WrongLength { predictor: String, got: usize, expected: usize },
    #[error("predictor {predictor} failed")]
    Model { predictor: String, source: models::ModelError },
    #[error(
        "predictor {predictor} begins with its own prediction of {shift} samples ago, but only \
         {pre_roll} samples are recorded before the window; allowed: a shift from 1 to that"
    )]
    PreRoll { predictor: String, shift: usize, pre_roll: usize },
    #[error("{failed} of {plans} plans were foreseen to lead to positions that are not finite")]
    NotFinite { failed: usize, plans: usize },
    #[error(transparent)]
    Shape(#[from] series::ShapeError),
    #[error("cell {0} of the evaluation has no result")]
    MissingCell(usize),
}
