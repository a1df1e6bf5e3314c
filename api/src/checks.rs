//! Threads for checking what requests send, and memory for questions to models.
//!
//! A check of a large body takes longer than other requests should wait for a thread of the
//! runtime, and a parsed body takes many times its size. So only a few are checked at the same
//! time, on threads that may block.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::error::ApiError;
use crate::limits::{BRIEF_BODY_BYTES, CONCURRENT_CHECKS, QUESTIONS_MEMORY_BYTES};
use crate::live::LiveError;

/// Clones share the threads and the memory.
#[derive(Clone)]
pub struct Checks {
    threads: Arc<Semaphore>,
    /// Mebibytes that questions may still take.
    memory: Arc<Semaphore>,
}

/// Memory that a question takes. It is free again when this is dropped.
pub struct QuestionMemory(#[expect(dead_code, reason = "dropped at the end")] OwnedSemaphorePermit);

const MEBIBYTE: usize = 1 << 20;

impl Checks {
    pub fn new() -> Self {
        Self {
            threads: Arc::new(Semaphore::new(CONCURRENT_CHECKS)),
            memory: Arc::new(Semaphore::new(QUESTIONS_MEMORY_BYTES / MEBIBYTE)),
        }
    }

    /// The result of `check`, which reads `bytes` bytes. A brief body is checked at once.
    ///
    /// # Errors
    /// The error of `check`.
    pub async fn run<T: Send + 'static>(
        &self,
        bytes: usize,
        check: impl FnOnce() -> Result<T, ApiError> + Send + 'static,
    ) -> Result<T, ApiError> {
        let Some(place) = self.place(bytes).await? else { return check() };
        // A caller who leaves does not interrupt the check, so its place goes with it.
        let checked = tokio::task::spawn_blocking(move || {
            let result = check();
            drop(place);
            result
        });
        checked.await.map_err(|error| {
            tracing::error!(error = spec::causes(&error), "a check failed");
            ApiError::Internal
        })?
    }

    /// A place for a check of `bytes` bytes, after those that came before; `None` for a brief body,
    /// which needs none.
    pub async fn place(&self, bytes: usize) -> Result<Option<OwnedSemaphorePermit>, ApiError> {
        if bytes <= BRIEF_BODY_BYTES {
            return Ok(None);
        }
        let place = Arc::clone(&self.threads).acquire_owned().await;
        place.map(Some).map_err(|_| ApiError::Internal)
    }

    /// Memory for a question with `bytes` bytes.
    ///
    /// # Errors
    /// [`LiveError::Memory`] when other questions have it.
    pub fn memory(&self, bytes: usize) -> Result<QuestionMemory, ApiError> {
        let mebibytes = u32::try_from(bytes.div_ceil(MEBIBYTE)).unwrap_or(u32::MAX);
        let taken = Arc::clone(&self.memory).try_acquire_many_owned(mebibytes);
        let crowded = LiveError::Memory { bytes: QUESTIONS_MEMORY_BYTES };
        taken.map(QuestionMemory).map_err(|_| ApiError::Live(crowded))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[tokio::test]
    async fn a_few_large_bodies_are_checked_at_once_and_brief_ones_do_not_wait_for_them() {
        let checks = Checks::new();
        let mut places = Vec::new();
        for _ in 0..CONCURRENT_CHECKS {
            places.push(checks.place(BRIEF_BODY_BYTES + 1).await.unwrap().unwrap());
        }
        assert_eq!(checks.run(BRIEF_BODY_BYTES, || Ok(7)).await.unwrap(), 7);
        let waiting = {
            let checks = checks.clone();
            tokio::spawn(async move { checks.run(BRIEF_BODY_BYTES + 1, || Ok(8)).await })
        };
        tokio::time::sleep(Duration::from_millis(50)).await;
        assert!(!waiting.is_finished());
        places.pop();
        assert_eq!(waiting.await.unwrap().unwrap(), 8);
    }

    /// The runtime of this test has one thread.
    #[tokio::test]
    async fn a_long_check_leaves_the_thread_of_the_runtime_to_others() {
        let checks = Checks::new();
        let (release, released) = std::sync::mpsc::channel::<()>();
        let long = checks.run(1 << 20, move || {
            released.recv_timeout(Duration::from_secs(30)).map_err(|_| ApiError::Internal)
        });
        let other = async move { release.send(()).unwrap() };
        let (long, ()) = tokio::join!(long, other);
        assert!(long.is_ok(), "nothing else ran during the check");
    }

    #[test]
    fn questions_share_their_memory() {
        let checks = Checks::new();
        let most = checks.memory(QUESTIONS_MEMORY_BYTES - MEBIBYTE).unwrap();
        let last = checks.memory(1).unwrap();
        let refused = checks.memory(1).err().unwrap().to_string();
        assert!(refused.contains("try again later"), "{refused}");
        drop(last);
        assert!(checks.memory(MEBIBYTE).is_ok());
        drop(most);
    }
}
