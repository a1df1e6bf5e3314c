//! Tracked runs: runs that MLflow clients log beside torqued's own.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use crate::database::column::json;
use crate::database::query::{Query, from_row, sql};
use crate::database::{Reading, Scope, Transaction};
use crate::{ExperimentId, Store, StoreError, Timestamp, TrackedRunId, boxed};

macro_rules! select_tracked_run {
    ($($rest:expr),+ $(,)?) => {
        concat!("SELECT tracked_run.*, status AS state FROM tracked_run ", $($rest),+)
    };
}

/// A run that a client of MLflow has logged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackedRun {
    /// The id of its row.
    pub id: TrackedRunId,
    /// The id that clients use: 32 hexadecimal digits.
    pub identifier: String,
    /// The experiment that it belongs to.
    pub experiment: ExperimentId,
    /// Its name for people.
    pub name: String,
    /// The name of the user, as the client sent it.
    pub user: String,
    /// The status that the client sent.
    pub status: TrackedStatus,
    /// The start time that the client sent. The end time also comes from the client.
    pub start_time: Timestamp,
    /// When it ended; `None` while it goes on.
    pub end_time: Option<Timestamp>,
    /// Whether it is in the trash.
    pub is_deleted: bool,
}

/// The status of a run, in MLflow's words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackedStatus {
    /// It is under way.
    Running,
    /// It will begin later.
    Scheduled,
    /// It has succeeded.
    Finished,
    /// It has failed.
    Failed,
    /// It was stopped.
    Killed,
}

/// A tracked run to begin.
#[derive(Clone, Debug)]
pub struct NewTrackedRun {
    /// The experiment that it belongs to.
    pub experiment: ExperimentId,
    /// The name; `None` derives it from the identifier.
    pub name: Option<String>,
    /// The name of the user.
    pub user: String,
    /// When it began, by the client's clock.
    pub start_time: Timestamp,
    /// Tags, as keys and values.
    pub tags: Vec<(String, String)>,
}

/// Fields of a run to change.
#[derive(Clone, Debug, Default)]
pub struct TrackedRunChange {
    /// Another name.
    pub name: Option<String>,
    /// Another status.
    pub status: Option<TrackedStatus>,
    /// The time of its end.
    pub end_time: Option<Timestamp>,
}

/// The tag in which MLflow stores a run's name a second time.
const NAME_TAG: &str = "mlflow.runName";

const CHANGING: &str = "changing a tracked run";

const READING: &str = "reading tracked runs";

crate::database::column::word_columns!(TrackedStatus);

impl TrackedStatus {
    /// Every status.
    pub const ALL: [Self; 5] =
        [Self::Running, Self::Scheduled, Self::Finished, Self::Failed, Self::Killed];

    /// Its word in MLflow's API.
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
        match tx.experiment_is_deleted(new.experiment).await? {
            None => return Err(StoreError::not_found("experiment", id())),
            Some(true) => return Err(StoreError::Deleted { what: "experiment", id: id() }),
            Some(false) => {}
        }
        let run = tx.insert_tracked_run(new).await?;
        let mut tags = new.tags.clone();
        tags.retain(|(key, _)| key != NAME_TAG);
        tags.push((NAME_TAG.to_owned(), run.name.clone()));
        tx.set_tracked_tags(run.id, &tags).await?;
        tx.commit().await?;
        Ok(run)
    }

    /// # Errors
    /// When there is no such run.
    #[boxed]
    pub async fn tracked_run(&self, identifier: &str) -> Result<TrackedRun, StoreError> {
        self.read(READING)
            .tracked_run(identifier)
            .await?
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
        sql(select_tracked_run!("WHERE experiment IN ", "{ids $1}", " ORDER BY id DESC"))
            .bind(json(&experiments))
            .all(&mut self.read(READING))
            .await
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
        tx.update_tracked_run(&changed).await?;
        let tag = (NAME_TAG.to_owned(), changed.name.clone());
        tx.set_tracked_tags(changed.id, &[tag]).await?;
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
        let Some(run) = tx.kept_run(identifier).await? else {
            return Err(StoreError::not_found("run", identifier.to_owned()));
        };
        tx.set_tracked_run_deleted(run.id, keep).await?;
        tx.commit().await
    }

    /// # Errors
    /// When there is no such run, the run is deleted, or it has no such tag.
    #[boxed]
    pub async fn delete_tracked_tag(&self, identifier: &str, key: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        let run = active_run(&mut tx, identifier).await?;
        if !tx.delete_tracked_tag(run.id, key).await? {
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
        self.read(READING).tracked_texts("tracked_param", runs, keys).await
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
        self.read(READING).tracked_texts("tracked_tag", runs, keys).await
    }
}

/// A run that may be written to. It is locked, so nobody else writes to it until the transaction
/// ends.
pub(crate) async fn active_run(
    tx: &mut Transaction,
    identifier: &str,
) -> Result<TrackedRun, StoreError> {
    match tx.kept_run(identifier).await? {
        None => Err(StoreError::not_found("run", identifier.to_owned())),
        Some(run) if run.is_deleted => {
            Err(StoreError::Deleted { what: "run", id: identifier.to_owned() })
        }
        Some(run) => Ok(run),
    }
}

/// Rows per statement, with three values each. SQLite binds 32 766 values at most.
const ROWS_PER_STATEMENT: usize = 4000;

