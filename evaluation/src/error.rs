use thiserror::Error;

#[derive(Debug, Error)]
pub enum EvaluationError {
    #[error(
        "predictor {predictor} gave a value that is not finite for scenario {scenario} of the cell"
    )]
    NotFinite { predictor: String, scenario: usize },
    #[error("predictor {predictor} gave {got} values, {expected} were asked for")]
    WrongLength { predictor: String, got: usize, expected: usize },
    #[error("predictor {predictor} failed")]
    Model { predictor: String, source: models::ModelError },
    #[error("cell {0} of the evaluation has no result")]
    MissingCell(usize),
}
