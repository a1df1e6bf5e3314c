//! The SQL that SQLite has in its own way.

use sqlx::Sqlite;
use sqlx::sqlite::SqliteRow;

pub(super) type Db = Sqlite;
pub(super) type DbRow = SqliteRow;

/// The present by the database's clock, in milliseconds since 1970.
macro_rules! now {
    () => {
        "CAST(unixepoch('subsec') * 1000 AS INTEGER)"
    };
}

/// The ids of a parameter that is a list of them in JSON.
macro_rules! listed_ids {
    ($parameter:literal) => {
        concat!("(SELECT value FROM json_each(", $parameter, "))")
    };
}

/// What stands before and after such a parameter.
pub(super) const LISTED_IDS: (&str, &str) = ("(SELECT value FROM json_each(", "))");

/// The texts of a parameter that is a list of them in JSON.
macro_rules! listed_texts {
    ($parameter:literal) => {
        concat!("(SELECT value FROM json_each(", $parameter, "))")
    };
}

/// What stands before and after such a parameter.
pub(super) const LISTED_TEXTS: (&str, &str) = LISTED_IDS;

/// The lists in a parameter that is a list of lists in JSON, as rows of `item` with their place `key`.
macro_rules! items {
    ($parameter:literal) => {
        concat!("json_each(", $parameter, ") AS item")
    };
}

/// An element of an `item`.
macro_rules! item {
    ($kind:ident $index:literal) => {
        concat!("item.value ->> ", $index)
    };
}

/// A field of a column with JSON, as text; `NULL` if there is none.
macro_rules! field {
    ($column:literal, $parameter:literal) => {
        concat!("CAST(", $column, " ->> ", $parameter, " AS TEXT)")
    };
}

/// A number from 0 to 250 by chance.
macro_rules! chance {
    () => {
        "abs(random() % 251)"
    };
}

/// Keeps the rows as they were read until the transaction ends: nobody else writes meanwhile.
macro_rules! locked {
    () => {
        ""
    };
}

pub(super) const TASK_LOCKED_OR_SKIPPED: &str = "";

/// What the partial indexes of experiments say, word for word.
pub(super) const IS_EXPERIMENT: &str = "job.is_part = 0";
