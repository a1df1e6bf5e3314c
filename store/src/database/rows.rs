//! Values of other types in columns of text.

use serde::de::DeserializeOwned;
use spec::{Digest, Moment, Resources};
use sqlx::Row;
use sqlx::types::Text;

use super::{Db, DbRow};
use crate::{Deletion, FileContent, StoredObject, Timestamp};

/// Reads a state from the column `state`.
pub(super) fn state<S>(row: &DbRow) -> Result<S, sqlx::Error>
where
    Text<S>: for<'r> sqlx::Decode<'r, Db> + sqlx::Type<Db>,
{
    let Text(state) = row.try_get("state")?;
    Ok(state)
}

/// Reads an enum from a column with one of a few words.
pub(super) fn word<W>(row: &DbRow, column: &str) -> Result<W, sqlx::Error>
where
    Text<W>: for<'r> sqlx::Decode<'r, Db> + sqlx::Type<Db>,
{
    let Text(word) = row.try_get(column)?;
    Ok(word)
}

/// Reads the columns `deleted_at`, `purge_at`, `purged_at` and `deletion_reason`.
pub(super) fn deletion(row: &DbRow) -> Result<Option<Deletion>, sqlx::Error> {
    let deleted_at: Option<Timestamp> = row.try_get("deleted_at")?;
    let Some(deleted_at) = deleted_at else { return Ok(None) };
    let purge_at: Option<Timestamp> = row.try_get("purge_at")?;
    Ok(Some(Deletion {
        deleted_at,
        purge_at: purge_at.unwrap_or(deleted_at),
        purged_at: row.try_get("purged_at")?,
        reason: row.try_get("deletion_reason")?,
    }))
}

pub(super) fn digest(row: &DbRow, column: &str) -> Result<Digest, sqlx::Error> {
    let text: &str = row.try_get(column)?;
    text.parse().map_err(|error: spec::ParseDigestError| undecodable(column, error.into()))
}

pub(super) fn json<T: DeserializeOwned>(row: &DbRow, column: &str) -> Result<T, sqlx::Error> {
    let text: &str = row.try_get(column)?;
    serde_json::from_str(text).map_err(|error| undecodable(column, error.into()))
}

/// Reads the columns `cpus`, `gpus`, `memory_mb` and `tags`, where 0 means unspecified.
pub(super) fn resources(row: &DbRow) -> Result<Resources, sqlx::Error> {
    let cpus: u32 = number(row, "cpus")?;
    let tags: &str = row.try_get("tags")?;
    Ok(Resources {
        cpus: (cpus > 0).then_some(cpus),
        gpus: number(row, "gpus")?,
        memory_gb: Resources::gigabytes(number(row, "memory_mb")?),
        tags: serde_json::from_str(tags).map_err(|error| undecodable("tags", error.into()))?,
    })
}

/// Names as a sorted JSON list.
pub fn text_of_tags<T: serde::Serialize>(tags: &T) -> String {
    serde_json::json!(tags).to_string()
}

/// Reads tags, sorted, from a column of `tags_of!`.
pub(super) fn tags(row: &DbRow, column: &str) -> Result<Vec<String>, sqlx::Error> {
    let text: Option<&str> = row.try_get(column)?;
    let tags: Result<Vec<String>, _> = text.map_or(Ok(Vec::new()), serde_json::from_str);
    let mut tags = tags.map_err(|error| undecodable(column, error.into()))?;
    tags.sort_unstable();
    Ok(tags)
}

/// Reads a moment from a column where 0 means none.
pub(super) fn moment(row: &DbRow, column: &str) -> Result<Option<Moment>, sqlx::Error> {
    let milliseconds: i64 = row.try_get(column)?;
    Ok((milliseconds > 0).then(|| Moment::from_milliseconds(milliseconds)))
}

/// Reads the column `content`.
pub(super) fn file_content(row: &DbRow) -> Result<FileContent, sqlx::Error> {
    let text: &str = row.try_get("content")?;
    FileContent::ALL
        .into_iter()
        .find(|content| content.as_str() == text)
        .ok_or_else(|| undecodable("content", format!("there is no content {text:?}").into()))
}

/// Reads the columns `path`, `size` and `sha256`.
pub(super) fn stored_object(row: &DbRow) -> Result<StoredObject, sqlx::Error> {
    Ok(StoredObject {
        path: row.try_get("path")?,
        size: number(row, "size")?,
        sha256: digest(row, "sha256")?,
    })
}

/// Reads a count. Every database stores it as a signed integer of 64 bits.
pub(super) fn number<N>(row: &DbRow, column: &str) -> Result<N, sqlx::Error>
where
    N: TryFrom<i64>,
    N::Error: std::error::Error + Send + Sync + 'static,
{
    let integer: i64 = row.try_get(column)?;
    N::try_from(integer).map_err(|error| undecodable(column, error.into()))
}

/// Reads a count from a column that may be `NULL`.
pub(super) fn optional_number<N>(row: &DbRow, column: &str) -> Result<Option<N>, sqlx::Error>
where
    N: TryFrom<i64>,
    N::Error: std::error::Error + Send + Sync + 'static,
{
    let integer: Option<i64> = row.try_get(column)?;
    integer.map(N::try_from).transpose().map_err(|error| undecodable(column, error.into()))
}

fn undecodable(column: &str, source: sqlx::error::BoxDynError) -> sqlx::Error {
    sqlx::Error::ColumnDecode { index: column.to_owned(), source }
}
