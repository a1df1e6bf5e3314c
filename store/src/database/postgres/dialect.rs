//! SQL fragments in PostgreSQL's dialect.

use sqlx::Postgres;
use sqlx::postgres::PgRow;

pub(super) type Db = Postgres;
pub(super) type DbRow = PgRow;

/// The current time by the database's clock, in milliseconds since 1970. It advances within a
/// transaction.
macro_rules! now {
    () => {
        "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT)"
    };
}

/// The ids of a parameter that is a JSON list of ids.
macro_rules! listed_ids {
    ($parameter:literal) => {
        concat!("(SELECT CAST(value AS BIGINT) FROM jsonb_array_elements_text(", $parameter, "))")
    };
}

/// The SQL before and after such a parameter.
pub(super) const LISTED_IDS: (&str, &str) =
    ("(SELECT CAST(value AS BIGINT) FROM jsonb_array_elements_text(", "))");

/// The texts of a parameter that is a JSON list of texts.
macro_rules! listed_texts {
    ($parameter:literal) => {
        concat!("(SELECT value FROM jsonb_array_elements_text(", $parameter, "))")
    };
}

/// The SQL before and after such a parameter.
pub(super) const LISTED_TEXTS: (&str, &str) =
    ("(SELECT value FROM jsonb_array_elements_text(", "))");

/// The lists of a parameter that is a JSON list of lists, as rows of `item` with their position
/// `key`.
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

/// A field of a JSON column, as text; `NULL` if there is none.
macro_rules! field {
    ($column:literal, $parameter:literal) => {
        concat!("(CAST(", $column, " AS json) ->> ", $parameter, ")")
    };
}

/// The number at a path of names and indexes in a JSON column; `NULL` if there is none.
pub(super) fn number_in(column: &str, path: &[&str]) -> String {
    let steps = path.join(",");
    format!("CAST(CAST({column} AS json) #>> '{{{steps}}}' AS DOUBLE PRECISION)")
}

/// 32 hexadecimal digits that are unique.
macro_rules! unique_digits {
    () => {
        "replace(CAST(gen_random_uuid() AS TEXT), '-', '')"
    };
}

/// The tags of the thing with this id, from a table of tags, as JSON; `NULL` if it has none.
macro_rules! tags_of {
    ($table:literal, $thing:literal, $id:literal) => {
        concat!(
            "(SELECT CAST(json_agg(tag) AS TEXT) FROM ",
            $table,
            " WHERE ",
            $table,
            ".",
            $thing,
            " = ",
            $id,
            ")"
        )
    };
}

/// A random integer from 0 to 250.
macro_rules! chance {
    () => {
        "CAST(floor(random() * 251) AS BIGINT)"
    };
}

/// Locks the rows that were read until the transaction ends. Waits if another transaction has
/// locked them.
macro_rules! locked {
    () => {
        " FOR NO KEY UPDATE"
    };
}

/// Combines two statements that change rows of different tables into one.
macro_rules! together {
    ($first:expr, $second:expr) => {
        concat!("WITH first AS (", $first, ") ", $second)
    };
}

/// The larger of two numbers.
macro_rules! larger {
    ($a:expr, $b:expr) => {
        concat!("GREATEST(", $a, ", ", $b, ")")
    };
}

/// The first task in line that a worker could take; none if it is drained. The worker's name is
/// `$1`, and its offer is `$2` to `$5`. The first task of each combination of resources is at the
/// beginning of the index, however many wait.
pub(super) fn first_in_line(may_be_claimed: &str, locked: &str) -> String {
    format!(
        "SELECT first.* FROM resources AS asked CROSS JOIN LATERAL \
             (SELECT * FROM task WHERE resources = asked.id AND {may_be_claimed} \
              ORDER BY turn, id LIMIT 1{locked}) AS first \
         WHERE asked.cpus <= $2 AND asked.gpus <= $3 AND asked.memory_mb <= $4 \
         AND NOT EXISTS (SELECT 1 FROM jsonb_array_elements_text(CAST(asked.tags AS jsonb)) AS tag (name) \
             WHERE tag.name NOT IN (SELECT value FROM jsonb_array_elements_text(CAST($5 AS jsonb)))) \
         AND NOT EXISTS (SELECT 1 FROM worker WHERE name = $1 AND drained_at IS NOT NULL) \
         ORDER BY first.turn, first.id LIMIT 1"
    )
}

/// The function that returns the position of a text in another, counting from 1; 0 if it is not
/// there.
pub(super) const FIND: &str = "strpos";

/// Placed after a text, it makes comparisons go by bytes.
pub(super) const BY_BYTES: &str = " COLLATE \"C\"";

/// The condition of the partial indexes of experiments. It must be the same, word for word.
pub(super) const IS_EXPERIMENT: &str = "NOT job.is_part";
