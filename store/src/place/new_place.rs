//! The place of a new store: an empty one, or one that somebody confirmed, and no part of another
//! store. It is checked before anything is made there.

use std::collections::VecDeque;
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};

use object_store::{ObjectStore, ObjectStoreExt};

use crate::database::Database;
use crate::objects::mark::Marker;
use crate::objects::path::MARKER;
use crate::place::data_dir::DataDir;
use crate::place::location::resolved;
use crate::transfer::tables::content_tables;
use crate::{Access, Location, Store, StoreError};

/// Number of found files that an error names.
const NAMED: usize = 5;

/// How far a confirmed folder is searched for other stores.
const SEARCHED_LEVELS: usize = 4;
const SEARCHED_ENTRIES: usize = 20_000;

/// Checks the data folder of a store that may be new. A folder that has a store already passes.
///
/// # Errors
/// [`StoreError::Occupied`], [`StoreError::StoreAround`], [`StoreError::StoreInside`] or
/// [`StoreError::DatabaseLost`]. Nothing was changed then.
pub(crate) fn check_folder(
    dir: &DataDir,
    location: &Location,
    access: Access,
) -> Result<(), StoreError> {
    if has_store(dir, location) {
        return Ok(());
    }
    if let Some(other) = store_around(&location.folder) {
        let other = other.display().to_string();
        return Err(StoreError::StoreAround { place: dir.place(), other });
    }
    if access == Access::Rebuilding {
        return Ok(());
    }
    if location.objects.is_none() && location.database.is_none() && is_mark(&dir.objects()) {
        return Err(StoreError::DatabaseLost { place: dir.place() });
    }
    let strangers = strangers(dir).map_err(|reason| dir.unusable(reason))?;
    if strangers.is_empty() {
        return Ok(());
    }
    if !location.claimed {
        return Err(occupied(dir.place(), &strangers, access));
    }
    match store_inside(dir.path()) {
        None => Ok(()),
        Some(other) => {
            let other = other.display().to_string();
            Err(StoreError::StoreInside { place: dir.place(), other })
        }
    }
}

/// Whether the folder has a store, as far as the folder itself says it. A folder beside PostgreSQL
/// has the files of a store, or an empty folder of objects and a cache.
fn has_store(dir: &DataDir, location: &Location) -> bool {
    if location.database.is_none() {
        return dir.database().exists();
    }
    is_mark(&dir.objects()) || (dir.objects().is_dir() && dir.cache().is_dir())
}

/// Whether a folder of objects has the mark of a store.
fn is_mark(objects: &Path) -> bool {
    std::fs::read(objects.join(MARKER)).is_ok_and(|bytes| Marker::of_bytes(&bytes).is_some())
}

/// The first names in a folder that torqued did not make. A hidden name and `lost+found`, which a
/// new disk has, do not count.
fn strangers(dir: &DataDir) -> io::Result<Vec<String>> {
    let mut found = Vec::new();
    for name in names(dir.path())? {
        if name.starts_with('.') || name == "lost+found" || dir.has_made(&name) {
            continue;
        }
        let folder = dir.path().join(&name);
        if folder == dir.objects() || folder == dir.cache() {
            let is_cache = folder == dir.cache();
            let is_other = |inner: &String| !(is_cache && crate::objects::is_cache_name(inner));
            let inner = names(&folder)?.into_iter().filter(is_other);
            found.extend(inner.map(|inner| format!("{name}/{inner}")));
        } else {
            found.push(name);
        }
    }
    Ok(found)
}

/// The names in a folder, sorted. A folder that does not exist has none.
fn names(folder: &Path) -> io::Result<Vec<String>> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let name = |entry: io::Result<std::fs::DirEntry>| {
        Ok(entry?.file_name().to_string_lossy().into_owned())
    };
    let mut names: Vec<String> = entries.map(name).collect::<io::Result<_>>()?;
    names.sort_unstable();
    Ok(names)
}

