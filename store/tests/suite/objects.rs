use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;
use std::time::Duration;

use arrow_array::{ArrayRef, Float32Array, Int32Array, RecordBatch};
use bytes::Bytes;
use futures::TryStreamExt;
use object_store::ObjectStoreExt;
use spec::{Column, ColumnType, Digest};
use store::{
    Epoch, FileContent, GarbageKind, JobId, Ripe, STEP, StoreError, StoredObject, Sweeper,
    TRAJECTORY, TableWriter, object_path, table_schema,
};

use super::{Fixture, simulate};

fn bytes(length: usize) -> Bytes {
    (0..length).map(|i| u8::try_from(i % 251).unwrap()).collect()
}

async fn download(
    f: &Fixture,
    object: &StoredObject,
    range: Option<std::ops::Range<u64>>,
) -> Result<Vec<u8>, StoreError> {
    let bytes = f.store.open_object(object, range.clone()).await?;
    assert_eq!(bytes.range, range.unwrap_or(0..object.size));
    Ok(bytes.stream.try_collect::<Vec<Bytes>>().await?.concat())
}

pub async fn an_object_is_downloaded_whole_or_in_part(f: Fixture) {
    let data = bytes(1_000_000);
    let object = f.store.put_object("a/b", data.clone()).await.unwrap();
    assert_eq!((object.size, object.sha256), (1_000_000, Digest::of(&data)));
    assert_eq!(download(&f, &object, None).await.unwrap(), data);
    let part = download(&f, &object, Some(300_000..700_001)).await.unwrap();
    assert_eq!(part, data[300_000..700_001]);
    for path in ["a/absent", "../outside"] {
        let absent = StoredObject { path: path.to_owned(), ..object.clone() };
        assert!(f.store.open_object(&absent, None).await.is_err());
    }
}

pub async fn an_object_written_in_pieces_appears_when_finished(f: Fixture) {
    let data = bytes(20_000_000);
    let mut writer = f.store.write_object("a/big").await.unwrap();
    let expected = data.clone();
    let store = f.store.clone();
    let object = tokio::task::spawn_blocking(move || {
        for piece in data.chunks(777_777) {
            writer.write_all(piece).unwrap();
        }
        let early = writer.path().to_owned();
        assert!(store.measure_object(&early).is_err());
        writer.finish().unwrap()
    })
    .await
    .unwrap();
    assert_eq!((object.size, object.sha256), (20_000_000, Digest::of(&expected)));
    assert_eq!(f.store.read_object(&object).await.unwrap(), expected);
}

pub async fn damaged_bytes_are_refused(f: Fixture) {
    let object = f.store.put_object("a/b", "right".into()).await.unwrap();
    f.damage("a/b", "wrong".into()).await;
    let error = f.store.read_object(&object).await.unwrap_err();
    assert!(matches!(error, StoreError::DamagedObject { .. }), "{error}");
    let (expected, found) = (Digest::of(b"right"), Digest::of(b"wrong"));
    let says = format!("object a/b is damaged: expected SHA-256 {expected}, found SHA-256 {found}");
    assert_eq!(error.to_string(), says);
}

/// Caught: damaged bytes were sent completely, under the digest of the published bytes.
pub async fn the_last_bytes_of_a_damaged_object_are_never_sent(f: Fixture) {
    let data = bytes(1_000_000);
    let object = f.store.put_object("a/b", data.clone()).await.unwrap();
    let mut damaged = data.to_vec();
    damaged[10] ^= 1;
    f.damage("a/b", damaged.clone().into()).await;
    let mut stream = f.store.open_object(&object, None).await.unwrap().stream;
    let mut sent = 0;
    let error = loop {
        match stream.try_next().await {
            Ok(piece) => sent += piece.expect("an error before the end").len(),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, StoreError::DamagedObject { .. }), "{error}");
    assert!(sent < data.len(), "all {sent} bytes were sent");
    for range in [None, Some(0..1_000_000), Some(500..600)] {
        let error = download(&f, &object, range).await.unwrap_err();
        assert!(matches!(error, StoreError::DamagedObject { .. }), "{error}");
    }
    assert!(f.store.look_up_object(&object).await.is_err());

    tokio::time::sleep(Duration::from_millis(20)).await;
    f.damage("a/b", data.clone()).await;
    assert_eq!(download(&f, &object, None).await.unwrap(), data, "restored");
}

pub async fn an_object_of_another_size_is_refused_before_its_first_byte(f: Fixture) {
    let object = f.store.put_object("a/b", bytes(1000)).await.unwrap();
    f.damage("a/b", bytes(999)).await;
    for range in [None, Some(0..10), Some(998..1000)] {
        let error = f.store.open_object(&object, range).await.err().expect("another size");
        assert!(error.to_string().ends_with("expected 1000 bytes, found 999 bytes"), "{error}");
    }
    assert!(f.store.look_up_object(&object).await.is_err());
}

