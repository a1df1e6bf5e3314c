//! Tests that a bucket can be used before anything depends on it.

use futures::TryStreamExt;
use object_store::path::Path;
use object_store::{Error, ObjectStore, ObjectStoreExt};

use super::client::Condition;
use super::path::PROBE_OBJECT;
use super::path::unique_name;
use super::s3::S3Options;
use super::trouble::{Trouble, in_short};
use super::url::ObjectsUrl;
use crate::StoreError;

const CONTENT: &[u8] = b"torqued asks whether objects can be kept here; this one may be deleted";

/// Writes, reads and deletes a small object.
///
/// # Errors
/// [`StoreError::ObjectsUnusable`] when one of these fails.
pub(super) async fn probe(
    url: &ObjectsUrl,
    options: &S3Options,
    store: &dyn ObjectStore,
) -> Result<(), StoreError> {
    let unusable = |reason: String| StoreError::ObjectsUnusable {
        url: url.to_string(),
        endpoint: options.endpoint().to_owned(),
        reason,
    };
    let failed = |operation: &'static str| {
        move |error: Error| {
            let short = in_short(&error);
            tracing::debug!(operation, error = short, "an object store refuses");
            match Trouble::of(&error) {
                Some(trouble) => unusable(format!("{operation} failed: {}", trouble.advice())),
                None => unusable(format!("{operation} failed: {short}")),
            }
        }
    };
    let path = Path::from(unique_name(PROBE_OBJECT));
    store.list(Some(&Path::from("probe"))).try_next().await.map_err(failed("listing"))?;
    store.put(&path, CONTENT.into()).await.map_err(failed("writing"))?;
    let again = store.put(&path, CONTENT.into()).await;
    let read = async { store.get(&path).await?.bytes().await };
    let read = read.await.map_err(failed("reading"))?;
    store.delete(&path).await.map_err(failed("deleting"))?;
    if read != CONTENT {
        return Err(unusable("it returned other bytes than it was given".to_owned()));
    }
    match again {
        Err(Error::Precondition { .. } | Error::AlreadyExists { .. }) => Ok(()),
        Ok(_) if options.condition() == Condition::NoneThere => {
            tracing::warn!(
                %url,
                "the object store replaces existing objects; give no other database this bucket \
                 and prefix"
            );
            Ok(())
        }
        Ok(_) => Ok(()),
        Err(error) => Err(failed("writing on a condition")(error)),
    }
}
