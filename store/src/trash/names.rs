//! The names by which people know items.

use spec::Digest;
use wire::ItemKind;

use crate::database::column::json;
use crate::database::query::sql;
use crate::{Item, JobId, Store, StoreError, boxed};

/// The name of an item of this kind, as an expression in a statement that has its table. `job` is
/// the table of the item's job there, or its alias.
///
/// A run or a dataset without a name of its own has that of its job, and a checkpoint that of its
/// run and its step. A job keeps its name whatever its results are called.
pub(crate) fn name_of(kind: ItemKind, job: &str) -> String {
    match kind {
        ItemKind::Job => format!("COALESCE({job}.given_name, {job}.name)"),
        ItemKind::Run | ItemKind::Dataset => {
            format!("COALESCE({kind}.given_name, {job}.given_name, {job}.name)")
        }
        ItemKind::Checkpoint => format!(
            "COALESCE(checkpoint.given_name, COALESCE({}, {job}.given_name, {job}.name) \
             || ', step ' || CAST(checkpoint.step AS TEXT))",
            given_to("run", job),
        ),
    }
}

/// The name that users gave the result of a job; `NULL` without one.
pub(crate) fn given_to_result(job: &str) -> String {
    format!("COALESCE({}, {})", given_to("dataset", job), given_to("run", job))
}

/// The name of the result of a job, or of the job if it has none.
fn name_of_result(job: &str) -> String {
    format!("COALESCE({}, {})", given_to_result(job), name_of(ItemKind::Job, job))
}

fn given_to(table: &str, job: &str) -> String {
    format!("(SELECT made.given_name FROM {table} AS made WHERE made.job = {job}.id)")
}

impl Store {
    /// The name by which people know an item, also one in the trash.
    ///
    /// # Errors
    /// When there is no such item.
    #[boxed]
    pub async fn name_of(&self, item: Item) -> Result<String, StoreError> {
        let Item { kind, id } = item;
        let from = match kind {
            ItemKind::Job => "job".to_owned(),
            ItemKind::Run | ItemKind::Dataset | ItemKind::Checkpoint => {
                format!("{kind} JOIN job ON job.id = {kind}.job")
            }
        };
        let name = name_of(kind, "job");
        let found = sql(format!("SELECT {name} AS name FROM {from} WHERE {kind}.id = $1"))
            .bind(id)
            .optional(&mut self.read("looking for the name of something"))
            .await?;
        found.ok_or_else(|| StoreError::not_found(kind.as_str(), id.to_string()))
    }

    /// Pairs of a job and the name of its result, which is its own name if nobody named the result.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn result_names(&self, jobs: &[JobId]) -> Result<Vec<(JobId, String)>, StoreError> {
        let name = name_of_result("job");
        sql(format!(
            "SELECT job.id, {name} AS name FROM job WHERE job.id IN {{ids $1}} ORDER BY job.id"
        ))
        .bind(json(&jobs))
        .all(&mut self.read("reading the names of results"))
        .await
    }

    /// Pairs of a digest and the name of the result of its newest job, whether that still exists or
    /// was deleted.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn names_of_digests(
        &self,
        digests: &[Digest],
    ) -> Result<Vec<(Digest, String)>, StoreError> {
        let name = name_of_result("job");
        sql(format!(
            "SELECT job.digest, {name} AS name FROM job WHERE job.id IN (SELECT MAX(id) FROM job \
             WHERE digest IN {{texts $1}} GROUP BY digest) ORDER BY job.digest"
        ))
        .bind(json(&digests))
        .all(&mut self.read("reading the names of digests"))
        .await
    }
}
