//! Columns of text that hold something else.

use serde_json::Value;
use spec::Digest;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;
use sqlx::types::Text;

use crate::{FileContent, StoredObject};

/// From the column `state`.
pub(super) fn state<S>(row: &SqliteRow) -> Result<S, sqlx::Error>
where
    Text<S>: for<'r> sqlx::Decode<'r, sqlx::Sqlite> + sqlx::Type<sqlx::Sqlite>,
{
    let Text(state) = row.try_get("state")?;
    Ok(state)
}

pub(super) fn digest(row: &SqliteRow, column: &str) -> Result<Digest, sqlx::Error> {
    let text: &str = row.try_get(column)?;
    text.parse().map_err(|error: spec::ParseDigestError| undecodable(column, error.into()))
}

pub(super) fn json(row: &SqliteRow, column: &str) -> Result<Value, sqlx::Error> {
    let text: &str = row.try_get(column)?;
    serde_json::from_str(text).map_err(|error| undecodable(column, error.into()))
}

/// From the column `content`.
pub(super) fn file_content(row: &SqliteRow) -> Result<FileContent, sqlx::Error> {
    let text: &str = row.try_get("content")?;
    FileContent::ALL
        .into_iter()
        .find(|content| content.as_str() == text)
        .ok_or_else(|| undecodable("content", format!("there is no content {text:?}").into()))
}

/// From the columns `path`, `size` and `sha256`.
pub(super) fn stored_object(row: &SqliteRow) -> Result<StoredObject, sqlx::Error> {
    Ok(StoredObject {
        path: row.try_get("path")?,
        size: row.try_get("size")?,
        sha256: digest(row, "sha256")?,
    })
}

fn undecodable(column: &str, source: sqlx::error::BoxDynError) -> sqlx::Error {
    sqlx::Error::ColumnDecode { index: column.to_owned(), source }
}
