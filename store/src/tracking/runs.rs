//! Tracked runs: runs that MLflow clients log beside torqued's own.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use crate::boxed;
use crate::database::{Scope, Transaction, sql};
use crate::{ExperimentId, Store, StoreError, Timestamp, TrackedRunId};

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackedRun {
    pub id: TrackedRunId,
    /// The id that clients use: 32 hexadecimal digits.
    pub identifier: String,
    pub experiment: ExperimentId,
    pub name: String,
    pub user: String,
    pub status: TrackedStatus,
    /// The start time that the client sent. The end time also comes from the client.
    pub start_time: Timestamp,
    pub end_time: Option<Timestamp>,
    pub is_deleted: bool,
}

/// The status of a run, in MLflow's words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackedStatus {
    Running,
    Scheduled,
    Finished,
    Failed,
    Killed,
}

#[derive(Clone, Debug)]
pub struct NewTrackedRun {
    pub experiment: ExperimentId,
    /// The name; `None` derives it from the identifier.
    pub name: Option<String>,
    pub user: String,
    pub start_time: Timestamp,
    pub tags: Vec<(String, String)>,
}

/// Fields of a run to change.
#[derive(Clone, Debug, Default)]
pub struct TrackedRunChange {
    pub name: Option<String>,
    pub status: Option<TrackedStatus>,
    pub end_time: Option<Timestamp>,
}

/// The tag in which MLflow stores a run's name a second time.
const NAME_TAG: &str = "mlflow.runName";

const CHANGING: &str = "changing a tracked run";

const READING: &str = "reading tracked runs";

impl TrackedStatus {
    pub const ALL: [Self; 5] =
        [Self::Running, Self::Scheduled, Self::Finished, Self::Failed, Self::Killed];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Running => "RUNNING",
            Self::Scheduled => "SCHEDULED",
            Self::Finished => "FINISHED",
            Self::Failed => "FAILED",
            Self::Killed => "KILLED",
        }
    }
}

impl fmt::Display for TrackedStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for TrackedStatus {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|status| status.as_str() == text);
        found.ok_or_else(|| format!("there is no status {text:?}"))
    }
}

impl Store {
    /// # Errors
    /// When there is no such experiment, or it is deleted.
    #[boxed]
    pub async fn create_tracked_run(&self, new: &NewTrackedRun) -> Result<TrackedRun, StoreError> {
        let mut tx = self.begin(Scope::Rows, "creating a tracked run").await?;
        let id = || new.experiment.to_string();
        match sql!(&mut tx, experiment_is_deleted(new.experiment))? {
            None => return Err(StoreError::not_found("experiment", id())),
            Some(true) => return Err(StoreError::Deleted { what: "experiment", id: id() }),
            Some(false) => {}
        }
        let run = sql!(&mut tx, insert_tracked_run(new))?;
        let mut tags = new.tags.clone();
        tags.retain(|(key, _)| key != NAME_TAG);
        tags.push((NAME_TAG.to_owned(), run.name.clone()));
        sql!(&mut tx, set_tracked_tags(run.id, &tags))?;
        tx.commit().await?;
        Ok(run)
    }

    /// # Errors
    /// When there is no such run.
    #[boxed]
    pub async fn tracked_run(&self, identifier: &str) -> Result<TrackedRun, StoreError> {
        sql!(self.database(), READING, tracked_run(identifier))?
            .ok_or_else(|| StoreError::not_found("run", identifier.to_owned()))
    }

    /// All runs of `experiments`, including deleted ones, newest first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tracked_runs(
        &self,
        experiments: &[ExperimentId],
    ) -> Result<Vec<TrackedRun>, StoreError> {
        sql!(self.database(), READING, tracked_runs(experiments))
    }

    /// # Errors
    /// When there is no such run, or it is deleted.
    #[boxed]
    pub async fn change_tracked_run(
        &self,
        identifier: &str,
        change: &TrackedRunChange,
    ) -> Result<TrackedRun, StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        let run = active_run(&mut tx, identifier).await?;
        let changed = TrackedRun {
            name: change.name.clone().unwrap_or(run.name),
            status: change.status.unwrap_or(run.status),
            end_time: change.end_time.or(run.end_time),
            ..run
        };
        sql!(&mut tx, update_tracked_run(&changed))?;
        let tag = (NAME_TAG.to_owned(), changed.name.clone());
        sql!(&mut tx, set_tracked_tags(changed.id, &[tag]))?;
        tx.commit().await?;
        Ok(changed)
    }

    /// Deletes a run; it can be restored for `keep`. With `None`, restores it.
    ///
    /// # Errors
    /// When there is no such run.
    #[boxed]
    pub async fn set_tracked_run_deleted(
        &self,
        identifier: &str,
        keep: Option<Duration>,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        let Some(run) = sql!(&mut tx, kept_run(identifier))? else {
            return Err(StoreError::not_found("run", identifier.to_owned()));
        };
        sql!(&mut tx, set_tracked_run_deleted(run.id, keep))?;
        tx.commit().await
    }

    /// # Errors
    /// When there is no such run, the run is deleted, or it has no such tag.
    #[boxed]
    pub async fn delete_tracked_tag(&self, identifier: &str, key: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        let run = active_run(&mut tx, identifier).await?;
        if !sql!(&mut tx, delete_tracked_tag(run.id, key))? {
            return Err(StoreError::not_found("tag", format!("{key:?} of run {identifier}")));
        }
        tx.commit().await
    }

    /// Params of `runs`, or only those with `keys`, sorted by run and key.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tracked_params(
        &self,
        runs: &[TrackedRunId],
        keys: Option<&[String]>,
    ) -> Result<Vec<(TrackedRunId, String, String)>, StoreError> {
        sql!(self.database(), READING, tracked_texts("tracked_param", runs, keys))
    }

    /// Tags of `runs`, or only those with `keys`, sorted by run and key.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tracked_tags(
        &self,
        runs: &[TrackedRunId],
        keys: Option<&[String]>,
    ) -> Result<Vec<(TrackedRunId, String, String)>, StoreError> {
        sql!(self.database(), READING, tracked_texts("tracked_tag", runs, keys))
    }
}

/// A run that may be written to. It is locked, so nobody else writes to it until the transaction
/// ends.
pub(crate) async fn active_run(
    tx: &mut Transaction,
    identifier: &str,
) -> Result<TrackedRun, StoreError> {
    match sql!(&mut *tx, kept_run(identifier))? {
        None => Err(StoreError::not_found("run", identifier.to_owned())),
        Some(run) if run.is_deleted => {
            Err(StoreError::Deleted { what: "run", id: identifier.to_owned() })
        }
        Some(run) => Ok(run),
    }
}
