//! Who sends requests: tokens, sessions and failed logins of this server, and its audit log.

use std::num::NonZero;

use axum::http::{Method, StatusCode, Uri};
use spec::Digest;
use store::{AuditEntry, Store, StoreError};
use subtle::ConstantTimeEq;
use wire::Scope;

use crate::access::credentials::{self, Credentials};
use crate::access::failures::FailedLogins;
use crate::access::tokens::{KnownTokens, TokenLookup};
use crate::error::ApiError;
use crate::limits::SESSION_LASTS;
use crate::remote::Remote;

/// The largest number of bytes of a path that the audit log keeps.
const LOGGED_PATH_BYTES: usize = 500;

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

/// The name of the present request's caller.
pub fn caller_name() -> String {
    CALLER.try_with(|caller| caller.name.clone()).unwrap_or_else(|_| NOBODY.to_owned())
}

/// Whether the present request's caller may submit, change and delete. A page without a caller, such
/// as the login, shows what everybody sees.
pub fn may_submit() -> bool {
    may(Scope::Submit)
}

/// Whether the present request's caller may pause the queue and drain workers.
pub fn may_administer() -> bool {
    may(Scope::Admin)
}

fn may(needed: Scope) -> bool {
    CALLER.try_with(|caller| caller.scope >= needed).unwrap_or(true)
}

/// Does something as a part of `caller`'s request, which is over.
pub fn seen_by<T>(caller: Option<Caller>, act: impl FnOnce() -> T) -> T {
    match caller {
        Some(caller) => CALLER.sync_scope(caller, act),
        None => act(),
    }
}

/// Name of the token with which the browser logged in that gets the present page.
pub fn logged_in_as() -> Option<String> {
    CALLER.try_with(|caller| caller.is_logged_in.then(|| caller.name.clone())).ok().flatten()
}

/// A token of this process, stored as its digest.
#[derive(Clone)]
struct OwnToken(Digest);

impl OwnToken {
    fn new(token: &str) -> Self {
        Self(credentials::digest(token))
    }

    fn is(&self, offered: Digest) -> bool {
        self.0.as_bytes().ct_eq(offered.as_bytes()).into()
    }
}

/// Who may use this server. Clones share it.
#[derive(Clone)]
pub struct Access {
    store: Store,
    /// The token that the server was started with.
    token: Option<OwnToken>,
    /// The token of the process that the server runs in.
    own_token: Option<OwnToken>,
    tokens: KnownTokens,
    failures: FailedLogins,
}

impl Access {
    pub fn new(
        store: Store,
        token: Option<&str>,
        own_token: Option<&str>,
        failed_logins_per_minute: NonZero<u32>,
    ) -> Self {
        Self {
            store,
            token: token.map(OwnToken::new),
            own_token: own_token.map(OwnToken::new),
            tokens: KnownTokens::default(),
            failures: FailedLogins::new(failed_logins_per_minute),
        }
    }

    pub fn failures(&self) -> &FailedLogins {
        &self.failures
    }

    /// Whether the server was started with a token.
    pub fn has_own_token(&self) -> bool {
        self.token.is_some()
    }

    /// Makes the next request read the store's tokens again, because this server changed them.
    pub fn forget_tokens(&self) {
        self.tokens.forget();
    }

    /// Whether everybody who can reach this server may do everything.
    pub async fn is_open(&self) -> Result<bool, StoreError> {
        Ok(self.token.is_none() && !self.tokens.has_any(&self.store).await?)
    }

    /// The caller with these credentials; `None` if they are not valid.
    pub async fn caller(&self, offered: Credentials) -> Result<Option<Caller>, ApiError> {
        let (token, is_logged_in) = match offered {
            Credentials::Token(token) => (Some(token), false),
            Credentials::Session(session) => (self.store.session(session).await?, true),
            Credentials::None | Credentials::Unreadable => (None, false),
        };
        let is = |known: &Option<OwnToken>| {
            known.as_ref().zip(token).is_some_and(|(known, token)| known.is(token))
        };
        for (known, name) in [(&self.token, SERVERS_TOKEN), (&self.own_token, OWN_PROCESS)] {
            if is(known) {
                return Ok(Some(Caller { is_logged_in, ..Caller::admin(name) }));
            }
        }
        if self.is_open().await? {
            return Ok(Some(Caller::admin(ANYONE)));
        }
        let Some(token) = token else { return Ok(None) };
        let found = self.tokens.find(token, &self.store).await?;
        let (TokenLookup::Token(token) | TokenLookup::ToRecord(token)) = &found else {
            return Ok(None);
        };
        if let TokenLookup::ToRecord(token) = &found
            && let Err(error) = self.store.token_used(token.id).await
        {
            tracing::warn!(%error, token = token.name, "cannot record that a token was used");
        }
        Ok(Some(Caller { name: token.name.clone(), scope: token.scope, is_logged_in }))
    }

    /// Opens a session for the owner of `token`, and returns the value of the browser's cookie.
    /// `None` if the token is not valid.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn log_in(&self, token: &str) -> Result<Option<(Caller, String)>, ApiError> {
        let digest = credentials::digest(token);
        let Some(caller) = self.caller(Credentials::Token(digest)).await? else { return Ok(None) };
        let session = credentials::new_session()?;
        self.store.open_session(credentials::digest(&session), digest, SESSION_LASTS).await?;
        Ok(Some((caller, session)))
    }

    /// # Errors
    /// When the database fails.
    pub async fn log_out(&self, session: &str) -> Result<(), ApiError> {
        Ok(self.store.close_session(credentials::digest(session)).await?)
    }

    /// Counts a token that is not valid, and records it in the audit log unless too many were
    /// recorded.
    pub async fn record_failure(&self, remote: Remote, method: &Method, target: &Uri) {
        let Some(unrecorded) = self.failures.count(remote.network()) else { return };
        let entry = entry(NOBODY, remote, method, target);
        tracing::warn!(address = entry.address, unrecorded, "a token is not valid");
        let status = StatusCode::UNAUTHORIZED.as_u16();
        self.record_refused(&AuditEntry { status, ..entry }).await;
    }

    /// Adds to the audit log. If that fails, the request has been answered already, so the entry
    /// goes to the server's log.
    pub async fn record(&self, entry: &AuditEntry) {
        let AuditEntry { actor, address, method, path, status, made } = entry;
        tracing::info!(actor, address, method, path, status, made, "a request changed something");
        self.record_refused(entry).await;
    }

    /// Adds a request to the audit log that changed nothing.
    async fn record_refused(&self, entry: &AuditEntry) {
        let AuditEntry { actor, method, path, .. } = entry;
        if let Err(error) = self.store.record_audit(entry).await {
            let error = spec::causes(&error);
            tracing::error!(error, actor, method, path, "the audit log cannot be written");
        }
    }
}

/// An entry of the audit log for a request without an answer yet.
pub(super) fn entry(actor: &str, remote: Remote, method: &Method, target: &Uri) -> AuditEntry {
    let path = target.path_and_query().map_or("", |path| path.as_str()).trim_end_matches('?');
    let end = path.floor_char_boundary(LOGGED_PATH_BYTES);
    AuditEntry {
        actor: actor.to_owned(),
        address: remote.name(),
        method: method.to_string(),
        path: path[..end].to_owned(),
        status: 0,
        made: None,
    }
}
