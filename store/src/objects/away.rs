//! Remote objects: objects that are not files of the data folder.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use futures::StreamExt;
use object_store::path::Path;
use object_store::{Error, ObjectStore, ObjectStoreExt};
use tokio::runtime::Handle;
use tokio::sync::Semaphore;

use super::answers::Answers;
use super::cache::{CACHE_LIMIT, Cache, UnfinishedCopy};
use super::mark::{Displaced, MarkWatch};
use super::path::PROBE_CLOCK;
use super::signed::UrlSigner;
use super::trouble::in_short;
use super::{parse, unique_name};
use crate::StoreError;
use crate::place::data_dir::DataDir;

/// A remote object store and the options of its use.
#[derive(Clone, Debug)]
pub struct RemoteObjects {
    pub(super) store: Arc<dyn ObjectStore>,
    pub(super) answers: Answers,
    pub(super) cache_bytes: u64,
    /// Signs URLs; only a bucket has one.
    pub(super) signer: Option<UrlSigner>,
    /// The bucket around the objects, if they have a prefix in it.
    pub(super) around: Option<Surroundings>,
}

/// A whole bucket, and the prefix of the objects in it.
#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    pub bucket: Arc<dyn ObjectStore>,
    pub prefix: Path,
}

#[derive(Debug)]
pub(crate) struct RemoteStore {
    pub(super) remote: Arc<dyn ObjectStore>,
    /// Local copies, from which objects are read.
    pub(super) cache: Cache,
    pub(super) signer: Option<UrlSigner>,
    /// Watches the mark of the open store.
    pub(super) mark: Arc<MarkWatch>,
    around: Option<Surroundings>,
    answers: Answers,
    /// Whether a thread is checking whether a failing store still fails.
    asks_again: Arc<AtomicBool>,
    /// Whether a thread is looking at the mark.
    looks: Arc<AtomicBool>,
    /// Each object that is fetched ahead takes one permit.
    pub(super) ahead: Arc<Semaphore>,
    /// Runs network requests while a thread blocks.
    pub(super) runtime: Handle,
}

/// How long a store may fail before tasks have to wait.
const FAILS_BRIEFLY: Duration = Duration::from_secs(5);

/// Number of objects that are fetched ahead at a time.
const FETCHED_AHEAD: usize = 4;

impl From<Arc<dyn ObjectStore>> for RemoteObjects {
    fn from(store: Arc<dyn ObjectStore>) -> Self {
        let answers = Answers::default();
        Self { store, answers, cache_bytes: CACHE_LIMIT, signer: None, around: None }
    }
}

impl RemoteObjects {
    /// The `object_store` client.
    pub fn store(&self) -> Arc<dyn ObjectStore> {
        Arc::clone(&self.store)
    }
}

impl RemoteStore {
    /// Remote objects with copies in the data folder.
    pub fn new(dir: &DataDir, objects: RemoteObjects) -> Result<Self, StoreError> {
        let RemoteObjects { store: remote, answers, cache_bytes, signer, around } = objects;
        let cache = Cache::new(dir.cache(), cache_bytes).map_err(|reason| dir.unusable(reason))?;
        let (asks_again, looks) = (Arc::default(), Arc::default());
        let mark = Arc::default();
        let ahead = Arc::new(Semaphore::new(FETCHED_AHEAD));
        let runtime = Handle::current();
        Ok(Self { remote, cache, signer, mark, around, answers, asks_again, looks, ahead, runtime })
    }

    /// The bucket around the objects, if they have a prefix in it.
    pub const fn around(&self) -> Option<&Surroundings> {
        self.around.as_ref()
    }

    /// Blocks on a future. A thread of the runtime tells the runtime that it blocks.
    pub(super) fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        tokio::task::block_in_place(|| self.runtime.block_on(future))
    }

    /// Begins a file that will be published.
    pub fn begin(&self, path: &str) -> Result<UnfinishedCopy, StoreError> {
        self.cache.begin().map_err(StoreError::file("writing", path))
    }

    /// Why no task should be claimed: it would fail when it reads or writes. It also has the store
    /// checked again.
    pub fn obstacle(&self) -> Option<String> {
        let failing = self.answers.failing_for()?;
        if !self.asks_again.swap(true, Ordering::Relaxed) {
            let (remote, asks_again) = (Arc::clone(&self.remote), Arc::clone(&self.asks_again));
            self.runtime.spawn(async move {
                // The request is only made to note whether the store answers.
                let _ = remote.head(&Path::from("probe/object")).await;
                asks_again.store(false, Ordering::Relaxed);
            });
        }
        (failing >= FAILS_BRIEFLY).then(|| {
            format!("the object store has refused or not answered for {} s", failing.as_secs())
        })
    }

    /// The fault that the last look found at the place. If that look is old, this begins another one.
    pub fn displaced(&self) -> Option<Displaced> {
        if self.mark.is_stale() && !self.looks.swap(true, Ordering::Relaxed) {
            let (remote, mark) = (Arc::clone(&self.remote), Arc::clone(&self.mark));
            let looks = Arc::clone(&self.looks);
            self.runtime.spawn(async move {
                mark.look_at(&*remote).await;
                looks.store(false, Ordering::Relaxed);
            });
        }
        self.mark.known()
    }

    pub(super) async fn delete(&self, paths: Vec<String>) {
        let locations: Vec<_> = paths.iter().filter_map(|path| Path::parse(path).ok()).collect();
        let locations = futures::stream::iter(locations.into_iter().map(Ok)).boxed();
        let mut deleted = self.remote.delete_stream(locations);
        while let Some(deleted) = deleted.next().await {
            match deleted {
                // Some stores return this for an object that is deleted already.
                Ok(_) | Err(Error::NotFound { .. }) => {}
                Err(error) => {
                    tracing::warn!(error = in_short(&error), "cannot delete objects");
                }
            }
        }
    }

    /// The store's clock: the time of publication of an object that is deleted again.
    pub(super) async fn now(&self) -> Result<SystemTime, StoreError> {
        let path = unique_name(PROBE_CLOCK);
        let failed = || StoreError::object("asking for the time of", &path);
        let location = parse(&path)?;
        self.remote.put(&location, Bytes::from_static(b"now").into()).await.map_err(failed())?;
        let published = self.remote.head(&location).await.map_err(failed())?.last_modified;
        self.remote.delete(&location).await.map_err(failed())?;
        Ok(published.into())
    }
}
