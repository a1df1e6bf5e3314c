//! The tables that move. Their columns are read from the database, so a new column cannot be
//! forgotten.

use std::collections::BTreeMap;

use super::rows::{DatabaseColumn, Kind, Table};
use crate::StoreError;
use crate::database::FoundColumn;

/// The tables that move. Each comes after those that its rows refer to.
pub(crate) const TABLES: [&str; 39] = [
    "resources",
    "job",
    "job_need",
    "job_input",
    "pipeline_member",
    "task",
    "attempt",
    "attempt_log",
    "purged_attempts",
    "idempotency_key",
    "run",
    "metric",
    "metric_latest",
    "metric_extremes",
    "artifact",
    "dataset",
    "shard",
    "shard_file",
    "checkpoint",
    "checkpoint_file",
    "job_tag",
    "run_tag",
    "dataset_tag",
    "checkpoint_tag",
    "checkpoint_alias",
    "upload",
    "robot",
    "worker",
    "queue",
    "token",
    "audit",
    "tracked_experiment",
    "tracked_experiment_tag",
    "tracked_run",
    "tracked_param",
    "tracked_tag",
    "tracked_metric",
    "tracked_metric_latest",
    "tracked_artifact",
];

/// Those of [`TABLES`] that may have rows in a store without jobs.
const NEVER_EMPTY: [&str; 4] = ["resources", "worker", "queue", "tracked_experiment"];

/// The tables that have no rows in a store that was never used.
pub(crate) fn content_tables() -> Vec<&'static str> {
    TABLES.into_iter().filter(|name| !NEVER_EMPTY.contains(name)).collect()
}

/// The rows of a table, as in `3 jobs`.
pub(crate) fn in_words(table: &str, rows: u64) -> String {
    let plural = if rows == 1 { "" } else { "s" };
    format!("{rows} {}{plural}", table.replace('_', " "))
}

/// Tables about the database itself, which do not move: the store's identity, the last write, the
/// server started last, open sessions, the engine's view of workers, and events.
const STAYING: [&str; 7] = ["store", "probe", "server", "session", "engine", "placement", "event"];

/// The tables that move, with the columns that they have in a database.
///
/// # Errors
/// [`StoreError::UnknownTable`] when there is a table or a type of column that is not listed here.
pub(super) fn tables(found: Vec<FoundColumn>, place: &str) -> Result<Vec<Table>, StoreError> {
    let unknown = |table: &str, column: &str| {
        let column = if column.is_empty() { String::new() } else { format!(".{column}") };
        StoreError::UnknownTable { place: place.to_owned(), what: format!("{table}{column}") }
    };
    let mut by_table: BTreeMap<String, Vec<DatabaseColumn>> = BTreeMap::new();
    for FoundColumn { table, name, type_name } in found {
        let kind = Kind::of_type(&type_name).ok_or_else(|| unknown(&table, &name))?;
        by_table.entry(table).or_default().push(DatabaseColumn { name, kind });
    }
    let mut tables = Vec::new();
    for name in TABLES {
        let mut columns = by_table.remove(name).ok_or_else(|| unknown(name, ""))?;
        columns.sort_by(|a, b| a.name.cmp(&b.name));
        tables.push(Table { name, columns });
    }
    match by_table.keys().find(|table| !STAYING.contains(&table.as_str())) {
        Some(table) => Err(unknown(table, "")),
        None => Ok(tables),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(tables: &[&str], type_name: &str) -> Vec<FoundColumn> {
        let column = |table: &&str| FoundColumn {
            table: (*table).to_owned(),
            name: "id".to_owned(),
            type_name: type_name.to_owned(),
        };
        tables.iter().map(column).collect()
    }

    #[test]
    fn a_table_that_nobody_thought_of_is_refused() {
        let known = found(&[&TABLES[..], &STAYING].concat(), "INTEGER");
        assert_eq!(tables(known.clone(), "here").unwrap().len(), TABLES.len());
        let more = [known, found(&["log"], "TEXT")].concat();
        let error = tables(more, "here").unwrap_err().to_string();
        assert_eq!(error, "here has log, which this torqued cannot move");
        let error = tables(found(&TABLES, "BLOB"), "here").unwrap_err().to_string();
        assert_eq!(error, "here has resources.id, which this torqued cannot move");
        assert!(tables(found(&TABLES[1..], "TEXT"), "here").is_err());
    }
}
