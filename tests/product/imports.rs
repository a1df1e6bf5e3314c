//! A user's own recordings: sent from the command line and over HTTP, used for training, and
//! refused where they are invalid.

use std::io::Write;
use std::path::Path;

use serde_json::{Value, json};

use crate::product::{Product, run_to_end, torqued};

/// Recordings with the columns of the example in docs/import.md. The script beside it made the
/// file.
const RECORDINGS: &str = "tests/data/like_isaac_ms1.parquet";

fn mapping() -> Value {
    serde_json::from_str(&std::fs::read_to_string("docs/examples/isaac_ms1.json").unwrap()).unwrap()
}

fn import(product: &Product, file: &str, spec: &str) -> (Option<i32>, String, String) {
    let arguments = ["import", file, "--spec", spec, "--wait", "--server", &product.url];
    run_to_end(&mut torqued(&arguments))
}

fn small_training(data: &Value) -> Value {
    json!({
        "kind": "train", "data": data, "context": 40, "batch_size": 4, "steps": 20,
        "validate_every_steps": 10,
        "model": {
            "architecture": "robomorph", "d_model": 16, "heads": 2, "encoder_layers": 1,
            "decoder_layers": 1, "patch": 5,
        },
    })
}

#[tokio::test]
async fn the_worked_example_becomes_a_dataset_that_trains() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let command = || import(&product, RECORDINGS, "docs/examples/isaac_ms1.json");
    let (code, output, errors) = command();
    assert_eq!(code, Some(0), "{output}{errors}");
    assert!(output.contains("dataset 1: ") && output.contains("job 1 succeeded"), "{output}");
    let dataset = product.get("/v1/datasets/1").await;
    assert_eq!((&dataset["state"], &dataset["trajectories"]), (&json!("complete"), &json!(2)));
    let files = dataset["files"].as_array().unwrap();
    let table = files.iter().find(|file| file["name"] == "robots-00000.parquet").unwrap();
    assert_eq!(table["rows"], 2);

    let (code, output, _) = command();
    assert_eq!(code, Some(0));
    assert!(output.contains("imported before"), "{output}");

    // Another import of the same file, which is not sent again.
    let mut shorter = product.get("/v1/jobs/1").await["spec"].clone();
    shorter["samples"] = json!(60);
    shorter["split"]["stride"] = json!(50);
    let job = product.submit(&shorter).await;
    let id = product.succeeded(job).await["dataset"].clone();
    let dataset = product.get(&format!("/v1/datasets/{id}")).await;
    assert_eq!(dataset["trajectories"], 2 * 8);

    let training = product.submit(&small_training(&json!({"dataset": id}))).await;
    let training = product.succeeded(training).await;
    assert_eq!(training["progress"]["done"], 20);

    let evaluation = json!({"kind": "evaluate", "data": {"dataset": id}, "context": 40});
    let evaluation = product.submit(&evaluation).await;
    product.succeeded(evaluation).await;
    let report = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    assert_eq!(report["groups"][0]["name"], "all scenarios", "{report:#}");
    let [cell] = report["cells"].as_array().unwrap().as_slice() else { panic!("one cell") };
    assert_eq!((&cell["scenarios"], &cell["frequency_hz"]), (&json!(16), &Value::Null));

    let verified = product.post(&format!("/v1/datasets/{id}/verify"), "").await.1;
    product.succeeded(verified["id"].as_i64().unwrap()).await;
}

