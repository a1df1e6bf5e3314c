//! Published objects, and the fingerprints that tell one from other bytes under the same path.

use std::fmt;

use spec::Digest;

use crate::StoreError;

/// An object that was published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredObject {
    /// The path in the store, or in the folder that it was written to.
    pub path: String,
    /// Size in bytes.
    pub size: u64,
    /// The digest of all bytes.
    pub sha256: Digest,
}

/// A property that tells bytes from other bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fingerprint {
    /// In bytes.
    Size(u64),
    /// An object that was compared byte by byte, by its digest.
    Sha256(Digest),
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size(bytes) => write!(f, "{bytes} bytes"),
            Self::Sha256(digest) => write!(f, "SHA-256 {digest}"),
        }
    }
}

impl StoredObject {
    /// # Errors
    /// [`StoreError::DamagedObject`] when it was published with another size.
    pub(crate) fn check_size(&self, found: u64) -> Result<(), StoreError> {
        self.check(Fingerprint::Size(self.size), Fingerprint::Size(found))
    }

    /// # Errors
    /// [`StoreError::DamagedObject`] when it was published with another digest.
    pub(crate) fn check_digest(&self, found: Digest) -> Result<(), StoreError> {
        self.check(Fingerprint::Sha256(self.sha256), Fingerprint::Sha256(found))
    }

    fn check(&self, expected: Fingerprint, found: Fingerprint) -> Result<(), StoreError> {
        if found == expected {
            return Ok(());
        }
        Err(StoreError::DamagedObject { path: self.path.clone(), expected, found })
    }
}
