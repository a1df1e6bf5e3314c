//! Events for a client that follows all jobs, or one job.
//!
//! A reader has a `position` among the events. It reads stored events page by page, and then
//! continues with the feed. If it falls so far behind that the feed skips events, it reads these
//! from the store again.

mod feed;

use std::collections::{BTreeMap, VecDeque};
use std::pin::Pin;
use std::sync::Arc;

use serde_json::{Value, json};
use store::{EventFilter, EventKind, JobId, RunId};
use tokio::sync::{OwnedSemaphorePermit, broadcast, watch};
use tokio::time::{Interval, MissedTickBehavior, interval};
use wire::{EventEnd, EventGap, JobProgress};

use crate::access::Credentials;
use crate::app::App;
use crate::error::ApiError;
use crate::limits::{EVENT_ACCESS_CHECKED, EVENT_PAGE, EVENT_POLL};

pub use feed::Feed;
use feed::Listener;

/// The subject whose events are requested.
#[derive(Clone, Copy, Debug)]
pub enum Subject {
    Everything {
        kind: Option<EventKind>,
    },
    Job(i64),
    /// The events of its job.
    Run(i64),
}

/// Reads events for one connection until it ends.
pub struct EventReader {
    app: App,
    /// They are checked regularly, to stop when access ends.
    credentials: Credentials,
    access_checked: Interval,
    closing: Pin<Box<dyn Future<Output = ()> + Send>>,
    /// The followed jobs, including those of a pipeline; `None` for all jobs.
    jobs: Option<Vec<JobId>>,
    kind: Option<EventKind>,
    news: broadcast::Receiver<Arc<store::Event>>,
    /// Events up to this id were sent, or were not requested.
    position: i64,
    /// Events up to this id are read from the store.
    replay_to: i64,
    followed: Option<Followed>,
    to_send: VecDeque<wire::Event>,
    has_ended: bool,
    _place: OwnedSemaphorePermit,
}

/// The job of a stream.
struct Followed {
    job: i64,
    changes: watch::Receiver<Option<Arc<JobProgress>>>,
    /// Its progress as sent last.
    told: Option<JobProgress>,
    /// The job has ended, and its final event has this id or a smaller one.
    ends_by: Option<i64>,
}

impl App {
    /// Opens a stream of events: those after the id `after`, or new ones. A job's stream begins
    /// with its progress.
    ///
    /// # Errors
    /// When there is no such job or run, or too many streams are open.
    pub(crate) async fn event_reader(
        &self,
        subject: Subject,
        after: Option<i64>,
        credentials: Credentials,
    ) -> Result<EventReader, ApiError> {
        let place = self.places.event_stream()?;
        let (job, kind) = match subject {
            Subject::Everything { kind } => (None, kind),
            Subject::Job(job) => (Some(self.store.job(JobId(job)).await?.id), None),
            Subject::Run(run) => (Some(self.store.run(RunId(run)).await?.job), None),
        };
        let jobs = match job {
            Some(job) => {
                let members = self.store.members(&[job]).await?;
                Some(members.into_iter().map(|member| member.job).chain([job]).collect())
            }
            None => None,
        };
        let Listener { news, position } = self.feed.listen(self).await?;
        let followed = job.map(|JobId(job)| Followed {
            job,
            changes: self.feed.watch(job),
            told: None,
            ends_by: None,
        });
        let mut access_checked = interval(EVENT_ACCESS_CHECKED);
        access_checked.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut reader = EventReader {
            app: self.clone(),
            credentials,
            access_checked,
            closing: Box::pin(self.places.closing()),
            jobs,
            kind,
            news,
            position,
            replay_to: position,
            followed,
            to_send: VecDeque::new(),
            has_ended: false,
            _place: place,
        };
        if let Some(after) = after {
            reader.go_back_to(after).await?;
        }
        Ok(reader)
    }

    /// The present progress of jobs, by id.
    pub(super) async fn job_progress(
        &self,
        jobs: &[i64],
    ) -> Result<BTreeMap<i64, JobProgress>, ApiError> {
        let ids: Vec<JobId> = jobs.iter().copied().map(JobId).collect();
        let rows = self.store.jobs_by_id(&ids).await?;
        let progress = self.progress_of(rows).await?;
        Ok(progress.into_iter().map(|progress| (progress.job, progress)).collect())
    }
}

impl EventReader {
    /// Waits for the next event. `None` at the end: the job has ended, the server stops, the token
    /// is no longer valid, or the database does not answer. A client that connects again continues
    /// here.
    pub async fn next(&mut self) -> Option<wire::Event> {
        loop {
            if let Some(event) = self.to_send.pop_front() {
                return Some(event);
            }
            if self.has_ended {
                return None;
            }
            if let Err(error) = self.advance().await {
                tracing::warn!(%error, "a stream of events ends");
                return None;
            }
        }
    }