#[tokio::test]
async fn a_file_that_is_not_as_its_mapping_says_fails_alone() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| -> String {
        let path = folder.path().join(name);
        std::fs::File::create(&path).unwrap().write_all(bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let good = std::fs::read(RECORDINGS).unwrap();
    let spec = "docs/examples/isaac_ms1.json";

    let cut = write("cut.parquet", &good[..good.len() / 2]);
    let (code, output, _) = import(&product, &cut, spec);
    assert_eq!(code, Some(3));
    assert!(!output.contains("/datasets/"), "there is no dataset to look at: {output}");
    assert!(output.contains("does not end with PAR1"), "{output}");

    let mut damaged = good;
    for byte in &mut damaged[20_000..20_400] {
        *byte = !*byte;
    }
    let damaged = write("damaged.parquet", &damaged);
    let (code, output, _) = import(&product, &damaged, spec);
    assert_eq!(code, Some(3), "{output}");

    let mut whole = mapping();
    whole["split"] = json!({"kind": "whole"});
    let whole = write("whole.json", whole.to_string().as_bytes());
    let (code, output, _) = import(&product, RECORDINGS, &whole);
    assert_eq!(code, Some(3));
    assert!(
        output.contains("recording \"0\", row 1 (counted from 1): ")
            && output.contains("450 samples"),
        "{output}"
    );

    let mut lost = mapping();
    lost["columns"]["time"] = json!("time");
    let lost = write("lost.json", lost.to_string().as_bytes());
    let (code, output, _) = import(&product, RECORDINGS, &lost);
    assert_eq!(code, Some(3));
    assert!(output.contains("\"time\" (columns.time)") && output.contains("\"t\""), "{output}");

    let mut impossible = mapping();
    impossible["samples"] = json!(1);
    let impossible = write("impossible.json", impossible.to_string().as_bytes());
    let (code, _, errors) = import(&product, RECORDINGS, &impossible);
    assert_eq!(code, Some(1));
    assert!(errors.contains("samples is 1, allowed: 2 to 10000"), "{errors}");

    assert_eq!(import(&product, RECORDINGS, spec).0, Some(0), "the worker went on");
}

#[tokio::test]
async fn an_import_has_a_name_and_the_noise_of_its_encoders() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let command = |more: &[&str]| {
        let arguments = ["import", RECORDINGS, "--spec", "docs/examples/isaac_ms1.json", "--wait"];
        let server = ["--server", &product.url];
        run_to_end(&mut torqued(&[&arguments[..], &server, more].concat()))
    };
    // The first time the file is sent, and the second time it is there already.
    for (id, noise, deviation) in [(1, "0.0001", 1e-4), (2, "0.001", 1e-3)] {
        let name = format!("arm {id}");
        let flags = ["--name", &name, "--tag", "lab", "--position-noise-rad", noise];
        let (code, _, errors) = command(&flags);
        assert_eq!(code, Some(0), "{errors}");
        let dataset = product.get(&format!("/v1/datasets/{id}")).await;
        assert_eq!(dataset["name"], json!(name), "{dataset}");
        assert_eq!(dataset["spec"]["position_noise_rad"], json!(deviation));
        assert_eq!(product.get(&format!("/v1/jobs/{id}")).await["tags"], json!(["lab"]));
    }
    let (code, _, errors) = command(&["--position-noise-rad", "0.2"]);
    assert_eq!(code, Some(1));
    assert!(errors.contains("--position-noise-rad is 0.2, allowed: 0 to 0.1"), "{errors}");

    let evaluation = json!({
        "kind": "evaluate", "data": {"dataset": 2}, "context": 40,
        "baselines": ["nominal-simulator"],
    });
    let evaluation = product.submit(&evaluation).await;
    assert_eq!(product.get(&format!("/v1/jobs/{evaluation}")).await["progress"]["total"], 2);
    product.succeeded(evaluation).await;
    let report = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    assert_eq!(report["data_noise"], json!({"position_rad": 1e-3, "torque_nm": 0.0}));

    let summary = ["summary", "2", "--server", &product.url];
    let (_, output, _) = run_to_end(&mut torqued(&summary));
    assert!(output.contains(" trajectories, ") && !output.contains("draws"), "{output}");
}

