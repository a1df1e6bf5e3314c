//! Copies objects from store to store.

use std::io::{self, Write};

use bytes::Bytes;
use futures::{StreamExt, TryStreamExt};
use tokio::sync::mpsc;

use super::TransferProgress;
use crate::{Store, StoreError, StoredObject};

/// Number of objects that are copied at a time. Each is synced, and many are small.
const AT_A_TIME: usize = 4;

/// Number of pieces of an object that are read ahead.
const PIECES_AHEAD: usize = 4;

enum Piece {
    Bytes(Bytes),
    /// All pieces were sent, and their digest is right.
    End,
}

/// Copies objects and checks each against its digest on the way. Returns the objects that do not
/// exist, with the error.
pub(super) async fn copy_all(
    objects: Vec<StoredObject>,
    source: &Store,
    target: &Store,
    progress: &TransferProgress,
) -> Result<Vec<(String, StoreError)>, StoreError> {
    let copies =
        objects.iter().map(async |object| match copy(object, source, target, progress).await {
            Ok(()) => Ok(None),
            Err(error) if error.is_missing_file() => Ok(Some((object.path.clone(), error))),
            Err(error) => Err(error),
        });
    let copied = futures::stream::iter(copies).buffer_unordered(AT_A_TIME);
    copied.try_filter_map(async |missing| Ok(missing)).try_collect().await
}

async fn copy(
    object: &StoredObject,
    source: &Store,
    target: &Store,
    progress: &TransferProgress,
) -> Result<(), StoreError> {
    match target.read_to_the_end(object).await {
        Ok(()) => {
            progress.add_found(object.size);
            return Ok(());
        }
        Err(error) if error.is_missing_file() => {}
        Err(StoreError::DamagedObject { .. }) => {
            target.objects().delete(vec![object.path.clone()]).await;
        }
        Err(error) => return Err(error),
    }
    let mut pieces = source.open_object(object, None).await?.stream;
    let (sender, receiver) = mpsc::channel(PIECES_AHEAD);
    let reading = async move {
        while let Some(bytes) = pieces.try_next().await? {
            progress.add_bytes(bytes.len() as u64);
            if sender.send(Piece::Bytes(bytes)).await.is_err() {
                break;
            }
        }
        // If the writer is gone, it reports its own error.
        let _ = sender.send(Piece::End).await;
        Ok(())
    };
    let writing = write(object, target, receiver);
    tokio::try_join!(reading, writing).map(|_| ())
}

/// Publishes the pieces of an object once all are there. Without a [`Piece::End`], nothing is
/// published.
async fn write(
    object: &StoredObject,
    target: &Store,
    mut pieces: mpsc::Receiver<Piece>,
) -> Result<(), StoreError> {
    let mut writer = target.write_object(&object.path).await?;
    let copied = object.clone();
    let writing = move || {
        loop {
            match pieces.blocking_recv() {
                Some(Piece::Bytes(bytes)) => {
                    writer.write_all(&bytes).map_err(StoreError::file("writing", &copied.path))?;
                }
                Some(Piece::End) => return copied.check_digest(writer.finish()?.sha256),
                // The reader failed, or nobody waits any more.
                None => return Ok(()),
            }
        }
    };
    tokio::task::spawn_blocking(writing)
        .await
        .map_err(|error| StoreError::file("copying", &object.path)(io::Error::other(error)))?
}
