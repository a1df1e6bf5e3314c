//! The layout of tables in Parquet files, and reading them back.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, BooleanArray, Float32Array, Float64Array, Int32Array, Int64Array, RecordBatch,
    StringArray,
};
use arrow_schema::SchemaRef;
use parquet::basic::{Compression, Encoding, Type};
use parquet::file::reader::{FileReader, SerializedFileReader};
use spec::{Column, ColumnType, Digest};
use store::{
    Access, ShardContents, Store, StoreError, StoredObject, TableWriter, table_schema,
    trajectories_per_row_group,
};
use tempfile::TempDir;

const CHANNELS: [&str; 3] = ["u1", "u2", "q1"];
/// 40 trajectories share a row group.
const SAMPLES: u32 = 5000;

async fn store() -> (Store, TempDir) {
    let dir = tempfile::tempdir().unwrap();
    (Store::open(dir.path(), Access::Server).await.unwrap(), dir)
}

fn schema() -> SchemaRef {
    let channels = CHANNELS.map(|name| Column::new(name, ColumnType::Float32, "a channel"));
    let columns: Vec<Column> =
        [Column::trajectory(), Column::step()].into_iter().chain(channels).collect();
    table_schema(&columns)
}

/// Any value that depends on all three and is not smooth.
fn value(trajectory: i32, step: i32, channel: usize) -> f32 {
    let mixed = u32::try_from(trajectory * 31 + step * 17).unwrap();
    let mixed = mixed.wrapping_mul(2_654_435_761u32.wrapping_shr(7));
    f32::from_bits(0x3f00_0000 | (mixed & 0x007f_ffff)) + f32::from(u8::try_from(channel).unwrap())
}

fn trajectories(range: std::ops::Range<i32>) -> RecordBatch {
    let samples = i32::try_from(SAMPLES).unwrap();
    let rows = || range.clone().flat_map(move |i| (0..samples).map(move |step| (i, step)));
    let ids: [ArrayRef; 2] = [
        Arc::new(rows().map(|(i, _)| i).collect::<Int32Array>()),
        Arc::new(rows().map(|(_, step)| step).collect::<Int32Array>()),
    ];
    let channels = (0..CHANNELS.len()).map(|c| -> ArrayRef {
        Arc::new(rows().map(|(i, step)| value(i, step, c)).collect::<Float32Array>())
    });
    let columns = ids.into_iter().chain(channels).collect();
    RecordBatch::try_new(schema(), columns).unwrap()
}

fn footer() -> BTreeMap<String, String> {
    [("spec", "{}"), ("digest", "abc"), ("units", "rad")]
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .into()
}

/// Writes `batches` as one file.
async fn write(store: &Store, path: &str, batches: Vec<RecordBatch>) -> StoredObject {
    let object = store.write_object(path).await.unwrap();
    let mut writer = TableWriter::trajectories(object, schema(), SAMPLES, &footer()).unwrap();
    tokio::task::spawn_blocking(move || {
        for batch in batches {
            writer.write(batch).unwrap();
        }
        writer.finish().unwrap()
    })
    .await
    .unwrap()
}

fn shard(first: u64, count: u64, file: StoredObject) -> ShardContents {
    ShardContents { first, count, rejected: 0, robots: file.clone(), trajectories: file }
}

#[tokio::test]
async fn trajectories_come_back_bit_for_bit() {
    let (store, _dir) = store().await;
    let object = write(&store, "a.parquet", vec![trajectories(10..110)]).await;
    let reader = store.open_shard(&shard(10, 100, object)).unwrap();
    assert_eq!(reader.row_groups(), [10..50, 50..90, 90..110]);
    assert_eq!(reader.samples(), 5000);

    let columns = ["q1", "trajectory", "u2"];
    let group = reader.read_row_group(1, &columns).unwrap();
    let names: Vec<_> = group.schema().fields().iter().map(|field| field.name().clone()).collect();
    assert_eq!(names, columns);
    assert_eq!(group, trajectories(50..90).project(&[4, 0, 3]).unwrap());

    let all = ["trajectory", "step", "u1", "u2", "q1"];
    assert_eq!(reader.read_trajectories(48..93, &all).unwrap(), trajectories(48..93));
    let one = reader.read_trajectories(109..110, &["trajectory"]).unwrap();
    assert_eq!(one.num_rows(), 5000);
    assert_eq!(one.column(0).as_primitive::<Int32Type>().value(0), 109);
}

#[tokio::test]
async fn a_file_is_laid_out_for_compression_and_for_training() {
    let (store, _dir) = store().await;
    let object = write(&store, "a.parquet", vec![trajectories(0..100)]).await;
    let bytes = store.read_object(&object).await.unwrap();
    let file = SerializedFileReader::new(bytes).unwrap();
    let metadata = file.metadata();
    let rows: Vec<_> = metadata.row_groups().iter().map(|group| group.num_rows()).collect();
    assert_eq!(trajectories_per_row_group(SAMPLES), 40);
    assert_eq!(rows, [200_000, 200_000, 100_000]);
    for group in metadata.row_groups() {
        for column in group.columns() {
            let expected = match column.column_type() {
                Type::INT32 => Encoding::DELTA_BINARY_PACKED,
                Type::FLOAT => Encoding::BYTE_STREAM_SPLIT,
                other => panic!("{other} in trajectories"),
            };
            let encodings: Vec<_> = column.encodings().collect();
            assert!(encodings.contains(&expected), "{encodings:?}");
            assert!(!encodings.contains(&Encoding::RLE_DICTIONARY), "{encodings:?}");
            assert!(column.dictionary_page_offset().is_none());
            assert!(matches!(column.compression(), Compression::ZSTD(_)));
        }
    }
    let mut pages = file.get_row_group(0).unwrap().get_column_page_reader(2).unwrap();
    let page = pages.get_next_page().unwrap().unwrap();
    assert!((16_000..=17_000).contains(&page.num_values()), "64 KiB of f32");

    let file_metadata = metadata.file_metadata();
    assert_eq!(
        file_metadata.created_by(),
        Some(concat!("torqued version ", env!("CARGO_PKG_VERSION")))
    );
    let footer: Vec<_> = file_metadata
        .key_value_metadata()
        .unwrap()
        .iter()
        .map(|entry| (entry.key.as_str(), entry.value.as_deref().unwrap()))
        .collect();
    assert_eq!(footer, [("digest", "abc"), ("spec", "{}"), ("units", "rad")]);
}

