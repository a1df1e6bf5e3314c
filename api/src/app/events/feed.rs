//! The feed of settled events, which is read once for all listeners. Nothing is read while nobody
//! listens.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use store::{Event, EventTail};
use tokio::sync::{broadcast, watch};
use tokio::task::JoinHandle;
use wire::JobProgress;

use crate::app::App;
use crate::error::ApiError;
use crate::limits::{EVENT_BACKLOG, EVENT_POLL, EVENT_PROGRESS};

/// Pause before the next look after the database did not answer.
const RETRY: Duration = Duration::from_secs(1);

/// The feed. Clones share it.
#[derive(Clone)]
pub struct Feed(Arc<Inner>);

struct Inner {
    news: broadcast::Sender<Arc<Event>>,
    /// Events up to this id were sent, or existed before.
    settled: AtomicI64,
    /// The task that reads events while somebody listens.
    reading: tokio::sync::Mutex<Option<JoinHandle<()>>>,
    /// The jobs whose progress is sent.
    watched: Mutex<HashMap<i64, Watched>>,
}

type Watched = watch::Sender<Option<Arc<JobProgress>>>;

/// A listener. It gets every event after `position`, or learns that some were skipped.
pub struct Listener {
    pub news: broadcast::Receiver<Arc<Event>>,
    pub position: i64,
}

impl Feed {
    pub fn new() -> Self {
        Self(Arc::new(Inner {
            news: broadcast::Sender::new(EVENT_BACKLOG),
            settled: AtomicI64::new(0),
            reading: tokio::sync::Mutex::new(None),
            watched: Mutex::default(),
        }))
    }

    /// # Errors
    /// [`ApiError::Timeout`] when another open transaction prevents the first listener from
    /// learning where to begin. Also when the database fails.
    pub async fn listen(&self, app: &App) -> Result<Listener, ApiError> {
        let mut reading = self.0.reading.lock().await;
        let news = self.0.news.subscribe();
        if reading.as_ref().is_none_or(JoinHandle::is_finished) {
            let tail = app.store.event_tail().await?.ok_or(ApiError::Timeout)?;
            self.0.settled.store(tail.position(), Ordering::Release);
            *reading = Some(tokio::spawn(self.clone().read(app.clone(), tail)));
        }
        // The sender of an event moves the position first, so every later event is in the news.
        Ok(Listener { news, position: self.settled() })
    }

    /// Events up to this id can be read from the store.
    pub fn settled(&self) -> i64 {
        self.0.settled.load(Ordering::Acquire)
    }

    /// The progress of a job, each time it changes.
    pub fn watch(&self, job: i64) -> watch::Receiver<Option<Arc<JobProgress>>> {
        self.watched().entry(job).or_default().subscribe()
    }

    /// Sends events as they settle, until nobody listens.
    async fn read(self, app: App, mut tail: EventTail) {
        let mut told_at = Instant::now();
        loop {
            tokio::time::sleep(EVENT_POLL).await;
            {
                let mut reading = self.0.reading.lock().await;
                if self.0.news.receiver_count() == 0 {
                    *reading = None;
                    return;
                }
            }
            match self.look(&app, &mut tail, &mut told_at).await {
                Ok(()) => {}
                Err(error) => {
                    tracing::warn!(%error, "cannot read events");
                    tokio::time::sleep(RETRY).await;
                }
            }
        }
    }

    async fn look(
        &self,
        app: &App,
        tail: &mut EventTail,
        told_at: &mut Instant,
    ) -> Result<(), ApiError> {
        let before = tail.position();
        loop {
            let events = tail.read().await?;
            let is_last = events.is_empty();
            for event in events {
                self.0.settled.store(event.id, Ordering::Release);
                // The listeners may have gone meanwhile.
                let _ = self.0.news.send(Arc::new(event));
            }
            self.0.settled.store(tail.position(), Ordering::Release);
            if is_last {
                break;
            }
        }
        let something_happened = tail.position() > before;
        if something_happened || told_at.elapsed() >= EVENT_PROGRESS {
            self.tell_progress(app).await?;
            *told_at = Instant::now();
        }
        Ok(())
    }

    async fn tell_progress(&self, app: &App) -> Result<(), ApiError> {
        let jobs: Vec<i64> = {
            let mut watched = self.watched();
            watched.retain(|_, told| told.receiver_count() > 0);
            watched.keys().copied().collect()
        };
        if jobs.is_empty() {
            return Ok(());
        }
        let mut progress: BTreeMap<i64, JobProgress> = app.job_progress(&jobs).await?;
        for (job, told) in self.watched().iter() {
            let Some(progress) = progress.remove(job) else { continue };
            told.send_if_modified(|last| {
                let is_new = last.as_deref() != Some(&progress);
                if is_new {
                    *last = Some(Arc::new(progress));
                }
                is_new
            });
        }
        Ok(())
    }

    fn watched(&self) -> MutexGuard<'_, HashMap<i64, Watched>> {
        // No code panics while it holds the lock.
        self.0.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
