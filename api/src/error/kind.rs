//! Status, type and title of the problem that an error is answered with.

use axum::http::StatusCode;
use store::StoreError;

use super::ApiError;
use crate::live::LiveError;

impl ApiError {
    pub fn status(&self) -> StatusCode {
        self.kind().0
    }

    /// Status, type and title of the problem.
    pub(super) fn kind(&self) -> (StatusCode, &'static str, &'static str) {
        use StatusCode as S;
        match self {
            Self::NotFound { .. } => (S::NOT_FOUND, "not-found", "There is no such resource"),
            Self::NoRoute { .. } => (S::NOT_FOUND, "no-route", "There is no such path"),
            Self::Method { .. } => {
                (S::METHOD_NOT_ALLOWED, "method", "The path does not answer this method")
            }
            Self::Parameter { .. } | Self::Query { .. } => {
                (S::BAD_REQUEST, "parameter", "A parameter is not allowed")
            }
            Self::ContentType { .. } => {
                (S::UNSUPPORTED_MEDIA_TYPE, "content-type", "The body is not declared as JSON")
            }
            Self::UploadType { .. } => {
                (S::UNSUPPORTED_MEDIA_TYPE, "content-type", "The body is not declared as a file")
            }
            Self::RobotType { .. } => {
                (S::UNSUPPORTED_MEDIA_TYPE, "content-type", "The body is not declared as a robot")
            }
            Self::BodyTooLarge { .. } => {
                (S::PAYLOAD_TOO_LARGE, "body-too-large", "The body is too large")
            }
            Self::UploadTooLarge { .. } => {
                (S::PAYLOAD_TOO_LARGE, "file-too-large", "The file is too large")
            }
            Self::UploadQuota { .. } => {
                (S::PAYLOAD_TOO_LARGE, "upload-quota", "The quota of sent files is used up")
            }
            Self::UploadStalled { .. } => {
                (S::REQUEST_TIMEOUT, "stalled", "The file did not arrive in time")
            }
            Self::UploadsCrowded => {
                (S::SERVICE_UNAVAILABLE, "crowded", "Too many files are being received")
            }
            Self::Form { .. } => (S::BAD_REQUEST, "form", "The form could not be read"),
            Self::Body { .. } => (S::BAD_REQUEST, "body", "The body could not be read"),
            Self::Json(_) => (S::BAD_REQUEST, "json", "The body is not JSON"),
            Self::Spec(_) => (S::UNPROCESSABLE_ENTITY, "spec", "The spec is not allowed"),
            Self::Urdf(_) => (S::UNPROCESSABLE_ENTITY, "urdf", "The URDF is not allowed"),
            Self::Question(_) => {
                (S::UNPROCESSABLE_ENTITY, "question", "The prediction request is not allowed")
            }
            Self::Labels(_) => (
                S::UNPROCESSABLE_ENTITY,
                "labels",
                "The name, note, tags or aliases are not allowed",
            ),
            Self::NewToken(_) => (S::UNPROCESSABLE_ENTITY, "new-token", "The token is not allowed"),
            Self::Live(error) => of_live(error),
            Self::NoModels => {
                (S::NOT_IMPLEMENTED, "no-models", "The server has no models for predictions")
            }
            Self::Handshake { .. } => {
                (S::UPGRADE_REQUIRED, "handshake", "The path needs a WebSocket")
            }
            Self::StreamsCrowded => {
                (S::SERVICE_UNAVAILABLE, "crowded", "Too many streams are open")
            }
            Self::EventsCrowded => {
                (S::SERVICE_UNAVAILABLE, "crowded", "Too many streams of events are open")
            }
            Self::Store(error) => of_store(error),
            Self::Unwritable(_) => {
                (S::SERVICE_UNAVAILABLE, "database", "The database cannot be written")
            }
            Self::AlreadyFinal { .. } => (S::CONFLICT, "already-final", "The job has ended"),
            Self::NotFailed { .. } => (S::CONFLICT, "not-failed", "The job has not failed"),
            Self::DatasetIncomplete { .. } => {
                (S::CONFLICT, "dataset-incomplete", "The dataset is not complete")
            }
            Self::Unauthorized { .. } => (S::UNAUTHORIZED, "token", "A token is required"),
            Self::Scope { .. } => (S::FORBIDDEN, "scope", "The token's scope is too small"),
            Self::CrossSite => (S::FORBIDDEN, "cross-site", "The request came from another site"),
            Self::ForeignHost { .. } => {
                (S::MISDIRECTED_REQUEST, "host", "The server does not have this name")
            }
            Self::Crowded => (S::SERVICE_UNAVAILABLE, "crowded", "Too many requests at once"),
            Self::TooFast { .. } => {
                (S::TOO_MANY_REQUESTS, "too-fast", "Too many requests per second")
            }
            Self::TooManyFailures { .. } => {
                (S::TOO_MANY_REQUESTS, "too-many-failures", "Too many logins failed")
            }
            Self::AddressCrowded => {
                (S::SERVICE_UNAVAILABLE, "crowded", "Too many connections from one address")
            }
            Self::RepeatedHeader { .. } => {
                (S::BAD_REQUEST, "repeated-header", "A header comes more than once")
            }
            Self::OtherFile { .. } => {
                (S::PRECONDITION_FAILED, "other-file", "The file is another one")
            }
            Self::DownloadsCrowded => {
                (S::SERVICE_UNAVAILABLE, "crowded", "Too many files are being sent")
            }
            Self::Ending => (S::SERVICE_UNAVAILABLE, "ending", "The server is about to stop"),
            Self::SlowBody => (S::REQUEST_TIMEOUT, "slow-body", "The body did not arrive in time"),
            Self::Timeout => (S::SERVICE_UNAVAILABLE, "timeout", "The answer took too long"),
            Self::Damaged { .. } => DAMAGED,
            Self::ShardUnreadable { .. } => {
                (S::INTERNAL_SERVER_ERROR, "shard-unreadable", "A shard cannot be read")
            }
            Self::Arrow(_) | Self::Figure(_) | Self::Random(_) | Self::Page(_) | Self::Internal => {
                (S::INTERNAL_SERVER_ERROR, "internal", "The server failed")
            }
        }
    }
}

