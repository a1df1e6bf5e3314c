//! MCAP files.

use std::io::{Read, Write};

use arrow_array::cast::AsArray;
use arrow_array::types::Float32Type;
use serde_json::{Value, json};

use super::{Recordings, check_refused, error, import, spec};

const JOINTS: usize = 7;

fn text(text: &str) -> Vec<u8> {
    [&u32::try_from(text.len()).unwrap().to_le_bytes(), text.as_bytes()].concat()
}

fn record(opcode: u8, content: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(content.len() as u64).to_le_bytes(), content].concat()
}

fn schema(id: u16, name: &str) -> Vec<u8> {
    let definition = text("string[] name");
    record(3, &[&id.to_le_bytes()[..], &text(name), &text("ros2msg"), &definition].concat())
}

fn channel(id: u16, schema: u16, topic: &str, encoding: &str) -> Vec<u8> {
    let ids = [id.to_le_bytes(), schema.to_le_bytes()].concat();
    record(4, &[&ids[..], &text(topic), &text(encoding), &[0; 4]].concat())
}

fn message(channel: u16, time_ns: u64, data: &[u8]) -> Vec<u8> {
    let times = [time_ns.to_le_bytes(); 2].concat();
    record(5, &[&channel.to_le_bytes()[..], &[0; 4], &times, data].concat())
}

fn chunk(records: &[u8], compression: &str) -> Vec<u8> {
    let stored = match compression {
        "zstd" => zstd::encode_all(records, 0).unwrap(),
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        _ => records.to_vec(),
    };
    let crc = crc32fast::hash(records).to_le_bytes();
    let length = (records.len() as u64).to_le_bytes();
    let stored_length = (stored.len() as u64).to_le_bytes();
    let head = [&[0; 16][..], &length, &crc, &text(compression), &stored_length].concat();
    record(6, &[head, stored].concat())
}

