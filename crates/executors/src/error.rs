//! Failed requests to an engine, and what they say about it.

use std::io;
use std::time::Duration;

/// Why a request to an engine failed.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    #[error(
        "cannot run Slurm's {program}: {source}; install Slurm's commands where the server runs"
    )]
    Program { program: &'static str, source: io::Error },
    #[error("Slurm's {program} did not answer within {} s", limit.as_secs())]
    ProgramSilent { program: &'static str, limit: Duration },
    #[error("Slurm's {program} failed: {message}")]
    ProgramFailed { program: &'static str, message: String },
    #[error("Slurm's {program} printed an unexpected line: {line:?}")]
    Unreadable { program: &'static str, line: String },
    #[error("Kubernetes did not answer within {} s", limit.as_secs())]
    KubernetesSilent { limit: Duration },
    #[error(
        "Kubernetes does not accept the credentials (401): {message}; check them, or the service \
         account's token"
    )]
    Unauthorized { message: String },
    #[error(
        "Kubernetes does not allow the request (403): {message}; the Role in \
         deploy/kubernetes/server.yaml has the needed permissions"
    )]
    Forbidden { message: String },
    #[error("Kubernetes refuses ({code}): {message}")]
    Refused { code: u16, message: String },
    #[error("the request to Kubernetes failed")]
    Kubernetes(#[source] Box<kube::Error>),
}

impl EngineError {
    /// Whether the engine may have carried the request out nevertheless.
    pub(crate) fn is_uncertain(&self) -> bool {
        match self {
            Self::ProgramSilent { .. } | Self::KubernetesSilent { .. } | Self::Kubernetes(_) => {
                true
            }
            Self::Unreadable { .. } => true,
            // Slurm's library prints these words when no answer came.
            Self::ProgramFailed { message, .. } => {
                message.contains("timed out") || message.contains("Zero Bytes")
            }
            // A gateway gave up waiting, or the server broke off.
            Self::Refused { code, .. } => *code >= 500,
            Self::Program { .. } | Self::Unauthorized { .. } | Self::Forbidden { .. } => false,
        }
    }

    /// Whether the refusal is about this request only. The engine may accept others.
    pub(crate) fn is_of_this_request(&self) -> bool {
        const TOO_MANY_REQUESTS: u16 = 429;
        match self {
            Self::ProgramFailed { .. } => !self.is_uncertain(),
            // A quota, for example.
            Self::Forbidden { .. } => true,
            Self::Refused { code, .. } => *code < 500 && *code != TOO_MANY_REQUESTS,
            Self::Program { .. }
            | Self::ProgramSilent { .. }
            | Self::Unreadable { .. }
            | Self::KubernetesSilent { .. }
            | Self::Unauthorized { .. }
            | Self::Kubernetes(_) => false,
        }
    }
}
