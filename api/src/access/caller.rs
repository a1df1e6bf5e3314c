//! Who asks.

use wire::Scope;

/// Who sent a request that was let in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caller {
    /// Name of the token, or one of the names below.
    pub name: String,
    pub scope: Scope,
    /// Whether a browser's session let the request in.
    pub is_logged_in: bool,
}

/// The name of callers of a server that asks for no token.
pub const ANYONE: &str = "anyone";

/// The name of the token that the server was started with.
pub const SERVERS_TOKEN: &str = "TORQUED_TOKEN";

/// The name of the process that the server runs in.
pub const OWN_PROCESS: &str = "this server";

impl Caller {
    pub fn admin(name: &str) -> Self {
        Self { name: name.to_owned(), scope: Scope::Admin, is_logged_in: false }
    }
}

tokio::task_local! {
    /// The caller of the request that is being answered.
    pub(super) static CALLER: Caller;
}

/// Whether the request that is being answered had to bring a token.
pub fn asked_for_a_token() -> bool {
    CALLER.try_with(|caller| caller.name != ANYONE).unwrap_or(true)
}

/// Name of the token with which the browser logged in that the present page is for.
pub fn logged_in_as() -> Option<String> {
    CALLER.try_with(|caller| caller.is_logged_in.then(|| caller.name.clone())).ok().flatten()
}
