//! Experiments: names under which MLflow clients group their runs.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::database::column::json;
use crate::database::query::{from_row, sql};
use crate::database::{Reading, Scope, Transaction};
use crate::{ExperimentId, Store, StoreError, Timestamp, boxed};

/// An experiment of MLflow's clients, which groups their runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackedExperiment {
    /// Its id. 0 is the experiment of clients that name none, and 1 that of torqued's own runs.
    pub id: ExperimentId,
    /// A name that no other experiment has.
    pub name: String,
    /// Whether it is in the trash.
    pub is_deleted: bool,
    /// When it was created.
    pub created_at: Timestamp,
    /// When it was last changed.
    pub updated_at: Timestamp,
    /// Its tags, by their keys.
    pub tags: BTreeMap<String, String>,
}

const CHANGING: &str = "changing an experiment";

const READING: &str = "reading experiments";

impl ExperimentId {
    /// The experiment for clients that name none.
    pub const DEFAULT: Self = Self(0);

    /// The experiment of torqued's own runs.
    pub const TORQUED: Self = Self(1);
}

impl Store {
    /// # Errors
    /// [`StoreError::ExperimentTaken`] when an experiment has this name, even a deleted one.
    #[boxed]
    pub async fn create_experiment(
        &self,
        name: &str,
        tags: &[(String, String)],
    ) -> Result<ExperimentId, StoreError> {
        let mut tx = self.begin(Scope::Rows, "creating an experiment").await?;
        let Some(id) = tx.insert_experiment(name).await? else {
            return Err(StoreError::ExperimentTaken { name: name.to_owned() });
        };
        for (key, value) in tags {
            tx.set_experiment_tag(id, key, value).await?;
        }
        tx.commit().await?;
        Ok(id)
    }

    /// # Errors
    /// When there is no such experiment.
    #[boxed]
    pub async fn experiment(&self, id: ExperimentId) -> Result<TrackedExperiment, StoreError> {
        let found = self.read(READING).experiment(id).await?;
        self.with_tags(found.into_iter().collect())
            .await?
            .pop()
            .ok_or_else(|| StoreError::not_found("experiment", id.to_string()))
    }

    /// # Errors
    /// When there is no such experiment.
    #[boxed]
    pub async fn experiment_named(&self, name: &str) -> Result<TrackedExperiment, StoreError> {
        let found = self.read(READING).experiment_named(name).await?;
        self.with_tags(found.into_iter().collect())
            .await?
            .pop()
            .ok_or_else(|| StoreError::not_found("experiment", format!("{name:?}")))
    }

    /// All experiments, sorted by id.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tracked_experiments(&self) -> Result<Vec<TrackedExperiment>, StoreError> {
        let found = self.read(READING).tracked_experiments().await?;
        self.with_tags(found).await
    }

    /// # Errors
    /// When there is no such experiment, or another one has this name.
    #[boxed]
    pub async fn rename_experiment(&self, id: ExperimentId, name: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        if tx.experiment_id(name).await?.is_some_and(|other| other != id) {
            return Err(StoreError::ExperimentTaken { name: name.to_owned() });
        }
        if !tx.rename_experiment(id, name).await? {
            return Err(StoreError::not_found("experiment", id.to_string()));
        }
        tx.commit().await
    }

    /// Deletes an experiment with its runs; they can be restored for `keep`. With `None`, restores
    /// both.
    ///
    /// # Errors
    /// When there is no such experiment.
    #[boxed]
    pub async fn set_experiment_deleted(
        &self,
        id: ExperimentId,
        keep: Option<Duration>,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        if !tx.set_experiment_deleted(id, keep).await? {
            return Err(StoreError::not_found("experiment", id.to_string()));
        }
        tx.commit().await
    }

    /// Sets a tag of an experiment. With `None`, removes it.
    ///
    /// # Errors
    /// When there is no such experiment, or no such tag to remove.
    #[boxed]
    pub async fn tag_experiment(
        &self,
        id: ExperimentId,
        key: &str,
        value: Option<&str>,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        if !tx.touch_experiment(id).await? {
            return Err(StoreError::not_found("experiment", id.to_string()));
        }
        match value {
            Some(value) => tx.set_experiment_tag(id, key, value).await?,
            None => {
                if !tx.delete_experiment_tag(id, key).await? {
                    return Err(StoreError::not_found(
                        "tag",
                        format!("{key:?} of experiment {id}"),
                    ));
                }
            }
        }
        tx.commit().await
    }

    async fn with_tags(
        &self,
        mut experiments: Vec<TrackedExperiment>,
    ) -> Result<Vec<TrackedExperiment>, StoreError> {
        let ids: Vec<ExperimentId> = experiments.iter().map(|experiment| experiment.id).collect();
        let mut tags: BTreeMap<ExperimentId, BTreeMap<String, String>> = BTreeMap::new();
        for (id, key, value) in self.read(READING).experiment_tags(&ids).await? {
            tags.entry(id).or_default().insert(key, value);
        }
        for experiment in &mut experiments {
            experiment.tags = tags.remove(&experiment.id).unwrap_or_default();
        }
        Ok(experiments)
    }
}

