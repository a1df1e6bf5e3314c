//! Errors in MLflow's form: a code and a message.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde_json::json;
use spec::{ALLOWED_BYTES, cut};
use store::StoreError;
use thiserror::Error;

use crate::error::ApiError;

/// The codes of `mlflow/protos/databricks.proto` that this server uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorCode {
    InvalidParameterValue,
    ResourceDoesNotExist,
    ResourceAlreadyExists,
    EndpointNotFound,
    PermissionDenied,
    Unauthenticated,
    RequestLimitExceeded,
    TemporarilyUnavailable,
    InternalError,
}

#[derive(Debug, Error)]
pub enum MlflowError {
    #[error("{message}")]
    Refused { code: ErrorCode, message: String },

    /// An error that any path of the server may have. [`super::translate`] puts it into MLflow's
    /// form.
    #[error(transparent)]
    Api(#[from] ApiError),
}

impl ErrorCode {
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::InvalidParameterValue => "INVALID_PARAMETER_VALUE",
            Self::ResourceDoesNotExist => "RESOURCE_DOES_NOT_EXIST",
            Self::ResourceAlreadyExists => "RESOURCE_ALREADY_EXISTS",
            Self::EndpointNotFound => "ENDPOINT_NOT_FOUND",
            Self::PermissionDenied => "PERMISSION_DENIED",
            Self::Unauthenticated => "UNAUTHENTICATED",
            Self::RequestLimitExceeded => "REQUEST_LIMIT_EXCEEDED",
            Self::TemporarilyUnavailable => "TEMPORARILY_UNAVAILABLE",
            Self::InternalError => "INTERNAL_ERROR",
        }
    }

    /// The status in `mlflow/exceptions.py`.
    const fn status(self) -> StatusCode {
        match self {
            Self::InvalidParameterValue | Self::ResourceAlreadyExists => StatusCode::BAD_REQUEST,
            Self::ResourceDoesNotExist | Self::EndpointNotFound => StatusCode::NOT_FOUND,
            Self::PermissionDenied => StatusCode::FORBIDDEN,
            Self::Unauthenticated => StatusCode::UNAUTHORIZED,
            Self::RequestLimitExceeded => StatusCode::TOO_MANY_REQUESTS,
            Self::TemporarilyUnavailable => StatusCode::SERVICE_UNAVAILABLE,
            Self::InternalError => StatusCode::INTERNAL_SERVER_ERROR,
        }
    }

    /// The most specific code for an answer with this status.
    pub fn of_status(status: StatusCode) -> Self {
        match status {
            StatusCode::NOT_FOUND | StatusCode::GONE => Self::ResourceDoesNotExist,
            StatusCode::UNAUTHORIZED => Self::Unauthenticated,
            StatusCode::FORBIDDEN => Self::PermissionDenied,
            StatusCode::METHOD_NOT_ALLOWED => Self::EndpointNotFound,
            StatusCode::TOO_MANY_REQUESTS => Self::RequestLimitExceeded,
            StatusCode::SERVICE_UNAVAILABLE | StatusCode::REQUEST_TIMEOUT => {
                Self::TemporarilyUnavailable
            }
            status if status.is_server_error() => Self::InternalError,
            _ => Self::InvalidParameterValue,
        }
    }
}

impl MlflowError {
    pub fn refused(code: ErrorCode, message: String) -> Self {
        Self::Refused { code, message: cut(message, ALLOWED_BYTES) }
    }

    /// An invalid field. `value` is its value as received, or a part of it.
    pub fn invalid(field: &str, value: &str, allowed: &str) -> Self {
        let message = format!("{field} is {}, allowed: {allowed}", shortened(value));
        Self::refused(ErrorCode::InvalidParameterValue, message)
    }

    pub fn missing(field: &str) -> Self {
        let message = format!("{field} is missing");
        Self::refused(ErrorCode::InvalidParameterValue, message)
    }

    pub fn not_found(message: String) -> Self {
        Self::refused(ErrorCode::ResourceDoesNotExist, message)
    }
}

/// The value in quotes, cut to one line.
fn shortened(value: &str) -> String {
    const CHARACTERS: usize = 80;
    match value.char_indices().nth(CHARACTERS) {
        None => format!("{value:?}"),
        Some((end, _)) => format!("{:?}… of {} characters", &value[..end], value.chars().count()),
    }
}

impl From<StoreError> for MlflowError {
    fn from(error: StoreError) -> Self {
        let code = match &error {
            StoreError::NotFound { .. } => ErrorCode::ResourceDoesNotExist,
            StoreError::ExperimentTaken { .. } => ErrorCode::ResourceAlreadyExists,
            StoreError::Deleted { .. } | StoreError::ParamChanged { .. } => {
                ErrorCode::InvalidParameterValue
            }
            _ => return Self::Api(error.into()),
        };
        Self::refused(code, error.to_string())
    }
}

impl IntoResponse for MlflowError {
    fn into_response(self) -> Response {
        match self {
            Self::Refused { code, message } => {
                let body = json!({"error_code": code.as_str(), "message": message});
                (code.status(), Json(body)).into_response()
            }
            Self::Api(error) => error.into_response(),
        }
    }
}
