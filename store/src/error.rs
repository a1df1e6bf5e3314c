//! The errors of the store, in one enum.

use std::error::Error;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use spec::Digest;
use thiserror::Error;
use wire::{JobState, Relation, Scope};

use crate::objects::trouble::{Trouble, advice, in_short};
use crate::{Dependent, Epoch, Fingerprint, Item, JobId, TaskId, Timestamp};

/// Why the store refused an operation, or could not do it. The message says what was wrong, where,
/// and what to do.
#[derive(Debug, Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the message of each variant says what it and its fields mean")]
pub enum StoreError {
    #[error("data folder {} cannot be used: {reason}", dir.display())]
    Unusable { dir: PathBuf, reason: io::Error },

    #[error("{place} has no store; start a server on it first")]
    Absent { place: String },

    #[error("data folder {} is in use by another torqued server{}", dir.display(), of_process(*pid))]
    InUse { dir: PathBuf, pid: Option<u32> },

    #[error(
        "{place} was made by a newer torqued (schema {found}, this one knows {known}); nothing was changed"
    )]
    NewerSchema { place: String, found: i64, known: i64 },

    #[error(
        "{place} has schema {found}, but this torqued needs {known}; start a server of this \
         version first"
    )]
    OlderSchema { place: String, found: i64, known: i64 },

    /// The database was made before the first release, and this program no longer has the files
    /// that bring it up to date.
    #[error(
        "{place} has schema {found} of an unreleased torqued, and this one opens schema {first} or \
         later; nothing was changed; build torqued at commit {commit}, start its server on the store \
         once, and then start this one"
    )]
    UnreleasedSchema { place: String, found: i64, first: i64, commit: &'static str },

    #[error("the database in {place} is damaged: {detail}; nothing was changed")]
    Damaged { place: String, detail: String },

    /// A database that other programs provide.
    #[error("{place} cannot be used: {reason}; {remedy}")]
    DatabaseUnusable { place: String, reason: String, remedy: String },

    #[error(
        "objects at {place} belong to another database, whose server would delete what this one writes; {remedy}"
    )]
    ForeignObjects { place: String, remedy: &'static str },

    /// A new store would lie among the files of somebody else.
    #[error(
        "{place} is not empty: it has {found}; a new store needs an empty place: choose another one, \
         or confirm this one with --claim-place, and torqued leaves the files of others alone"
    )]
    Occupied { place: String, found: String },

    /// A new store would lie in another one, whose users may delete it or move it away.
    #[error("{place} lies in the store at {other}; choose a place outside of it")]
    StoreAround { place: String, other: String },

    #[error("{place} has another store in it, at {other}; choose a place without one")]
    StoreInside { place: String, other: String },

    /// The files of a store without their database.
    #[error(
        "{place} has the files of a store whose database is not there: if it is in PostgreSQL, name it \
         with --database; if torqued.sqlite is lost, restore a backup into another folder, or rebuild \
         it with `torqued reindex`"
    )]
    DatabaseLost { place: String },

    /// The database names files, and their place is another one or lost them all.
    #[error(
        "{place} {found}, but the database has {rows}, so its files lie elsewhere: mount the disk, or \
         correct --data or --objects; nothing was written there. If the files are lost for good, \
         `torqued serve --claim-place` begins with the place as it is"
    )]
    FilesLost { place: String, found: &'static str, rows: String },

    /// The place changed while the store was open.
    #[error(
        "the files of this store are not at {place} any more, which {found}: mount the disk, or put the \
         bucket's objects back; nothing is written there until then"
    )]
    Displaced { place: String, found: &'static str },

    /// A store that is in use cannot be moved.
    #[error("{place} is in use by {by}; {remedy}")]
    InService { place: String, by: String, remedy: &'static str },

    /// The server of one store would delete objects of the other.
    #[error(
        "{to} shares a folder, the database or a prefix with {from}; choose a place that shares \
         nothing with it"
    )]
    SharedPlace { from: String, to: String },

    #[error("{place} has {found} already; choose an empty place for the store")]
    NotEmpty { place: String, found: String },

    #[error(
        "{place} has an unfinished copy of a store; repeat `torqued migrate`, `backup` or \
         `restore` with the same places, or delete the copy and its database"
    )]
    UnfinishedTransfer { place: String },

    #[error("{place} has {what}, which this torqued cannot move")]
    UnknownTable { place: String, what: String },

    #[error(
        "table {table} differs: {source_rows} rows in {source_place}, {target_rows} in {target_place}; \
         delete the latter and move the store again"
    )]
    RowsDiffer {
        table: &'static str,
        source_place: String,
        source_rows: u64,
        target_place: String,
        target_rows: u64,
    },

    #[error(
        "the database was deleted or replaced after it was opened, so further changes would be \
         lost; put it back, and start the server and its workers again"
    )]
    DatabaseGone,

    #[error("the database accepted no write for {} s: another process has locked it, or the disk hangs", waited.as_secs())]
    DatabaseBusy { waited: Duration },

    #[error("disk full while {operation}")]
    DiskFull { operation: String },

    #[error("the database failed while {operation}")]
    Database { operation: &'static str, source: sqlx::Error },

    #[error("the schema of the database could not be migrated")]
    Migration { source: sqlx::migrate::MigrateError },

    #[error("`{url}` is not a place for objects: {reason}; allowed: s3://BUCKET/PREFIX")]
    ObjectsUrl { url: String, reason: String },

    #[error("{name} is `{value}`, allowed: {allowed}")]
    S3Options { name: &'static str, value: String, allowed: String },

    #[error("objects in {url} at {endpoint} cannot be used: {reason}")]
    ObjectsUnusable { url: String, endpoint: String, reason: String },

    /// Two databases probably use the same bucket and prefix.
    #[error(
        "object {path} exists already with other bytes; two databases cannot share a bucket and a \
         prefix: give each a prefix of its own"
    )]
    ObjectTaken { path: String },

    #[error("object {path} failed while {operation}: {}{}", in_short(error), advice(error))]
    Object { operation: &'static str, path: String, error: object_store::Error },

    #[error("object {path} failed while {operation}")]
    ObjectFile { operation: &'static str, path: String, source: io::Error },

    /// An object's bytes differ from those that were published.
    #[error("object {path} is damaged: expected {expected}, found {found}")]
    DamagedObject { path: String, expected: Fingerprint, found: Fingerprint },

    #[error("Parquet file {path} failed while {operation}")]
    Parquet { operation: &'static str, path: String, source: parquet::errors::ParquetError },

    /// The task was given to another worker meanwhile, or has ended.
    #[error("the lease of task {task} at epoch {epoch} is lost")]
    LeaseLost { task: TaskId, epoch: Epoch },

    #[error("there is no {what} {id}")]
    NotFound { what: &'static str, id: String },

    #[error("a token with the name {name} exists already; revoke it, or choose another name")]
    TokenExists { name: String },

    #[error("there are {allowed} tokens, which is the limit; revoke some")]
    TooManyTokens { allowed: u64 },

    #[error("{what} {id} would have {tags} tags, allowed: {allowed}; remove some of them first")]
    TooManyTags { what: &'static str, id: i64, tags: usize, allowed: usize },

    #[error(
        "the first token has the scope {scope}, allowed: admin; the server requires a token from \
         then on, and without admin nobody could create another one"
    )]
    FirstToken { scope: Scope },

    #[error("a submission is inconsistent: {reason}")]
    InvalidSubmission { reason: String },

    #[error("needs job {job}, which is {state}")]
    NeedNotMet { job: JobId, state: JobState },

    #[error("idempotency key {key:?} was used before with a different request; use another key")]
    IdempotencyConflict { key: String },

    #[error("an experiment {name:?} exists already")]
    ExperimentTaken { name: String },

    #[error(
        "{item} was deleted on {deleted_at} and is in the trash until {purge_at}; `torqued undelete {item}` or \
         POST /v1/{}s/{}/restore brings it back", item.kind, item.id
    )]
    InTrash { item: Item, deleted_at: Timestamp, purge_at: Timestamp },

    #[error("{item} was deleted, and purged from the trash on {purged_at}")]
    Purged { item: Item, purged_at: Timestamp },

    #[error("{item} is not in the trash")]
    NotDeleted { item: Item },

    #[error(
        "{item} was deleted together with its owner; restore job {job}, which made it, or its run"
    )]
    OwnerDeleted { item: Item, job: JobId },

    #[error(
        "{item} cannot be deleted while job {job} is {state}; cancel the job, or wait until it has ended"
    )]
    NotEnded { item: Item, job: JobId, state: JobState },

    #[error("{item} cannot be deleted: {}", in_words(by))]
    Needed { item: Item, by: Vec<Dependent> },

    /// An item that a submission refers to was deleted after it was looked up.
    #[error("needs {item}, which was deleted or lost its results")]
    InputDeleted { item: Item },

    /// A sent file that a submission refers to was deleted after it was looked up.
    #[error("reads the file {digest}, which was deleted; send it again")]
    FileDeleted { digest: Digest },

    /// A tracked run or its experiment was deleted.
    #[error("{what} {id} is deleted; restore it first")]
    Deleted { what: &'static str, id: String },

    #[error("param {key:?} of run {run} was logged as {logged:?} and cannot be changed to {new:?}")]
    ParamChanged { run: String, key: String, logged: String, new: String },
}

