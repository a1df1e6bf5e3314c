//! Faulty Parquet files.

use std::sync::Arc;

use ::parquet::basic::{Compression, Encoding, GzipLevel, ZstdLevel};
use ::parquet::file::properties::{WriterProperties, WriterVersion};
use ::parquet::schema::types::ColumnPath;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float16Type, Float32Type, Float64Type, Int32Type};
use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, BinaryArray, Decimal128Array, DurationMicrosecondArray,
    DurationMillisecondArray, DurationNanosecondArray, Float16Array, Float32Array, Float64Array,
    Int64Array, ListArray, Time32MillisecondArray, Time64MicrosecondArray, Time64NanosecondArray,
    TimestampMicrosecondArray, TimestampMillisecondArray, TimestampNanosecondArray, UInt64Array,
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
    check_refused(with("pos_2", nested), &spec, &["\"pos_2\" (columns.q[1]) has lists", "flat"]);
}

#[test]
fn dates_bring_their_unit_along() {
    let times = (0..80_i64).map(|k| 1_700_000_000_000 + (k % 40) * 50 / 3);
    let file = with("t", Arc::new(TimestampMillisecondArray::from_iter_values(times)));
    let in_ms = spec("parquet", &json!({"units": {"time": "ms"}}));
    import(file.clone(), &in_ms).unwrap();
    import(file.clone(), &spec("parquet", &json!({}))).unwrap();
    let in_us = spec("parquet", &json!({"units": {"time": "us"}}));
    check_refused(file, &in_us, &["(columns.time) is Timestamp", "units.time \"ms\", or none"]);
}

/// The time of the second sample, which is a sixtieth of a second after the first.
fn second_time(file: Vec<u8>) -> f64 {
    let fields = json!({"split": {"kind": "windows", "stride": 1}, "samples": 39});
    let table = import(file, &spec("parquet", &fields)).unwrap().table;
    let times = table.column(2).as_primitive::<Float64Type>();
    times.value(1) - times.value(0)
}

#[test]
fn times_of_every_type_have_the_unit_of_their_type() {
    let of = |per_second: i64| (0..80_i64).map(move |k| (k % 40) * per_second / 60 + 7);
    let columns: [ArrayRef; 11] = [
        Arc::new(TimestampMillisecondArray::from_iter_values(of(1000)).with_timezone("UTC")),
        Arc::new(
            TimestampMicrosecondArray::from_iter_values(of(1_000_000)).with_timezone("+02:00"),
        ),
        Arc::new(TimestampNanosecondArray::from_iter_values(of(1_000_000_000))),
        Arc::new(DurationMillisecondArray::from_iter_values(of(1000))),
        Arc::new(DurationMicrosecondArray::from_iter_values(of(1_000_000))),
        Arc::new(DurationNanosecondArray::from_iter_values(of(1_000_000_000))),
        Arc::new(Time32MillisecondArray::from_iter_values(
            of(1000).map(|time| i32::try_from(time).unwrap()),
        )),
        Arc::new(Time64MicrosecondArray::from_iter_values(of(1_000_000))),
        Arc::new(Time64NanosecondArray::from_iter_values(of(1_000_000_000))),
        Arc::new(Float32Array::from_iter_values((0..80_u8).map(|k| f32::from(k % 40) / 60.0))),
        Arc::new(
            Decimal128Array::from_iter_values(of(1_000_000).map(i128::from))
                .with_precision_and_scale(20, 6)
                .unwrap(),
        ),
    ];
    for column in columns {
        let kind = column.data_type().clone();
        let second = second_time(with("t", column));
        assert!((second - 1.0 / 60.0).abs() < 1e-3, "{kind}: {second}");
    }
}

#[test]
fn f16_and_decimals_are_numbers() {
    let spec = spec("parquet", &json!({}));
    let q3 = |column: ArrayRef| {
        let imported = import(with("pos_3", column), &spec).unwrap();
        let column = imported.samples.column_by_name("q3").unwrap().clone();
        column.as_primitive::<Float32Type>().values()[..3].to_vec()
    };
    type Half = <Float16Type as ArrowPrimitiveType>::Native;
    let halves = (0..80_u8).map(|k| Half::from_f32(f32::from(k) / 128.0));
    let halves = Float16Array::from_iter_values(halves);
    assert_eq!(q3(Arc::new(halves)), [0.0, 1.0 / 128.0, 2.0 / 128.0]);
    let decimals = Decimal128Array::from_iter_values((0..80).map(|k| -5 * k));
    let decimals = decimals.with_precision_and_scale(9, 3).unwrap();
    assert_eq!(q3(Arc::new(decimals)), [0.0, -0.005, -0.01]);
}

