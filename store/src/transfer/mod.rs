//! Transfers: a store moves to another place, from the data folder to PostgreSQL or back. A backup
//! copies a store while it is used.
//!
//! Objects are copied first, and then all rows in one transaction, so the target has everything or
//! no jobs at all. Until then a mark among its objects (`store::identity`) says so: no server
//! serves it, and the move can be repeated. During a move nobody may change either store.
//! Transactions, the folder's lock and the duties of servers ensure that.
//!
//! The target is a store of its own, with its own identity and its own objects. A server of the
//! source that somebody starts by mistake cannot sweep them.
//!
//! A backup has the rows of one moment, which a read-only transaction holds. While objects are
//! copied, only objects of checkpoints can vanish, because trainings delete outdated ones. Such a
//! checkpoint is left out of the backup.
//!
//! Tables are listed in the order of their references, and the database is asked for their columns.
//! A table that is not listed is refused. A test compares the catalogues of both databases and
//! needs a value in every column, so none is forgotten.

pub(crate) mod statements;

mod objects;
mod place;
pub(crate) mod rows;
pub(crate) mod tables;

use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::mpsc;

use self::rows::{RowsDigest, Table};
use self::tables::TABLES;
use crate::database::{Scope, Transaction};
use crate::{DutyClaim, Location, S3Options, Store, StoreError};

/// Number of objects that are looked up at once.
const OBJECTS_PER_PAGE: i64 = 1000;

/// The table that names files that may vanish during a backup.
const CHECKPOINT_FILES: &str = "checkpoint_file";

/// Number of batches of rows that are read ahead.
const BATCHES_AHEAD: usize = 2;

/// A move that has been prepared: all checks have passed.
pub struct Transfer {
    source: Side,
    target: Side,
    contents: StoreContents,
    /// Whether the target has the rows already, from an earlier move that was interrupted just
    /// before its end.
    has_rows: bool,
    /// Objects of checkpoints that were deleted after the moment of the backup.
    vanished: Vec<String>,
}

/// One of the two stores, which nobody may change.
struct Side {
    store: Store,
    place: String,
    transaction: Transaction,
    tables: Vec<Table>,
    /// Whether others use it meanwhile.
    is_in_use: bool,
    /// Held to the end.
    _lock: Option<File>,
    _duties: Vec<DutyClaim>,
}

/// The size of a store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreContents {
    /// Number of jobs.
    pub jobs: u64,
    /// Number of rows in all tables that move.
    pub rows: u64,
    /// Number of objects.
    pub objects: u64,
    /// Size of all objects.
    pub bytes: u64,
}

/// The progress of a move. Clones share it.
#[derive(Clone, Debug, Default)]
pub struct TransferProgress(Arc<Done>);

#[derive(Debug, Default)]
struct Done {
    bytes: AtomicU64,
    found: AtomicU64,
    written: AtomicU64,
    compared: AtomicU64,
}

impl Transfer {
    /// Checks that a store can move, and keeps both sides unchanged as long as this lives. `s3` has
    /// the options for buckets on both sides.
    ///
    /// # Errors
    /// When one of them is in use, cannot be opened, has a schema of another version, or shares
    /// something with the other. When the target holds something that is not from an earlier try.
    pub async fn prepare(
        from: &Location,
        to: &Location,
        s3: &S3Options,
    ) -> Result<Self, StoreError> {
        place::refuse_shared(from, to)?;
        let source = place::open_source(from, s3).await?;
        Self::prepare_from(source, from, to, s3).await
    }

    /// Like [`Transfer::prepare`], but copies the state of this moment while servers and workers go
    /// on.
    ///
    /// # Errors
    /// Like [`Transfer::prepare`], but the source may be in use.
    pub async fn prepare_backup(
        from: &Location,
        to: &Location,
        s3: &S3Options,
    ) -> Result<Self, StoreError> {
        place::refuse_shared(from, to)?;
        let source = place::open_snapshot(from, s3).await?;
        Self::prepare_from(source, from, to, s3).await
    }

