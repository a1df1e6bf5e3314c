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

/// The SQL before and after such a parameter.
pub(super) const LISTED_IDS: (&str, &str) =
    ("(SELECT CAST(value AS BIGINT) FROM jsonb_array_elements_text(", "))");

/// The texts of a parameter that is a list of them in JSON.
macro_rules! listed_texts {
    ($parameter:literal) => {
        concat!("(SELECT value FROM jsonb_array_elements_text(", $parameter, "))")
    };
}

/// The SQL before and after such a parameter.
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

/// 32 hexadecimal digits that nothing else has.
macro_rules! unique_digits {
    () => {
        "replace(CAST(gen_random_uuid() AS TEXT), '-', '')"
    };
}

/// The tags in a table of them, as JSON: those of the thing whose id is given; `NULL` for none.
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

/// Two statements that change rows of different tables, as one.
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

/// The first task in line of those that a worker could take, none if it is drained: its name is `$1`, and its offer
/// are `$2` to `$5`. The first of each combination of resources is at the beginning of the index, however many wait.
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

/// The function that says where a text begins in another, counting from 1; 0 for nowhere.
pub(super) const FIND: &str = "strpos";

/// Behind a text, has it compared by its bytes.
pub(super) const BY_BYTES: &str = " COLLATE \"C\"";

/// The condition of the partial indexes of experiments, word for word.
pub(super) const IS_EXPERIMENT: &str = "NOT job.is_part";
