//! The schema: the files in `migrations`, and the versions of a database that this program opens.
//!
//! The first file of a database has its whole schema. A later change of the schema is a file of its
//! own with the next number. The number is the version of the schema.
//!
//! Before torqued was released, the schema was spread over many files. Databases of that time are
//! opened if they had run all of them: the whole schema has the number of the last of those files,
//! and the same checksum in `_sqlx_migrations`.

use std::borrow::Cow;

use sqlx::SqlStr;
use sqlx::migrate::{Migrate, MigrateError, Migration, MigrationType, Migrator};

use crate::{Access, StoreError};

/// Number, name and statements of a file in `migrations`. sqlx has a macro that lists the files,
/// but it builds a second SQLite for the compiler.
pub(crate) type File = (i64, &'static str, &'static str);

/// The last commit that opens databases which had not run all files of before the release, and
/// brings them up to date.
const OPENS_EARLIER: &str = "6b1219be";

/// The schema of one database.
#[derive(Debug)]
pub(crate) struct Schema {
    /// The version of the file with the whole schema.
    first: i64,
    migrations: Migrator,
}

impl Schema {
    /// `files` begin with the one that has the whole schema. `checksum` is what databases have
    /// recorded for that file, in hexadecimal digits.
    pub fn new(files: &[File], checksum: &str) -> Self {
        let migration = |&(version, name, sql): &File| {
            let statements = SqlStr::from_static(sql);
            Migration::new(version, name.into(), MigrationType::Simple, statements, false)
        };
        let mut migrations: Vec<Migration> = files.iter().map(migration).collect();
        let first = &mut migrations[0];
        first.checksum = Cow::Owned(hex::decode(checksum).expect("a checksum in hexadecimal"));
        let first = first.version;
        let mut migrations = Migrator::with_migrations(migrations);
        // Databases of before the release have rows of files that are gone.
        migrations.set_ignore_missing(true);
        Self { first, migrations }
    }

    /// The version of a database with the newest schema.
    pub fn known(&self) -> i64 {
        self.migrations.iter().map(|migration| migration.version).max().unwrap_or(0)
    }

    /// The version of a database that has a table of migrations; 0 before the first one.
    pub async fn found(&self, connection: &mut impl Migrate) -> Result<i64, MigrateError> {
        let applied = connection.list_applied_migrations(&self.migrations.table_name).await?;
        Ok(applied.iter().map(|migration| migration.version).max().unwrap_or(0))
    }

    /// Refuses a database of a version that `access` cannot use. Owners can bring one up to date.
    pub fn admit(&self, found: i64, place: String, access: Access) -> Result<(), StoreError> {
        let known = self.known();
        let is_older = found < known && !access.is_owner();
        match found {
            _ if found > known => Err(StoreError::NewerSchema { place, found, known }),
            0 if is_older => Err(StoreError::Absent { place }),
            0 => Ok(()),
            _ if found < self.first => {
                let (first, commit) = (self.first, OPENS_EARLIER);
                Err(StoreError::UnreleasedSchema { place, found, first, commit })
            }
            _ if is_older => Err(StoreError::OlderSchema { place, found, known }),
            _ => Ok(()),
        }
    }

    /// Makes the schema of an empty database, or brings an older one up to date.
    pub async fn apply(&self, connection: &mut impl Migrate) -> Result<(), MigrateError> {
        self.migrations.run_direct(None, connection, false).await
    }
}

#[cfg(test)]
mod tests {
    use crate::database::{postgres, sqlite};

    #[test]
    fn every_file_of_migrations_is_run() {
        for (folder, listed) in [("sqlite", &sqlite::FILES[..]), ("postgres", &postgres::FILES[..])]
        {
            let folder = format!("{}/../migrations/{folder}", env!("CARGO_MANIFEST_DIR"));
            let mut files: Vec<String> = std::fs::read_dir(folder)
                .unwrap()
                .map(|entry| entry.unwrap().file_name().into_string().unwrap())
                .collect();
            files.sort();
            let listed = listed.iter().map(|(version, name, _)| format!("{version:04}_{name}.sql"));
            assert_eq!(files, listed.collect::<Vec<_>>());
        }
    }
}