/// Number of dependents that an error names. It counts the others.
const NAMED: usize = 10;

/// Names the dependents that prevent a deletion in every case, or all dependents if there are none.
fn in_words(dependents: &[Dependent]) -> String {
    let open: Vec<&Dependent> =
        dependents.iter().filter(|dependent| !dependent.state.is_final()).collect();
    let (named, advice) = if open.is_empty() {
        (
            dependents.iter().collect(),
            "`--force` (`?force=true`) deletes it and leaves them as they are",
        )
    } else {
        (open, "cancel them, or wait until they have ended")
    };
    let words = |dependent: &&Dependent| {
        let relation = match dependent.relation {
            Relation::Reads => "reads it",
            Relation::Needs => "needs it",
            Relation::Continues => "continues from it",
            Relation::Holds => "has it as a member",
        };
        format!("{} job {} ({}) {relation}", dependent.kind, dependent.job, dependent.state)
    };
    let mut list: Vec<String> = named.iter().take(NAMED).map(words).collect();
    if named.len() > NAMED {
        list.push(format!("{} more depend on it", named.len() - NAMED));
    }
    format!("{}; {advice}", list.join(", "))
}

fn of_process(pid: Option<u32>) -> String {
    pid.map_or(String::new(), |pid| format!(" (pid {pid})"))
}