#[tokio::test]
async fn several_logs_become_one_dataset_and_are_sent_once() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| -> String {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let joints = |prefix: &str| (1..=7).map(|k| format!("{prefix}{k}")).collect::<Vec<_>>();
    let log = |rows: u32, shift: f64| {
        let mut text = format!("t,{},{}\n", joints("u").join(","), joints("q").join(","));
        for row in 0..rows {
            let t = f64::from(row) / 60.0;
            let values = (0..14).map(|k| (t + f64::from(k) + shift).sin().to_string());
            text += &format!("{t},{}\n", values.collect::<Vec<_>>().join(","));
        }
        text
    };
    let mapping = json!({
        "columns": {"time": "t", "u": joints("u"), "q": joints("q")},
        "samples": 50, "split": {"kind": "windows", "stride": 50},
    });
    let spec = write("mapping.json", &mapping.to_string());
    let monday = write("monday.csv", &log(120, 0.0));
    let tuesday = write("tuesday.csv", &log(60, 0.3));
    let again = write("later/tuesday.csv", &log(70, 0.6));
    let import = |files: &[&str], more: &[&str]| {
        let flags = ["--spec", &spec, "--server", &product.url];
        run_to_end(&mut torqued(&[&["import"][..], files, &flags, more].concat()))
    };
    let (code, output, errors) = import(&[&monday, &tuesday], &["--check"]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(output.contains("recordings: 2, rows: 180, trajectories: 3"), "{output}");

    let (code, output, errors) = import(&[&monday, &tuesday], &["--wait"]);
    assert_eq!(code, Some(0), "{output}{errors}");
    let files = product.get("/v1/jobs/1").await["spec"]["files"].clone();
    assert_eq!((&files[0]["name"], &files[1]["name"]), (&json!("monday"), &json!("tuesday")));
    assert_eq!(product.get("/v1/datasets/1").await["trajectories"], 3);
    let (_, output, _) = import(&[&monday, &tuesday], &[]);
    assert!(output.contains("imported before"), "{output}");

    // Files of the same name are called by their paths, and only the new one is sent.
    let sent = uploads(data.path()).len();
    let (code, output, errors) = import(&[&monday, &tuesday, &again], &["--wait"]);
    assert_eq!(code, Some(0), "{output}{errors}");
    assert_eq!(uploads(data.path()).len(), sent + 1);
    let files = product.get("/v1/jobs/2").await["spec"]["files"].clone();
    let last = files[2]["name"].as_str().unwrap().to_owned();
    assert!(last.ends_with("later/tuesday"), "{files}");
    let verified = product.post("/v1/datasets/2/verify", "").await.1;
    product.succeeded(verified["id"].as_i64().unwrap()).await;

    let cut = write("wednesday.csv", "t,u1\n0,1\n");
    let (code, output, _) = import(&[&monday, &cut], &["--wait"]);
    assert_eq!(code, Some(3));
    assert!(output.contains("file \"wednesday\": "), "{output}");
}

#[tokio::test]
async fn a_file_beyond_the_limit_is_refused_and_leaves_nothing() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--max-upload-bytes", "10000"]);
    let (code, _, errors) = import(&product, RECORDINGS, "docs/examples/isaac_ms1.json");
    assert_eq!(code, Some(1));
    assert!(errors.contains("allowed: 10000 bytes"), "{errors}");
    assert!(uploads(data.path()).is_empty());
}

/// A file of kilobytes that decodes to gigabytes: a name of 4 MiB in each of 1000 rows.
#[tokio::test]
async fn a_file_that_takes_too_much_memory_ends_its_import_alone() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let names = ["tau_", "pos_"].map(|prefix| (1..=7).map(|k| format!("{prefix}{k}")).collect());
    let [u, q]: [Vec<String>; 2] = names;
    let mapping = json!({"columns": {"time": "t", "recording": "arm", "u": u, "q": q}});
    let spec = data.path().join("mapping.json");
    std::fs::write(&spec, mapping.to_string()).unwrap();
    let (code, output, errors) =
        import(&product, "tests/data/long_names.parquet", spec.to_str().unwrap());
    assert_eq!(code, Some(3), "{output}{errors}");
    for words in ["\"long_names.parquet\" cannot be imported", "more than 1024 MiB of memory"] {
        assert!(output.contains(words), "{output}{errors}");
    }
    let job = product.get("/v1/jobs/1").await;
    assert_eq!(job["state"], "failed", "{job:#}");
    let tasks = product.get("/v1/jobs/1/tasks").await;
    assert_eq!(tasks["tasks"][0]["attempt"], 1, "not tried again: {tasks:#}");
    let (code, output, _) = import(&product, RECORDINGS, "docs/examples/isaac_ms1.json");
    assert_eq!(code, Some(0), "the worker went on: {output}");
}