pub async fn the_first_range_of_an_object_has_all_of_it_checked(f: Fixture) {
    let data = bytes(1_000_000);
    let object = f.store.put_object("a/b", data.clone()).await.unwrap();
    let mut damaged = data.to_vec();
    damaged[999_999] ^= 1;
    f.damage("a/b", damaged.into()).await;
    assert_eq!(download(&f, &object, Some(0..10)).await.unwrap(), data[..10]);
    let started = std::time::Instant::now();
    while f.store.look_up_object(&object).await.is_ok() {
        assert!(started.elapsed() < Duration::from_secs(30), "nobody checked it");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    assert!(download(&f, &object, Some(0..10)).await.is_err());
}

pub async fn a_table_is_written_and_read_wherever_it_lies(f: Fixture) {
    let u1 = Column::new("u1", ColumnType::Float32, "a channel");
    let schema = table_schema(&[Column::trajectory(), Column::step(), u1]);
    let (ids, steps) = (vec![0, 0, 1, 1], vec![0, 1, 0, 1]);
    let columns: [ArrayRef; 3] = [
        Arc::new(Int32Array::from(ids)),
        Arc::new(Int32Array::from(steps)),
        Arc::new(Float32Array::from(vec![0.5, 1.5, 2.5, 3.5])),
    ];
    let batch = RecordBatch::try_new(schema.clone(), columns.to_vec()).unwrap();
    let footer = BTreeMap::new();
    let object = f.store.write_object("a/table").await.unwrap();
    let mut writer = TableWriter::trajectories(object, schema, 2, &footer).unwrap();
    let rows = batch.clone();
    let written = tokio::task::spawn_blocking(move || {
        writer.write(rows).unwrap();
        writer.finish().unwrap()
    });
    let object = written.await.unwrap();
    assert_eq!(f.store.measure_object("a/table").unwrap(), object);

    let table = f.store.open_table(&object).unwrap();
    let names = [TRAJECTORY, STEP, "u1"];
    assert_eq!(table.read_row_group(0, &names).unwrap().columns(), batch.columns());
    assert!(f.store.open_unchecked(&object).is_ok());
    let names = std::fs::read_dir(f.dir.path().join("objects")).unwrap();
    let names = names
        .map(|entry| entry.unwrap().file_name())
        .filter(|name| name != "a" && name != "store.json");
    assert_eq!(names.count(), 0, "a copy lies elsewhere");

    let other = StoredObject { sha256: Digest::of(b"other"), ..object };
    let absent = StoredObject { path: "a/absent".to_owned(), ..other };
    assert!(f.store.open_table(&absent).unwrap_err().is_missing_file());
    let error = f.store.open_table(&other).unwrap_err();
    assert!(matches!(error, StoreError::DamagedObject { .. }), "{error}");
}

pub async fn what_a_killed_worker_left_half_written_is_swept(f: Fixture) {
    let path = object_path::shard(JobId(1), 0, Epoch(1), FileContent::Robots);
    let folder = f.dir.path().join("objects");
    let left = folder.join(format!("{path}#0"));
    std::fs::create_dir_all(left.parent().unwrap()).unwrap();
    std::fs::write(&left, "half").unwrap();
    let upload = folder.join("uploads/upload-1-2-3#1");
    std::fs::create_dir_all(upload.parent().unwrap()).unwrap();
    std::fs::write(&upload, "ha").unwrap();
    let alive = f.store.write_object("datasets/2/shard-00000-e1-robots.parquet").await.unwrap();
    check_unfinished(&f, 2, 6).await;
    assert!(!left.exists() && !upload.exists());
    alive.finish().unwrap();
}

pub async fn what_a_killed_process_left_of_a_copy_is_swept(f: Fixture) {
    let cache = f.dir.path().join("cache");
    let digest = Digest::of(b"copy");
    for (name, bytes) in [(format!("{digest}.part"), "half"), ("new-1-2-3.part".to_owned(), "ha")] {
        std::fs::write(cache.join(name), bytes).unwrap();
    }
    std::fs::write(cache.join("thesis.part"), "mine").unwrap();
    let alive = f.store.write_object("datasets/2/shard-00000-e1-robots.parquet").await.unwrap();
    check_unfinished(&f, 2, 6).await;
    assert!(cache.join("thesis.part").exists());
    drop(alive);
}

/// Checks that so many unfinished files of so many bytes are foretold, and then deleted.
async fn check_unfinished(f: &Fixture, files: u64, bytes: u64) {
    const HOUR: Duration = Duration::from_secs(3600);
    let ripe = Ripe::AtItsDate { leap: Duration::ZERO };
    assert_eq!(f.store.garbage(ripe, HOUR).await.unwrap(), [], "too young");
    tokio::time::sleep(Duration::from_millis(20)).await;
    let foretold = f.store.garbage(ripe, Duration::ZERO).await.unwrap();
    let found: Vec<_> = foretold.iter().map(|left| (&left.kind, left.files, left.bytes)).collect();
    assert_eq!(found, [(&GarbageKind::Unfinished, files, bytes)]);
    assert_eq!(f.store.collect_garbage(ripe, Duration::ZERO).await.unwrap(), foretold);
    assert_eq!(f.store.garbage(ripe, Duration::ZERO).await.unwrap(), []);
}

/// Caught: a server deleted the files of others that lay at its place, and other stores.
pub async fn only_what_torqued_makes_is_swept_and_only_after_it_was_named(f: Fixture) {
    let orphan = object_path::shard(JobId(7), 0, Epoch(1), FileContent::Robots);
    f.store.put_object(&orphan, "nobody's".into()).await.unwrap();
    let others = [
        "ball.obj",
        "meshes/link1.stl",
        "lab/store.json",
        "lab/datasets/1/shard-00000-e1-robots.parquet",
        "datasets/1/notes.md",
        "datasets/panda/shard-00000-e1-robots.parquet",
        "uploads/upload-of-a-colleague",
        "runs/1/events.log",
    ];
    for other in others {
        f.objects.put(&other.into(), "mine".into()).await.unwrap();
    }
    // Some stores round times to seconds.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    let mut sweeper = Sweeper::new(f.store.clone());
    let first = sweeper.sweep(Duration::ZERO).await.unwrap();
    assert_eq!((first.deleted, first.bytes), (0, 8));
    assert_eq!(first.announced, std::slice::from_ref(&orphan));
    assert!(f.objects.head(&orphan.as_str().into()).await.is_ok());
    let late = object_path::shard(JobId(7), 1, Epoch(1), FileContent::Robots);
    f.store.put_object(&late, "late".into()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(1100)).await;
    let second = sweeper.sweep(Duration::ZERO).await.unwrap();
    assert_eq!((second.deleted, second.announced), (1, vec![late]));
    assert!(f.objects.head(&orphan.as_str().into()).await.is_err());
    assert_eq!(sweeper.sweep(Duration::ZERO).await.unwrap().deleted, 1);
    for other in others {
        let found = f.objects.get(&other.into()).await.unwrap().bytes().await.unwrap();
        assert_eq!(found, "mine", "{other}");
    }
}

/// The disk is unmounted, or the bucket emptied, while the store is open.
pub async fn a_place_without_its_mark_is_neither_written_nor_swept(f: Fixture) {
    let mark = f.objects.get(&"store.json".into()).await.unwrap().bytes().await.unwrap();
    let orphan = object_path::shard(JobId(7), 0, Epoch(1), FileContent::Robots);
    f.store.put_object(&orphan, "nobody's".into()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(1100)).await;
    let mut sweeper = Sweeper::new(f.store.clone());
    let other = format!("{{\"store\": \"{}\"}}", "ab".repeat(16));
    for found in [None, Some(Bytes::from(other))] {
        match found {
            None => f.objects.delete(&"store.json".into()).await.unwrap(),
            Some(found) => {
                f.objects.put(&"store.json".into(), found.into()).await.unwrap();
            }
        }
        let refused = [
            sweeper.sweep(Duration::ZERO).await.map(drop),
            f.store.collect_garbage(Ripe::After(Duration::ZERO), Duration::ZERO).await.map(drop),
            f.store.put_object("datasets/1/a", "a".into()).await.map(drop),
            f.store.write_object("datasets/1/a").await.map(drop),
            f.store.begin_upload().await.map(drop),
        ];
        for refused in refused {
            let error = refused.unwrap_err();
            assert!(matches!(error, StoreError::Displaced { .. }), "{error}");
        }
        assert!(f.store.obstacle().unwrap().contains("store.json"));
        assert!(f.objects.head(&orphan.as_str().into()).await.is_ok());
    }
    f.objects.put(&"store.json".into(), mark.into()).await.unwrap();
    assert_eq!(sweeper.sweep(Duration::ZERO).await.unwrap().announced, [orphan]);
    assert_eq!(f.store.obstacle(), None);
    f.store.put_object("datasets/1/a", "a".into()).await.unwrap();
}

pub async fn what_was_published_but_not_committed_is_swept(f: Fixture) {
    f.submit_one(simulate(1)).await;
    let committed = f.must_claim().await;
    let shard = f.publish_shard(&committed).await;
    f.store.commit_shard(committed.fence, &shard, None).await.unwrap();
    let killed = f.must_claim().await;
    let orphan = f.publish_shard(&killed).await;
    assert_eq!(f.sweep(Duration::from_secs(3600)).await, 0, "too young");
    assert!(f.store.read_object(&orphan.robots).await.is_ok());
    // Some stores round times to seconds.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    assert_eq!(f.sweep(Duration::ZERO).await, 2);
    assert!(f.store.read_object(&orphan.robots).await.is_err());
    assert!(f.store.read_object(&shard.robots).await.is_ok());
    assert!(f.store.read_object(&shard.trajectories).await.is_ok());
}