impl StoreError {
    /// Whether the results of a task found no place to lie. Another attempt may succeed later,
    /// whatever the task is.
    pub fn is_without_room(error: &(dyn Error + 'static)) -> bool {
        let mut cause = Some(error);
        while let Some(error) = cause {
            if let Some(Self::DiskFull { .. } | Self::Displaced { .. }) =
                error.downcast_ref::<Self>()
            {
                return true;
            }
            cause = error.source();
        }
        is_disk_full(error)
    }

    /// Whether the requested file does not exist.
    pub fn is_missing_file(&self) -> bool {
        match self {
            Self::ObjectFile { source, .. } => source.kind() == io::ErrorKind::NotFound,
            Self::Object { error, .. } => {
                let is_missing = matches!(error, object_store::Error::NotFound { .. });
                is_missing && Trouble::of(error) != Some(Trouble::NoBucket)
            }
            _ => false,
        }
    }

    /// Whether the object that the error is about is gone or damaged. Trying again does not help
    /// then.
    pub fn is_unusable_object(&self) -> bool {
        self.is_missing_file() || matches!(self, Self::DamagedObject { .. })
    }

    /// The path of the object that the error is about.
    pub fn object_path(&self) -> Option<&str> {
        match self {
            Self::Object { path, .. }
            | Self::ObjectFile { path, .. }
            | Self::ObjectTaken { path }
            | Self::DamagedObject { path, .. } => Some(path),
            _ => None,
        }
    }

    /// Whether the database did not answer and may answer again later: it was stopped, is starting,
    /// or cannot be reached.
    pub fn is_database_away(&self) -> bool {
        let Self::Database { source, .. } = self else { return false };
        match source {
            sqlx::Error::Io(_) | sqlx::Error::PoolTimedOut => true,
            // Broken connections (08), too many connections (53300), a server that shuts down or
            // starts (57P), and conflicting transactions (40). SQLite's codes are numbers without
            // letters.
            sqlx::Error::Database(error) => error.code().is_some_and(|code| {
                code.len() == SQLSTATE_LENGTH
                    && ["08", "40", "53300", "57P"].iter().any(|class| code.starts_with(class))
            }),
            _ => false,
        }
    }

    /// For `map_err` after a query; `operation` completes "while ...".
    pub(crate) fn database(operation: &'static str) -> impl Fn(sqlx::Error) -> Self {
        move |source| {
            if is_disk_full(&source) {
                Self::DiskFull { operation: operation.to_owned() }
            } else {
                Self::Database { operation, source }
            }
        }
    }

    /// For `map_err` after an object operation; `operation` completes "while ...".
    pub(crate) fn object(
        operation: &'static str,
        path: &str,
    ) -> impl FnOnce(object_store::Error) -> Self {
        let path = path.to_owned();
        move |error| {
            if is_disk_full(&error) {
                Self::DiskFull { operation: format!("{operation} object {path}") }
            } else {
                Self::Object { operation, path, error }
            }
        }
    }

    pub(crate) fn parquet(
        operation: &'static str,
        path: &str,
    ) -> impl FnOnce(parquet::errors::ParquetError) -> Self {
        let path = path.to_owned();
        move |source| {
            if is_disk_full(&source) {
                Self::DiskFull { operation: format!("{operation} object {path}") }
            } else {
                Self::Parquet { operation, path, source }
            }
        }
    }

    /// For `map_err` after a file operation; `operation` completes "while ...".
    pub(crate) fn file(
        operation: &'static str,
        path: &str,
    ) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| {
            if is_disk_full(&source) {
                Self::DiskFull { operation: format!("{operation} {path}") }
            } else {
                Self::ObjectFile { operation, path, source }
            }
        }
    }