    async fn advance(&mut self) -> Result<(), ApiError> {
        if self.position < self.replay_to {
            return self.replay().await;
        }
        if self.followed.as_ref().is_some_and(|followed| followed.told.is_none()) {
            return self.begin_with_progress().await;
        }
        let ends_by = self.followed.as_ref().and_then(|followed| followed.ends_by);
        if ends_by.is_some_and(|id| id <= self.position) {
            return self.tell_end().await;
        }
        let changed = async {
            match &mut self.followed {
                Some(followed) => followed.changes.changed().await.is_ok(),
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            () = &mut self.closing => self.has_ended = true,
            _ = self.access_checked.tick() => {
                self.has_ended = self.app.access.caller(self.credentials).await?.is_none();
            }
            news = self.news.recv() => match news {
                Ok(event) => self.take(&event).await?,
                Err(broadcast::error::RecvError::Lagged(_)) => {
                    let after = self.position;
                    self.replay_to = self.app.feed.settled();
                    self.go_back_to(after).await?;
                }
                Err(broadcast::error::RecvError::Closed) => self.has_ended = true,
            },
            _ = changed => self.take_progress(),
            () = tokio::time::sleep(EVENT_POLL), if ends_by.is_some() => {
                self.replay_to = self.app.feed.settled();
            }
        }
        Ok(())
    }

    /// Continues from `after`, if the events after it are stored.
    async fn go_back_to(&mut self, after: i64) -> Result<(), ApiError> {
        let (oldest, newest) = self.app.store.kept_events().await?;
        let next_that_is_kept = oldest - 1;
        self.position = match after {
            // All stored events.
            0 => next_that_is_kept,
            _ if after < next_that_is_kept => self.gap(after, next_that_is_kept),
            // The id comes from another database.
            _ if after > newest => self.gap(after, self.replay_to),
            _ => after,
        };
        Ok(())
    }

    /// Reports a gap up to `id`. The end of the job may lie in it, so its progress is sent again.
    fn gap(&mut self, after: i64, id: i64) -> i64 {
        if let Some(followed) = &mut self.followed {
            followed.told = None;
        }
        self.to_send.push_back(wire::Event::Gap(EventGap { id, after }));
        id
    }

    /// Reads a page from the store.
    async fn replay(&mut self) -> Result<(), ApiError> {
        let filter = EventFilter { jobs: self.jobs.as_deref(), kind: self.kind };
        let (after, up_to) = (self.position, self.replay_to);
        let events = self.app.store.events(&filter, after, up_to, EVENT_PAGE).await?;
        let is_last = u32::try_from(events.len()).is_ok_and(|read| read < EVENT_PAGE);
        for event in &events {
            self.take(event).await?;
            if self.has_ended {
                return Ok(());
            }
        }
        if is_last {
            self.position = up_to;
        }
        Ok(())
    }

    /// Sends an event if it was requested and not sent before. The stream ends after the final
    /// event of a followed job.
    async fn take(&mut self, event: &store::Event) -> Result<(), ApiError> {
        if event.id <= self.position {
            return Ok(());
        }
        self.position = event.id;
        let is_asked_for = self.jobs.as_ref().is_none_or(|jobs| jobs.contains(&event.job))
            && self.kind.is_none_or(|kind| kind == event.kind);
        if !is_asked_for {
            return Ok(());
        }
        let Some(event) = told(event) else { return Ok(()) };
        let ends = match (&event, &self.followed) {
            (wire::Event::Job(event), Some(followed)) => {
                event.job == followed.job && event.state.is_final()
            }
            _ => false,
        };
        self.to_send.push_back(event);
        if ends {
            self.tell_end().await?;
        }
        Ok(())
    }

    /// Sends the present progress of the job. If the job has ended, its final event may not have
    /// settled yet, so the stream ends once all events that exist now were sent.
    async fn begin_with_progress(&mut self) -> Result<(), ApiError> {
        let Some(progress) = self.tell_progress().await? else { return Ok(()) };
        if !progress.state.is_final() {
            return Ok(());
        }
        let (_, newest) = self.app.store.kept_events().await?;
        if newest <= self.position {
            self.end(progress);
        } else if let Some(followed) = &mut self.followed {
            followed.ends_by = Some(newest);
        }
        Ok(())
    }

    async fn tell_end(&mut self) -> Result<(), ApiError> {
        if let Some(progress) = self.tell_progress().await? {
            self.end(progress);
        }
        Ok(())
    }

    /// Sends the present progress of the job. `None`, and the stream ends, if the job was deleted.
    async fn tell_progress(&mut self) -> Result<Option<JobProgress>, ApiError> {
        let Some(followed) = &mut self.followed else { return Ok(None) };
        let progress = self.app.job_progress(&[followed.job]).await?.remove(&followed.job);
        followed.told.clone_from(&progress);
        match &progress {
            Some(progress) => self.to_send.push_back(wire::Event::Progress(progress.clone())),
            None => self.has_ended = true,
        }
        Ok(progress)
    }

    fn end(&mut self, JobProgress { job, state, error, .. }: JobProgress) {
        self.to_send.push_back(wire::Event::End(EventEnd { job, state, error }));
        self.has_ended = true;
    }

    /// Sends the progress that the feed has read. Its state may be final before the final event has
    /// settled, and only that event ends the stream.
    fn take_progress(&mut self) {
        let Some(followed) = &mut self.followed else { return };
        let progress = followed.changes.borrow_and_update().as_deref().cloned();
        if let Some(progress) = progress
            && followed.told.as_ref() != Some(&progress)
        {
            followed.told = Some(progress.clone());
            self.to_send.push_back(wire::Event::Progress(progress));
        }
    }
}

/// The event in the API's form; `None` for a kind of job that this version does not know.
fn told(event: &store::Event) -> Option<wire::Event> {
    let mut data = json!({
        "event": event.kind, "id": event.id, "at": event.at, "job": event.job,
    });
    if let (Value::Object(data), Value::Object(rest)) = (&mut data, &event.data) {
        data.extend(rest.iter().map(|(name, value)| (name.clone(), value.clone())));
    }
    serde_json::from_value(data)
        .inspect_err(|error| tracing::warn!(%error, event = event.id, "an event cannot be read"))
        .ok()
}