impl Reading<'_> {
    pub async fn tracked_run(
        &mut self,
        identifier: &str,
    ) -> Result<Option<TrackedRun>, StoreError> {
        sql(select_tracked_run!("WHERE identifier = $1")).bind(identifier).optional(self).await
    }

    /// Reads a table of texts with keys.
    pub async fn tracked_texts(
        &mut self,
        table: &str,
        runs: &[TrackedRunId],
        keys: Option<&[String]>,
    ) -> Result<Vec<(TrackedRunId, String, String)>, StoreError> {
        let mut query = sql(format!("SELECT run, key, value FROM {table}"));
        query.push(" WHERE run IN ").push_ids(&runs);
        if let Some(keys) = keys {
            query.push(" AND key IN ").push_texts(&keys);
        }
        query.push(" ORDER BY run, key");
        query.all(self).await
    }
}

impl Transaction {
    /// A run, locked so that nobody else writes to it until the transaction ends.
    pub async fn kept_run(&mut self, identifier: &str) -> Result<Option<TrackedRun>, StoreError> {
        sql(select_tracked_run!("WHERE identifier = $1", "{locked}"))
            .bind(identifier)
            .optional(self)
            .await
    }

    pub async fn insert_tracked_run(
        &mut self,
        new: &NewTrackedRun,
    ) -> Result<TrackedRun, StoreError> {
        // The identifier is drawn once and used in both places.
        sql("WITH drawn (identifier) AS MATERIALIZED \
             (SELECT {unique}) INSERT INTO tracked_run (identifier, experiment, name, user_name, \
             status, start_time, created_at) SELECT drawn.identifier, $1, COALESCE($2, 'run-' || \
             substr(drawn.identifier, 1, 8)), $3, 'RUNNING', $4, {now} FROM drawn \
             RETURNING *, status AS state")
        .bind(new.experiment)
        .bind(new.name.as_deref())
        .bind(&new.user)
        .bind(new.start_time)
        .one(self)
        .await
    }

    pub async fn update_tracked_run(&mut self, run: &TrackedRun) -> Result<(), StoreError> {
        sql("UPDATE tracked_run SET name = $2, status = $3, end_time = $4 WHERE id = $1")
            .bind(run.id)
            .bind(&run.name)
            .bind(run.status)
            .bind(run.end_time)
            .run(self)
            .await
    }

    /// Moves a run into the trash for `keep`, or out of it. A run that is in the trash already
    /// keeps its date.
    pub async fn set_tracked_run_deleted(
        &mut self,
        run: TrackedRunId,
        keep: Option<Duration>,
    ) -> Result<(), StoreError> {
        let statement = match keep {
            Some(keep) => sql(
                "UPDATE tracked_run SET is_deleted = TRUE, deleted_at = {now}, purge_at = {now} \
                 + $2 WHERE id = $1 AND NOT is_deleted",
            )
            .bind(run)
            .bind(keep),
            None => sql(
                "UPDATE tracked_run SET is_deleted = FALSE, deleted_at = NULL, purge_at = NULL \
                 WHERE id = $1",
            )
            .bind(run),
        };
        statement.run(self).await
    }

    /// Sets tags. No key may appear twice.
    pub async fn set_tracked_tags(
        &mut self,
        run: TrackedRunId,
        tags: &[(String, String)],
    ) -> Result<(), StoreError> {
        for part in tags.chunks(ROWS_PER_STATEMENT) {
            let mut query = texts("tracked_tag", run, part);
            query.push(" ON CONFLICT (run, key) DO UPDATE SET value = excluded.value");
            query.persistent(false).changed(self).await?;
        }
        Ok(())
    }

    /// Adds params and leaves existing ones as they are. No key may appear twice.
    pub async fn add_tracked_params(
        &mut self,
        run: TrackedRunId,
        params: &[(String, String)],
    ) -> Result<(), StoreError> {
        for part in params.chunks(ROWS_PER_STATEMENT) {
            let mut query = texts("tracked_param", run, part);
            query.push(" ON CONFLICT (run, key) DO NOTHING");
            query.persistent(false).changed(self).await?;
        }
        Ok(())
    }

    pub async fn params_of(
        &mut self,
        run: TrackedRunId,
        keys: &[&str],
    ) -> Result<Vec<(String, String)>, StoreError> {
        sql("SELECT key, value FROM tracked_param WHERE run = $1 AND key IN {texts $2}")
            .bind(run)
            .bind(json(&keys))
            .all(self)
            .await
    }

    /// Returns whether the tag existed.
    pub async fn delete_tracked_tag(
        &mut self,
        run: TrackedRunId,
        key: &str,
    ) -> Result<bool, StoreError> {
        let deleted = sql("DELETE FROM tracked_tag WHERE run = $1 AND key = $2")
            .bind(run)
            .bind(key)
            .changed(self)
            .await?;
        Ok(deleted > 0)
    }
}

fn texts(table: &str, run: TrackedRunId, rows: &[(String, String)]) -> Query {
    let mut query = sql(format!("INSERT INTO {table} (run, key, value) "));
    query.push_values(rows, |row, (key, value)| {
        row.push_bind(run).push_bind(key.clone()).push_bind(value.clone());
    });
    query
}

from_row!(TrackedRun {
    id, identifier, experiment, name, start_time, end_time, is_deleted,
    ..row =>
    user: row.get("user_name")?,
    status: row.get("state")?,
});
