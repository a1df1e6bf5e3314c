//! SQL fragments in SQLite's dialect.

use sqlx::Sqlite;
use sqlx::sqlite::SqliteRow;

pub(super) type Db = Sqlite;
pub(super) type DbRow = SqliteRow;

/// The current time by the database's clock, in milliseconds since 1970.
macro_rules! now {
    () => {
        "CAST(unixepoch('subsec') * 1000 AS INTEGER)"
    };
}

/// The ids of a parameter that is a JSON list of ids.
macro_rules! listed_ids {
    ($parameter:literal) => {
        concat!("(SELECT value FROM json_each(", $parameter, "))")
    };
}

/// The SQL before and after such a parameter.
pub(super) const LISTED_IDS: (&str, &str) = ("(SELECT value FROM json_each(", "))");

/// The texts of a parameter that is a JSON list of texts.
macro_rules! listed_texts {
    ($parameter:literal) => {
        concat!("(SELECT value FROM json_each(", $parameter, "))")
    };
}

/// The SQL before and after such a parameter.
pub(super) const LISTED_TEXTS: (&str, &str) = LISTED_IDS;

/// The lists of a parameter that is a JSON list of lists, as rows of `item` with their position
/// `key`.
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

/// A field of a JSON column, as text; `NULL` if there is none.
macro_rules! field {
    ($column:literal, $parameter:literal) => {
        concat!("CAST(", $column, " ->> ", $parameter, " AS TEXT)")
    };
}

/// The number at a path of names and indexes in a JSON column; `NULL` if there is none.
pub(super) fn number_in(column: &str, path: &[&str]) -> String {
    let steps = path.iter().map(|step| match step.parse::<usize>() {
        Ok(index) => format!("[{index}]"),
        Err(_) => format!(".\"{step}\""),
    });
    format!("CAST({column} ->> '${}' AS REAL)", steps.collect::<String>())
}

/// 32 hexadecimal digits that are unique.
macro_rules! unique_digits {
    () => {
        "lower(hex(randomblob(16)))"
    };
}

/// The tags of the thing with this id, from a table of tags, as JSON.
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

/// A random integer from 0 to 250.
macro_rules! chance {
    () => {
        "abs(random() % 251)"
    };
}

/// Locks the rows that were read until the transaction ends. SQLite needs nothing for it, because
/// nobody else writes meanwhile.
macro_rules! locked {
    () => {
        ""
    };
}

/// Combines two statements that change rows of different tables into one.
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

/// The first task in line that a worker could take; none if it is drained. The worker's name is
/// `$1`, and its offer is `$2` to `$5`. The first task of each combination of resources is at the
/// beginning of the index, however many wait.
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

/// The function that returns the position of a text in another, counting from 1; 0 if it is not
/// there.
pub(super) const FIND: &str = "instr";

/// Placed after a text, it makes comparisons go by bytes.
pub(super) const BY_BYTES: &str = "";

/// The condition of the partial indexes of experiments. It must be the same, word for word.
pub(super) const IS_EXPERIMENT: &str = "job.is_part = 0";
