use reqwest::StatusCode;
use serde::Deserialize;
use thiserror::Error;

use crate::client::innermost;

/// Why the MLflow server did not take what it was sent.
#[derive(Debug, Error)]
pub enum MlflowError {
    #[error(
        "--mlflow is {server:?}, allowed: http://HOST:PORT or https://HOST, with a path if there is one"
    )]
    Address { server: String },

    #[error(
        "no answer from the MLflow server {server}: {}; is `mlflow server` running there?",
        innermost(reason)
    )]
    Unreachable { server: String, reason: reqwest::Error },

    #[error(
        "the MLflow server {server} refused the login ({status}); set MLFLOW_TRACKING_USERNAME and \
         MLFLOW_TRACKING_PASSWORD, or MLFLOW_TRACKING_TOKEN"
    )]
    Login { server: String, status: StatusCode },

    #[error("the MLflow server {server} refused {request}: {message}")]
    Refused { server: String, request: String, status: StatusCode, code: String, message: String },

    #[error(
        "the MLflow server {server} answered {request} with something else than MLflow does: {reason}"
    )]
    UnexpectedResponse { server: String, request: String, reason: String },

    #[error(
        "experiment {name:?} is deleted in the MLflow server {server}; restore it there, or name another one with --experiment"
    )]
    DeletedExperiment { server: String, name: String },

    #[error(
        "the MLflow server {server} keeps files at {place}, where its own clients write without it; start it with \
         --serve-artifacts and without --default-artifact-root, or give --without-files"
    )]
    NoProxy { server: String, place: String },

    #[error("cannot read {}: {reason}", path.display())]
    File { path: std::path::PathBuf, reason: std::io::Error },
}

/// An error as MLflow's servers write it.
#[derive(Deserialize)]
struct Refusal {
    error_code: String,
    #[serde(default)]
    message: String,
}

impl MlflowError {
    pub fn refused(server: String, request: String, status: StatusCode, body: &str) -> Self {
        match serde_json::from_str::<Refusal>(body) {
            Err(_) if matches!(status, StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN) => {
                Self::Login { server, status }
            }
            Ok(_) if status == StatusCode::UNAUTHORIZED => Self::Login { server, status },
            Ok(Refusal { error_code: code, message }) => {
                let message = in_a_line(if message.is_empty() { &code } else { &message });
                Self::Refused { server, request, status, code, message }
            }
            Err(_) if status == StatusCode::NOT_FOUND => {
                let reason = "there is no such path; is this MLflow's address?".to_owned();
                Self::UnexpectedResponse { server, request, reason }
            }
            Err(_) => {
                let message = format!("it answered {status}");
                Self::Refused { server, request, status, code: String::new(), message }
            }
        }
    }

    /// Whether the server says that there is no such thing.
    pub fn is_absent(&self) -> bool {
        matches!(self, Self::Refused { code, .. } if code == "RESOURCE_DOES_NOT_EXIST")
    }
}

fn in_a_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(status: StatusCode, body: &str) -> String {
        let request = "runs/log-batch".to_owned();
        MlflowError::refused("http://lab:5000".to_owned(), request, status, body).to_string()
    }

    #[test]
    fn a_limit_of_mlflow_is_said_in_its_words_and_in_one_line() {
        let body = r#"{"error_code": "INVALID_PARAMETER_VALUE", "message": "Param value\n'x' is too long"}"#;
        assert_eq!(
            refused(StatusCode::BAD_REQUEST, body),
            "the MLflow server http://lab:5000 refused runs/log-batch: Param value 'x' is too long"
        );
    }

    #[test]
    fn a_login_that_is_missing_says_which_variables_to_set() {
        for body in ["You are not authenticated.", r#"{"error_code": "UNAUTHENTICATED"}"#] {
            let message = refused(StatusCode::UNAUTHORIZED, body);
            assert!(message.contains("MLFLOW_TRACKING_TOKEN"), "{message}");
        }
    }
}
