//! Signed URLs, from which a bucket itself sends an object to anybody who has the URL.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use object_store::path::Path;
use object_store::signer::Signer;

use crate::objects::parse;
use crate::{Store, StoreError, StoredObject, boxed};

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
    Get,
    Head,
}

impl Store {
    /// A URL from which anybody can fetch the object, or ranges of it, for the given time. `None`
    /// where objects do not lie in a bucket. The bytes are not compared with their digest on the
    /// way.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when the object has another size or was found damaged. It also
    /// fails when the object does not exist.
    #[boxed]
    pub async fn signed_url(
        &self,
        object: &StoredObject,
        method: SignedFor,
        valid_for: Duration,
    ) -> Result<Option<String>, StoreError> {
        let signer = self.objects().away().and_then(|elsewhere| elsewhere.signer.as_ref());
        let Some(UrlSigner { bucket, prefix }) = signer else { return Ok(None) };
        self.look_up_object(object).await?;
        let method = match method {
            SignedFor::Get => object_store::signer::Method::GET,
            SignedFor::Head => object_store::signer::Method::HEAD,
        };
        let path = prefix.parts().chain(parse(&object.path)?.parts()).collect();
        let signed = bucket.signed_url(method, &path, valid_for).await;
        signed
            .map(|url| Some(url.into()))
            .map_err(StoreError::object("signing an address of", &object.path))
    }
}
