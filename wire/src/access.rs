//! Tokens, and the log of what was done with them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Scope;

/// A token that lets its bearer in, without the token itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Token {
    pub id: i64,
    /// Unique among the tokens that are not revoked. The audit log names it.
    pub name: String,
    pub scope: Scope,
    /// Whether the server accepts it: it is neither revoked nor expired.
    pub valid: bool,
    pub created_at: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires_at: Option<String>,
    /// To the minute.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_used_at: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revoked_at: Option<String>,
}

/// All tokens, oldest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Tokens {
    pub tokens: Vec<Token>,
}

/// A token to be made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewToken {
    /// Letters, digits, dashes, underscores, dots and @.
    #[schema(
        min_length = 1,
        max_length = 100,
        pattern = "^[A-Za-z0-9._@-]+$",
        example = "notebook-ana"
    )]
    pub name: String,
    pub scope: Scope,
    /// Seconds until it expires; left out, it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 60, maximum = 315_360_000)]
    pub expires_in_s: Option<u64>,
}

/// A new token. The server keeps its digest alone, and shows it this once.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CreatedToken {
    /// 256 random bits behind the prefix `torqued_`.
    #[schema(example = "torqued_3q2-7wEj...")]
    pub secret: String,
    pub token: Token,
}

/// A request that changed something, or tried to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct AuditEntry {
    pub id: i64,
    pub at: String,
    /// Name of the token; `TORQUED_TOKEN` for the one that the server was started with, and `anyone` where the server
    /// asks for none.
    pub actor: String,
    /// The address that it came from; `socket` on a Unix socket.
    pub address: String,
    #[schema(example = "POST")]
    pub method: String,
    /// With its query.
    #[schema(example = "/v1/jobs/6/cancel")]
    pub path: String,
    /// The answer's status.
    pub status: u16,
    /// Path of what it made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = "/v1/jobs/7")]
    pub made: Option<String>,
}

/// Entries of the audit log, newest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Audit {
    pub entries: Vec<AuditEntry>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}
