//! A short-lived cache of the store's tokens.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use spec::Digest;
use store::{Store, StoreError, Token, TokenId};

/// How long a list of tokens is used. Together with [`READ_WITHIN`], a token that another server
/// revoked works here for 5 s at most.
const TOKENS_KEPT: Duration = Duration::from_secs(3);

/// How long requests wait for a new list before they use the old one.
const READ_WITHIN: Duration = Duration::from_secs(2);

/// After this time an unknown token causes a new read of the list, because it may be new.
const UNKNOWN_AGAIN: Duration = Duration::from_secs(1);

/// The precision of the time when a token was last used.
const USE_RECORDED_EVERY: Duration = Duration::from_secs(60);

/// The tokens of the store, shared by all requests. One request at a time reads them, and the
/// others use the present list. So a database that hangs delays nobody.
#[derive(Clone, Default)]
pub struct KnownTokens {
    list: Arc<Mutex<Option<List>>>,
    /// Held by the request that reads the list.
    reading: Arc<tokio::sync::Mutex<()>>,
    /// Whether there have been any tokens. A server that required a token continues to do so while
    /// it runs.
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

/// The result of looking up a request's token.
pub enum TokenLookup {
    Nothing,
    Token(Token),
    /// The token is valid, and its use must be recorded: the last record is a minute old.
    ToRecord(Token),
}

impl KnownTokens {
    /// Whether the store has tokens, or had some since this server started.
    pub async fn has_any(&self, store: &Store) -> Result<bool, StoreError> {
        if !self.some.load(Ordering::Relaxed) {
            self.refresh(store, TOKENS_KEPT).await?;
        }
        Ok(self.some.load(Ordering::Relaxed))
    }

    /// The valid token with this digest.
    pub async fn find(&self, digest: Digest, store: &Store) -> Result<TokenLookup, StoreError> {
        self.refresh(store, TOKENS_KEPT).await?;
        if !self.has(digest) {
            self.refresh(store, UNKNOWN_AGAIN).await?;
        }
        Ok(self.look_up(digest))
    }

    fn has(&self, digest: Digest) -> bool {
        let list = self.list();
        list.as_ref()
            .is_some_and(|list| list.tokens.iter().any(|known| known.token.digest == digest))
    }

    fn look_up(&self, digest: Digest) -> TokenLookup {
        let mut list = self.list();
        let tokens = list.as_mut().map(|list| &mut list.tokens);
        let mut valid = tokens.into_iter().flatten().filter(|known| known.token.is_valid);
        let Some(known) = valid.find(|known| known.token.digest == digest) else {
            return TokenLookup::Nothing;
        };
        let is_recorded =
            known.use_recorded.is_some_and(|recorded| recorded.elapsed() < USE_RECORDED_EVERY);
        if is_recorded {
            return TokenLookup::Token(known.token.clone());
        }
        known.use_recorded = Some(Instant::now());
        TokenLookup::ToRecord(known.token.clone())
    }

    /// Makes the next request read the list again, because this server changed it.
    pub fn forget(&self) {
        *self.list() = None;
    }

    /// Reads the list if it is older than `age`. While the database is away or slow, the old list
    /// stays.
    async fn refresh(&self, store: &Store, age: Duration) -> Result<(), StoreError> {
        if self.is_younger_than(age) {
            return Ok(());
        }
        if self.list().is_none() {
            let _turn = self.reading.lock().await;
            if self.list().is_none() {
                self.keep(store.tokens().await?);
            }
            return Ok(());
        }
        let Ok(_turn) = self.reading.try_lock() else { return Ok(()) };
        match tokio::time::timeout(READ_WITHIN, store.tokens()).await {
            Ok(Ok(tokens)) => self.keep(tokens),
            Ok(Err(_)) | Err(_) => {
                if let Some(list) = self.list().as_mut() {
                    list.read_at = Instant::now();
                }
            }
        }
        Ok(())
    }

    fn is_younger_than(&self, age: Duration) -> bool {
        self.list().as_ref().is_some_and(|list| list.read_at.elapsed() < age)
    }

    fn keep(&self, tokens: Vec<Token>) {
        self.some.fetch_or(!tokens.is_empty(), Ordering::Relaxed);
        let mut list = self.list();
        let before = list.take().map(|list| list.tokens).unwrap_or_default();
        let recorded = |id: TokenId| {
            let known = before.iter().find(|known| known.token.id == id);
            known.and_then(|known| known.use_recorded)
        };
        let known = |token: Token| Known { use_recorded: recorded(token.id), token };
        let tokens = tokens.into_iter().map(known).collect();
        *list = Some(List { read_at: Instant::now(), tokens });
    }

    fn list(&self) -> MutexGuard<'_, Option<List>> {
        // No code panics while it holds the lock.
        self.list.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
