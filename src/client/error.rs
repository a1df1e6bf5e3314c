//! Failed requests and failed jobs, in words for the terminal.

use std::fmt::Write;
use std::time::Duration;

use reqwest::StatusCode;
use serde_json::Value;
use spec::Digest;
use thiserror::Error;
use wire::{Job, JobState, Problem};

/// Why a request to the server failed.
#[derive(Debug, Error)]
pub enum ClientError {
    #[error("{server:?} is not a server address: {reason}")]
    Address { server: String, reason: String },

    #[error("no answer from {server}: {}; is `torqued serve` running there?", innermost(reason))]
    Unreachable { server: String, reason: reqwest::Error },

    #[error("{server} sent nothing for {} s", waited.as_secs())]
    Silent { server: String, waited: Duration },

    #[error("cannot read {}: {reason}", path.display())]
    File { path: std::path::PathBuf, reason: std::io::Error },

    #[error("cannot write {}: {reason}", path.display())]
    Write { path: std::path::PathBuf, reason: std::io::Error },

    #[error(
        "checksum mismatch of {name}: expected {expected}, received {found}; repeat the command"
    )]
    Checksum { name: String, expected: Digest, found: Digest },

    #[error(
        "{} differs from the server's: expected {expected}, found {found}; delete it, or choose \
         another folder",
        path.display()
    )]
    Differs { path: std::path::PathBuf, expected: Digest, found: Digest },

    #[error("the server names a file {name:?}, allowed: a name without folders")]
    Name { name: String },

    /// An RFC 9457 problem, with one violation per line.
    #[error("{message}")]
    Refused {
        status: StatusCode,
        message: String,
        /// The fields of the spec that were refused.
        fields: Vec<String>,
    },

    #[error("the stream to {server} ended: {reason}")]
    Stream { server: String, reason: String },

    #[error("{server} sent an answer that is not torqued's: {source}")]
    UnexpectedResponse { server: String, source: serde_json::Error },
}

/// The innermost cause. `reqwest` wraps the reason ("connection refused") in several layers of its
/// own.
pub fn innermost(error: &reqwest::Error) -> String {
    if error.is_timeout() {
        return "timed out".to_owned();
    }
    let mut innermost: &dyn std::error::Error = error;
    while let Some(source) = innermost.source() {
        innermost = source;
    }
    innermost.to_string()
}

impl ClientError {
    /// Whether the server may answer later.
    pub fn is_unreachable(&self) -> bool {
        matches!(self, Self::Unreachable { .. } | Self::Silent { .. })
    }

    pub(super) fn refused(status: StatusCode, body: &str) -> Self {
        let (message, fields) = match serde_json::from_str::<Problem>(body) {
            Ok(problem) => {
                let message = message(&problem);
                (message, problem.violations.into_iter().map(|violation| violation.field).collect())
            }
            // The part of the API that is MLflow's has errors of MLflow's shape.
            Err(_) => match serde_json::from_str::<Value>(body)
                .map(|problem| problem["message"].clone())
            {
                Ok(Value::String(message)) => (message, Vec::new()),
                _ => (format!("the server answered {status}"), Vec::new()),
            },
        };
        Self::Refused { status, message, fields }
    }
}

impl ClientError {
    /// The same refusal with what to do next.
    pub fn with_advice(mut self, advice: &str) -> Self {
        if let Self::Refused { message, .. } = &mut self {
            let separator = if message.contains('\n') { "\n" } else { "; " };
            let _ = write!(message, "{separator}{advice}");
        }
        self
    }
}

/// The title, followed by its detail or by one line per violation.
fn message(problem: &Problem) -> String {
    let mut message = problem.title.clone();
    if problem.violations.is_empty() {
        let _ = write!(message, ": {}", problem.detail);
    }
    for violation in &problem.violations {
        let _ = write!(message, "\n  {violation}");
    }
    if problem.more_violations > 0 {
        let _ = write!(message, "\n  and {} more", problem.more_violations);
    }
    message
}

/// A job that had to succeed failed or was cancelled.
#[derive(Debug, Error)]
#[error("job {id} {state}: {reason}")]
pub struct JobEnded {
    id: i64,
    state: JobState,
    reason: String,
}

impl JobEnded {
    /// The error of a job that ended without success.
    pub fn new(job: &Job) -> Self {
        Self { id: job.id, state: job.state, reason: failure(job) }
    }
}

/// Why a job did not succeed: the reasons of its members, or its own if it has none.
fn failure(job: &Job) -> String {
    let failed = job.members.iter().filter(|member| member.state == JobState::Failed);
    let reasons: Vec<String> = failed
        .filter_map(|member| Some(format!("{}: {}", member.name, member.error.as_ref()?)))
        .collect();
    match (reasons.is_empty(), &job.error) {
        (true, Some(error)) => error.clone(),
        (true, None) => "no reason given".to_owned(),
        (false, _) => reasons.join("; "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_names_each_field_its_value_and_what_is_allowed() {
        let body = r#"{"type":"/problems/spec","title":"The spec is not allowed","status":422,
            "detail":"steps is 0, allowed: 1 to 10; stesp: unknown field",
            "violations":[{"field":"steps","value":"0","allowed":"1 to 10"},
                          {"field":"stesp","value":"","allowed":"unknown field"}]}"#;
        let error = ClientError::refused(StatusCode::UNPROCESSABLE_ENTITY, body);
        assert_eq!(
            error.to_string(),
            "The spec is not allowed\n  steps is 0, allowed: 1 to 10\n  stesp: unknown field"
        );
        let body = body.replace("\"status\"", "\"more_violations\":7,\"status\"");
        let error = ClientError::refused(StatusCode::UNPROCESSABLE_ENTITY, &body);
        assert!(error.to_string().ends_with("\n  stesp: unknown field\n  and 7 more"), "{error}");
    }

    #[test]
    fn an_answer_that_is_no_problem_still_names_the_status() {
        let error = ClientError::refused(StatusCode::BAD_GATEWAY, "<html>");
        assert_eq!(error.to_string(), "the server answered 502 Bad Gateway");
    }
}