    async fn prepare_from(
        mut source: Side,
        from: &Location,
        to: &Location,
        s3: &S3Options,
    ) -> Result<Self, StoreError> {
        let source_identity = source.store.identity().await?;
        if place::identity(to).await?.is_some_and(|found| found == source_identity) {
            return Err(place::shared(from, to));
        }
        let mut target = place::open_target(to, s3).await?;
        target.refuse_other_columns(&source)?;
        let contents = source.contents().await?;
        let rows = target.first_content().await?;
        let has_rows = rows.is_some();
        let in_the_way = match target.store.moving_from().await? {
            Some(from) if from == source_identity => None,
            Some(_) => Some("a part of another store".to_owned()),
            None => match rows {
                Some(rows) => Some(rows),
                None => {
                    let first = target.store.objects().first(1).await?.pop();
                    first.map(|path| format!("object {path}"))
                }
            },
        };
        if let Some(found) = in_the_way {
            return Err(StoreError::NotEmpty { place: target.place, found });
        }
        target.store.begin_move(source_identity).await?;
        Ok(Self { source, target, contents, has_rows, vanished: Vec::new() })
    }

    /// The size of the store that moves.
    pub const fn contents(&self) -> StoreContents {
        self.contents
    }

    /// Copies everything, and compares both sides.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when an object differs from what was published.
    /// [`StoreError::RowsDiffer`] when a table differs between the sides. It also fails when a
    /// database, an object or the disk fails. The source is unchanged then, and the target is
    /// unfinished.
    pub async fn run(mut self, progress: &TransferProgress) -> Result<(), StoreError> {
        self.copy_objects(progress).await?;
        for place in 0..TABLES.len() {
            let expected = if self.has_rows {
                self.source.digest(place, &progress.0.written).await?
            } else {
                self.copy_rows(place, progress).await?
            };
            let found = self.target.digest(place, &progress.0.compared).await?;
            if found != expected {
                return Err(self.rows_differ(place, expected, found));
            }
        }
        for path in &self.vanished {
            self.target.transaction.forget_checkpoint_with(path).await?;
        }
        if self.source.is_in_use {
            // These workers work for the source, and not for its copy.
            self.target.transaction.delete_rows("worker").await?;
        }
        self.target.transaction.commit().await?;
        self.target.store.end_move().await?;
        self.source.transaction.roll_back().await?;
        self.target.store.close().await;
        self.source.store.close().await;
        Ok(())
    }

    async fn copy_objects(&mut self, progress: &TransferProgress) -> Result<(), StoreError> {
        let source = &mut self.source;
        let mut tables: Vec<&Table> =
            source.tables.iter().filter(|table| table.has("path")).collect();
        // Trainings delete files of checkpoints, so these are copied first.
        tables.sort_by_key(|table| source.is_in_use && table.name != CHECKPOINT_FILES);
        for table in tables {
            let mut after = String::new();
            loop {
                let objects = objects_after(&mut source.transaction, table.name, &after).await?;
                let Some(last) = objects.last() else { break };
                after.clone_from(&last.path);
                let missing =
                    objects::copy_all(objects, &source.store, &self.target.store, progress).await?;
                for (path, error) in missing {
                    if !source.has_deleted(table.name, &path).await? {
                        return Err(error);
                    }
                    self.vanished.push(path);
                }
            }
        }
        Ok(())
    }

    /// Returns the digest of the rows that were read.
    async fn copy_rows(
        &mut self,
        place: usize,
        progress: &TransferProgress,
    ) -> Result<RowsDigest, StoreError> {
        let (source, target) = (&mut self.source, &mut self.target);
        let (from, to) = (&source.tables[place], &target.tables[place]);
        target.transaction.delete_rows(to.name).await?;
        let (sender, mut receiver) = mpsc::channel(BATCHES_AHEAD);
        let reading = async { source.transaction.send_rows(from, sender).await };
        let writing = async {
            let mut digest = RowsDigest::default();
            while let Some(rows) = receiver.recv().await {
                rows.iter().for_each(|row| digest.add(row));
                target.transaction.insert_rows(to, &rows).await?;
                progress.0.written.fetch_add(rows.len() as u64, Ordering::Relaxed);
            }
            Ok(digest)
        };
        let ((), digest) = tokio::try_join!(reading, writing)?;
        if from.has("id") {
            let last = source.transaction.last_number(from.name).await?;
            if let Some(last) = last {
                target.transaction.set_last_number(to.name, last).await?;
            }
        }
        Ok(digest)
    }

    fn rows_differ(&self, place: usize, expected: RowsDigest, found: RowsDigest) -> StoreError {
        StoreError::RowsDiffer {
            table: TABLES[place],
            source_place: self.source.place.clone(),
            source_rows: expected.rows(),
            target_place: self.target.place.clone(),
            target_rows: found.rows(),
        }
    }
}

async fn objects_after(
    transaction: &mut Transaction,
    table: &'static str,
    path: &str,
) -> Result<Vec<crate::StoredObject>, StoreError> {
    transaction.objects_after(table, path, OBJECTS_PER_PAGE).await
}

