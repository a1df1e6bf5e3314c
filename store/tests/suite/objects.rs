use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;
use std::time::Duration;

use arrow_array::{ArrayRef, Float32Array, Int32Array, RecordBatch};
use bytes::Bytes;
use futures::TryStreamExt;
use spec::{Column, ColumnType, Digest};
use store::{STEP, StoredObject, TRAJECTORY, TableWriter, table_schema};

use super::{Fixture, simulate};

fn bytes(length: usize) -> Bytes {
    (0..length).map(|i| u8::try_from(i % 251).unwrap()).collect()
}

async fn download(f: &Fixture, path: &str, range: Option<std::ops::Range<u64>>) -> Vec<u8> {
    let object = f.store.open_object(path, range.clone()).await.unwrap();
    assert_eq!(object.range, range.unwrap_or(0..object.size));
    object.stream.try_collect::<Vec<Bytes>>().await.unwrap().concat()
}

pub async fn an_object_is_downloaded_whole_or_in_part(f: Fixture) {
    let data = bytes(1_000_000);
    let object = f.store.put_object("a/b", data.clone()).await.unwrap();
    assert_eq!((object.size, object.sha256), (1_000_000, Digest::of(&data)));
    assert_eq!(download(&f, "a/b", None).await, data);
    assert_eq!(download(&f, "a/b", Some(300_000..700_001)).await, data[300_000..700_001]);
    assert!(f.store.open_object("a/absent", None).await.is_err());
    assert!(f.store.open_object("../outside", None).await.is_err());
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
        tokio::runtime::Handle::current()
            .block_on(async { assert!(store.open_object(&early, None).await.is_err()) });
        writer.finish().unwrap()
    })
    .await
    .unwrap();
    assert_eq!((object.size, object.sha256), (20_000_000, Digest::of(&expected)));
    assert_eq!(f.store.read_object(&object).await.unwrap(), expected);
}

pub async fn damaged_bytes_are_refused(f: Fixture) {
    let object = f.store.put_object("a/b", "right".into()).await.unwrap();
    f.store.put_object("a/b", "wrong".into()).await.unwrap();
    assert!(f.store.read_object(&object).await.is_err());
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
    let names = std::fs::read_dir(f._dir.path().join("objects")).unwrap();
    let names = names.map(|it| it.unwrap().file_name()).filter(|it| it != "a");
    assert_eq!(names.count(), 0, "a copy has no name");

    let absent = StoredObject { path: "a/absent".to_owned(), ..object };
    assert!(f.store.open_table(&absent).unwrap_err().is_missing_file());
    let other = StoredObject { sha256: Digest::of(b"other"), ..object };
    assert!(f.store.open_table(&other).unwrap_err().to_string().contains("checking"));
}

pub async fn what_was_published_but_not_committed_is_swept(f: Fixture) {
    f.submit_one(simulate(1)).await;
    let committed = f.must_claim().await;
    let shard = f.publish_shard(&committed).await;
    f.store.commit_shard(committed.fence, &shard, None).await.unwrap();
    let killed = f.must_claim().await;
    let orphan = f.publish_shard(&killed).await;
    let unfinished = f.store.write_object("datasets/1/unfinished").await.unwrap();
    std::mem::forget(unfinished);

    assert_eq!(f.store.sweep_orphans(Duration::from_secs(3600)).await.unwrap(), 0, "too young");
    assert!(f.store.read_object(&orphan.robots).await.is_ok());
    tokio::time::sleep(Duration::from_millis(20)).await;
    assert_eq!(f.store.sweep_orphans(Duration::ZERO).await.unwrap(), 3);
    assert!(f.store.read_object(&orphan.robots).await.is_err());
    assert!(f.store.read_object(&shard.robots).await.is_ok());
    assert!(f.store.read_object(&shard.trajectories).await.is_ok());
}
