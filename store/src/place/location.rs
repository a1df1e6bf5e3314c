//! Where a store keeps its rows and its objects.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sqlx::postgres::PgConnectOptions;

use crate::ObjectsUrl;

/// The location of a store. By default everything lies in one folder.
#[derive(Clone, Debug)]
pub struct Location {
    /// The data folder. It holds the SQLite database and all objects. With a database or objects
    /// elsewhere, it holds copies of objects and unfinished files.
    pub folder: PathBuf,
    /// The PostgreSQL database, if it is not SQLite.
    pub database: Option<DatabaseUrl>,
    /// The bucket, if objects are not files in the folder.
    pub objects: Option<ObjectsUrl>,
    /// Whether somebody confirmed that the place is meant: that a new store may lie among the files
    /// of others, or that the files which the database names are lost for good.
    pub claimed: bool,
}

impl Location {
    /// A store with everything in one folder.
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into(), database: None, objects: None, claimed: false }
    }
}

/// The location's name in errors.
impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let folder = self.folder.display();
        match (&self.database, &self.objects) {
            (None, None) => write!(f, "data folder {folder}"),
            (None, Some(objects)) => write!(f, "data folder {folder} with {objects}"),
            (Some(database), None) => write!(f, "{database} with data folder {folder}"),
            (Some(database), Some(objects)) => write!(f, "{database} with {objects}"),
        }
    }
}

/// The folder's path without links, as far as the folder exists.
pub(crate) fn resolved(folder: &Path) -> PathBuf {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let existing = absolute.ancestors().find_map(|ancestor| {
        let rest = absolute.strip_prefix(ancestor).ok()?;
        Some(ancestor.canonicalize().ok()?.join(rest))
    });
    existing.unwrap_or(absolute)
}

/// A PostgreSQL database, as `postgres://USER:PASSWORD@HOST:PORT/DATABASE?sslmode=verify-full`. It
/// is shown without the password.
#[derive(Clone)]
pub struct DatabaseUrl {
    text: String,
    options: Box<PgConnectOptions>,
}

impl DatabaseUrl {
    pub(crate) const fn options(&self) -> &PgConnectOptions {
        &self.options
    }

    /// The URL with its password, for the environment of a worker.
    pub fn expose(&self) -> &str {
        &self.text
    }
}

impl FromStr for DatabaseUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const ALLOWED: &str = "postgres://USER:PASSWORD@HOST:PORT/DATABASE";
        if !text.starts_with("postgres://") && !text.starts_with("postgresql://") {
            // The text may begin with a password, so the error does not repeat it.
            return Err(format!("it must begin with postgres://, as in {ALLOWED}"));
        }
        let options = text.parse().map_err(|error| format!("{error}; expected {ALLOWED}"))?;
        Ok(Self { text: text.to_owned(), options: Box::new(options) })
    }
}

impl fmt::Display for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let options = &self.options;
        let database = options.get_database().unwrap_or_else(|| options.get_username());
        write!(f, "database {database} of PostgreSQL at ")?;
        match options.get_socket() {
            Some(socket) => write!(f, "{}", socket.display()),
            None => write!(f, "{}:{}", options.get_host(), options.get_port()),
        }
    }
}

impl fmt::Debug for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "DatabaseUrl({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_url_is_shown_without_its_password() {
        let url: DatabaseUrl = "postgres://lab:secret@db.lab:5433/arms".parse().unwrap();
        assert_eq!(url.to_string(), "database arms of PostgreSQL at db.lab:5433");
        assert!(!format!("{url:?}").contains("secret"));
        let url: DatabaseUrl = "postgres:///arms?host=/run/pg".parse().unwrap();
        assert_eq!(url.to_string(), "database arms of PostgreSQL at /run/pg");
    }

    #[test]
    fn what_is_no_url_of_postgresql_is_refused_without_repeating_it() {
        for text in ["secret", "mysql://lab:secret@db/arms", "postgres://lab:secret@db:port/arms"] {
            let error = text.parse::<DatabaseUrl>().unwrap_err();
            assert!(error.contains("postgres://") && !error.contains("secret"), "{error}");
        }
    }
}
