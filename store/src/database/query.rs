//! Statements with their parameters, and the rows that answer them, for any database.
//!
//! The text of a statement is SQL that all databases share. Where they differ, it has a fragment in
//! braces, such as `{now}`. The page of the contract ([`crate::database`]) lists all fragments.

use std::borrow::Cow;

use serde::Serialize;
use sqlx::error::BoxDynError;
use sqlx::postgres::PgRow;
use sqlx::sqlite::SqliteRow;
use sqlx::{AssertSqlSafe, ColumnIndex, SqlSafeStr, SqlStr};

use super::column::{Column, IntoParameter, Parameter, json};
use crate::StoreError;

/// A statement and the values of its parameters.
#[derive(Debug)]
pub(crate) struct Query {
    sql: Cow<'static, str>,
    pub(super) parameters: Vec<Parameter>,
    /// Whether a connection keeps the prepared statement.
    pub(super) persistent: bool,
}

/// A statement with numbered parameters (`$1`).
pub(crate) fn sql(sql: impl Into<Cow<'static, str>>) -> Query {
    Query { sql: sql.into(), parameters: Vec::new(), persistent: true }
}

impl Query {
    /// Sets the next parameter.
    pub fn bind(mut self, value: impl IntoParameter) -> Self {
        self.parameters.push(value.into_parameter());
        self
    }

    /// Adds SQL to the statement.
    pub fn push(&mut self, sql: impl AsRef<str>) -> &mut Self {
        self.sql.to_mut().push_str(sql.as_ref());
        self
    }

    /// Adds a parameter to the statement.
    pub fn push_bind(&mut self, value: impl IntoParameter) -> &mut Self {
        self.parameters.push(value.into_parameter());
        let number = self.parameters.len();
        self.push(format!("${number}"))
    }

    /// Adds a set of ids, for `IN`.
    pub fn push_ids(&mut self, ids: &impl Serialize) -> &mut Self {
        self.push("{ids ").push_bind(json(ids)).push("}")
    }

    /// Adds a set of texts, for `IN`.
    pub fn push_texts(&mut self, texts: &impl Serialize) -> &mut Self {
        self.push("{texts ").push_bind(json(texts)).push("}")
    }

    /// Adds `VALUES` and a list of values for each item.
    pub fn push_values<T>(
        &mut self,
        items: impl IntoIterator<Item = T>,
        mut write: impl FnMut(&mut Values<'_>, T),
    ) -> &mut Self {
        let mut before = "VALUES (";
        for item in items {
            self.push(before);
            write(&mut Values { query: self, is_first: true }, item);
            before = "), (";
        }
        self.push(")")
    }

    /// Says whether connections keep the prepared statement. They should forget one that differs
    /// each time.
    pub fn persistent(mut self, persistent: bool) -> Self {
        self.persistent = persistent;
        self
    }

    /// All rows.
    pub async fn rows(self, on: &mut impl Executor) -> Result<Vec<Row>, StoreError> {
        on.fetch(self).await
    }

    /// The first row, if there is one.
    pub async fn optional_row(self, on: &mut impl Executor) -> Result<Option<Row>, StoreError> {
        Ok(on.fetch(self).await?.into_iter().next())
    }

    /// The first row.
    pub async fn row(self, on: &mut impl Executor) -> Result<Row, StoreError> {
        let operation = on.operation();
        let row = self.optional_row(on).await?;
        row.ok_or_else(|| StoreError::database(operation)(sqlx::Error::RowNotFound))
    }

    /// The values of all rows.
    pub async fn all<T: FromRow>(self, on: &mut impl Executor) -> Result<Vec<T>, StoreError> {
        self.rows(on).await?.iter().map(T::from_row).collect()
    }

    /// The value of the first row, if there is one.
    pub async fn optional<T: FromRow>(
        self,
        on: &mut impl Executor,
    ) -> Result<Option<T>, StoreError> {
        self.optional_row(on).await?.as_ref().map(T::from_row).transpose()
    }

    /// The value of the first row.
    pub async fn one<T: FromRow>(self, on: &mut impl Executor) -> Result<T, StoreError> {
        T::from_row(&self.row(on).await?)
    }

    /// Executes a statement that returns no rows.
    pub async fn run(self, on: &mut impl Writer) -> Result<(), StoreError> {
        on.execute(self).await.map(drop)
    }

    /// Executes a statement that returns no rows. Returns how many rows it changed.
    pub async fn changed(self, on: &mut impl Writer) -> Result<u64, StoreError> {
        on.execute(self).await
    }

    /// Replaces the numbers of the parameters by question marks, if there are many. SQLite searches
    /// a list of all numbers for each, so a statement with thousands of rows would take minutes.
    /// Only [`Self::push_values`] makes so many, and their order is that of their numbers.
    pub(super) fn forget_numbers(&mut self) {
        const MANY: usize = 100;
        if self.parameters.len() <= MANY {
            return;
        }
        let mut parts = self.sql.split('$');
        let mut unnumbered = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            unnumbered.push('?');
            unnumbered.push_str(part.trim_start_matches(|digit: char| digit.is_ascii_digit()));
        }
        self.sql = unnumbered.into();
    }

