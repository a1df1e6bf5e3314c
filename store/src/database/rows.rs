//! Values of several columns, and of columns with a form of their own.

use spec::{Execution, Moment, Resources};

use super::query::{FromRow, Row};
use crate::{Deletion, StoreError, StoredObject, Timestamp};

/// Reads the columns `deleted_at`, `purge_at`, `purged_at` and `deletion_reason`.
pub(crate) fn deletion(row: &Row) -> Result<Option<Deletion>, StoreError> {
    let deleted_at: Option<Timestamp> = row.get("deleted_at")?;
    let Some(deleted_at) = deleted_at else { return Ok(None) };
    let purge_at: Option<Timestamp> = row.get("purge_at")?;
    Ok(Some(Deletion {
        deleted_at,
        purge_at: purge_at.unwrap_or(deleted_at),
        purged_at: row.get("purged_at")?,
        reason: row.get("deletion_reason")?,
    }))
}

/// Reads the columns `cpus`, `gpus`, `memory_mb` and `tags`, where 0 means unspecified.
pub(crate) fn resources(row: &Row) -> Result<Resources, StoreError> {
    let cpus: u32 = row.get("cpus")?;
    Ok(Resources {
        cpus: (cpus > 0).then_some(cpus),
        gpus: row.get("gpus")?,
        memory_gb: Resources::gigabytes(row.get("memory_mb")?),
        tags: row.json("tags")?,
    })
}

/// Reads the columns of a job, with those of its resources.
impl FromRow for Execution {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        Ok(Self {
            priority: row.get("priority")?,
            max_attempts: row.get("max_attempts")?,
            time_limit_s: row.get("time_limit_s")?,
            resources: resources(row)?,
            not_before: moment(row, "not_before")?,
        })
    }
}

/// Names as a sorted JSON list.
pub(crate) fn text_of_tags<T: serde::Serialize>(tags: &T) -> String {
    serde_json::json!(tags).to_string()
}

/// Reads tags, sorted, from a column of the fragment `tags`.
pub(crate) fn tags(row: &Row, column: &str) -> Result<Vec<String>, StoreError> {
    let text: Option<String> = row.get(column)?;
    let mut tags: Vec<String> = if text.is_some() { row.json(column)? } else { Vec::new() };
    tags.sort_unstable();
    Ok(tags)
}

/// Reads a moment from a column where 0 means none.
pub(crate) fn moment(row: &Row, column: &str) -> Result<Option<Moment>, StoreError> {
    let milliseconds: i64 = row.get(column)?;
    Ok((milliseconds > 0).then(|| Moment::from_milliseconds(milliseconds)))
}

/// Reads the columns `path`, `size` and `sha256`.
impl FromRow for StoredObject {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        Ok(Self { path: row.get("path")?, size: row.get("size")?, sha256: row.get("sha256")? })
    }
}
