//! NumPy archives.

use std::io::Write;

use flate2::Compression;
use flate2::write::DeflateEncoder;
use serde_json::{Value, json};

use super::{Recordings, check_refused, error, import, narrow, spec};

/// An array as NumPy writes it.
fn array(descr: &str, shape: &str, is_column_major: bool, content: &[u8]) -> Vec<u8> {
    let order = if is_column_major { "True" } else { "False" };
    let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    // The content begins at a multiple of 64 bytes.
    let header = format!("{header:117}\n");
    let length = u16::try_from(header.len()).unwrap().to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), content].concat()
}

/// An archive as `numpy.savez` writes it, or `numpy.savez_compressed`.
fn archive_of(arrays: &[(&str, Vec<u8>)], is_deflated: bool) -> Vec<u8> {
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in arrays {
        let name = format!("{name}.npy");
        let stored = if is_deflated {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        } else {
            content.clone()
        };
        let number = |number: usize| u32::try_from(number).unwrap().to_le_bytes();
        let short = |number: usize| u16::try_from(number).unwrap().to_le_bytes();
        let (version, flags, date) = (short(45), short(0), [0; 4]);
        let method = short(if is_deflated { 8 } else { 0 });
        let crc = crc32fast::hash(content).to_le_bytes();
        let at = number(file.len());
        let common = [&version[..], &flags, &method, &date, &crc].concat();
        // NumPy's local headers have their sizes in fields of 64 bits.
        let extra = [&[1, 0, 16, 0][..], &[0xff; 16]].concat();
        file.extend(
            [b"PK\x03\x04", &common[..], &[0xff; 8], &short(name.len()), &short(20)].concat(),
        );
        file.extend([name.as_bytes(), &extra, &stored].concat());
        let sizes = [number(stored.len()), number(content.len())].concat();
        let rest = [0; 2 + 2 + 2 + 2 + 4];
        directory.extend([b"PK\x01\x02\x2d\x03", &common[..], &sizes, &short(name.len())].concat());
        directory.extend([&rest[..], &at, name.as_bytes()].concat());
    }
    let count = u16::try_from(arrays.len()).unwrap().to_le_bytes();
    let size = u32::try_from(directory.len()).unwrap().to_le_bytes();
    let at = u32::try_from(file.len()).unwrap().to_le_bytes();
    file.extend(directory);
    file.extend([b"PK\x05\x06\0\0\0\0", &count[..], &count, &size, &at, &[0; 2]].concat());
    file
}

fn bytes<const N: usize>(values: impl Iterator<Item = [u8; N]>) -> Vec<u8> {
    values.flatten().collect()
}

/// The values of channels, row by row.
fn rows(channels: &[Vec<f64>]) -> Vec<f64> {
    (0..channels[0].len()).flat_map(|row| channels.iter().map(move |values| values[row])).collect()
}

fn arrays(recordings: &Recordings) -> Vec<(&'static str, Vec<u8>)> {
    let count = recordings.times.len();
    let (u, q) = recordings.channels.split_at(7);
    let shape = format!("({count}, 7)");
    let texts = recordings.names.iter().flat_map(|name| {
        let mut codes: Vec<u32> = name.chars().map(u32::from).collect();
        codes.resize(8, 0);
        codes
    });
    vec![
        (
            "t",
            array(
                "<f8",
                &format!("({count},)"),
                false,
                &bytes(recordings.times.iter().map(|t| t.to_le_bytes())),
            ),
        ),
        ("arm", array("<U8", &format!("({count},)"), false, &bytes(texts.map(u32::to_le_bytes)))),
        (
            "u",
            array(
                "<f4",
                &shape,
                false,
                &bytes(rows(u).into_iter().map(|u| narrow(u).to_le_bytes())),
            ),
        ),
        ("q", array(">f8", &shape, true, &bytes(q.concat().into_iter().map(f64::to_be_bytes)))),
    ]
}

pub(super) fn archive(recordings: &Recordings, is_deflated: bool) -> Vec<u8> {
    archive_of(&arrays(recordings), is_deflated)
}

/// The mapping of [`archive`].
pub(super) fn columns() -> Value {
    json!({"time": "t", "recording": "arm", "u": ["u"], "q": ["q"]})
}

#[test]
fn arrays_are_read_as_columns() {
    let recordings = Recordings::of(&[40, 40, 1200]);
    let split = json!({"kind": "windows", "stride": 40});
    let csv = spec("csv", &json!({"split": split}));
    let expected = import(recordings.csv(), &csv).unwrap();
    let npz = spec("npz", &json!({"split": split, "columns": columns()}));
    for is_deflated in [false, true] {
        let found = import(archive(&recordings, is_deflated), &npz).unwrap();
        assert_eq!(found.samples, expected.samples);
        assert_eq!(found.table.column(1), expected.table.column(1));
    }
}