    /// The statement in the SQL of a database, whose fragments `fragment` knows.
    pub(super) fn text(&mut self, fragment: fn(&[&str]) -> Option<String>) -> SqlStr {
        match std::mem::take(&mut self.sql) {
            Cow::Borrowed(sql) if !sql.contains('{') => SqlStr::from_static(sql),
            sql => AssertSqlSafe(translated(&sql, fragment)).into_sql_str(),
        }
    }
}

/// Replaces the fragments in braces. Other braces stay.
fn translated(sql: &str, fragment: fn(&[&str]) -> Option<String>) -> String {
    let mut translated = String::with_capacity(2 * sql.len());
    let mut rest = sql;
    while let Some((before, after)) = rest.split_once('{') {
        translated.push_str(before);
        let (name, after) = after.split_once('}').unwrap_or((after, ""));
        let words: Vec<&str> = name.split(' ').collect();
        match fragment(&words).or_else(|| shared_fragment(&words)) {
            Some(found) => translated.push_str(&found),
            None => translated.extend(["{", name, "}"]),
        }
        rest = after;
    }
    translated.push_str(rest);
    translated
}

/// The fragments that are the same in all databases.
fn shared_fragment(words: &[&str]) -> Option<String> {
    match words {
        ["gone", job] => Some(format!(
            "({job}.deleted_at IS NOT NULL OR EXISTS (SELECT 1 FROM dataset \
             WHERE dataset.job = {job}.id AND dataset.deleted_at IS NOT NULL) OR EXISTS \
             (SELECT 1 FROM run WHERE run.job = {job}.id AND run.deleted_at IS NOT NULL) OR \
             EXISTS (SELECT 1 FROM checkpoint WHERE checkpoint.job = {job}.id \
             AND checkpoint.deleted_at IS NOT NULL AND (checkpoint.is_final \
             OR checkpoint.is_best)))"
        )),
        _ => None,
    }
}

/// One list of values of [`Query::push_values`].
pub(crate) struct Values<'a> {
    query: &'a mut Query,
    is_first: bool,
}

impl Values<'_> {
    /// Adds SQL as a value.
    pub fn push(&mut self, sql: &str) -> &mut Self {
        if !std::mem::replace(&mut self.is_first, false) {
            self.query.push(", ");
        }
        self.query.push(sql);
        self
    }

    /// Adds a parameter as a value.
    pub fn push_bind(&mut self, value: impl IntoParameter) -> &mut Self {
        self.push("");
        self.query.push_bind(value);
        self
    }
}

/// A row that answers a query.
#[derive(Debug)]
pub(crate) struct Row {
    row: DatabaseRow,
    operation: &'static str,
}

#[derive(Debug)]
pub(super) enum DatabaseRow {
    Sqlite(SqliteRow),
    Postgres(PgRow),
}

impl From<SqliteRow> for DatabaseRow {
    fn from(row: SqliteRow) -> Self {
        Self::Sqlite(row)
    }
}

