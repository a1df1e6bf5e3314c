//! Faulty Parquet files.

use std::sync::Arc;

use ::parquet::basic::{Compression, Encoding, GzipLevel, ZstdLevel};
use ::parquet::file::properties::{WriterProperties, WriterVersion};
use ::parquet::schema::types::ColumnPath;
use arrow_array::types::Int32Type;
use arrow_array::{
    Array, ArrayRef, BinaryArray, Float64Array, Int64Array, ListArray, TimestampMillisecondArray,
    UInt64Array,
};
use serde_json::json;

use super::{Recordings, check_refused, error, import, ints, parquet_of, small_pages, spec};

/// Options of different writers.
pub(super) fn variants() -> Vec<WriterProperties> {
    let of = WriterProperties::builder;
    let encoded = |encoding| {
        small_pages().into_builder().set_dictionary_enabled(false).set_encoding(encoding)
    };
    vec![
        of().set_compression(Compression::SNAPPY).build(),
        small_pages(),
        small_pages().into_builder().set_compression(Compression::LZ4_RAW).build(),
        small_pages().into_builder().set_compression(Compression::LZ4).build(),
        small_pages()
            .into_builder()
            .set_compression(Compression::GZIP(GzipLevel::default()))
            .build(),
        small_pages()
            .into_builder()
            .set_writer_version(WriterVersion::PARQUET_2_0)
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .build(),
        encoded(Encoding::PLAIN).build(),
        encoded(Encoding::BYTE_STREAM_SPLIT)
            .set_column_encoding(ColumnPath::from("arm"), Encoding::DELTA_LENGTH_BYTE_ARRAY)
            .build(),
    ]
}

fn columns() -> Vec<(String, ArrayRef)> {
    Recordings::of(&[40, 40]).columns()
}

/// The file with a column replaced.
fn with(name: &str, column: ArrayRef) -> Vec<u8> {
    let mut columns = columns();
    columns.iter_mut().find(|(other, _)| other == name).unwrap().1 = column;
    parquet_of(columns, small_pages())
}

#[test]
fn files_of_other_writers_are_read() {
    let spec = spec("parquet", &json!({}));
    let recordings = Recordings::of(&[40, 40, 40]);
    let expected = import(recordings.csv(), &super::spec("csv", &json!({}))).unwrap();
    assert_eq!(expected.counts.trajectories, 3);
    for properties in variants() {
        let found = import(recordings.parquet(properties), &spec).unwrap();
        assert_eq!(found.counts, expected.counts);
        assert_eq!(found.samples, expected.samples);
        assert_eq!(found.table, expected.table);
    }
}

#[test]
fn columns_of_any_numeric_type_are_read() {
    let spec = spec("parquet", &json!({}));
    let zeros = || std::iter::repeat_n(0, 80);
    import(with("tau_1", ints(zeros())), &spec).unwrap();
    import(with("tau_1", Arc::new(UInt64Array::from_iter_values(zeros().map(|_| 0)))), &spec)
        .unwrap();
    import(with("tau_1", Arc::new(Float64Array::from(vec![0.0; 80]))), &spec).unwrap();
    import(with("arm", Arc::new(Int64Array::from_iter_values((0..80).map(|k| k / 40)))), &spec)
        .unwrap();
}

#[test]
fn a_column_of_another_type_is_refused_with_what_it_is() {
    let spec = spec("parquet", &json!({}));
    let text = columns()[0].1.clone();
    check_refused(with("tau_1", text.clone()), &spec, &["\"tau_1\" (columns.u[0]) is Utf8", "f64"]);
    check_refused(with("t", text), &spec, &["\"t\" (columns.time) is Utf8"]);
    let bytes: ArrayRef = Arc::new(BinaryArray::from_iter_values((0..80).map(|_| b"x")));
    check_refused(with("arm", bytes), &spec, &["\"arm\" (columns.recording) is Binary", "text"]);
    let list = ListArray::from_iter_primitive::<Int32Type, _, _>(
        (0..80).map(|_| Some(vec![Some(1), Some(2)])),
    );
    let nested: ArrayRef = Arc::new(list);
    assert!(!nested.is_empty());
    check_refused(with("pos_2", nested), &spec, &["no column \"pos_2\" (columns.q[1])"]);
}

#[test]
fn dates_bring_their_unit_along() {
    let times = (0..80_i64).map(|k| 1_700_000_000_000 + (k % 40) * 50 / 3);
    let file = with("t", Arc::new(TimestampMillisecondArray::from_iter_values(times)));
    let in_ms = spec("parquet", &json!({"units": {"time": "ms"}}));
    import(file.clone(), &in_ms).unwrap();
    check_refused(file, &spec("parquet", &json!({})), &["columns.time", "units.time \"ms\""]);
}

#[test]
fn a_null_is_named_with_its_place() {
    let holes: Float64Array = (0..80).map(|k| (k != 57).then_some(0.5)).collect();
    check_refused(
        with("tau_1", Arc::new(holes)),
        &spec("parquet", &json!({})),
        &["row 58 (counted from 1), column \"tau_1\"", "nothing"],
    );
}

#[test]
fn every_beginning_of_a_file_is_refused() {
    let spec = spec("parquet", &json!({}));
    for properties in variants() {
        let file = Recordings::of(&[40]).parquet(properties);
        for length in 0..file.len() {
            error(&file[..length], &spec);
        }
    }
}

#[test]
fn what_is_no_parquet_is_refused() {
    let spec = spec("parquet", &json!({}));
    check_refused("", &spec, &["not a Parquet file", "0 bytes"]);
    check_refused(Recordings::of(&[40]).csv(), &spec, &["does not begin with PAR1"]);
    check_refused(b"PAR1........PAR1", &spec, &["footer claims"]);
    let mut encrypted = Recordings::of(&[40]).parquet(small_pages());
    encrypted.truncate(encrypted.len() - 1);
    encrypted.push(b'E');
    check_refused(encrypted, &spec, &["encrypted"]);
}

/// A billion equal rows fit into a few bytes, and the decoder would believe the page.
#[test]
fn a_page_with_more_values_than_the_row_group_is_refused() {
    let spec = spec("parquet", &json!({}));
    let good = Recordings::of(&[40]).parquet(WriterProperties::default());
    // The first data page header says 40 values as a zigzag varint.
    let header = [0x2c, 0x15, 80];
    let place = good.windows(3).position(|bytes| bytes == header).unwrap();
    let mut file = good;
    file[place + 2] = 82;
    check_refused(file, &spec, &["41 values where the row group has 40 rows"]);
}
