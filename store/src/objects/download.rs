//! Downloads of objects. A client never receives the last bytes of a damaged object.

use std::fs::File;
use std::io::{self, Seek, SeekFrom};
use std::ops::Range;

use bytes::Bytes;
use futures::stream::{BoxStream, Fuse};
use futures::{StreamExt, TryStreamExt};
use object_store::{GetOptions, GetRange, GetResultPayload, ObjectMeta, ObjectStoreExt};
use sha2::{Digest as _, Sha256};
use spec::Digest;
use tokio_util::io::ReaderStream;

use crate::boxed;
use crate::objects::checked::Verdict;
use crate::objects::fetch::shorter;
use crate::objects::parse;
use crate::{ObjectBytes, Store, StoreError, StoredObject};

impl Store {
    /// Streams an object, or `range` of it.
    ///
    /// A whole object is checked while it streams. Its last piece is sent if the digest is right,
    /// and otherwise the stream ends with [`StoreError::DamagedObject`]. A range cannot be checked
    /// by itself, so the first range of an object starts a background check of the whole object,
    /// for later requests.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when the object has another size or was found damaged before.
    /// It also fails when the object cannot be opened or `range` is not in it.
    #[boxed]
    pub async fn open_object(
        &self,
        object: &StoredObject,
        range: Option<Range<u64>>,
    ) -> Result<ObjectBytes, StoreError> {
        let version = self.undamaged_version(object).await?;
        let is_whole = range.as_ref().is_none_or(|range| *range == (0..object.size));
        if !is_whole {
            self.check_once(object, &version);
        }
        let failed = || StoreError::object("reading", &object.path);
        let options = GetOptions { range: range.map(GetRange::Bounded), ..GetOptions::default() };
        let location = parse(&object.path)?;
        let found = self.objects().remote().get_opts(&location, options).await.map_err(failed())?;
        let range = found.range.clone();
        let pieces = match found.payload {
            GetResultPayload::File(file, _) => stream_file(file, &range).map_err(failed())?,
            GetResultPayload::Stream(pieces) => whole(pieces, range.end - range.start),
        };
        let path = object.path.clone();
        let pieces = pieces.map_err(move |error| StoreError::object("reading", &path)(error));
        let stream = if is_whole {
            Checking::new(self.clone(), object.clone(), version, pieces.boxed()).stream()
        } else {
            pieces.boxed()
        };
        Ok(ObjectBytes { size: object.size, range, stream })
    }

    /// Checks that an object exists, has its size and was not found damaged.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when it was found damaged or has another size. It also fails
    /// when the object does not exist.
    #[boxed]
    pub async fn look_up_object(&self, object: &StoredObject) -> Result<(), StoreError> {
        self.undamaged_version(object).await.map(|_| ())
    }

    async fn undamaged_version(&self, object: &StoredObject) -> Result<ObjectMeta, StoreError> {
        let found = self.objects().remote().head(&parse(&object.path)?).await;
        let version = found.map_err(StoreError::object("looking for it", &object.path))?;
        object.check_size(version.size)?;
        if let Some(Verdict::Damaged(found)) = self.objects().checked.verdict(object, &version) {
            object.check_digest(found)?;
        }
        Ok(version)
    }

    /// Has an object checked in the background if it was not checked yet. One object is read at a
    /// time. If too many wait already, the next range tries again.
    fn check_once(&self, object: &StoredObject, version: &ObjectMeta) {
        let checked = &self.objects().checked;
        if checked.verdict(object, version).is_some() {
            return;
        }
        let Ok(place) = checked.places.clone().try_acquire_owned() else { return };
        checked.remember(object, version, Verdict::Pending);
        let (store, object) = (self.clone(), object.clone());
        tokio::spawn(async move {
            let _place = place;
            let _turn = store.objects().checked.turn.acquire().await;
            match store.read_to_the_end(&object).await {
                Ok(()) | Err(StoreError::DamagedObject { .. }) => {}
                Err(error) => {
                    store.objects().checked.forget(&object);
                    tracing::warn!(path = object.path, %error, "cannot check an object");
                }
            }
        });
    }

    /// Checks an object.
    pub(crate) async fn read_to_the_end(&self, object: &StoredObject) -> Result<(), StoreError> {
        let mut pieces = self.open_object(object, None).await?.stream;
        while pieces.try_next().await?.is_some() {}
        Ok(())
    }
}

/// A download that holds its last piece back until all bytes have been digested.
struct Checking {
    store: Store,
    object: StoredObject,
    version: ObjectMeta,
    pieces: Fuse<BoxStream<'static, Result<Bytes, StoreError>>>,
    digest: Sha256,
    held: Option<Bytes>,
}

impl Checking {
    fn new(
        store: Store,
        object: StoredObject,
        version: ObjectMeta,
        pieces: BoxStream<'static, Result<Bytes, StoreError>>,
    ) -> Self {
        Self { store, object, version, pieces: pieces.fuse(), digest: Sha256::new(), held: None }
    }

    fn stream(self) -> BoxStream<'static, Result<Bytes, StoreError>> {
        let next = |mut checking: Self| async move {
            let piece = checking.next().await?;
            Ok(piece.map(|piece| (piece, checking)))
        };
        futures::stream::try_unfold(self, next).boxed()
    }

    async fn next(&mut self) -> Result<Option<Bytes>, StoreError> {
        while let Some(piece) = self.pieces.try_next().await? {
            self.digest.update(&piece);
            if let Some(before) = self.held.replace(piece) {
                return Ok(Some(before));
            }
        }
        let Some(last) = self.held.take() else { return Ok(None) };
        let found = Digest::from_bytes(std::mem::take(&mut self.digest).finalize().into());
        self.store.objects().checked.judge(&self.object, &self.version, found)?;
        Ok(Some(last))
    }
}

/// Bytes per piece of a download. The file stream of object_store has pieces of 8 KiB, each read on
/// a thread of its own.
const DOWNLOAD_PIECE: usize = 256 * 1024;

/// The same pieces, with an error at the end if there were too few bytes.
fn whole(
    pieces: BoxStream<'static, object_store::Result<Bytes>>,
    length: u64,
) -> BoxStream<'static, object_store::Result<Bytes>> {
    let next = |(mut pieces, left): (BoxStream<'static, object_store::Result<Bytes>>, u64)| async move {
        match pieces.try_next().await? {
            Some(piece) => {
                let left = left.saturating_sub(piece.len() as u64);
                Ok(Some((piece, (pieces, left))))
            }
            None if left == 0 => Ok(None),
            None => Err(object_store::Error::Generic {
                store: "objects",
                source: Box::new(shorter(left)),
            }),
        }
    };
    futures::stream::try_unfold((pieces, length), next).boxed()
}

fn stream_file(
    mut file: File,
    range: &Range<u64>,
) -> Result<BoxStream<'static, object_store::Result<Bytes>>, object_store::Error> {
    use tokio::io::AsyncReadExt;
    let generic = |source: io::Error| object_store::Error::Generic {
        store: "LocalFileSystem",
        source: Box::new(source),
    };
    file.seek(SeekFrom::Start(range.start)).map_err(generic)?;
    let part = tokio::fs::File::from_std(file).take(range.end - range.start);
    Ok(ReaderStream::with_capacity(part, DOWNLOAD_PIECE).map_err(generic).boxed())
}