fn finished(records: &[Vec<u8>]) -> Vec<u8> {
    let end = [record(15, &[0; 4]), record(2, &[0; 20])].concat();
    let magic = b"\x89MCAP0\r\n";
    [&magic[..], &record(1, &[text(""), text("test")].concat()), &records.concat(), &end, magic]
        .concat()
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds")]
fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

/// `sensor_msgs/JointState` in CDR, little-endian.
fn joint_state(time_s: f64, names: &[String], lists: [&[f64]; 3]) -> Vec<u8> {
    let mut content = Vec::new();
    let number = |content: &mut Vec<u8>, number: u32| {
        content.resize(content.len().next_multiple_of(4), 0);
        content.extend(number.to_le_bytes());
    };
    let nanoseconds = nanoseconds(time_s);
    number(&mut content, 1_700_000_000 + u32::try_from(nanoseconds / 1_000_000_000).unwrap());
    number(&mut content, u32::try_from(nanoseconds % 1_000_000_000).unwrap());
    let text = |content: &mut Vec<u8>, text: &str| {
        number(content, u32::try_from(text.len()).unwrap() + 1);
        content.extend(text.as_bytes());
        content.push(0);
    };
    text(&mut content, "base_link");
    number(&mut content, u32::try_from(names.len()).unwrap());
    names.iter().for_each(|name| text(&mut content, name));
    for list in lists {
        number(&mut content, u32::try_from(list.len()).unwrap());
        for value in list {
            content.resize(content.len().next_multiple_of(8), 0);
            content.extend(value.to_le_bytes());
        }
    }
    [vec![0, 1, 0, 0], content].concat()
}

fn names() -> Vec<String> {
    (1..=JOINTS).map(|joint| format!("panda_joint{joint}")).collect()
}

/// Messages of one recording, whose joints come in another order in every second message.
fn messages(recordings: &Recordings) -> Vec<Vec<u8>> {
    let gripper = joint_state(0.0, &["finger".to_owned()], [&[0.04], &[], &[]]);
    let mut messages = Vec::new();
    for (row, time_s) in recordings.times.iter().enumerate() {
        let of = |from: usize| {
            (from..from + JOINTS).map(|k| recordings.channels[k][row]).collect::<Vec<f64>>()
        };
        let (mut u, mut q, mut names) = (of(0), of(JOINTS), names());
        if row % 2 == 1 {
            u.rotate_left(3);
            q.rotate_left(3);
            names.rotate_left(3);
        }
        let time_ns = nanoseconds(*time_s);
        messages.push(message(1, time_ns, &joint_state(*time_s, &names, [&q, &[], &u])));
        messages.push(message(1, time_ns, &gripper));
        messages.push(message(2, time_ns, b"of another topic"));
    }
    messages
}

fn start() -> Vec<Vec<u8>> {
    vec![
        schema(1, "sensor_msgs/msg/JointState"),
        schema(2, "std_msgs/msg/String"),
        channel(1, 1, "/joint_states", "cdr"),
        channel(2, 2, "/rosout", "cdr"),
    ]
}

pub(super) fn file(recordings: &Recordings, compression: &str) -> Vec<u8> {
    let messages = messages(recordings);
    let (first, second) = messages.split_at(messages.len() / 2);
    let first = chunk(&[start().concat(), first.concat()].concat(), compression);
    finished(&[first, chunk(&second.concat(), compression)])
}

/// The mapping of [`file`].
pub(super) fn columns() -> Value {
    json!({"time": "stamp", "u": ["effort"], "q": ["position"]})
}

fn of(fields: &Value) -> spec::ImportSpec {
    let mut whole = json!({"columns": columns(), "mcap": {"joints": names()}});
    whole.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    spec("mcap", &whole)
}

#[test]
fn joint_states_are_rows_and_joints_have_names() {
    let recordings = Recordings::of(&[1600]);
    let split = json!({"split": {"kind": "windows", "stride": 40}});
    let expected = import(recordings.csv(), &spec("csv", &split)).unwrap();
    for compression in ["", "zstd", "lz4"] {
        let found = import(file(&recordings, compression), &of(&split)).unwrap();
        assert_eq!(found.samples, expected.samples, "{compression:?}");
    }
    let unchunked = [start(), messages(&recordings)].concat();
    let mut logged = of(&split);
    logged.columns.time = Some("log_time".to_owned());
    logged.mcap.topic = Some("/joint_states".to_owned());
    assert_eq!(import(finished(&unchunked), &logged).unwrap().samples, expected.samples);
}

#[test]
fn what_is_not_in_the_messages_is_named() {
    let recordings = Recordings::of(&[40]);
    let good = || file(&recordings, "");
    let default = of(&json!({}));
    import(good(), &default).unwrap();
    let mut without_effort = default.clone();
    without_effort.columns.u = vec!["velocity".to_owned()];
    check_refused(good(), &without_effort, &["row 1", "column \"velocity\": 0 values", "7"]);
    let mut renamed = default.clone();
    renamed.mcap.joints.as_mut().unwrap()[6] = "wrist".to_owned();
    check_refused(good(), &renamed, &["row 1", "no joint \"wrist\"", "panda_joint7"]);
    renamed.mcap.joints = Some((1..=JOINTS).map(|joint| format!("joint{joint}")).collect());
    let joints = ["joints joint1, joint2", "panda_joint7, finger; name yours in mcap.joints"];
    check_refused(good(), &renamed, &joints);
    let mut topic = default.clone();
    topic.mcap.topic = Some("/states".to_owned());
    check_refused(good(), &topic, &["on the topic \"/states\"", "/joint_states, /rosout"]);
    let mut columns = default.clone();
    columns.columns.q = vec!["positions".to_owned()];
    check_refused(good(), &columns, &["columns.q is \"positions\"", "[\"position\"]"]);
    columns = default.clone();
    columns.columns.recording = Some("run".to_owned());
    check_refused(good(), &columns, &["columns.recording", "one recording"]);
    columns = default.clone();
    columns.columns.time = Some("t".to_owned());
    check_refused(good(), &columns, &["columns.time", "\"log_time\""]);

    let two = [start(), vec![channel(3, 1, "/other", "cdr")]].concat();
    check_refused(finished(&two), &default, &["\"/joint_states\" and \"/other\"", "mcap.topic"]);
    let json = [start().swap_remove(0), channel(1, 1, "/a", "json")];
    check_refused(finished(&json), &default, &["the encoding \"json\"", "\"cdr\""]);
    check_refused(finished(&[]), &default, &["no messages of type sensor_msgs/msg/JointState"]);
    let brotli = finished(&[chunk(b"x", "br")]);
    check_refused(brotli, &default, &["\"br\"", "zstd"]);
}

#[test]
fn every_beginning_of_a_file_and_every_wrong_checksum_is_refused() {
    let spec = of(&json!({}));
    for compression in ["", "zstd", "lz4"] {
        let good = file(&Recordings::of(&[40]), compression);
        // The end after the last message may be missing.
        let needed = good.len() - 13 - 29 - 8;
        for length in (0..needed).step_by(11) {
            error(&good[..length], &spec);
        }
        let mut damaged = good.clone();
        damaged[needed - 20] ^= 1;
        error(damaged, &spec);
    }
    check_refused(Recordings::of(&[40]).csv(), &spec, &["not an MCAP file"]);
}

/// A chunk of a few kilobytes gives a quarter of a gigabyte.
#[test]
fn a_chunk_that_grows_without_end_takes_no_memory() {
    const BYTES: u64 = 1 << 28;
    let claims = [&[99][..], &BYTES.to_le_bytes()].concat();
    let zeros = zstd::encode_all((&claims[..]).chain(std::io::repeat(0).take(BYTES)), 0).unwrap();
    let head = [&[0; 16][..], &BYTES.to_le_bytes(), &[0; 4], &text("zstd")].concat();
    let whole = record(6, &[head, (zeros.len() as u64).to_le_bytes().to_vec(), zeros].concat());
    let records = [start().concat(), whole].concat();
    check_refused(finished(&[records]), &of(&json!({})), &["0 rows"]);
}

/// Files of the Python packages `mcap` and `numpy`; tests/data/joint_states.py makes them.
#[test]
fn files_of_other_libraries_are_read() {
    let description = include_str!("../../../../tests/data/arm_of_six.json");
    let mut arm: Value = serde_json::from_str(description).unwrap();
    let names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"];
    for (joint, name) in arm["joints"].as_array_mut().unwrap().iter_mut().zip(names) {
        joint["name"] = format!("{name}_joint").into();
    }
    let import = |format: &str, file: &[u8], columns: Value| {
        let fields = json!({
            "columns": columns, "samples": 60, "robot": {"model": arm},
            "ranges": {"q_rad": [-2, 2], "u_nm": [-9, 9]},
        });
        import(file, &spec(format, &fields)).unwrap()
    };
    let columns = json!({"time": "stamp", "u": ["effort"], "q": ["position"], "qd": ["velocity"]});
    let bag = include_bytes!("../../../../tests/data/joint_states.mcap");
    let bag = import("mcap", bag, columns);
    let columns = json!({"time": "t", "u": ["u"], "q": ["q"], "qd": ["qd"]});
    let arrays = include_bytes!("../../../../tests/data/joint_states.npz");
    let arrays = import("npz", arrays, columns);
    assert_eq!(bag.samples, arrays.samples);
    let q3 = bag.samples.column_by_name("q3").unwrap().clone();
    let q3 = q3.as_primitive::<Float32Type>().value(30);
    assert!((q3 - 0.5 * 3_f32.sin()).abs() < 1e-6, "{q3}");
}