/// A folder above that is a data folder, or the folder of objects of one.
fn store_around(folder: &Path) -> Option<PathBuf> {
    let folder = resolved(folder);
    folder.ancestors().skip(1).find(|above| is_store(above)).map(Path::to_owned)
}

fn is_store(folder: &Path) -> bool {
    DataDir::new(folder).database().is_file() || is_mark(folder) || is_mark(&folder.join("objects"))
}

/// A folder below that is a data folder, as far as the search goes.
fn store_inside(root: &Path) -> Option<PathBuf> {
    let mut folders = VecDeque::from([(root.to_owned(), 0)]);
    let mut searched = 0;
    while let Some((folder, level)) = folders.pop_front() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            searched += 1;
            if searched > SEARCHED_ENTRIES {
                return None;
            }
            // Links are not followed.
            if !entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                continue;
            }
            let inner = entry.path();
            if is_store(&inner) {
                return Some(inner);
            }
            if level + 1 < SEARCHED_LEVELS && entry.file_name() != OsStr::new("lost+found") {
                folders.push_back((inner, level + 1));
            }
        }
    }
    None
}

fn occupied(place: String, strangers: &[String], access: Access) -> StoreError {
    let named = strangers.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
    let found = match strangers.len().saturating_sub(NAMED) {
        0 => named,
        _ => format!("{named} and more"),
    };
    // Only a server can be told that the place is meant.
    match access {
        Access::Server => StoreError::Occupied { place, found },
        _ => StoreError::NotEmpty { place, found },
    }
}

impl Store {
    /// Checks the objects of a store whose place has no mark, before the mark is written.
    ///
    /// # Errors
    /// [`StoreError::FilesLost`] when the database names files, unless the place was claimed.
    /// [`StoreError::Occupied`], [`StoreError::StoreAround`] or [`StoreError::StoreInside`] when the
    /// place is not that of a new store.
    pub(crate) async fn check_unmarked(
        &self,
        location: &Location,
        access: Access,
    ) -> Result<(), StoreError> {
        let place = self.objects().place();
        if !location.claimed {
            refuse_lost(self.database(), place.clone()).await?;
        }
        if let Some(other) = self.bucket_around().await {
            return Err(StoreError::StoreAround { place, other });
        }
        let strangers = self.objects().first(NAMED + 1).await?;
        if strangers.is_empty() {
            return Ok(());
        }
        if !location.claimed {
            return Err(occupied(place, &strangers, access));
        }
        for mark in self.objects().marks_below().await? {
            if is_marked(self.objects().remote(), &mark).await {
                return Err(StoreError::StoreInside { place, other: mark });
            }
        }
        Ok(())
    }

    /// The mark of a store whose prefix in the bucket begins this one's. A bucket that shows
    /// nothing above the prefix hides such a store.
    async fn bucket_around(&self) -> Option<String> {
        let around = self.objects().away()?.around()?;
        let parts: Vec<_> = around.prefix.parts().collect();
        for length in (0..parts.len()).rev() {
            let above = object_store::path::Path::from_iter(parts[..length].iter().cloned());
            let mark = above.join(MARKER);
            if is_marked(&*around.bucket, mark.as_ref()).await {
                return Some(mark.to_string());
            }
        }
        None
    }
}

/// Refuses a folder without the objects of a store if the database has rows that were made with
/// another one. It creates nothing, because the folder may be a mount point.
///
/// # Errors
/// [`StoreError::FilesLost`], unless the place was claimed.
pub(crate) async fn refuse_lost_folder(
    dir: &DataDir,
    database: &Database,
    location: &Location,
) -> Result<(), StoreError> {
    if location.claimed || is_mark(&dir.objects()) {
        return Ok(());
    }
    refuse_lost(database, dir.objects().display().to_string()).await
}