/// Names of the files among the uploads of a data folder.
fn uploads(data: &Path) -> Vec<std::ffi::OsString> {
    match std::fs::read_dir(data.join("objects/uploads")) {
        Ok(entries) => entries.map(|entry| entry.unwrap().file_name()).collect(),
        Err(_) => Vec::new(),
    }
}

/// A recording of one slow motion, as CSV, with `rows` rows.
fn slow_motion(rows: u32, change: impl Fn(u32, &mut Vec<f64>)) -> String {
    let names: Vec<String> =
        ["u", "q"].iter().flat_map(|name| (1..=7).map(move |k| format!("{name}{k}"))).collect();
    let mut text = names.join(",");
    for row in 0..rows {
        let mut values: Vec<f64> =
            (0..14).map(|k| 0.7 + 0.2 * (f64::from(row + 9 * k) * 0.02).sin()).collect();
        change(row, &mut values);
        let values: Vec<String> = values.iter().map(ToString::to_string).collect();
        text.push('\n');
        text.push_str(&values.join(","));
    }
    text
}

fn numbered_mapping() -> Value {
    let names = |quantity: &str| (1..=7).map(|k| format!("{quantity}{k}")).collect::<Vec<_>>();
    json!({
        "columns": {"u": names("u"), "q": names("q")}, "samples": 100,
        "split": {"kind": "windows", "stride": 100},
    })
}

#[tokio::test]
async fn a_position_that_jumps_is_refused_and_one_that_stays_is_doubtful() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(&folder.path().join("data"));
    let import = |file: &str, text: &str, more: &[&str]| {
        let [file, spec] = [file, "mapping.json"].map(|name| folder.path().join(name));
        std::fs::write(&spec, numbered_mapping().to_string()).unwrap();
        std::fs::write(&file, text).unwrap();
        let [file, spec] = [&file, &spec].map(|path| path.to_str().unwrap());
        let arguments = ["import", file, "--spec", spec, "--wait", "--server", &product.url];
        run_to_end(torqued(&arguments).args(more))
    };
    let wrapping = slow_motion(200, |row, values| {
        values[9] = (3.0 + f64::from(row) * 0.01 + std::f64::consts::PI)
            .rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
    });
    let (code, output, errors) = import("wrapping.csv", &wrapping, &[]);
    assert_eq!(code, Some(3), "{output}{errors}");
    for words in ["line 17, column \"q3\": -3.13", "in line 16", "\"unwrap\": true"] {
        assert!(output.contains(words), "{words}: {output}");
    }
    let (code, output, errors) = import("wrapping.csv", &wrapping, &["--unwrap"]);
    assert_eq!(code, Some(0), "{output}{errors}");
    assert!(!output.contains("warning"), "{output}");

    let frozen = slow_motion(200, |row, values| {
        values[0] = 30.0 * (f64::from(row) * 0.05).sin();
        values[7] = f64::from(row.min(50)) * 0.01;
    });
    let (code, output, errors) = import("frozen.csv", &frozen, &[]);
    assert_eq!(code, Some(0), "{output}{errors}");
    let warning = "line 52 to line 201: column \"q1\" stays at 0.5 rad";
    assert!(output.contains(&format!("warning: {warning}")), "{output}");
    let log = ["logs", "3", "--server", &product.url];
    let (_, log, _) = run_to_end(&mut torqued(&log));
    assert!(log.contains("stays at 0.5 rad"), "{log}");
}

