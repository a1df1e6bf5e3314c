//! Fragments of SQL in PostgreSQL's dialect, and the types of its parameters.

use sqlx::encode::{Encode, IsNull};
use sqlx::error::BoxDynError;
use sqlx::postgres::{PgArgumentBuffer, PgArguments, PgTypeInfo};
use sqlx::query::Query as Prepared;
use sqlx::{Arguments, Postgres, Type};

use crate::database::column::Parameter;
use crate::database::query::Query;
use crate::queue::statements::line::may_be_claimed;

pub(super) const NOW: &str = "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT)";

/// A fragment of the list in [`crate::database`].
pub(super) fn fragment(words: &[&str]) -> Option<String> {
    Some(match words {
        ["now"] => NOW.to_owned(),
        ["ids", list] => {
            format!("(SELECT CAST(value AS BIGINT) FROM jsonb_array_elements_text({list}))")
        }
        ["texts", list] => format!("(SELECT value FROM jsonb_array_elements_text({list}))"),
        ["items", list] => {
            format!("jsonb_array_elements({list}) WITH ORDINALITY AS item (value, key)")
        }
        ["integer", index] => format!("CAST(item.value ->> {index} AS BIGINT)"),
        ["text", index] => format!("item.value ->> {index}"),
        ["field", column, name] => format!("(CAST({column} AS json) ->> {name})"),
        ["number", column, path @ ..] => {
            let steps = path.join(",");
            format!("CAST(CAST({column} AS json) #>> '{{{steps}}}' AS DOUBLE PRECISION)")
        }
        ["tags", table, item, id] => {
            format!("(SELECT CAST(json_agg(tag) AS TEXT) FROM {table} WHERE {table}.{item} = {id})")
        }
        ["aliases", id] => format!(
            "(SELECT CAST(json_agg(alias) AS TEXT) FROM checkpoint_alias WHERE checkpoint_alias.checkpoint = {id})"
        ),
        ["unique"] => "replace(CAST(gen_random_uuid() AS TEXT), '-', '')".to_owned(),
        ["chance"] => "CAST(floor(random() * 251) AS BIGINT)".to_owned(),
        ["larger"] => "GREATEST".to_owned(),
        ["find"] => "strpos".to_owned(),
        ["by_bytes"] => " COLLATE \"C\"".to_owned(),
        ["is_experiment"] => "NOT job.is_part".to_owned(),
        // Waits if another transaction has locked them.
        ["locked"] => " FOR NO KEY UPDATE".to_owned(),
        ["both"] => "WITH first AS (".to_owned(),
        ["and"] => ")".to_owned(),
        ["end"] => String::new(),
        ["first_in_line"] => first_in_line(""),
        _ => return None,
    })
}

/// The first task of each combination of resources is at the beginning of the index, however many
/// wait. `locked` follows the query of the task.
pub(super) fn first_in_line(locked: &str) -> String {
    format!(
        "SELECT first.* FROM resources AS asked CROSS JOIN LATERAL (SELECT * FROM task \
         WHERE resources = asked.id AND {} ORDER BY turn, id LIMIT 1{locked}) AS first \
         WHERE asked.cpus <= $2 AND asked.gpus <= $3 AND asked.memory_mb <= $4 AND NOT EXISTS \
         (SELECT 1 FROM jsonb_array_elements_text(CAST(asked.tags AS jsonb)) AS tag (name) \
         WHERE tag.name NOT IN (SELECT value FROM jsonb_array_elements_text(CAST($5 AS jsonb)))) \
         AND NOT EXISTS (SELECT 1 FROM worker WHERE name = $1 AND drained_at IS NOT NULL) \
         ORDER BY first.turn, first.id LIMIT 1",
        may_be_claimed(NOW)
    )
}

impl Query {
    /// The query as PostgreSQL's driver takes it.
    pub(super) fn for_postgres(
        mut self,
    ) -> Result<Prepared<'static, Postgres, PgArguments>, sqlx::Error> {
        let mut arguments = PgArguments::default();
        for parameter in std::mem::take(&mut self.parameters) {
            add(&mut arguments, parameter).map_err(sqlx::Error::Encode)?;
        }
        let prepared = sqlx::query_with(self.text(fragment), arguments);
        Ok(prepared.persistent(self.persistent))
    }
}

fn add(arguments: &mut PgArguments, parameter: Parameter) -> Result<(), BoxDynError> {
    match parameter {
        Parameter::Integer(value) => Arguments::add(arguments, value),
        Parameter::Truth(value) => Arguments::add(arguments, value),
        Parameter::Real(value) => Arguments::add(arguments, value),
        Parameter::Text(value) => Arguments::add(arguments, value),
        Parameter::Json(value) => Arguments::add(arguments, value.map(Jsonb)),
    }
}

/// Text that is JSON, as a value of type `jsonb`.
struct Jsonb(String);

impl Type<Postgres> for Jsonb {
    fn type_info() -> PgTypeInfo {
        <serde_json::Value as Type<Postgres>>::type_info()
    }
}

impl Encode<'_, Postgres> for Jsonb {
    fn encode_by_ref(&self, buffer: &mut PgArgumentBuffer) -> Result<IsNull, BoxDynError> {
        /// The version of `jsonb` in the binary format.
        const VERSION: u8 = 1;
        buffer.push(VERSION);
        buffer.extend_from_slice(self.0.as_bytes());
        Ok(IsNull::No)
    }
}
