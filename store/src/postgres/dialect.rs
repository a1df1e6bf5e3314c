//! The SQL that PostgreSQL has in its own way.

use sqlx::Postgres;
use sqlx::postgres::PgRow;

pub(super) type Db = Postgres;
pub(super) type DbRow = PgRow;

/// The present by the database's clock, in milliseconds since 1970; it goes on within a transaction.
macro_rules! now {
    () => {
        "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT)"
    };
}

/// The ids of a parameter that is a list of them in JSON.
macro_rules! listed_ids {
    ($parameter:literal) => {
        concat!("(SELECT CAST(value AS BIGINT) FROM jsonb_array_elements_text(", $parameter, "))")
    };
}

/// What stands before and after such a parameter.
pub(super) const LISTED_IDS: (&str, &str) =
    ("(SELECT CAST(value AS BIGINT) FROM jsonb_array_elements_text(", "))");

/// The texts of a parameter that is a list of them in JSON.
macro_rules! listed_texts {
    ($parameter:literal) => {
        concat!("(SELECT value FROM jsonb_array_elements_text(", $parameter, "))")
    };
}

/// What stands before and after such a parameter.
pub(super) const LISTED_TEXTS: (&str, &str) =
    ("(SELECT value FROM jsonb_array_elements_text(", "))");

/// The lists in a parameter that is a list of lists in JSON, as rows of `item` with their place `key`.
macro_rules! items {
    ($parameter:literal) => {
        concat!("jsonb_array_elements(", $parameter, ") WITH ORDINALITY AS item (value, key)")
    };
}

/// An element of an `item`.
macro_rules! item {
    (integer $index:literal) => {
        concat!("CAST(item.value ->> ", $index, " AS BIGINT)")
    };
    (text $index:literal) => {
        concat!("item.value ->> ", $index)
    };
}

/// A field of a column with JSON, as text; `NULL` if there is none.
macro_rules! field {
    ($column:literal, $parameter:literal) => {
        concat!("(CAST(", $column, " AS json) ->> ", $parameter, ")")
    };
}

/// A number from 0 to 250 by chance.
macro_rules! chance {
    () => {
        "CAST(floor(random() * 251) AS BIGINT)"
    };
}

/// Keeps the rows as they were read until the transaction ends, and waits for who keeps them already.
macro_rules! locked {
    () => {
        " FOR NO KEY UPDATE"
    };
}

/// The same for tasks, passing over those that somebody keeps.
pub(super) const TASK_LOCKED_OR_SKIPPED: &str = " FOR NO KEY UPDATE OF task SKIP LOCKED";

/// What the partial indexes of experiments say, word for word.
pub(super) const IS_EXPERIMENT: &str = "NOT job.is_part";
