//! Signed URLs, from which a bucket itself sends an object to anybody who has the URL.

use std::fmt;
use std::sync::Arc;

use object_store::path::Path;
use object_store::signer::Signer;

/// Signs with the keys of a bucket.
#[derive(Clone)]
pub(super) struct UrlSigner {
    pub bucket: Arc<dyn Signer>,
    /// The prefix of all objects in the bucket; may be empty.
    pub prefix: Path,
}

impl fmt::Debug for UrlSigner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("UrlSigner").field("prefix", &self.prefix).finish_non_exhaustive()
    }
}

/// The purpose for which a URL is signed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignedFor {
    /// Reads the object.
    Get,
    /// Asks for the size of the object.
    Head,
}
