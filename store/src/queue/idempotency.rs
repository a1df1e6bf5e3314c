//! Idempotency keys: a repeated request gets the answer of the first one.

use spec::Digest;

use crate::boxed;
use crate::database::Transaction;
use crate::{Store, StoreError, Submitted};

/// Makes a repeated request return the outcome of the first one.
#[derive(Clone, Debug)]
pub struct Idempotency {
    /// The key that the client chose.
    pub key: String,
    /// Digest of the request. The same key with another request is refused.
    pub request: Digest,
}

/// How long idempotency keys are kept: one day.
const KEEP_KEYS_MILLISECONDS: i64 = 24 * 60 * 60 * 1000;

impl Store {
    /// The outcome of a request that was accepted before. Ask for it first: the answer then stays
    /// the same even if something that the request refers to has changed since.
    ///
    /// # Errors
    /// [`StoreError::IdempotencyConflict`] when the key was used with another request.
    #[boxed]
    pub async fn repeated(&self, asked: &Idempotency) -> Result<Option<Submitted>, StoreError> {
        const OPERATION: &str = "looking up an idempotency key";
        let known = self.read(OPERATION).recent_request(&asked.key, KEEP_KEYS_MILLISECONDS).await?;
        asked.outcome(known)
    }
}

/// Like [`Store::repeated`], but inside the submission's transaction, so that it also covers two
/// requests that come at once.
pub(crate) async fn repeated(
    tx: &mut Transaction,
    asked: &Idempotency,
) -> Result<Option<Submitted>, StoreError> {
    tx.forget_requests(KEEP_KEYS_MILLISECONDS).await?;
    let known = tx.request(&asked.key).await?;
    asked.outcome(known)
}

impl Idempotency {
    /// The outcome recorded under the key, if its request is the same. `known` has the digest of
    /// that request and its outcome.
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
