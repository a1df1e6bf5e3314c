//! An inventory of a store, to check that everything its rows name exists.

use futures::TryStreamExt;

use crate::database::Reading;
use crate::database::query::sql;
use crate::transfer::statements::select_objects;
use crate::transfer::tables::in_words;
use crate::{Store, StoreError, StoredObject, boxed};

/// The tables whose rows name objects.
const TABLES: [&str; 5] =
    ["shard_file", "artifact", "checkpoint_file", "upload", "tracked_artifact"];

/// Number of objects read at once.
const PAGE: i64 = 500;

/// A position among all objects that rows name. The next page begins there.
#[derive(Clone, Debug, Default)]
pub struct ObjectPlace {
    table: usize,
    path: String,
}

impl Store {
    /// The next objects that rows name; empty after the last.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn next_objects(
        &self,
        place: &mut ObjectPlace,
    ) -> Result<Vec<StoredObject>, StoreError> {
        while let Some(table) = TABLES.get(place.table) {
            let path = place.path.as_str();
            let operation = "listing objects";
            let objects = self.read(operation).objects_named_by(table, path, PAGE).await?;
            if let Some(last) = objects.last() {
                place.path.clone_from(&last.path);
                return Ok(objects);
            }
            *place = ObjectPlace { table: place.table + 1, path: String::new() };
        }
        Ok(Vec::new())
    }

    /// Reads an object to its end and compares its digest.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when its bytes differ from those that were published. It also
    /// fails when the object does not exist.
    #[boxed]
    pub async fn check_object(&self, object: &StoredObject) -> Result<(), StoreError> {
        let mut bytes = self.open_object(object, None).await?.stream;
        while bytes.try_next().await?.is_some() {}
        Ok(())
    }

    /// Damage inside the database, if there is any. PostgreSQL checks its own files.
    ///
    /// # Errors
    /// When the database cannot be read.
    #[boxed]
    pub async fn database_damage(&self) -> Result<Option<String>, StoreError> {
        let damage = self.database().damage().await;
        damage.map_err(StoreError::database("looking for damage"))
    }
}

impl Reading<'_> {
    /// The objects that a table names, sorted by path, beginning after `path`.
    pub async fn objects_named_by(
        &mut self,
        table: &str,
        path: &str,
        limit: i64,
    ) -> Result<Vec<StoredObject>, StoreError> {
        select_objects(table, path, limit).all(self).await
    }

    /// The number of rows of the first of these tables that has any, in words.
    pub async fn first_content(&mut self, tables: &[&str]) -> Result<Option<String>, StoreError> {
        for table in tables {
            let count: i64 = sql(format!("SELECT COUNT(*) FROM {table}")).one(self).await?;
            if count > 0 {
                return Ok(Some(in_words(table, count.unsigned_abs())));
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_with_objects_is_listed() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../migrations/sqlite");
        let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
        let schema: String = files.map(|file| std::fs::read_to_string(file).unwrap()).collect();
        let tables = schema
            .split("CREATE TABLE ")
            .skip(1)
            .filter(|table| table.lines().any(|line| line.trim_start().starts_with("path ")));
        let mut found: Vec<&str> =
            tables.filter_map(|table| table.split_whitespace().next()).collect();
        found.sort_unstable();
        let mut listed = TABLES.to_vec();
        listed.sort_unstable();
        assert_eq!(listed, found);
    }
}
