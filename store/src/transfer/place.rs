//! The two places of a move: checks that nobody uses them meanwhile, and that they hold what they
//! must.

use std::time::{Duration, Instant};

use super::Side;
use crate::database::{Database, Scope};
use crate::place::data_dir::DataDir;
use crate::place::location::resolved;
use crate::{Access, Duty, DutyClaim, Location, S3Options, Store, StoreError};

const SOURCE_REMEDY: &str =
    "let its tasks end (`torqued pause --wait`), then stop its servers and workers and try again";

const TARGET_REMEDY: &str = "stop it first";

/// How long PostgreSQL may take to notice that a process with a duty has ended, e.g. an interrupted
/// move.
const RELEASED_WITHIN: Duration = Duration::from_secs(1);

/// Number of tasks that an error names.
const NAMED_TASKS: i64 = 3;

/// Refuses two places if one lies in the other. Databases are compared once they are open.
pub(super) fn refuse_shared(from: &Location, to: &Location) -> Result<(), StoreError> {
    let (from_folder, to_folder) = (resolved(&from.folder), resolved(&to.folder));
    let has_folder = from_folder.starts_with(&to_folder) || to_folder.starts_with(&from_folder);
    let has_bucket = match (&from.objects, &to.objects) {
        (Some(from), Some(to)) => from.overlaps(to),
        _ => false,
    };
    if has_folder || has_bucket { Err(shared(from, to)) } else { Ok(()) }
}

pub(super) fn shared(from: &Location, to: &Location) -> StoreError {
    StoreError::SharedPlace { from: from.to_string(), to: to.to_string() }
}

/// Opens the store that moves. It must have the schema that this program knows, and must not be in
/// use.
pub(super) async fn open_source(location: &Location, s3: &S3Options) -> Result<Side, StoreError> {
    let (store, place) = (open(location, Access::Worker, s3).await?, location.to_string());
    // The server of a folder with SQLite locks it. PostgreSQL knows which server has the duties.
    let lock = location.database.is_none().then(|| store.dir().lock()).transpose()?;
    let duties = take_duties(&store, &place, SOURCE_REMEDY).await?;
    let mut side = Side::keep_still(store, Scope::Queue, place.clone(), lock, duties).await?;
    // Tasks of dead workers move as they are. The next server takes them back.
    let leased = side.transaction.leased_tasks(NAMED_TASKS).await?;
    if !leased.is_empty() {
        return Err(StoreError::InService { place, by: leased.join(", "), remedy: SOURCE_REMEDY });
    }
    Ok(side)
}

/// Opens the present state of a store, beside its servers and workers.
pub(super) async fn open_snapshot(location: &Location, s3: &S3Options) -> Result<Side, StoreError> {
    let (store, place) = (open(location, Access::Worker, s3).await?, location.to_string());
    Side::snapshot(store, place).await
}

/// The identity of the database at a place, if it has one. It is looked up before anything there
/// could change. The files of that database may lie elsewhere.
///
/// # Errors
/// When the database has another version, or cannot be opened.
pub(super) async fn identity(location: &Location) -> Result<Option<String>, StoreError> {
    let dir = DataDir::new(&location.folder);
    match Database::open(&dir, location.database.as_ref(), Access::Worker).await {
        Ok(database) => {
            let identity = database.read("reading the store's identity").identity().await;
            database.close().await;
            identity.map(Some)
        }
        Err(StoreError::Absent { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Opens the target of a move. Creates it if it is new.
pub(super) async fn open_target(location: &Location, s3: &S3Options) -> Result<Side, StoreError> {
    let (store, place) = (open(location, Access::Transfer, s3).await?, location.to_string());
    let duties = take_duties(&store, &place, TARGET_REMEDY).await?;
    Side::keep_still(store, Scope::Rows, place, None, duties).await
}

async fn open(location: &Location, access: Access, s3: &S3Options) -> Result<Store, StoreError> {
    match &location.objects {
        None => Store::open_at(location, access).await,
        Some(url) => Store::open_with_objects(location, access, url.connect(s3).await?).await,
    }
}

/// Takes the duties of servers, so that no server does housekeeping meanwhile.
async fn take_duties(
    store: &Store,
    place: &str,
    remedy: &'static str,
) -> Result<Vec<DutyClaim>, StoreError> {
    let in_use = |by: String| StoreError::InService { place: place.to_owned(), by, remedy };
    let mut duties = Vec::new();
    for duty in [Duty::Reaping, Duty::Sweeping] {
        let mut claim = store.duty(duty);
        let began = Instant::now();
        while !claim.is_mine().await? {
            if began.elapsed() > RELEASED_WITHIN {
                return Err(in_use("a server".to_owned()));
            }
            tokio::time::sleep(RELEASED_WITHIN / 10).await;
        }
        duties.push(claim);
    }
    let workers = store.workers().await?;
    if let Some(worker) = workers.iter().find(|worker| worker.is_alive) {
        let process = &worker.process;
        let (name, host, pid) = (&process.name, &process.host, process.pid);
        return Err(in_use(format!("worker {name} (pid {pid} on {host})")));
    }
    Ok(duties)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_that_lie_in_each_other_are_shared() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| Location::in_folder(folder.path().join(name));
        let is_shared = |from: &Location, to: &Location| refuse_shared(from, to).is_err();
        std::fs::create_dir_all(folder.path().join("a/b")).unwrap();
        std::os::unix::fs::symlink("a", folder.path().join("link")).unwrap();
        for (from, to) in [("a", "a"), ("a", "a/new/one"), ("a/b", "a"), ("a", "link/new")] {
            assert!(is_shared(&at(from), &at(to)), "{from} and {to}");
        }
        for (from, to) in [("a", "ab"), ("a/b", "a/c"), ("new", "newer")] {
            assert!(!is_shared(&at(from), &at(to)), "{from} and {to}");
        }

        let in_bucket =
            |name: &str, url: &str| Location { objects: Some(url.parse().unwrap()), ..at(name) };
        let from = in_bucket("a", "s3://lab/arm");
        for url in ["s3://lab/arm", "s3://lab/arm/new", "s3://lab"] {
            assert!(is_shared(&from, &in_bucket("c", url)), "{url}");
        }
        for url in ["s3://lab/arms", "s3://other/arm"] {
            assert!(!is_shared(&from, &in_bucket("c", url)), "{url}");
        }
    }
}
