use std::collections::BTreeMap;
use std::time::Duration;

use sqlx::types::Json;
use sqlx::{FromRow, QueryBuilder, Row};

use super::{Database, Db, DbRow, Transaction, milliseconds};
use crate::{ExperimentId, TrackedExperiment};

impl Database {
    pub async fn experiment(
        &self,
        id: ExperimentId,
    ) -> Result<Option<TrackedExperiment>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM tracked_experiment WHERE id = $1")
            .bind(id)
            .fetch_optional(&self.reader)
            .await
    }

    pub async fn experiment_named(
        &self,
        name: &str,
    ) -> Result<Option<TrackedExperiment>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM tracked_experiment WHERE name = $1")
            .bind(name)
            .fetch_optional(&self.reader)
            .await
    }

    pub async fn tracked_experiments(&self) -> Result<Vec<TrackedExperiment>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM tracked_experiment ORDER BY id").fetch_all(&self.reader).await
    }

    pub async fn experiment_tags(
        &self,
        ids: &[ExperimentId],
    ) -> Result<Vec<(ExperimentId, String, String)>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT experiment, key, value FROM tracked_experiment_tag WHERE experiment IN ",
            listed_ids!("$1")
        ))
        .bind(Json(ids))
        .fetch_all(&self.reader)
        .await
    }
}

impl Transaction {
    /// Returns `None` when the name is taken.
    pub async fn insert_experiment(
        &mut self,
        name: &str,
    ) -> Result<Option<ExperimentId>, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "INSERT INTO tracked_experiment (name, created_at, updated_at) VALUES ($1, ",
            now!(),
            ", ",
            now!(),
            ") ON CONFLICT (name) DO NOTHING RETURNING id"
        ))
        .bind(name)
        .fetch_optional(self.connection())
        .await
    }

    pub async fn experiment_id(&mut self, name: &str) -> Result<Option<ExperimentId>, sqlx::Error> {
        sqlx::query_scalar("SELECT id FROM tracked_experiment WHERE name = $1")
            .bind(name)
            .fetch_optional(self.connection())
            .await
    }

    /// Whether the experiment is deleted. The row is locked until the transaction ends.
    pub async fn experiment_is_deleted(
        &mut self,
        id: ExperimentId,
    ) -> Result<Option<bool>, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "SELECT is_deleted FROM tracked_experiment WHERE id = $1",
            locked!()
        ))
        .bind(id)
        .fetch_optional(self.connection())
        .await
    }

    /// Returns whether the experiment exists, like the functions below.
    pub async fn rename_experiment(
        &mut self,
        id: ExperimentId,
        name: &str,
    ) -> Result<bool, sqlx::Error> {
        let renamed = sqlx::query(concat!(
            "UPDATE tracked_experiment SET name = $2, updated_at = ",
            now!(),
            " WHERE id = $1"
        ))
        .bind(id)
        .bind(name)
        .execute(self.connection())
        .await?;
        Ok(renamed.rows_affected() > 0)
    }

    pub async fn set_experiment_deleted(
        &mut self,
        id: ExperimentId,
        keep: Option<Duration>,
    ) -> Result<bool, sqlx::Error> {
        for (table, column) in [("tracked_run", "experiment"), ("tracked_experiment", "id")] {
            let mut query = QueryBuilder::<Db>::new(format!("UPDATE {table} SET is_deleted = "));
            match keep {
                // A run that was deleted before keeps its date.
                Some(keep) => {
                    query.push("TRUE, deleted_at = ").push(now!()).push(", purge_at = ");
                    query.push(now!()).push(" + ").push_bind(milliseconds(keep));
                    query.push(" WHERE NOT is_deleted AND ");
                }
                None => {
                    query.push("FALSE, deleted_at = NULL, purge_at = NULL WHERE ");
                }
            }
            query.push(format!("{column} = ")).push_bind(id);
            query.build().execute(self.connection()).await?;
        }
        self.touch_experiment(id).await
    }

    pub async fn touch_experiment(&mut self, id: ExperimentId) -> Result<bool, sqlx::Error> {
        let touched = sqlx::query(concat!(
            "UPDATE tracked_experiment SET updated_at = ",
            now!(),
            " WHERE id = $1"
        ))
        .bind(id)
        .execute(self.connection())
        .await?;
        Ok(touched.rows_affected() > 0)
    }

    pub async fn set_experiment_tag(
        &mut self,
        id: ExperimentId,
        key: &str,
        value: &str,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "INSERT INTO tracked_experiment_tag (experiment, key, value) VALUES ($1, $2, $3) \
             ON CONFLICT (experiment, key) DO UPDATE SET value = excluded.value",
        )
        .bind(id)
        .bind(key)
        .bind(value);
        self.execute(statement).await
    }

    /// Returns whether the tag existed.
    pub async fn delete_experiment_tag(
        &mut self,
        id: ExperimentId,
        key: &str,
    ) -> Result<bool, sqlx::Error> {
        let deleted =
            sqlx::query("DELETE FROM tracked_experiment_tag WHERE experiment = $1 AND key = $2")
                .bind(id)
                .bind(key)
                .execute(self.connection())
                .await?;
        Ok(deleted.rows_affected() > 0)
    }
}

impl FromRow<'_, DbRow> for TrackedExperiment {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            name: row.try_get("name")?,
            is_deleted: row.try_get("is_deleted")?,
            created_at: row.try_get("created_at")?,
            updated_at: row.try_get("updated_at")?,
            tags: BTreeMap::new(),
        })
    }
}
