//! The tokens that the store has, as they were read a moment ago.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use spec::Digest;
use store::{Store, StoreError, Token, TokenId};

/// How long a list of tokens is taken for what it was. With [`READ_WITHIN`], a token that another server revoked opens this one
/// for 5 s at most.
const TOKENS_KEPT: Duration = Duration::from_secs(3);

/// How long requests wait for a new list before they go on with the old one.
const READ_WITHIN: Duration = Duration::from_secs(2);

/// After this time an unknown token has the list read again: it may be new.
const UNKNOWN_AGAIN: Duration = Duration::from_secs(1);

/// How exactly the store knows when a token was used last.
const USE_RECORDED_EVERY: Duration = Duration::from_secs(60);

/// The tokens of the store, shared by all requests. One request at a time reads them; the others go on with the list that
/// there is, so that a database that hangs holds nobody up.
#[derive(Clone, Default)]
pub struct KnownTokens {
    list: Arc<Mutex<Option<List>>>,
    /// Held by the request that reads.
    reading: Arc<tokio::sync::Mutex<()>>,
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

/// The answer for a token that a request brings.
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
            self.refresh(store, TOKENS_KEPT).await?;
        }
        Ok(self.some.load(Ordering::Relaxed))
    }

    /// The valid token with this digest.
    pub async fn find(&self, digest: Digest, store: &Store) -> Result<Found, StoreError> {
        self.refresh(store, TOKENS_KEPT).await?;
        if !self.has(digest) {
            self.refresh(store, UNKNOWN_AGAIN).await?;
        }
        Ok(self.look_up(digest))
    }

    fn has(&self, digest: Digest) -> bool {
        let list = self.list();
        list.as_ref().is_some_and(|list| list.tokens.iter().any(|it| it.token.digest == digest))
    }

    fn look_up(&self, digest: Digest) -> Found {
        let mut list = self.list();
        let tokens = list.as_mut().map(|list| &mut list.tokens);
        let mut valid = tokens.into_iter().flatten().filter(|known| known.token.is_valid);
        let Some(known) = valid.find(|known| known.token.digest == digest) else {
            return Found::Nothing;
        };
        let is_recorded =
            known.use_recorded.is_some_and(|recorded| recorded.elapsed() < USE_RECORDED_EVERY);
        if is_recorded {
            return Found::Token(known.token.clone());
        }
        known.use_recorded = Some(Instant::now());
        Found::ToRecord(known.token.clone())
    }

    /// Has the list read again at the next request: this server changed it.
    pub fn forget(&self) {
        *self.list() = None;
    }

    /// Reads the list if it is older than `age`. While the database is away or slow, the old one stays.
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
        // Nothing panics while it holds the lock.
        self.list.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