/// The error of a worker at a place without the files of its store.
pub(crate) fn no_files(place: String, found: &'static str) -> StoreError {
    StoreError::FilesLost { place, found, rows: "a store".to_owned() }
}

/// Refuses a place without a mark if the database has rows that were made with another one.
async fn refuse_lost(database: &Database, place: String) -> Result<(), StoreError> {
    let found =
        database.read("looking for what the store has").first_content(&content_tables()).await?;
    match found {
        None => Ok(()),
        Some(rows) => Err(StoreError::FilesLost { place, found: "has no store.json", rows }),
    }
}

async fn is_marked(objects: &dyn ObjectStore, path: &str) -> bool {
    let read = async { objects.get(&path.into()).await?.bytes().await };
    read.await.is_ok_and(|bytes| Marker::of_bytes(&bytes).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    const MARK: &str = "{\"store\": \"0123456789abcdef0123456789abcdef\"}";

    fn check(folder: &Path, claimed: bool) -> Result<(), StoreError> {
        let location = Location { claimed, ..Location::in_folder(folder) };
        check_folder(&DataDir::new(folder), &location, Access::Server)
    }

    #[test]
    fn a_new_disk_and_what_torqued_makes_are_empty() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check(&folder.path().join("new/one"), false).is_ok());
        std::fs::create_dir_all(folder.path().join("lost+found")).unwrap();
        std::fs::create_dir_all(folder.path().join("objects")).unwrap();
        std::fs::create_dir_all(folder.path().join("cache")).unwrap();
        std::fs::write(folder.path().join("server.lock"), "7").unwrap();
        std::fs::write(folder.path().join(".nfs0001"), "").unwrap();
        check(folder.path(), false).unwrap();
    }

    #[test]
    fn files_of_others_are_named_with_the_flag_that_confirms_the_folder() {
        for stranger in ["notes.txt", "objects/ball.obj", "cache/pip.whl"] {
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join(stranger);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(&file, "mine").unwrap();
            let error = check(folder.path(), false).unwrap_err().to_string();
            assert!(error.contains(stranger) && error.contains("--claim-place"), "{error}");
            check(folder.path(), true).unwrap();
        }
    }

    #[test]
    fn stores_above_and_below_are_refused_even_in_a_confirmed_folder() {
        for other in ["torqued.sqlite", "objects/store.json", "store.json"] {
            let folder = tempfile::tempdir().unwrap();
            let place = folder.path().join("lab/data");
            let above = folder.path().join(other);
            std::fs::create_dir_all(above.parent().unwrap()).unwrap();
            std::fs::create_dir_all(&place).unwrap();
            std::fs::write(&above, MARK).unwrap();
            for claimed in [false, true] {
                let error = check(&place, claimed).unwrap_err();
                assert!(matches!(error, StoreError::StoreAround { .. }), "{other}: {error}");
            }
            let folder = tempfile::tempdir().unwrap();
            let below = folder.path().join("colleagues/robots").join(other);
            std::fs::create_dir_all(below.parent().unwrap()).unwrap();
            std::fs::write(&below, MARK).unwrap();
            let error = check(folder.path(), false).unwrap_err();
            assert!(matches!(error, StoreError::Occupied { .. }), "{other}: {error}");
            let error = check(folder.path(), true).unwrap_err();
            assert!(matches!(error, StoreError::StoreInside { .. }), "{other}: {error}");
        }
        // Another program's file of this name is no store.
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("store.json"), "{\"store\": \"shoes\"}").unwrap();
        check(&folder.path().join("data"), false).unwrap();
    }

    #[test]
    fn files_of_a_store_without_their_database_are_not_those_of_a_new_store() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("objects")).unwrap();
        std::fs::write(folder.path().join("objects/store.json"), MARK).unwrap();
        let error = check(folder.path(), true).unwrap_err();
        assert!(matches!(error, StoreError::DatabaseLost { .. }), "{error}");
        assert!(error.to_string().contains("torqued reindex"), "{error}");
    }
}
