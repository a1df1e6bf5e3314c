//! Places for answers that take long: how many there are at once, and when those end that wait for
//! something new.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::error::ApiError;
use crate::limits::{
    CONCURRENT_DOWNLOADS, CONCURRENT_UPLOADS, EVENT_STREAMS, LOG_READERS, STREAMS,
};

/// A permit for one answer. Dropping it frees the place.
pub type Place = OwnedSemaphorePermit;

/// The places of a server. Clones share them.
#[derive(Clone)]
pub struct Places {
    uploads: Arc<Semaphore>,
    downloads: Arc<Semaphore>,
    log_readers: Arc<Semaphore>,
    event_streams: Arc<Semaphore>,
    prediction_streams: Arc<Semaphore>,
    /// Whether requests should go to another server.
    ending: Arc<AtomicBool>,
    /// Whether waiting answers have to end.
    closing: watch::Sender<bool>,
}

impl Places {
    /// Long answers get a part of the `connections`, so that some are left for short ones.
    pub fn new(connections: usize) -> Self {
        let places = |number: usize| Arc::new(Semaphore::new(number));
        let part = |limit: usize, of: usize| places(limit.min(connections / of).max(1));
        Self {
            uploads: places(CONCURRENT_UPLOADS),
            downloads: part(CONCURRENT_DOWNLOADS, 8),
            log_readers: places(LOG_READERS),
            event_streams: part(EVENT_STREAMS, 4),
            prediction_streams: places(STREAMS),
            ending: Arc::default(),
            closing: watch::Sender::new(false),
        }
    }

    /// # Errors
    /// [`ApiError::UploadsCrowded`] when too many files are being received.
    pub fn upload(&self) -> Result<Place, ApiError> {
        place(&self.uploads).ok_or(ApiError::UploadsCrowded)
    }

    /// # Errors
    /// [`ApiError::DownloadsCrowded`] when too many files are being sent.
    pub fn download(&self) -> Result<Place, ApiError> {
        place(&self.downloads).ok_or(ApiError::DownloadsCrowded)
    }

    /// A place to wait for lines of a log; `None` if too many requests wait.
    pub fn log_reader(&self) -> Option<Place> {
        place(&self.log_readers)
    }

    /// # Errors
    /// [`ApiError::EventsCrowded`] when too many streams of events are open.
    pub fn event_stream(&self) -> Result<Place, ApiError> {
        place(&self.event_streams).ok_or(ApiError::EventsCrowded)
    }

    /// # Errors
    /// [`ApiError::StreamsCrowded`] when too many prediction streams are open.
    pub fn prediction_stream(&self) -> Result<Place, ApiError> {
        place(&self.prediction_streams).ok_or(ApiError::StreamsCrowded)
    }

    /// From now on, says that requests should go to another server. They are still answered.
    pub fn announce_end(&self) {
        self.ending.store(true, Ordering::Relaxed);
    }

    pub fn is_ending(&self) -> bool {
        self.ending.load(Ordering::Relaxed)
    }

    /// Makes streams and other waiting answers end.
    pub fn close(&self) {
        self.closing.send_replace(true);
    }

    /// Completes when streams and other waiting answers have to end.
    pub fn closing(&self) -> impl Future<Output = ()> + Send + 'static {
        let mut closing = self.closing.subscribe();
        async move {
            // If the sender is gone, they have to end too.
            let _ = closing.wait_for(|closing| *closing).await;
        }
    }

    /// Completes when no prediction stream is open and none can be opened any more.
    pub async fn streams_closed(&self) {
        let all = u32::try_from(STREAMS).unwrap_or(u32::MAX);
        let _ = self.prediction_streams.acquire_many(all).await;
    }
}

fn place(places: &Arc<Semaphore>) -> Option<Place> {
    Arc::clone(places).try_acquire_owned().ok()
}