/// A rosbag becomes a dataset, and its LeRobot export the same one. A fast log without a header is
/// filtered.
#[tokio::test]
async fn logs_are_imported_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(&folder.path().join("data"));
    let imported = |file: &Path, mapping: &Value| {
        let spec = folder.path().join("mapping.json");
        std::fs::write(&spec, mapping.to_string()).unwrap();
        let (code, output, errors) =
            import(&product, file.to_str().unwrap(), spec.to_str().unwrap());
        assert_eq!(code, Some(0), "{output}{errors}");
        output
    };
    let arm = std::fs::read_to_string("tests/data/arm_of_six.json").unwrap();
    let arm: Value = serde_json::from_str(&arm).unwrap();
    let names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"];
    let mut mapping = json!({
        "columns": {"time": "stamp", "u": ["effort"], "q": ["position"]},
        "mcap": {"joints": names.map(|name| format!("{name}_joint"))},
        "robot": {"model": arm}, "ranges": {"q_rad": [-2, 2], "u_nm": [-9, 9]}, "samples": 60,
    });
    imported(Path::new("tests/data/joint_states.mcap"), &mapping);

    let exported = folder.path().join("lerobot");
    let arguments = ["export", "--lerobot", "1", exported.to_str().unwrap(), "--server"];
    let (code, _, errors) = run_to_end(torqued(&arguments).arg(&product.url));
    assert_eq!(code, Some(0), "{errors}");
    mapping["columns"] = json!({
        "time": "timestamp", "recording": "episode_index", "u": ["action"], "q": ["observation.state"],
    });
    mapping.as_object_mut().unwrap().remove("mcap");
    imported(&exported.join("data/chunk-000/file-000.parquet"), &mapping);
    let tables = [1, 2].map(|id| format!("/v1/datasets/{id}/summary"));
    let (first, second) = (product.get(&tables[0]).await, product.get(&tables[1]).await);
    assert_eq!(first["channels"], second["channels"], "{first:#}");

    let text = slow_motion(4000, |_, _| {});
    let rows = text.lines().skip(1).enumerate();
    let rows =
        rows.map(|(row, line)| format!("{:.3};{}\n", row as f64 / 1000.0, line.replace(',', ";")));
    let fast = folder.path().join("fast.csv");
    std::fs::write(&fast, rows.collect::<String>() + "4.000;0.7;0.7").unwrap();
    let numbers = |from: usize| (from..from + 7).map(|k| k.to_string()).collect::<Vec<_>>();
    let output = imported(
        &fast,
        &json!({
            "columns": {"time": "1", "u": numbers(2), "q": numbers(9)},
            "csv": {"header": false, "separator": ";"},
            "resampling": "linear", "samples": 100, "split": {"kind": "windows", "stride": 100},
        }),
    );
    assert!(output.contains("warning: line 4001, the last one, is cut off"), "{output}");
    let dataset = product.get("/v1/datasets/3").await;
    assert_eq!(dataset["spec"]["low_pass_hz"].as_f64(), Some(24.0), "{dataset}");
}

/// The child waits with a full pipe while this test looks at it.
#[cfg(target_os = "linux")]
#[test]
fn the_process_that_decodes_a_file_is_alone_and_confined() {
    use std::process::{Command, Stdio};

    let mut spec = numbered_mapping();
    spec["kind"] = json!("import");
    spec["file"] = json!("0".repeat(64));
    spec["format"] = json!("csv");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.csv");
    std::fs::write(&path, slow_motion(20_000, |_, _| {})).unwrap();
    let mut child = Command::new(torqued(&[]).get_program())
        .args(["decode-recording", &spec.to_string()])
        .stdin(std::fs::File::open(path).unwrap())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let status = || std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    let value = |status: &str, name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.trim_start_matches(':').trim().to_owned()
    };
    for _ in 0..1000 {
        if value(&status(), "Seccomp") == "2" {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let status = status();
    child.kill().unwrap();
    child.wait().unwrap();
    for (name, expected) in [("Seccomp", "2"), ("NoNewPrivs", "1"), ("Threads", "1")] {
        assert_eq!(value(&status, name), expected, "{status}");
    }
}
