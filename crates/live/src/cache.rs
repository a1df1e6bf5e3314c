//! A cache of a few large values. Each is loaded once, however many requests ask for it.

use std::future::Future;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use api::live::LiveError;
use tokio::sync::OnceCell;

#[derive(Clone, Copy, Debug)]
pub struct Capacity {
    pub count: usize,
    pub bytes: u64,
}

/// The most recently requested values. A value in use is never evicted.
pub struct Cache<K, V> {
    capacity: Capacity,
    /// Most recently requested first.
    slots: Mutex<Vec<Slot<K, V>>>,
}

struct Slot<K, V> {
    key: K,
    bytes: u64,
    value: Arc<OnceCell<Arc<V>>>,
}

impl<K, V> Slot<K, V> {
    /// Whether a request is loading the value or holds it.
    fn is_in_use(&self) -> bool {
        let is_held = |value: &Arc<V>| Arc::strong_count(value) > 1;
        Arc::strong_count(&self.value) > 1 || self.value.get().is_some_and(is_held)
    }
}

impl<K: Copy + PartialEq, V> Cache<K, V> {
    pub fn new(capacity: Capacity) -> Self {
        Self { capacity, slots: Mutex::new(Vec::new()) }
    }

    /// The value of `key`, which takes `bytes` bytes. It is loaded if it is not there, and other
    /// requests for it wait meanwhile. A value that fails to load is forgotten, and the next
    /// request tries again.
    ///
    /// # Errors
    /// [`LiveError::Full`] when all other values are in use. [`LiveError::TooLarge`] when the value
    /// is larger than the cache. Also the errors of `load`.
    pub async fn get<F>(
        &self,
        key: K,
        bytes: u64,
        load: impl FnOnce() -> F,
    ) -> Result<Arc<V>, LiveError>
    where
        F: Future<Output = Result<V, LiveError>>,
    {
        let cell = self.slot(key, bytes)?;
        let loaded = cell.get_or_try_init(|| async { load().await.map(Arc::new) }).await.cloned();
        if loaded.is_err() {
            self.lock().retain(|slot| !Arc::ptr_eq(&slot.value, &cell) || cell.initialized());
        }
        loaded
    }

    /// The value of `key`, if it is loaded. This counts as a request.
    pub fn loaded(&self, key: K) -> Option<Arc<V>> {
        let mut slots = self.lock();
        let at = slots.iter().position(|slot| slot.key == key)?;
        slots[..=at].rotate_right(1);
        slots[0].value.get().cloned()
    }

    fn slot(&self, key: K, bytes: u64) -> Result<Arc<OnceCell<Arc<V>>>, LiveError> {
        let mut slots = self.lock();
        if let Some(at) = slots.iter().position(|slot| slot.key == key) {
            slots[..=at].rotate_right(1);
            return Ok(Arc::clone(&slots[0].value));
        }
        let Capacity { count: most, bytes: room } = self.capacity;
        if bytes > room {
            return Err(LiveError::TooLarge { found: bytes, bytes: room });
        }
        while slots.len() >= most || bytes > room - slots.iter().map(|slot| slot.bytes).sum::<u64>()
        {
            let last = slots.iter().rposition(|slot| !slot.is_in_use());
            let Some(last) = last else {
                return Err(LiveError::Full { models: most, bytes: room });
            };
            slots.remove(last);
        }
        let value = Arc::new(OnceCell::new());
        slots.insert(0, Slot { key, bytes, value: Arc::clone(&value) });
        Ok(value)
    }

    /// Ignores a poisoned lock: no change takes two steps, so the values are consistent after a
    /// panic.
    fn lock(&self) -> MutexGuard<'_, Vec<Slot<K, V>>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use futures::future::join_all;

    use super::*;

    fn cache(count: usize, bytes: u64) -> Cache<u32, u32> {
        Cache::new(Capacity { count, bytes })
    }

    /// Whether a request for `key` has to load it.
    async fn loads(cache: &Cache<u32, u32>, key: u32, bytes: u64) -> bool {
        let mut has_loaded = false;
        let load = || {
            has_loaded = true;
            async move { Ok(key) }
        };
        assert_eq!(*cache.get(key, bytes, load).await.unwrap(), key);
        has_loaded
    }

    #[tokio::test]
    async fn the_one_not_asked_for_longest_is_given_up_for_another() {
        let cache = cache(2, 100);
        for key in [1, 2, 1, 3] {
            loads(&cache, key, 1).await;
        }
        assert!(!loads(&cache, 1, 1).await && !loads(&cache, 3, 1).await);
        assert!(loads(&cache, 2, 1).await);
    }

    #[tokio::test]
    async fn what_is_loaded_is_found_without_loading_it() {
        let cache = cache(1, 100);
        assert_eq!(cache.loaded(1), None);
        loads(&cache, 1, 1).await;
        assert_eq!(cache.loaded(1).as_deref(), Some(&1));
    }

    #[tokio::test]
    async fn what_was_found_again_is_given_up_last() {
        let cache = cache(2, 100);
        for key in [1, 2] {
            loads(&cache, key, 1).await;
        }
        assert!(cache.loaded(1).is_some());
        loads(&cache, 3, 1).await;
        assert!(cache.loaded(2).is_none() && cache.loaded(1).is_some());
    }

    #[tokio::test]
    async fn as_many_are_given_up_as_bytes_are_needed() {
        let cache = cache(10, 100);
        for key in [1, 2, 3] {
            loads(&cache, key, 30).await;
        }
        assert!(loads(&cache, 4, 70).await);
        assert!(!loads(&cache, 3, 30).await, "70 and 30 are 100");
        assert!(loads(&cache, 1, 30).await && loads(&cache, 2, 30).await);
    }

    #[tokio::test]
    async fn what_is_held_stays_and_what_finds_no_room_is_refused() {
        let cache = cache(1, 100);
        let held = cache.get(1, 1, || async { Ok(1) }).await.unwrap();
        let refused = cache.get(2, 1, || async { Ok(2) }).await;
        assert!(matches!(refused, Err(LiveError::Full { models: 1, bytes: 100 })), "{refused:?}");
        assert!(!loads(&cache, 1, 1).await);
        drop(held);
        assert!(loads(&cache, 2, 1).await);
        let refused = cache.get(3, 101, || async { Ok(3) }).await;
        assert!(matches!(refused, Err(LiveError::TooLarge { found: 101, .. })), "{refused:?}");
    }

    #[tokio::test]
    async fn those_who_ask_at_once_load_once() {
        let cache = cache(1, 100);
        let loads = AtomicUsize::new(0);
        let all = join_all((0..20).map(|_| {
            cache.get(7, 1, || async {
                loads.fetch_add(1, Ordering::Relaxed);
                tokio::task::yield_now().await;
                Ok(7)
            })
        }));
        assert!(all.await.into_iter().all(|value| *value.unwrap() == 7));
        assert_eq!(loads.into_inner(), 1);
    }

    #[tokio::test]
    async fn what_failed_to_load_takes_no_room_and_is_tried_again() {
        let cache = cache(1, 100);
        let reason = "damaged".to_owned();
        let failed = cache.get(1, 100, || async { Err(LiveError::Unusable { reason }) }).await;
        assert!(matches!(failed, Err(LiveError::Unusable { .. })));
        assert!(loads(&cache, 2, 100).await && loads(&cache, 1, 100).await);
    }
}
