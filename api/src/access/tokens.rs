//! The tokens that the store has, as they were read a moment ago.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use spec::Digest;
use store::{Store, StoreError, Token, TokenId};
use tokio::sync::Mutex;

/// How long a list of tokens is taken for what it was. One that another server revoked opens this one for so long.
pub const TOKENS_KEPT: Duration = Duration::from_secs(5);

/// After this time an unknown token has the list read again: it may be new.
const UNKNOWN_AGAIN: Duration = Duration::from_secs(1);

/// How exactly the store knows when a token was used last.
const USE_RECORDED_EVERY: Duration = Duration::from_secs(60);

/// The tokens of the store, shared by all requests.
#[derive(Clone, Default)]
pub struct KnownTokens {
    list: Arc<Mutex<Option<List>>>,
    /// Whether there have been any. A server that asked for a token never stops to while it runs.
    some: Arc<AtomicBool>,
}

struct List {
    read_at: Instant,
    tokens: Vec<Known>,
}

struct Known {
    token: Token,
    use_recorded: Option<Instant>,
}

/// What becomes of a token that a request brings.
pub enum Found {
    Nothing,
    Token(Token),
    /// It is the first use since a minute.
    ToRecord(Token),
}

impl KnownTokens {
    /// Whether the store has tokens, or had some since this server began.
    pub async fn are_there(&self, store: &Store) -> Result<bool, StoreError> {
        if !self.some.load(Ordering::Relaxed) {
            let mut list = self.list.lock().await;
            self.refresh(&mut list, store, TOKENS_KEPT).await?;
        }
        Ok(self.some.load(Ordering::Relaxed))
    }

    /// The valid token with this digest.
    pub async fn find(&self, digest: Digest, store: &Store) -> Result<Found, StoreError> {
        let mut list = self.list.lock().await;
        self.refresh(&mut list, store, TOKENS_KEPT).await?;
        let is_known = |list: &Option<List>| {
            list.as_ref().is_some_and(|list| list.tokens.iter().any(|it| it.token.digest == digest))
        };
        if !is_known(&list) {
            self.refresh(&mut list, store, UNKNOWN_AGAIN).await?;
        }
        let tokens = list.as_mut().map(|list| &mut list.tokens);
        let mut valid = tokens.into_iter().flatten().filter(|known| known.token.is_valid);
        let Some(known) = valid.find(|known| known.token.digest == digest) else {
            return Ok(Found::Nothing);
        };
        let is_recorded =
            known.use_recorded.is_some_and(|recorded| recorded.elapsed() < USE_RECORDED_EVERY);
        if is_recorded {
            return Ok(Found::Token(known.token.clone()));
        }
        known.use_recorded = Some(Instant::now());
        Ok(Found::ToRecord(known.token.clone()))
    }

    /// Has the list read again at the next request: this server changed it.
    pub async fn forget(&self) {
        *self.list.lock().await = None;
    }

    /// Reads the list if it is older than `age`. While the database is away the old one stays.
    async fn refresh(
        &self,
        list: &mut Option<List>,
        store: &Store,
        age: Duration,
    ) -> Result<(), StoreError> {
        if list.as_ref().is_some_and(|list| list.read_at.elapsed() < age) {
            return Ok(());
        }
        let tokens = match store.tokens().await {
            Ok(tokens) => tokens,
            Err(_) if list.is_some() => return Ok(()),
            Err(error) => return Err(error),
        };
        self.some.fetch_or(!tokens.is_empty(), Ordering::Relaxed);
        let before = list.take().map(|list| list.tokens).unwrap_or_default();
        let recorded = |id: TokenId| {
            let known = before.iter().find(|known| known.token.id == id);
            known.and_then(|known| known.use_recorded)
        };
        let known = |token: Token| Known { use_recorded: recorded(token.id), token };
        let tokens = tokens.into_iter().map(known).collect();
        *list = Some(List { read_at: Instant::now(), tokens });
        Ok(())
    }
}
