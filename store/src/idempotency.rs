//! Idempotency keys: a request that is sent again is answered as the first time.

use spec::Digest;

use crate::boxed;
use crate::database::{Transaction, sql};
use crate::{Store, StoreError, Submitted};

/// Makes a repeated request return what the first one did.
#[derive(Clone, Debug)]
pub struct Idempotency {
    pub key: String,
    /// Digest of the request, to refuse the same key with another request.
    pub request: Digest,
}

/// Idempotency keys are kept for a day.
const KEEP_KEYS_MILLISECONDS: i64 = 24 * 60 * 60 * 1000;

impl Store {
    /// The outcome of a request that was accepted before. To ask this first keeps the answer the same although what the
    /// request refers to has changed since.
    ///
    /// # Errors
    /// [`StoreError::IdempotencyConflict`] when the key came with another request.
    #[boxed]
    pub async fn repeated(&self, asked: &Idempotency) -> Result<Option<Submitted>, StoreError> {
        const OPERATION: &str = "looking up an idempotency key";
        let known =
            sql!(self.database(), OPERATION, recent_request(&asked.key, KEEP_KEYS_MILLISECONDS))?;
        asked.outcome(known)
    }
}

/// The same within the transaction of a submission, between two requests that come at once.
pub(crate) async fn repeated(
    tx: &mut Transaction,
    asked: &Idempotency,
) -> Result<Option<Submitted>, StoreError> {
    sql!(tx, forget_requests(KEEP_KEYS_MILLISECONDS))?;
    let known = sql!(tx, request(&asked.key))?;
    asked.outcome(known)
}

impl Idempotency {
    /// The outcome of what is `known` under the key: the digest of a request, and what became of it.
    fn outcome(&self, known: Option<(String, Submitted)>) -> Result<Option<Submitted>, StoreError> {
        match known {
            Some((request, submitted)) if request == self.request.to_string() => {
                Ok(Some(submitted))
            }
            Some(_) => Err(StoreError::IdempotencyConflict { key: self.key.clone() }),
            None => Ok(None),
        }
    }
}
