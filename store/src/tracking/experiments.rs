//! Experiments: names under which MLflow clients group their runs.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::{ExperimentId, Store, StoreError, Timestamp};

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackedExperiment {
    pub id: ExperimentId,
    pub name: String,
    pub is_deleted: bool,
    pub created_at: Timestamp,
    pub updated_at: Timestamp,
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
        let Some(id) = sql!(&mut tx, insert_experiment(name))? else {
            return Err(StoreError::ExperimentTaken { name: name.to_owned() });
        };
        for (key, value) in tags {
            sql!(&mut tx, set_experiment_tag(id, key, value))?;
        }
        tx.commit().await?;
        Ok(id)
    }

    /// # Errors
    /// When there is no such experiment.
    #[boxed]
    pub async fn experiment(&self, id: ExperimentId) -> Result<TrackedExperiment, StoreError> {
        let found = sql!(self.database(), READING, experiment(id))?;
        self.with_tags(found.into_iter().collect())
            .await?
            .pop()
            .ok_or_else(|| StoreError::not_found("experiment", id.to_string()))
    }

    /// # Errors
    /// When there is no such experiment.
    #[boxed]
    pub async fn experiment_named(&self, name: &str) -> Result<TrackedExperiment, StoreError> {
        let found = sql!(self.database(), READING, experiment_named(name))?;
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
        let found = sql!(self.database(), READING, tracked_experiments())?;
        self.with_tags(found).await
    }

    /// # Errors
    /// When there is no such experiment, or another one has this name.
    #[boxed]
    pub async fn rename_experiment(&self, id: ExperimentId, name: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, CHANGING).await?;
        if sql!(&mut tx, experiment_id(name))?.is_some_and(|other| other != id) {
            return Err(StoreError::ExperimentTaken { name: name.to_owned() });
        }
        if !sql!(&mut tx, rename_experiment(id, name))? {
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
        if !sql!(&mut tx, set_experiment_deleted(id, keep))? {
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
        if !sql!(&mut tx, touch_experiment(id))? {
            return Err(StoreError::not_found("experiment", id.to_string()));
        }
        match value {
            Some(value) => sql!(&mut tx, set_experiment_tag(id, key, value))?,
            None => {
                if !sql!(&mut tx, delete_experiment_tag(id, key))? {
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
        for (id, key, value) in sql!(self.database(), READING, experiment_tags(&ids))? {
            tags.entry(id).or_default().insert(key, value);
        }
        for experiment in &mut experiments {
            experiment.tags = tags.remove(&experiment.id).unwrap_or_default();
        }
        Ok(experiments)
    }
}
