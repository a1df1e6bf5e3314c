//! Sessions of browsers that log in with a token.

use crate::access::{Caller, Credentials, credentials, secret};
use crate::app::App;
use crate::error::ApiError;
use crate::limits::SESSION_LASTS;

impl App {
    /// Opens a session for the owner of `token`, and returns the value of the browser's cookie.
    /// `None` if the token is not valid.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn log_in(&self, token: &str) -> Result<Option<(Caller, String)>, ApiError> {
        let digest = credentials::digest(token);
        let Some(caller) = self.caller(Credentials::Token(digest)).await? else { return Ok(None) };
        let session = secret::session()?;
        self.store.open_session(credentials::digest(&session), digest, SESSION_LASTS).await?;
        Ok(Some((caller, session)))
    }

    /// # Errors
    /// When the database fails.
    pub async fn log_out(&self, session: &str) -> Result<(), ApiError> {
        Ok(self.store.close_session(credentials::digest(session)).await?)
    }
}
