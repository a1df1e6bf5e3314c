//! The names by which people know items.

use wire::ItemKind;

use crate::database::query::sql;
use crate::{Item, Store, StoreError, boxed};

/// The name of an item of this kind, as an expression in a statement that has its table. `job` is
/// the table of the item's job there, or its alias.
///
/// A job without a name of its own has that which users gave its result, and a checkpoint that of
/// its run and its step.
pub(crate) fn name_of(kind: ItemKind, job: &str) -> String {
    let of_result = |table: &str| {
        format!("(SELECT made.given_name FROM {table} AS made WHERE made.job = {job}.id)")
    };
    match kind {
        ItemKind::Job => format!(
            "COALESCE({job}.given_name, {}, {}, {job}.name)",
            of_result("dataset"),
            of_result("run"),
        ),
        ItemKind::Run | ItemKind::Dataset => {
            format!("COALESCE({kind}.given_name, {job}.given_name, {job}.name)")
        }
        ItemKind::Checkpoint => format!(
            "COALESCE(checkpoint.given_name, COALESCE({}, {job}.given_name, {job}.name) \
             || ', step ' || CAST(checkpoint.step AS TEXT))",
            of_result("run"),
        ),
    }
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
}
