//! Fragments of SQL in SQLite's dialect, and the types of its parameters.

use sqlx::error::BoxDynError;
use sqlx::query::Query as Prepared;
use sqlx::sqlite::SqliteArguments;
use sqlx::{Arguments, Sqlite};

use crate::database::column::Parameter;
use crate::database::query::Query;
use crate::queue::statements::line::may_be_claimed;

const NOW: &str = "CAST(unixepoch('subsec') * 1000 AS INTEGER)";

/// A fragment of the list in [`crate::database`].
pub(super) fn fragment(words: &[&str]) -> Option<String> {
    Some(match words {
        ["now"] => NOW.to_owned(),
        ["ids" | "texts", list] => format!("(SELECT value FROM json_each({list}))"),
        ["items", list] => format!("json_each({list}) AS item"),
        ["integer" | "text", index] => format!("item.value ->> {index}"),
        ["field", column, name] => format!("CAST({column} ->> {name} AS TEXT)"),
        ["number", column, path @ ..] => {
            let steps = path.iter().map(|step| match step.parse::<usize>() {
                Ok(index) => format!("[{index}]"),
                Err(_) => format!(".\"{step}\""),
            });
            format!("CAST({column} ->> '${}' AS REAL)", steps.collect::<String>())
        }
        ["tags", table, item, id] => {
            format!("(SELECT json_group_array(tag) FROM {table} WHERE {table}.{item} = {id})")
        }
        ["aliases", id] => {
            format!(
                "(SELECT json_group_array(alias) FROM checkpoint_alias WHERE checkpoint_alias.checkpoint = {id})"
            )
        }
        ["unique"] => "lower(hex(randomblob(16)))".to_owned(),
        ["chance"] => "abs(random() % 251)".to_owned(),
        ["larger"] => "MAX".to_owned(),
        ["find"] => "instr".to_owned(),
        ["is_experiment"] => "job.is_part = 0".to_owned(),
        // Nobody else writes meanwhile. Texts are compared by bytes.
        ["locked" | "by_bytes" | "both" | "end"] => String::new(),
        ["and"] => ";".to_owned(),
        ["first_in_line"] => first_in_line(),
        _ => return None,
    })
}

/// The first task of each combination of resources is at the beginning of the index, however many
/// wait.
fn first_in_line() -> String {
    format!(
        "SELECT first.* FROM resources AS asked JOIN task AS first ON first.id = (SELECT id \
         FROM task WHERE resources = asked.id AND {} ORDER BY turn, id LIMIT 1) \
         WHERE asked.cpus <= $2 AND asked.gpus <= $3 AND asked.memory_mb <= $4 AND NOT EXISTS \
         (SELECT 1 FROM json_each(asked.tags) AS tag WHERE tag.value NOT IN (SELECT value \
         FROM json_each($5))) AND NOT EXISTS (SELECT 1 FROM worker WHERE name = $1 \
         AND drained_at IS NOT NULL) ORDER BY first.turn, first.id LIMIT 1",
        may_be_claimed(NOW)
    )
}

impl Query {
    /// The query as SQLite's driver takes it.
    pub(super) fn for_sqlite(
        mut self,
    ) -> Result<Prepared<'static, Sqlite, SqliteArguments>, sqlx::Error> {
        self.forget_numbers();
        let mut arguments = SqliteArguments::default();
        for parameter in std::mem::take(&mut self.parameters) {
            add(&mut arguments, parameter).map_err(sqlx::Error::Encode)?;
        }
        let prepared = sqlx::query_with(self.text(fragment), arguments);
        Ok(prepared.persistent(self.persistent))
    }
}

fn add(arguments: &mut SqliteArguments, parameter: Parameter) -> Result<(), BoxDynError> {
    match parameter {
        Parameter::Integer(value) => Arguments::add(arguments, value),
        Parameter::Truth(value) => Arguments::add(arguments, value),
        Parameter::Real(value) => Arguments::add(arguments, value),
        Parameter::Text(value) | Parameter::Json(value) => Arguments::add(arguments, value),
    }
}