    pub(crate) fn not_found(what: &'static str, id: String) -> Self {
        Self::NotFound { what, id }
    }
}

/// https://www.postgresql.org/docs/15/errcodes-appendix.html
const SQLSTATE_LENGTH: usize = 5;

/// `SQLITE_FULL` (https://www.sqlite.org/rescode.html#full).
const SQLITE_FULL: i32 = 13;

/// Whether the cause, at any depth, is a full disk or an exhausted quota.
pub(crate) fn is_disk_full(error: &(dyn Error + 'static)) -> bool {
    let mut cause = Some(error);
    while let Some(error) = cause {
        if let Some(error) = error.downcast_ref::<io::Error>() {
            let full = [io::ErrorKind::StorageFull, io::ErrorKind::QuotaExceeded];
            if full.contains(&error.kind()) || error.get_ref().is_some_and(|e| is_disk_full(e)) {
                return true;
            }
        }
        if let Some(sqlx::Error::Database(error)) = error.downcast_ref::<sqlx::Error>()
            && sqlite_code(error.as_ref()) == Some(SQLITE_FULL)
        {
            return true;
        }
        // `source` of an external error is the source of the wrapped error, not the wrapped error
        // itself.
        if let Some(parquet::errors::ParquetError::External(error)) = error.downcast_ref()
            && is_disk_full(error.as_ref())
        {
            return true;
        }
        cause = error.source();
    }
    false
}

/// The primary result code: extended codes carry more in their higher bytes.
pub(crate) fn sqlite_code(error: &dyn sqlx::error::DatabaseError) -> Option<i32> {
    Some(error.code()?.parse::<i32>().ok()? & 0xff)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_apart_however_deep_it_lies() {
        let full = || io::Error::from(io::ErrorKind::StorageFull);
        let object = object_store::Error::Generic { store: "local", source: Box::new(full()) };
        assert!(is_disk_full(&full()));
        assert!(is_disk_full(&io::Error::other(object)));
        assert!(is_disk_full(&parquet::errors::ParquetError::External(Box::new(full()))));
        assert!(!is_disk_full(&io::Error::other("something else")));
        let error = StoreError::object("writing", "a/b")(object_store::Error::Generic {
            store: "local",
            source: Box::new(full()),
        });
        assert_eq!(error.to_string(), "disk full while writing object a/b");
    }

    #[tokio::test]
    async fn a_database_that_cannot_grow_is_a_full_disk() {
        use sqlx::{ConnectOptions, Executor};
        let mut connection =
            sqlx::sqlite::SqliteConnectOptions::new().in_memory(true).connect().await.unwrap();
        connection.execute("PRAGMA max_page_count = 2").await.unwrap();
        connection.execute("CREATE TABLE t (x)").await.unwrap();
        let error = connection
            .execute("INSERT INTO t VALUES (zeroblob(100000))")
            .await
            .map_err(StoreError::database("submitting a job"))
            .unwrap_err();
        assert_eq!(error.to_string(), "disk full while submitting a job");
    }
}
