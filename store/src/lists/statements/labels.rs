use sqlx::types::Json;
use sqlx::{QueryBuilder, Row};

use super::{Database, Db, LISTED_TEXTS, Transaction};
use crate::{JobId, Labels, Thing};

impl Database {
    /// Some jobs whose names are not searchable yet.
    pub async fn unfolded_names(&self, limit: i64) -> Result<Vec<(JobId, String)>, sqlx::Error> {
        sqlx::query_as("SELECT id, name FROM job WHERE searched IS NULL ORDER BY id LIMIT $1")
            .bind(limit)
            .fetch_all(&self.reader)
            .await
    }
}

impl Transaction {
    pub async fn set_searched(&mut self, job: JobId, text: &str) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query("UPDATE job SET searched = $1 WHERE id = $2 AND searched IS NULL")
                .bind(text)
                .bind(job);
        self.execute(statement).await
    }

    /// The labels of a thing and the name that a job was made with. The row is locked until the
    /// transaction ends.
    pub async fn labels(
        &mut self,
        thing: Thing,
        id: i64,
    ) -> Result<Option<(Labels, Option<String>)>, sqlx::Error> {
        let table = thing.as_str();
        let made_with = if thing == Thing::Job { "name" } else { "CAST(NULL AS TEXT)" };
        let mut query = QueryBuilder::<Db>::new(format!(
            "SELECT given_name, note, {made_with} AS made_with FROM {table} WHERE id = "
        ));
        query.push_bind(id).push(locked!());
        let Some(row) = query.build().fetch_optional(self.connection()).await? else {
            return Ok(None);
        };
        let select = format!("SELECT tag FROM {table}_tag WHERE {table} = ");
        let mut query = QueryBuilder::<Db>::new(select);
        let tags: Vec<String> =
            query.push_bind(id).build_query_scalar().fetch_all(self.connection()).await?;
        let labels = Labels {
            name: row.try_get("given_name")?,
            note: row.try_get("note")?,
            tags: tags.into_iter().collect(),
        };
        Ok(Some((labels, row.try_get("made_with")?)))
    }

    pub async fn set_labels(
        &mut self,
        thing: Thing,
        id: i64,
        labels: &Labels,
        searched: Option<&str>,
    ) -> Result<(), sqlx::Error> {
        let table = thing.as_str();
        let mut update = QueryBuilder::<Db>::new(format!("UPDATE {table} SET given_name = "));
        update.push_bind(labels.name.clone()).push(", note = ").push_bind(labels.note.clone());
        update.push(", searched = ").push_bind(searched.map(str::to_owned));
        update.push(" WHERE id = ").push_bind(id);
        self.execute(update.build()).await?;
        let delete = format!("DELETE FROM {table}_tag WHERE {table} = ");
        let mut delete = QueryBuilder::<Db>::new(delete);
        self.execute(delete.push_bind(id).build()).await?;
        let insert =
            format!("INSERT INTO {table}_tag ({table}, tag) SELECT labelled.id, new.value FROM ");
        let mut insert = QueryBuilder::<Db>::new(insert);
        insert.push(LISTED_TEXTS.0).push_bind(Json(labels.tags.clone())).push(LISTED_TEXTS.1);
        insert.push(format!(" AS new, {table} AS labelled WHERE labelled.id = ")).push_bind(id);
        self.execute(insert.build()).await
    }

    /// The members of a pipeline, each once. Another job has none.
    pub async fn member_ids(&mut self, pipeline: JobId) -> Result<Vec<JobId>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT DISTINCT job FROM pipeline_member WHERE pipeline = $1 ORDER BY job",
        )
        .bind(pipeline)
        .fetch_all(self.connection())
        .await
    }
}
