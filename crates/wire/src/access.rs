//! Tokens, and the audit log.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Scope;

/// A token's record, without the token itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Token {
    /// Its id, by which it is revoked.
    pub id: i64,
    /// Unique among the tokens that are not revoked. The audit log names it.
    pub name: String,
    /// The requests that it allows.
    pub scope: Scope,
    /// Whether the server accepts it: it is neither revoked nor expired.
    pub valid: bool,
    /// When it was created.
    pub created_at: String,
    /// When it expires. Missing if it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires_at: Option<String>,
    /// When it was last used, precise to the minute. Missing if it never was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_used_at: Option<String>,
    /// When it was revoked. Missing if it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revoked_at: Option<String>,
}

/// All tokens, oldest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Tokens {
    /// The tokens, with those that are revoked or expired.
    pub tokens: Vec<Token>,
}

/// A token to be created.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewToken {
    /// Letters, digits, dashes, underscores, dots and @. Only a revoked token may share it.
    #[schema(
        min_length = 1,
        max_length = 100,
        pattern = "^[A-Za-z0-9._@-]+$",
        example = "notebook-ana"
    )]
    pub name: String,
    /// The requests that it should allow.
    pub scope: Scope,
    /// Seconds until it expires. Without it, the token does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 60, maximum = 315_360_000)]
    pub expires_in_s: Option<u64>,
}

/// A new token. It is shown only this once, because the server stores only its digest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CreatedToken {
    /// The token: the prefix `torqued_` and 256 random bits.
    #[schema(example = "torqued_3q2-7wEj...")]
    pub secret: String,
    /// Its record.
    pub token: Token,
}

/// A request that changed something, or was refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct AuditEntry {
    /// Grows from entry to entry.
    pub id: i64,
    /// The time of the answer.
    pub at: String,
    /// Name of the token. `TORQUED_TOKEN` stands for the token that the server was started with,
    /// and `anyone` is used when the server requires none.
    pub actor: String,
    /// The address of the client; `socket` on a Unix socket.
    pub address: String,
    /// The method of the request.
    #[schema(example = "POST")]
    pub method: String,
    /// The path and the query.
    #[schema(example = "/v1/jobs/6/cancel")]
    pub path: String,
    /// The status of the answer.
    pub status: u16,
    /// Path of the resource that the request created.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = "/v1/jobs/7")]
    pub made: Option<String>,
}

/// Entries of the audit log, newest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Audit {
    /// The entries of the page.
    pub entries: Vec<AuditEntry>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}