impl Reading<'_> {
    pub async fn experiment(
        &mut self,
        id: ExperimentId,
    ) -> Result<Option<TrackedExperiment>, StoreError> {
        sql("SELECT * FROM tracked_experiment WHERE id = $1").bind(id).optional(self).await
    }

    pub async fn experiment_named(
        &mut self,
        name: &str,
    ) -> Result<Option<TrackedExperiment>, StoreError> {
        sql("SELECT * FROM tracked_experiment WHERE name = $1").bind(name).optional(self).await
    }

    pub async fn tracked_experiments(&mut self) -> Result<Vec<TrackedExperiment>, StoreError> {
        sql("SELECT * FROM tracked_experiment ORDER BY id").all(self).await
    }

    pub async fn experiment_tags(
        &mut self,
        ids: &[ExperimentId],
    ) -> Result<Vec<(ExperimentId, String, String)>, StoreError> {
        sql("SELECT experiment, key, value FROM tracked_experiment_tag \
             WHERE experiment IN {ids $1}")
        .bind(json(&ids))
        .all(self)
        .await
    }
}

impl Transaction {
    /// Returns `None` when the name is taken.
    pub async fn insert_experiment(
        &mut self,
        name: &str,
    ) -> Result<Option<ExperimentId>, StoreError> {
        sql("INSERT INTO tracked_experiment (name, created_at, updated_at) \
             VALUES ($1, {now}, {now}) ON CONFLICT (name) DO NOTHING RETURNING id")
        .bind(name)
        .optional(self)
        .await
    }

    pub async fn experiment_id(&mut self, name: &str) -> Result<Option<ExperimentId>, StoreError> {
        sql("SELECT id FROM tracked_experiment WHERE name = $1").bind(name).optional(self).await
    }

    /// Whether the experiment is deleted. The row is locked until the transaction ends.
    pub async fn experiment_is_deleted(
        &mut self,
        id: ExperimentId,
    ) -> Result<Option<bool>, StoreError> {
        sql("SELECT is_deleted FROM tracked_experiment WHERE id = $1{locked}")
            .bind(id)
            .optional(self)
            .await
    }

    /// Returns whether the experiment exists, like the functions below.
    pub async fn rename_experiment(
        &mut self,
        id: ExperimentId,
        name: &str,
    ) -> Result<bool, StoreError> {
        let renamed =
            sql("UPDATE tracked_experiment SET name = $2, updated_at = {now} WHERE id = $1")
                .bind(id)
                .bind(name)
                .changed(self)
                .await?;
        Ok(renamed > 0)
    }

    pub async fn set_experiment_deleted(
        &mut self,
        id: ExperimentId,
        keep: Option<Duration>,
    ) -> Result<bool, StoreError> {
        for (table, column) in [("tracked_run", "experiment"), ("tracked_experiment", "id")] {
            let mut query = sql(format!("UPDATE {table} SET is_deleted = "));
            match keep {
                // A run that was deleted before keeps its date.
                Some(keep) => {
                    query.push("TRUE, deleted_at = ").push("{now}").push(", purge_at = ");
                    query.push("{now}").push(" + ").push_bind(keep);
                    query.push(" WHERE NOT is_deleted AND ");
                }
                None => {
                    query.push("FALSE, deleted_at = NULL, purge_at = NULL WHERE ");
                }
            }
            query.push(format!("{column} = ")).push_bind(id);
            query.changed(self).await?;
        }
        self.touch_experiment(id).await
    }

    pub async fn touch_experiment(&mut self, id: ExperimentId) -> Result<bool, StoreError> {
        let touched = sql("UPDATE tracked_experiment SET updated_at = {now} WHERE id = $1")
            .bind(id)
            .changed(self)
            .await?;
        Ok(touched > 0)
    }

    pub async fn set_experiment_tag(
        &mut self,
        id: ExperimentId,
        key: &str,
        value: &str,
    ) -> Result<(), StoreError> {
        sql("INSERT INTO tracked_experiment_tag (experiment, key, value) VALUES ($1, $2, $3) \
             ON CONFLICT (experiment, key) DO UPDATE SET value = excluded.value")
        .bind(id)
        .bind(key)
        .bind(value)
        .run(self)
        .await
    }

    /// Returns whether the tag existed.
    pub async fn delete_experiment_tag(
        &mut self,
        id: ExperimentId,
        key: &str,
    ) -> Result<bool, StoreError> {
        let deleted = sql("DELETE FROM tracked_experiment_tag WHERE experiment = $1 AND key = $2")
            .bind(id)
            .bind(key)
            .changed(self)
            .await?;
        Ok(deleted > 0)
    }
}

from_row!(TrackedExperiment {
    id, name, is_deleted, created_at, updated_at,
    ..row =>
    tags: BTreeMap::new(),
});
