//! The caller of a request.

use wire::Scope;

/// The sender of an accepted request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caller {
    /// Name of the token, or one of the names below.
    pub name: String,
    pub scope: Scope,
    /// Whether a browser's session let the request in.
    pub is_logged_in: bool,
}

/// The name of callers if the server requires no token.
pub const ANYONE: &str = "anyone";

/// The name of the token that the server was started with.
pub const SERVERS_TOKEN: &str = "TORQUED_TOKEN";

/// The name of callers whose token is not valid, in the audit log.
pub const NOBODY: &str = "nobody";

/// The name of the process that the server runs in.
pub const OWN_PROCESS: &str = "this server";

impl Caller {
    pub fn admin(name: &str) -> Self {
        Self { name: name.to_owned(), scope: Scope::Admin, is_logged_in: false }
    }
}

tokio::task_local! {
    /// The caller of the present request.
    pub(super) static CALLER: Caller;
}

/// Whether the present request needed a token.
pub fn asked_for_a_token() -> bool {
    CALLER.try_with(|caller| caller.name != ANYONE).unwrap_or(true)
}

/// Name of the token with which the browser logged in that gets the present page.
pub fn logged_in_as() -> Option<String> {
    CALLER.try_with(|caller| caller.is_logged_in.then(|| caller.name.clone())).ok().flatten()
}
