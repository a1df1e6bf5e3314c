//! Files that would exhaust the memory of a process that decodes them.

use std::sync::Arc;

use ::parquet::file::properties::WriterProperties;
use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, DictionaryArray, Int32Array, StringArray};
use recordings::ImportError;
use serde_json::json;

use super::decoder::import_alone;
use super::{Recordings, channel_names, check_refused, import, parquet_of, spec};

fn error(file: &[u8]) -> ImportError {
    import_alone(file, &spec("parquet", &json!({}))).err().unwrap()
}

/// Recordings of 1000 rows with one name of `length` bytes, which is stored once in a dictionary.
fn long_name(length: usize) -> Vec<u8> {
    let mut columns = Recordings::of(&[1000]).columns();
    let names = Arc::new(StringArray::from(vec!["x".repeat(length)]));
    let keys = Int32Array::from(vec![0; 1000]);
    let names: ArrayRef = Arc::new(DictionaryArray::<Int32Type>::try_new(keys, names).unwrap());
    columns[0].1 = names;
    let properties = WriterProperties::builder().set_dictionary_page_size_limit(1 << 26);
    parquet_of(columns, properties.build())
}

#[test]
fn a_long_name_is_refused_by_its_length() {
    let error = error(&long_name(201)).to_string();
    assert!(
        error.contains("row 1 (counted from 1), column \"arm\": a name of 201 bytes"),
        "{error}"
    );
}

/// Four gigabytes of names come from a file of four megabytes.
#[test]
fn a_file_of_which_too_much_comes_out_is_refused_at_the_limit() {
    let error = error(&long_name(4 << 20));
    assert!(matches!(error, ImportError::Memory { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("\"arm.parquet\" cannot be imported"), "{text}");
    assert!(text.contains("more than 1024 MiB of memory"), "{text}");
}

/// Positions move between -1 and 1 rad, and joint 2 of this arm may only move from -2.6 to 0.4.
#[test]
fn a_recording_that_leaves_the_limits_of_its_robot_is_refused_unless_ranges_allow_it() {
    let arm: serde_json::Value =
        serde_json::from_str(include_str!("../../../../tests/data/arm_of_six.json")).unwrap();
    let names = channel_names();
    let columns = json!({"time": "t", "recording": "arm", "u": names[..6], "q": names[7..13]});
    let mut fields = json!({"columns": columns, "robot": {"model": arm}});
    let file = Recordings::of(&[80]).csv();
    check_refused(
        file.clone(),
        &spec("csv", &fields),
        &[
            "recording \"arm 0\", line ",
            "column \"pos_2\": 0.",
            "allowed: -2.6 to 0.4 rad (position_rad of joint 2 in robot.model; ranges.q_rad replaces it)",
        ],
    );
    fields["ranges"] = json!({"q_rad": [-2, 2]});
    fields["split"] = json!({"kind": "windows", "stride": 40});
    let imported = import(file, &spec("csv", &fields)).unwrap();
    assert_eq!(imported.counts.trajectories, 2);
    assert!(imported.samples.column_by_name("q6").is_some());
    assert!(imported.samples.column_by_name("u7").is_none());
}

/// `FileMetaData` whose field 2, the tree of columns, claims to have `claimed` elements, but has
/// only these.
fn with_footer(claimed: u32, columns: &[u8]) -> Vec<u8> {
    let mut footer = vec![0x15, 0x04, 0x19, 0xfc];
    let mut rest = claimed;
    while rest > 0x7f {
        footer.push(0x80 | u8::try_from(rest & 0x7f).unwrap());
        rest >>= 7;
    }
    footer.push(u8::try_from(rest).unwrap());
    footer.extend(columns);
    let rows_and_no_row_groups = [0x16, 0x00, 0x19, 0x0c, 0x00];
    footer.extend(rows_and_no_row_groups);
    let mut file = b"PAR1".to_vec();
    file.extend(&footer);
    file.extend(u32::try_from(footer.len()).unwrap().to_le_bytes());
    file.extend(b"PAR1");
    file
}

/// A column or group with the name `c`.
fn column(children: u8) -> [u8; 6] {
    [0x48, 0x01, b'c', 0x15, children << 1, 0x00]
}

#[test]
fn a_tree_of_columns_that_is_not_whole_is_refused() {
    let of = |children: &[u8]| children.iter().flat_map(|count| column(*count)).collect::<Vec<_>>();
    for children in [&[3, 0, 0][..], &[1, 0, 0], &[2, 1, 0], &[60]] {
        let claimed = u32::try_from(children.len()).unwrap();
        let error = error(&with_footer(claimed, &of(children)));
        assert!(matches!(error, ImportError::Undecodable(_)), "{children:?}: {error}");
    }
    let error = error(&with_footer(u32::MAX >> 1, &of(&[1, 0])));
    assert!(!error.may_pass(), "{error:?}");
}

#[test]
fn columns_nested_without_end_end_with_the_child_at_worst() {
    let depth = 1_000_000;
    let columns: Vec<u8> = (0..depth).flat_map(|_| column(1)).chain(column(0)).collect();
    let error = error(&with_footer(depth + 1, &columns));
    assert!(!error.may_pass(), "{error:?}");
    assert!(error.to_string().contains("cannot be imported"), "{error}");
}