/// Status, name and title of damage to a stored file.
const DAMAGED: (StatusCode, &str, &str) =
    (StatusCode::INTERNAL_SERVER_ERROR, "damaged", "A stored file is damaged");

fn of_store(error: &StoreError) -> (StatusCode, &'static str, &'static str) {
    use StatusCode as S;
    match error {
        StoreError::NotFound { .. } => (S::NOT_FOUND, "not-found", "There is no such resource"),
        StoreError::IdempotencyConflict { .. } => (
            S::UNPROCESSABLE_ENTITY,
            "idempotency-key",
            "The Idempotency-Key belongs to another request",
        ),
        StoreError::NeedNotMet { .. } => {
            (S::CONFLICT, "need-not-met", "A job that this one needs has just ended")
        }
        StoreError::TokenExists { .. }
        | StoreError::TooManyTokens { .. }
        | StoreError::FirstToken { .. } => (S::CONFLICT, "tokens", "The token cannot be created"),
        StoreError::TooManyTags { .. } => (S::CONFLICT, "tags", "There are too many tags"),
        StoreError::ExperimentTaken { .. } => {
            (S::CONFLICT, "experiment-taken", "The experiment exists already")
        }
        StoreError::InTrash { .. } | StoreError::Purged { .. } => {
            (S::GONE, "deleted", "It was deleted")
        }
        StoreError::NotDeleted { .. } => (S::CONFLICT, "not-deleted", "It is not in the trash"),
        StoreError::OwnerDeleted { .. } => {
            (S::CONFLICT, "owner-deleted", "It was deleted together with its owner")
        }
        StoreError::NotEnded { .. } => (S::CONFLICT, "not-ended", "Its job has not ended"),
        StoreError::Needed { .. } => (S::CONFLICT, "needed", "Jobs depend on it"),
        StoreError::InputDeleted { .. } | StoreError::FileDeleted { .. } => {
            (S::CONFLICT, "input-deleted", "Something that the job reads was just deleted")
        }
        StoreError::Deleted { .. } => (S::CONFLICT, "deleted", "It is deleted"),
        StoreError::ParamChanged { .. } => {
            (S::CONFLICT, "param-changed", "The param has another value already")
        }
        StoreError::DiskFull { .. } => (S::INSUFFICIENT_STORAGE, "disk-full", "The disk is full"),
        StoreError::Displaced { .. } => {
            (S::SERVICE_UNAVAILABLE, "files-away", "The files of the store are not there")
        }
        StoreError::DamagedObject { .. } => DAMAGED,
        _ => (S::INTERNAL_SERVER_ERROR, "internal", "The server failed"),
    }
}

fn of_live(error: &LiveError) -> (StatusCode, &'static str, &'static str) {
    use StatusCode as S;
    match error {
        LiveError::Refused(_) => {
            (S::UNPROCESSABLE_ENTITY, "question", "The prediction request is not allowed")
        }
        LiveError::Queue { .. } | LiveError::Memory { .. } | LiveError::Full { .. } => {
            (S::SERVICE_UNAVAILABLE, "crowded", "Too many predictions at once")
        }
        LiveError::TooLarge { .. } => {
            (S::INSUFFICIENT_STORAGE, "model-too-large", "The model is too large to be loaded")
        }
        LiveError::Unusable { .. } => {
            (S::INTERNAL_SERVER_ERROR, "model-unusable", "The model cannot be loaded")
        }
        LiveError::Failed { .. } => {
            (S::INTERNAL_SERVER_ERROR, "model-failed", "The model gave no prediction")
        }
        LiveError::Store(error) => of_store(error),
    }
}