impl From<PgRow> for DatabaseRow {
    fn from(row: PgRow) -> Self {
        Self::Postgres(row)
    }
}

/// The name or the number of a column.
pub(crate) trait Place:
    ColumnIndex<SqliteRow> + ColumnIndex<PgRow> + ToString + Copy
{
}

impl Place for &str {}
impl Place for usize {}

impl Row {
    pub(super) fn new(row: impl Into<DatabaseRow>, operation: &'static str) -> Self {
        Self { row: row.into(), operation }
    }

    /// The value of a column.
    ///
    /// # Errors
    /// When the column is `NULL` or has a value that `T` cannot have.
    pub fn get<T: Column>(&self, at: impl Place) -> Result<T, StoreError> {
        use sqlx::Row as _;
        let found = match &self.row {
            DatabaseRow::Sqlite(row) => row.try_get::<T::Sql, _>(at),
            DatabaseRow::Postgres(row) => row.try_get::<T::Sql, _>(at),
        };
        found
            .and_then(|found| T::from_sql(found).map_err(|source| undecodable(&at, source)))
            .map_err(StoreError::database(self.operation))
    }

    /// The value of a column of JSON.
    ///
    /// # Errors
    /// When it is not the JSON of a `T`.
    pub fn json<T: serde::de::DeserializeOwned>(&self, column: &str) -> Result<T, StoreError> {
        let text: String = self.get(column)?;
        serde_json::from_str(&text).map_err(|error| {
            StoreError::database(self.operation)(undecodable(&column, error.into()))
        })
    }
}

impl Row {
    /// Another row that belongs to this one is missing.
    pub fn incomplete(&self) -> StoreError {
        StoreError::database(self.operation)(sqlx::Error::RowNotFound)
    }
}

fn undecodable(at: &impl ToString, source: BoxDynError) -> sqlx::Error {
    sqlx::Error::ColumnDecode { index: at.to_string(), source }
}

/// A type whose values are rows.
pub(crate) trait FromRow: Sized {
    fn from_row(row: &Row) -> Result<Self, StoreError>;
}

/// The value of a row's only column.
impl<T: Column> FromRow for T {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        row.get(0)
    }
}

macro_rules! tuple {
    ($($type:ident $index:literal),+) => {
        impl<$($type: Column),+> FromRow for ($($type,)+) {
            fn from_row(row: &Row) -> Result<Self, StoreError> {
                Ok(($(row.get::<$type>($index)?,)+))
            }
        }
    };
}

tuple!(A 0, B 1);
tuple!(A 0, B 1, C 2);
tuple!(A 0, B 1, C 2, D 3);
tuple!(A 0, B 1, C 2, D 3, E 4);

/// Reads a struct from columns with the names of its fields. Other fields follow `..`:
/// `from_row!(Upload { name, created_at, ..row => object: StoredObject::from_row(row)? })`.
macro_rules! from_row {
    ($name:ident { $($field:ident),+ $(,)? }) => {
        $crate::database::query::from_row!($name { $($field),+, ..row => });
    };
    ($name:ident { $($field:ident,)* ..$row:ident => $($other:ident: $value:expr),* $(,)? }) => {
        impl $crate::database::query::FromRow for $name {
            fn from_row($row: &$crate::database::query::Row) -> Result<Self, $crate::StoreError> {
                Ok(Self {
                    $($field: $row.get(stringify!($field))?,)*
                    $($other: $value,)*
                })
            }
        }
    };
}
pub(crate) use from_row;

/// Something that reads rows: a transaction, or the database outside of one.
pub(crate) trait Executor: Send {
    /// The purpose of the queries. It completes "while ..." in an error.
    fn operation(&self) -> &'static str;

    fn fetch(&mut self, query: Query) -> impl Future<Output = Result<Vec<Row>, StoreError>> + Send;
}

/// Something that changes rows: a transaction.
pub(crate) trait Writer: Executor {
    /// Executes a statement. Returns how many rows it changed.
    fn execute(&mut self, query: Query) -> impl Future<Output = Result<u64, StoreError>> + Send;
}
