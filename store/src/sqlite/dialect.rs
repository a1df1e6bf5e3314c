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

/// The SQL before and after such a parameter.
pub(super) const LISTED_IDS: (&str, &str) = ("(SELECT value FROM json_each(", "))");

/// The texts of a parameter that is a list of them in JSON.
macro_rules! listed_texts {
    ($parameter:literal) => {
        concat!("(SELECT value FROM json_each(", $parameter, "))")
    };
}

/// The SQL before and after such a parameter.
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

/// 32 hexadecimal digits that nothing else has.
macro_rules! unique_digits {
    () => {
        "lower(hex(randomblob(16)))"
    };
}

/// The tags in a table of them, as JSON: those of the thing whose id is given.
macro_rules! tags_of {
    ($table:literal, $thing:literal, $id:literal) => {
        concat!(
            "(SELECT json_group_array(tag) FROM ",
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
        "abs(random() % 251)"
    };
}

/// Keeps the rows as they were read until the transaction ends: nobody else writes meanwhile.
macro_rules! locked {
    () => {
        ""
    };
}

/// Two statements that change rows of different tables, as one.
macro_rules! together {
    ($first:expr, $second:expr) => {
        concat!($first, "; ", $second)
    };
}

/// The larger of two numbers.
macro_rules! larger {
    ($a:expr, $b:expr) => {
        concat!("MAX(", $a, ", ", $b, ")")
    };
}

/// The first task in line of those that a worker could take, none if it is drained: its name is `$1`, and its offer
/// are `$2` to `$5`. The first of each combination of resources is at the beginning of the index, however many wait.
pub(super) fn first_in_line(may_be_claimed: &str, locked: &str) -> String {
    format!(
        "SELECT first.* FROM resources AS asked JOIN task AS first ON first.id = \
             (SELECT id FROM task WHERE resources = asked.id AND {may_be_claimed} \
              ORDER BY turn, id LIMIT 1{locked}) \
         WHERE asked.cpus <= $2 AND asked.gpus <= $3 AND asked.memory_mb <= $4 \
         AND NOT EXISTS (SELECT 1 FROM json_each(asked.tags) AS tag \
             WHERE tag.value NOT IN (SELECT value FROM json_each($5))) \
         AND NOT EXISTS (SELECT 1 FROM worker WHERE name = $1 AND drained_at IS NOT NULL) \
         ORDER BY first.turn, first.id LIMIT 1"
    )
}

/// The function that says where a text begins in another, counting from 1; 0 for nowhere.
pub(super) const FIND: &str = "instr";

/// Behind a text, has it compared by its bytes.
pub(super) const BY_BYTES: &str = "";

/// The condition of the partial indexes of experiments, word for word.
pub(super) const IS_EXPERIMENT: &str = "job.is_part = 0";