#[test]
fn an_array_of_another_shape_or_type_is_named() {
    let spec = spec("npz", &json!({"columns": columns()}));
    let recordings = Recordings::of(&[40]);
    let with = |name: &str, content: Vec<u8>| {
        let mut arrays = arrays(&recordings);
        arrays.iter_mut().find(|(other, _)| *other == name).unwrap().1 = content;
        archive_of(&arrays, false)
    };
    let zeros =
        |descr: &str, shape: &str, length: usize| array(descr, shape, false, &vec![0; length]);
    import(with("u", zeros("<i2", "(40, 7)", 560)), &spec).unwrap();
    for (name, content, parts) in [
        ("u", zeros("<f4", "(40, 6)", 960), ["\"u\" (columns.u[0])", "the shape (rows, 7)"]),
        ("u", zeros("<f4", "(40, 8)", 1280), ["the shape [40, 8]", "a range with [0:7]"]),
        ("u", zeros("<f4", "(280,)", 1120), ["shape [280]", "the shape (rows, 7)"]),
        ("u", zeros("<f4", "(39, 7)", 1092), ["has 39 rows", "40 as the others"]),
        ("q", zeros("<c16", "(40, 7)", 4480), ["\"q\" (columns.q[0])", "\"<c16\""]),
        ("q", zeros("|O", "(40, 7)", 40), ["\"q\" (columns.q[0])", "\"|O\""]),
        ("q", zeros("<f8", "(40, 7)", 2232), ["\"q\"", "to its end"]),
        ("t", zeros("<M8[D]", "(40,)", 320), ["\"t\" (columns.time)", "<M8[D]"]),
        ("arm", zeros("<f8", "(40,)", 320), ["\"arm\" (columns.recording)", "integers or text"]),
        ("arm", b"no array".to_vec(), ["\"arm\"", "is no array"]),
    ] {
        check_refused(with(name, content), &spec, &parts);
    }
    let lost = archive_of(&arrays(&recordings)[..3], false);
    check_refused(lost, &spec, &["no column \"q\" (columns.q[0])", "\"u\""]);
}

#[test]
fn columns_of_an_array_are_named_by_their_place() {
    let recordings = Recordings::of(&[40]);
    let expected = import(recordings.csv(), &spec("csv", &json!({}))).unwrap();
    let mut channels = vec![recordings.times.clone()];
    channels.extend(recordings.channels.iter().cloned());
    channels.push(vec![0.5; 40]);
    let positions: Vec<String> = (8..15).map(|column| format!("log[{column}]")).collect();
    let columns = json!({"time": "log[0]", "u": ["log[1:8]"], "q": positions});
    let by_place = spec("npz", &json!({"columns": columns}));
    let contents = [(false, rows(&channels)), (true, channels.concat())];
    let archives = contents.map(|(is_column_major, values)| {
        let content = bytes(values.into_iter().map(f64::to_le_bytes));
        archive_of(&[("log", array("<f8", "(40, 16)", is_column_major, &content))], false)
    });
    for archive in &archives {
        let found = import(archive.clone(), &by_place).unwrap();
        assert_eq!(found.samples, expected.samples);
    }
    let mut refused = by_place;
    refused.columns.u = vec!["log[15:22]".to_owned()];
    check_refused(
        archives[0].clone(),
        &refused,
        &["array \"log\" (columns.u[0]) has the shape [40, 16]", "22 to 1000 columns"],
    );
}

#[test]
fn times_may_be_dates_or_integers() {
    let columns = json!({"time": "t", "u": ["u"], "q": ["q"]});
    let spec = spec("npz", &json!({"columns": columns, "units": {"time": "us"}}));
    let recordings = Recordings::of(&[40]);
    let times = bytes((0..40_i64).map(|k| (1_700_000_000_000_000 + k * 50_000 / 3).to_le_bytes()));
    for descr in ["<i8", "<M8[us]", "<m8[us]"] {
        let mut arrays = arrays(&recordings);
        arrays[0].1 = array(descr, "(40,)", false, &times);
        assert_eq!(import(archive_of(&arrays, true), &spec).unwrap().counts.trajectories, 1);
    }
    let mut arrays = arrays(&recordings);
    arrays[0].1 = array("<M8[ns]", "(40,)", false, &times);
    check_refused(archive_of(&arrays, true), &spec, &["columns.time", "units.time"]);
}

#[test]
fn every_beginning_of_an_archive_and_every_wrong_checksum_is_refused() {
    let spec = spec("npz", &json!({"columns": columns()}));
    for is_deflated in [false, true] {
        let file = archive(&Recordings::of(&[40]), is_deflated);
        for length in (0..file.len()).step_by(7) {
            error(&file[..length], &spec);
        }
        let mut damaged = file;
        let place = damaged.windows(5).position(|bytes| bytes == b"u.npy").unwrap() + 400;
        damaged[place] ^= 1;
        error(damaged, &spec);
    }
    check_refused(Recordings::of(&[40]).csv(), &spec, &["not a whole ZIP archive"]);
}