impl Side {
    /// Begins a transaction that reads the present state, and keeps reading that state.
    async fn snapshot(store: Store, place: String) -> Result<Self, StoreError> {
        let mut transaction = store.begin_snapshot("copying a store").await?;
        let columns = transaction.columns(&TABLES).await?;
        let tables = tables::tables(columns, &place)?;
        let (lock, duties) = (None, Vec::new());
        Ok(Self {
            store,
            place,
            transaction,
            tables,
            is_in_use: true,
            _lock: lock,
            _duties: duties,
        })
    }

    /// Whether an object is missing because its checkpoint was deleted meanwhile.
    async fn has_deleted(&self, table: &'static str, path: &str) -> Result<bool, StoreError> {
        if !self.is_in_use || table != CHECKPOINT_FILES {
            return Ok(false);
        }
        let is_there =
            self.store.read("looking for a checkpoint").names_object(table, path).await?;
        Ok(!is_there)
    }

    /// Begins a transaction that excludes all other writers.
    async fn keep_still(
        store: Store,
        scope: Scope,
        place: String,
        lock: Option<File>,
        duties: Vec<DutyClaim>,
    ) -> Result<Self, StoreError> {
        let mut transaction = store.begin(scope, "moving a store").await?;
        transaction.keep_still(&TABLES).await?;
        let columns = transaction.columns(&TABLES).await?;
        let tables = tables::tables(columns, &place)?;
        Ok(Self {
            store,
            place,
            transaction,
            tables,
            is_in_use: false,
            _lock: lock,
            _duties: duties,
        })
    }

    async fn contents(&mut self) -> Result<StoreContents, StoreError> {
        let mut contents = StoreContents::default();
        for table in &self.tables {
            let rows = self.transaction.count_rows(table.name).await?;
            contents.rows += rows;
            if table.name == "job" {
                contents.jobs = rows;
            }
            if table.has("path") {
                contents.objects += rows;
                contents.bytes += self.transaction.bytes_of_objects(table.name).await?;
            }
        }
        Ok(contents)
    }

    /// A description of rows that only a store in use has.
    async fn first_content(&mut self) -> Result<Option<String>, StoreError> {
        for name in tables::content_tables() {
            let rows = self.transaction.count_rows(name).await?;
            if rows > 0 {
                return Ok(Some(tables::in_words(name, rows)));
            }
        }
        Ok(None)
    }

    fn refuse_other_columns(&self, other: &Self) -> Result<(), StoreError> {
        for (own, others) in self.tables.iter().zip(&other.tables) {
            let found = own.columns.iter().find(|column| !others.has(&column.name));
            let missing = others.columns.iter().find(|column| !own.has(&column.name));
            let side = if found.is_some() { self } else { other };
            if let Some(column) = found.or(missing) {
                let what = format!("{}.{}", own.name, column.name);
                return Err(StoreError::UnknownTable { place: side.place.clone(), what });
            }
        }
        Ok(())
    }

    async fn digest(&mut self, place: usize, done: &AtomicU64) -> Result<RowsDigest, StoreError> {
        let (sender, mut receiver) = mpsc::channel(BATCHES_AHEAD);
        let table = &self.tables[place];
        let reading = async { self.transaction.send_rows(table, sender).await };
        let adding = async {
            let mut digest = RowsDigest::default();
            while let Some(rows) = receiver.recv().await {
                rows.iter().for_each(|row| digest.add(row));
                done.fetch_add(rows.len() as u64, Ordering::Relaxed);
            }
            Ok(digest)
        };
        let ((), digest) = tokio::try_join!(reading, adding)?;
        Ok(digest)
    }
}

impl TransferProgress {
    /// Bytes of objects in the target so far.
    pub fn bytes(&self) -> u64 {
        self.0.bytes.load(Ordering::Relaxed)
    }

    /// Objects that an earlier try had copied.
    pub fn found(&self) -> u64 {
        self.0.found.load(Ordering::Relaxed)
    }

    /// Rows copied so far.
    pub fn rows(&self) -> u64 {
        self.0.written.load(Ordering::Relaxed)
    }

    /// Rows of the target compared with the source so far.
    pub fn compared(&self) -> u64 {
        self.0.compared.load(Ordering::Relaxed)
    }

    fn add_bytes(&self, bytes: u64) {
        self.0.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    fn add_found(&self, bytes: u64) {
        self.add_bytes(bytes);
        self.0.found.fetch_add(1, Ordering::Relaxed);
    }
}