/// A file of another kind, under the name of a Parquet file.
#[test]
fn a_file_of_another_format_is_called_what_it_is() {
    for format in ["parquet", "csv"] {
        let spec = spec(format, &json!({}));
        check_refused(b"\x1f\x8b\x08\0\0\0\0\0\0\x03", &spec, &["compressed with gzip", "gunzip"]);
        check_refused(b"\x28\xb5\x2f\xfd and more bytes", &spec, &["Zstandard"]);
        check_refused(b"PK\x03\x04 and more bytes", &spec, &["Excel"]);
        check_refused(b"\x89HDF\r\n\x1a\n and more bytes", &spec, &["HDF5"]);
    }
    let parquet = Recordings::of(&[40]).parquet(small_pages());
    check_refused(parquet, &spec("csv", &json!({})), &["\"format\": \"parquet\""]);
}

/// pandas keeps the spaces of a CSV file's header, and writes them into Parquet.
#[test]
fn spaces_around_a_name_are_no_part_of_it() {
    let renamed = |from: &str, to: &str| {
        let mut columns = columns();
        columns.iter_mut().find(|(name, _)| name == from).unwrap().0 = to.to_owned();
        parquet_of(columns, small_pages())
    };
    let plain = spec("parquet", &json!({}));
    import(renamed("pos_3", " pos_3"), &plain).unwrap();
    let mut spaced = plain.clone();
    spaced.columns.q[2] = " pos_3 ".to_owned();
    import(renamed("pos_3", "pos_3"), &spaced).unwrap();
    let mut both = columns();
    both.push((" pos_3".to_owned(), columns()[4].1.clone()));
    import(parquet_of(both, small_pages()), &plain).unwrap();
    let mut twice = plain;
    twice.columns.q[2] = " pos_2".to_owned();
    check_refused(
        renamed("pos_3", "x"),
        &twice,
        &["columns.q[2] and columns.q[1] are both", "\"pos_2\""],
    );
}

/// The recordings with one column of lists for torques and one for positions.
pub(super) fn with_lists(recordings: &Recordings) -> Vec<(String, ArrayRef)> {
    let mut columns = recordings.columns();
    columns.truncate(2);
    let list = |channels: &[Vec<f64>]| -> ArrayRef {
        let row = |row: usize| channels.iter().map(move |values| Some(super::narrow(values[row])));
        let rows = (0..recordings.times.len()).map(|k| Some(row(k).collect::<Vec<_>>()));
        Arc::new(ListArray::from_iter_primitive::<Float32Type, _, _>(rows))
    };
    columns.push(("action".to_owned(), list(&recordings.channels[..7])));
    columns.push(("observation.state".to_owned(), list(&recordings.channels[7..])));
    columns
}

/// The mapping of [`with_lists`].
pub(super) fn of_lists() -> serde_json::Value {
    json!({"time": "t", "recording": "arm", "u": ["action"], "q": ["observation.state"]})
}

#[test]
fn a_column_of_lists_has_all_joints() {
    let recordings = Recordings::of(&[40, 40, 40]);
    let spec = spec("parquet", &json!({"columns": of_lists()}));
    let expected = import(recordings.csv(), &super::spec("csv", &json!({}))).unwrap();
    for properties in variants() {
        let file = parquet_of(with_lists(&recordings), properties);
        assert_eq!(import(file, &spec).unwrap().samples, expected.samples);
    }
    let doubles = with_lists(&recordings).into_iter().map(|(name, column)| {
        let lists = column.as_list_opt::<i32>().map(|lists| {
            let rows = lists.iter().map(|row| {
                let row = row.unwrap();
                let values = row.as_primitive::<Float32Type>().values().to_vec();
                Some(values.into_iter().map(|value| Some(f64::from(value))).collect::<Vec<_>>())
            });
            Arc::new(ListArray::from_iter_primitive::<Float64Type, _, _>(rows)) as ArrayRef
        });
        (name, lists.unwrap_or(column))
    });
    let file = parquet_of(doubles.collect(), small_pages());
    assert_eq!(import(file, &spec).unwrap().samples, expected.samples);
    let mut out_of_range = recordings;
    out_of_range.channels[9][50] = 7.5;
    let file = parquet_of(with_lists(&out_of_range), small_pages());
    check_refused(file, &spec, &["row 51", "column \"observation.state[2]\": 7.5 rad"]);
}

