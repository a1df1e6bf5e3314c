//! A store moves to another place: from the data folder to PostgreSQL, or back. Or it is copied while it is used: a backup.
//!
//! Objects go first, and then all rows in one transaction, so that the target has everything or no jobs at all. Until it
//! has, a mark among its objects (`store::identity`) says so: no server serves it, and the move can be done again. Both
//! stores are kept still by their own means: by their transactions, the folder's lock, and the duties of servers.
//!
//! The target is a store of its own, with another identity and with objects of its own: a server of the source
//! that somebody starts by mistake cannot sweep them.
//!
//! A backup has the rows of one moment, which a transaction that only reads keeps. Of the objects that they name those of
//! checkpoints alone may vanish before they are copied, since trainings delete outdated ones; such a checkpoint is left
//! out of the backup.

mod objects;
mod place;
pub(crate) mod rows;
pub(crate) mod tables;

use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::mpsc;

use self::rows::{RowsDigest, Table};
use self::tables::{NEVER_EMPTY, TABLES};
use crate::database::{Scope, Transaction, sql};
use crate::{DutyClaim, Location, S3Options, Store, StoreError};

/// Objects that are looked up at once.
const OBJECTS_PER_PAGE: i64 = 1000;

/// The table that names files which vanish while a backup is made.
const CHECKPOINT_FILES: &str = "checkpoint_file";

/// Batches of rows that have been read and wait to be written.
const BATCHES_AHEAD: usize = 2;

/// A move that has been prepared: nothing stands in its way.
pub struct Transfer {
    source: Side,
    target: Side,
    contents: StoreContents,
    /// Whether the rows are in the target already, from a move that ended just before it was finished.
    has_rows: bool,
    /// Objects of checkpoints that were deleted since the source's moment.
    vanished: Vec<String>,
}

/// A store that is kept as it is.
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

/// How much a store holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreContents {
    pub jobs: u64,
    /// In all tables that move.
    pub rows: u64,
    pub objects: u64,
    /// In all objects.
    pub bytes: u64,
}

/// How far a move is. Clones share it.
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
    /// Looks whether a store can move, and keeps both sides still for as long as this lives. Buckets of both are reached as
    /// `s3` says.
    ///
    /// # Errors
    /// When one of them is used, cannot be opened, has a schema of another version, or shares something with the other; when
    /// the target holds something already that is not of an earlier try.
    pub async fn prepare(
        from: &Location,
        to: &Location,
        s3: &S3Options,
    ) -> Result<Self, StoreError> {
        place::refuse_shared(from, to)?;
        let source = place::open_source(from, s3).await?;
        Self::prepare_from(source, from, to, s3).await
    }

    /// The same as a copy of what is there at this moment, while servers and workers go on.
    ///
    /// # Errors
    /// As [`Transfer::prepare`], but for the use of the source.
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
        if place::identity(to, s3).await?.is_some_and(|found| found == source_identity) {
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
                None => target.store.objects().any().await?.map(|path| format!("object {path}")),
            },
        };
        if let Some(found) = in_the_way {
            return Err(StoreError::NotEmpty { place: target.place, found });
        }
        target.store.begin_move(source_identity).await?;
        Ok(Self { source, target, contents, has_rows, vanished: Vec::new() })
    }

    pub const fn contents(&self) -> StoreContents {
        self.contents
    }

    /// Copies everything, and compares both sides.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when an object is not what was published; [`StoreError::RowsDiffer`] when a table is
    /// not the same on both sides; when a database, an object or the disk fails. The source is as it was, and the target
    /// is unfinished.
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
            sql!(&mut self.target.transaction, forget_checkpoint_with(path))?;
        }
        if self.source.is_in_use {
            // They work for the source, and not for its copy.
            sql!(&mut self.target.transaction, delete_rows("worker"))?;
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
        // Trainings delete files of checkpoints, so that these cannot wait for the others.
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

    /// Returns the digest of what was read.
    async fn copy_rows(
        &mut self,
        place: usize,
        progress: &TransferProgress,
    ) -> Result<RowsDigest, StoreError> {
        let (source, target) = (&mut self.source, &mut self.target);
        let (from, to) = (&source.tables[place], &target.tables[place]);
        sql!(&mut target.transaction, delete_rows(to.name))?;
        let (sender, mut receiver) = mpsc::channel(BATCHES_AHEAD);
        let reading = async { sql!(&mut source.transaction, send_rows(from, sender)) };
        let writing = async {
            let mut digest = RowsDigest::default();
            while let Some(rows) = receiver.recv().await {
                rows.iter().for_each(|row| digest.add(row));
                sql!(&mut target.transaction, insert_rows(to, &rows))?;
                progress.0.written.fetch_add(rows.len() as u64, Ordering::Relaxed);
            }
            Ok(digest)
        };
        let ((), digest) = tokio::try_join!(reading, writing)?;
        if from.has("id") {
            let last = sql!(&mut source.transaction, last_number(from.name))?;
            if let Some(last) = last {
                sql!(&mut target.transaction, set_last_number(to.name, last))?;
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
    sql!(transaction, objects_after(table, path, OBJECTS_PER_PAGE))
}

impl Side {
    /// Begins a transaction that reads what is there now, and goes on doing so.
    async fn snapshot(store: Store, place: String) -> Result<Self, StoreError> {
        let mut transaction = store.begin_snapshot("copying a store").await?;
        let columns = sql!(&mut transaction, columns(&TABLES))?;
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
            sql!(self.store.database(), "looking for a checkpoint", names_object(table, path))?;
        Ok(!is_there)
    }

    /// Begins a transaction that nobody else writes beside.
    async fn keep_still(
        store: Store,
        scope: Scope,
        place: String,
        lock: Option<File>,
        duties: Vec<DutyClaim>,
    ) -> Result<Self, StoreError> {
        let mut transaction = store.begin(scope, "moving a store").await?;
        sql!(&mut transaction, keep_still(&TABLES))?;
        let columns = sql!(&mut transaction, columns(&TABLES))?;
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
            let rows = sql!(&mut self.transaction, count_rows(table.name))?;
            contents.rows += rows;
            if table.name == "job" {
                contents.jobs = rows;
            }
            if table.has("path") {
                contents.objects += rows;
                contents.bytes += sql!(&mut self.transaction, bytes_of_objects(table.name))?;
            }
        }
        Ok(contents)
    }

    /// Rows that a store has which was used.
    async fn first_content(&mut self) -> Result<Option<String>, StoreError> {
        for name in TABLES.into_iter().filter(|name| !NEVER_EMPTY.contains(name)) {
            let rows = sql!(&mut self.transaction, count_rows(name))?;
            if rows > 0 {
                let plural = if rows == 1 { "" } else { "s" };
                return Ok(Some(format!("{rows} {}{plural}", name.replace('_', " "))));
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
        let reading = async { sql!(&mut self.transaction, send_rows(table, sender)) };
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
    /// Bytes of objects that are in the target.
    pub fn bytes(&self) -> u64 {
        self.0.bytes.load(Ordering::Relaxed)
    }

    /// Objects that an earlier try had copied.
    pub fn found(&self) -> u64 {
        self.0.found.load(Ordering::Relaxed)
    }

    /// Rows that were copied.
    pub fn rows(&self) -> u64 {
        self.0.written.load(Ordering::Relaxed)
    }

    /// Rows of the target that were compared with those of the source.
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