#[tokio::test]
async fn the_same_rows_give_the_same_bytes_however_they_come() {
    let (store, _dir) = store().await;
    let whole = write(&store, "whole.parquet", vec![trajectories(0..100)]).await;
    let parts = [0..1, 1..39, 39..41, 41..41, 41..97, 97..100].map(trajectories);
    let parts = write(&store, "parts.parquet", parts.to_vec()).await;
    assert_eq!(whole.sha256, parts.sha256);
    let again = write(&store, "again.parquet", vec![trajectories(0..100)]).await;
    assert_eq!(whole.sha256, again.sha256);
    let bytes = store.read_object(&whole).await.unwrap();
    assert_eq!((Digest::of(&bytes), bytes.len() as u64), (whole.sha256, whole.size));
}

#[tokio::test]
async fn any_table_with_a_row_per_trajectory_can_be_kept() {
    let (store, _dir) = store().await;
    let table = RecordBatch::try_from_iter([
        ("trajectory", Arc::new(Int64Array::from(vec![0, 1])) as ArrayRef),
        ("family", Arc::new(StringArray::from(vec!["chirp", "multisine"]))),
        ("mass", Arc::new(Float64Array::from(vec![2.5, 2.75]))),
        ("kept", Arc::new(BooleanArray::from(vec![true, false]))),
    ])
    .unwrap();
    let mut writer = store.write_table("r.parquet", table.schema(), &footer()).await.unwrap();
    let expected = table.clone();
    let object = tokio::task::spawn_blocking(move || {
        writer.write(table).unwrap();
        writer.finish().unwrap()
    })
    .await
    .unwrap();
    let bytes = store.read_object(&object).await.unwrap();
    let read: Vec<_> =
        parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder::try_new(bytes)
            .unwrap()
            .build()
            .unwrap()
            .collect::<Result<_, _>>()
            .unwrap();
    assert_eq!(read[0].columns(), expected.columns());
}

#[tokio::test]
async fn a_file_that_is_not_what_its_row_says_is_an_error() {
    let (store, _dir) = store().await;
    let object = write(&store, "a.parquet", vec![trajectories(0..10)]).await;
    let error = store.open_shard(&shard(0, 7, object.clone())).unwrap_err();
    assert_eq!(error.to_string(), "Parquet file a.parquet failed while opening");
    let reader = store.open_shard(&shard(0, 10, object.clone())).unwrap();
    assert!(reader.read_row_group(5, &["u1"]).is_err());
    assert!(reader.read_row_group(0, &["u9"]).is_err());
    assert!(reader.read_trajectories(10..11, &["u1"]).is_err());

    let bytes = store.read_object(&object).await.unwrap();
    let cut = store.put_object("cut.parquet", bytes.slice(..bytes.len() / 2)).await.unwrap();
    assert!(store.open_shard(&shard(0, 10, cut)).is_err());
    let missing = StoredObject { path: "missing.parquet".into(), ..object };
    assert!(store.open_shard(&shard(0, 10, missing)).is_err());
}

/// The Parquet decoder panics on some damaged pages and reads others as if they were intact.
#[tokio::test]
async fn a_file_with_any_bit_changed_is_refused_before_it_is_decoded() {
    let (store, _dir) = store().await;
    let object = write(&store, "a.parquet", vec![trajectories(0..10)]).await;
    let bytes = store.read_object(&object).await.unwrap();
    for position in (0..bytes.len()).step_by(bytes.len() / 50) {
        let mut changed = bytes.to_vec();
        changed[position] ^= 1;
        let changed = store.put_object("changed.parquet", changed.into()).await.unwrap();
        let tampered = StoredObject { sha256: object.sha256, ..changed };
        let error = store.open_shard(&shard(0, 10, tampered)).unwrap_err();
        assert!(matches!(error, StoreError::DamagedObject { .. }), "byte {position}: {error}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_file_that_is_not_finished_leaves_nothing() {
    let (store, dir) = store().await;
    let object = store.write_object("d/a.parquet").await.unwrap();
    let mut writer = TableWriter::trajectories(object, schema(), SAMPLES, &footer()).unwrap();
    tokio::task::spawn_blocking(move || {
        writer.write(trajectories(0..50)).unwrap();
        drop(writer);
    })
    .await
    .unwrap();
    tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    assert!(store.measure_object("d/a.parquet").is_err());
    assert_eq!(std::fs::read_dir(dir.path().join("objects/d")).unwrap().count(), 0);
}
