//! Objects whose bytes have been compared with their digests.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use object_store::ObjectMeta;
use spec::Digest;
use tokio::sync::Semaphore;

use crate::{StoreError, StoredObject};

/// Number of verdicts that are remembered. The oldest is forgotten first.
const REMEMBERED: usize = 32_768;

/// Number of objects that may wait to be checked in the background.
const WAITING: usize = 64;

/// Verdicts on objects that were read whole, and the permits of background checks.
#[derive(Debug)]
pub(crate) struct CheckedObjects {
    verdicts: Mutex<Verdicts>,
    /// Each background check takes one permit when it is requested.
    pub places: Arc<Semaphore>,
    /// The background check that is reading holds the permit.
    pub turn: Semaphore,
}

#[derive(Debug, Default)]
struct Verdicts {
    by_path: HashMap<String, Entry>,
    /// Paths, oldest first.
    order: VecDeque<String>,
}

#[derive(Debug)]
struct Entry {
    /// Size, time of modification and the like. Another file under the same path has other values.
    version: ObjectMeta,
    expected: Digest,
    verdict: Verdict,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// A check is reading it.
    Pending,
    Sound,
    /// It has this digest, which is wrong.
    Damaged(Digest),
}

impl Default for CheckedObjects {
    fn default() -> Self {
        Self {
            verdicts: Mutex::default(),
            places: Arc::new(Semaphore::new(WAITING)),
            turn: Semaphore::new(1),
        }
    }
}

impl CheckedObjects {
    /// The verdict on an object, if its file has not changed since.
    pub fn verdict(&self, object: &StoredObject, version: &ObjectMeta) -> Option<Verdict> {
        let verdicts = self.lock();
        let entry = verdicts.by_path.get(&object.path)?;
        let is_same = entry.version == *version && entry.expected == object.sha256;
        is_same.then_some(entry.verdict)
    }

    /// Compares the digest `found` with the object's digest, and remembers the verdict.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when they differ.
    pub fn judge(
        &self,
        object: &StoredObject,
        version: &ObjectMeta,
        found: Digest,
    ) -> Result<(), StoreError> {
        let checked = object.check_digest(found);
        if let Err(error) = &checked {
            tracing::error!(%error, "an object is not what was published");
        }
        let verdict = if checked.is_ok() { Verdict::Sound } else { Verdict::Damaged(found) };
        self.remember(object, version, verdict);
        checked
    }

    pub fn remember(&self, object: &StoredObject, version: &ObjectMeta, verdict: Verdict) {
        let entry = Entry { version: version.clone(), expected: object.sha256, verdict };
        let mut verdicts = self.lock();
        if verdicts.by_path.insert(object.path.clone(), entry).is_some() {
            return;
        }
        verdicts.order.push_back(object.path.clone());
        if verdicts.order.len() > REMEMBERED
            && let Some(oldest) = verdicts.order.pop_front()
        {
            verdicts.by_path.remove(&oldest);
        }
    }

    /// Forgets an object that could not be read to its end.
    pub fn forget(&self, object: &StoredObject) {
        let mut verdicts = self.lock();
        verdicts.by_path.remove(&object.path);
        verdicts.order.retain(|path| *path != object.path);
    }

    /// Ignores a poisoned lock. At worst an object is checked again.
    fn lock(&self) -> MutexGuard<'_, Verdicts> {
        self.verdicts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use object_store::path::Path;

    use super::*;

    fn object(path: &str) -> (StoredObject, ObjectMeta) {
        let version = ObjectMeta {
            location: Path::from(path),
            last_modified: chrono::DateTime::UNIX_EPOCH,
            size: 3,
            e_tag: None,
            version: None,
        };
        (StoredObject { path: path.to_owned(), size: 3, sha256: Digest::of(b"abc") }, version)
    }

    #[test]
    fn a_verdict_holds_until_the_file_is_another_one() {
        let checked = CheckedObjects::default();
        let (object, version) = object("a");
        assert_eq!(checked.verdict(&object, &version), None);
        let found = Digest::of(b"abd");
        let error = checked.judge(&object, &version, found).unwrap_err();
        assert!(matches!(error, StoreError::DamagedObject { .. }), "{error}");
        assert_eq!(checked.verdict(&object, &version), Some(Verdict::Damaged(found)));
        let repaired = ObjectMeta {
            last_modified: chrono::DateTime::UNIX_EPOCH + chrono::TimeDelta::seconds(1),
            ..version
        };
        assert_eq!(checked.verdict(&object, &repaired), None);
        checked.judge(&object, &repaired, object.sha256).unwrap();
        assert_eq!(checked.verdict(&object, &repaired), Some(Verdict::Sound));
        checked.forget(&object);
        assert_eq!(checked.verdict(&object, &repaired), None);
    }

    #[test]
    fn only_so_many_objects_are_remembered() {
        let checked = CheckedObjects::default();
        for index in 0..=REMEMBERED {
            let (object, version) = object(&index.to_string());
            checked.remember(&object, &version, Verdict::Sound);
        }
        let (first, version) = object("0");
        assert_eq!(checked.verdict(&first, &version), None);
        let (second, version) = object("1");
        assert_eq!(checked.verdict(&second, &version), Some(Verdict::Sound));
        assert_eq!(checked.lock().by_path.len(), REMEMBERED);
    }
}
