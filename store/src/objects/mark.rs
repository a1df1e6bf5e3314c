//! The watch over the mark of an open store. The disk of a folder can vanish, and a bucket can be
//! emptied, while a server and its workers run. Then nothing may be written or deleted there: the
//! files would land under the mount point, or be those of another store.

use std::io::ErrorKind;
use std::path::Path as FilePath;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use object_store::path::Path;
use object_store::{Error, ObjectStore, ObjectStoreExt};
use serde::{Deserialize, Serialize};

use super::path::MARKER;

/// The object that names the store that the objects beside it belong to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Marker {
    pub store: String,
}

impl Marker {
    /// Reads a file that may be a mark of a store.
    pub fn of_bytes(bytes: &[u8]) -> Option<Self> {
        let marker: Self = serde_json::from_slice(bytes).ok()?;
        let is_identity = marker.store.len() == IDENTITY_LENGTH
            && marker.store.bytes().all(|byte| byte.is_ascii_hexdigit());
        is_identity.then_some(marker)
    }

    fn compare(&self, found: &[u8]) -> Option<Displaced> {
        (Self::of_bytes(found).as_ref() != Some(self)).then_some(Displaced::OtherMark)
    }
}

/// Number of hexadecimal digits of a store's identity.
const IDENTITY_LENGTH: usize = 32;

/// A fault of the place of a store's objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Displaced {
    /// There is no mark: the disk is not mounted, the bucket was emptied, or it is another prefix.
    NoMark,
    /// The mark names another store.
    OtherMark,
}

impl Displaced {
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::NoMark => "has no store.json",
            Self::OtherMark => "has the store.json of another store",
        }
    }

    /// The reason why no task is claimed. It names no path, because `/healthz` answers strangers.
    pub const fn obstacle(self) -> &'static str {
        match self {
            Self::NoMark => {
                "the place of this store's files has no store.json (a disk that is not mounted, an \
                 emptied bucket, another prefix); nothing is written there until it is back"
            }
            Self::OtherMark => {
                "the place of this store's files has the store.json of another store; nothing is \
                 written there until the right one is back"
            }
        }
    }
}

/// The mark that an open store must find at its place.
#[derive(Debug, Default)]
pub(super) struct MarkWatch {
    /// `None` until the store is open, which writes the mark of a new store.
    expected: OnceLock<Marker>,
    last: Mutex<Option<Look>>,
}

/// The last look at the mark in a remote store.
#[derive(Clone, Copy, Debug)]
struct Look {
    at: Instant,
    found: Option<Displaced>,
}

/// How long a look at a bucket holds. A look at a folder costs nothing, so it is never old.
const HOLDS: Duration = Duration::from_secs(15);

impl MarkWatch {
    pub fn expect(&self, marker: Marker) {
        // A store is opened once.
        let _ = self.expected.set(marker);
        self.note(None);
    }

    /// Looks at the mark in a folder of objects.
    pub fn look_in_folder(&self, folder: &FilePath) -> Option<Displaced> {
        let expected = self.expected.get()?;
        match std::fs::read(folder.join(MARKER)) {
            Ok(bytes) => expected.compare(&bytes),
            Err(error) if is_absent(&error) => Some(Displaced::NoMark),
            // A failing disk is reported by what reads and writes.
            Err(_) => None,
        }
    }

    /// The last look at a remote store, however old.
    pub fn known(&self) -> Option<Displaced> {
        self.last().and_then(|look| look.found)
    }

    /// Whether the last look at a remote store is too old.
    pub fn is_stale(&self) -> bool {
        self.expected.get().is_some() && self.last().is_none_or(|look| look.at.elapsed() > HOLDS)
    }

    /// Looks at the mark in a remote store.
    pub async fn look_at(&self, remote: &dyn ObjectStore) -> Option<Displaced> {
        let expected = self.expected.get()?;
        let read = async { remote.get(&Path::from(MARKER)).await?.bytes().await };
        let found = match read.await {
            Ok(bytes) => expected.compare(&bytes),
            Err(Error::NotFound { .. }) => Some(Displaced::NoMark),
            // A store that does not answer is reported by what reads and writes.
            Err(_) => self.known(),
        };
        self.note(found);
        found
    }

    fn note(&self, found: Option<Displaced>) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) =
            Some(Look { at: Instant::now(), found });
    }

    fn last(&self) -> Option<Look> {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn is_absent(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory)
}