#[test]
fn a_list_of_another_length_or_place_is_refused() {
    let lists = spec("parquet", &json!({"columns": of_lists()}));
    let file = |change: &dyn Fn(usize) -> Option<Vec<Option<f32>>>| {
        let mut columns = with_lists(&Recordings::of(&[40, 40]));
        let rows = (0..80).map(change);
        columns[2].1 = Arc::new(ListArray::from_iter_primitive::<Float32Type, _, _>(rows));
        parquet_of(columns, small_pages())
    };
    let row = |length: usize| Some(vec![Some(0.5); length]);
    import(file(&|_| row(7)), &lists).unwrap();
    let place = "row 58 (counted from 1), column \"action\"";
    let shorter = file(&|k| row(if k == 57 { 6 } else { 7 }));
    check_refused(shorter, &lists, &[place, "a list of 6 elements", "7, one for each joint"]);
    let longer = file(&|_| row(8));
    check_refused(
        longer,
        &lists,
        &[
            "column \"action\" has lists of 8 numbers, allowed: 7",
            "\"action[0]\"",
            "\"action[0:7]\"",
        ],
    );
    let unlike = file(&|k| row(if k == 7 { 9 } else { 8 }));
    check_refused(unlike, &lists, &["\"action.list.item\"", "rows of 7 elements"]);
    let absent = file(&|k| if k == 57 { None } else { row(7) });
    check_refused(absent, &lists, &[place, "nothing"]);
    let hole = file(&|k| Some(vec![if k == 57 { None } else { Some(0.5) }; 7]));
    check_refused(hole, &lists, &[place, "nothing"]);

    let mut elements = lists.clone();
    elements.columns.u = (1..=7).map(|k| format!("tau_{k}")).collect();
    elements.columns.u[3] = "action".to_owned();
    let mut columns = Recordings::of(&[40, 40]).columns();
    columns.extend(with_lists(&Recordings::of(&[40, 40])).into_iter().skip(2));
    let both = parquet_of(columns, small_pages());
    check_refused(both.clone(), &elements, &["\"action\" (columns.u[3]) has lists", "named alone"]);
    let mut flat = lists;
    flat.columns.u = vec!["tau_1".to_owned()];
    check_refused(both, &flat, &["\"tau_1\" (columns.u[0]) is Float32", "lists of 7 numbers"]);
}

/// The recordings with one column of lists: a time, torques, positions and a gripper.
pub(super) fn with_one_list(recordings: &Recordings) -> Vec<(String, ArrayRef)> {
    let mut columns = recordings.columns();
    columns.truncate(1);
    let values = |row: usize| {
        let joints = recordings.channels.iter().map(move |values| super::narrow(values[row]));
        let time = super::narrow(recordings.times[row]);
        std::iter::once(time).chain(joints).chain([0.5]).map(Some).collect::<Vec<_>>()
    };
    let rows = (0..recordings.times.len()).map(|row| Some(values(row)));
    let list = ListArray::from_iter_primitive::<Float32Type, _, _>(rows);
    columns.push(("log".to_owned(), Arc::new(list)));
    columns
}

/// The mapping of [`with_one_list`].
pub(super) fn of_one_list() -> serde_json::Value {
    let positions: Vec<String> = (8..15).map(|element| format!("log[{element}]")).collect();
    json!({"time": "log[0]", "recording": "arm", "u": ["log[1:8]"], "q": positions})
}

#[test]
fn elements_of_lists_are_columns() {
    let recordings = Recordings::of(&[40, 40]);
    let expected = import(recordings.csv(), &spec("csv", &json!({}))).unwrap();
    let of_one_list = spec("parquet", &json!({"columns": of_one_list()}));
    for properties in variants() {
        let file = parquet_of(with_one_list(&recordings), properties);
        assert_eq!(import(file, &of_one_list).unwrap().samples, expected.samples);
    }
    let mut out_of_range = recordings.clone();
    out_of_range.channels[9][50] = 7.5;
    let file = parquet_of(with_one_list(&out_of_range), small_pages());
    check_refused(file, &of_one_list, &["row 51", "column \"log[10]\": 7.5 rad"]);

    let refused = |field: &str, names: serde_json::Value, parts: &[&str]| {
        let mut columns = json!({"u": ["log[1:8]"], "q": ["log[8:15]"]});
        columns[field] = names;
        let file = parquet_of(with_one_list(&recordings), small_pages());
        check_refused(file, &spec("parquet", &json!({"columns": columns})), parts);
    };
    refused("q", json!(["log[8:16]"]), &["columns.q is \"log[8:16]\"", "8 elements, allowed: 7"]);
    refused("q", json!(["log[8]"]), &["which is 1 element, allowed: 7"]);
    refused("q", json!(["log[10:17]"]), &["row 1", "\"log[10:17]\"", "16 elements", "at least 17"]);
    refused("q", json!(["log[7:14]"]), &["columns.q[0] and columns.u[0] are both", "\"log\""]);
    refused("q", json!(["logs[8:15]"]), &["no column \"logs[8:15]\""]);
    refused("time", json!("log[15:17]"), &["columns.time", "2 elements, allowed: 1"]);
    refused("time", json!("arm[0]"), &["columns.time is \"arm[0]\"", "\"arm\" has no lists"]);
    refused("recording", json!("log[0]"), &["columns.recording", "without lists"]);
}

#[test]
fn a_column_may_be_called_like_an_element() {
    let recordings = Recordings::of(&[40]);
    let expected = import(recordings.csv(), &spec("csv", &json!({}))).unwrap();
    let mut columns = recordings.columns();
    for (at, (name, _)) in columns.iter_mut().skip(9).enumerate() {
        *name = format!("log[{at}]");
    }
    columns.extend(with_one_list(&recordings).pop());
    let positions: Vec<String> = (0..7).map(|at| format!("log[{at}]")).collect();
    let mut named = spec("parquet", &json!({}));
    named.columns.q = positions;
    let file = parquet_of(columns, small_pages());
    assert_eq!(import(file, &named).unwrap().samples, expected.samples);
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
