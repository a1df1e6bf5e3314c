//! The commands that ask a server: tables for people, the API's own JSON for scripts, files with
//! their digests, and exit codes that tell what happened.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

use serde_json::{Value, json};

use crate::product::{Product, member, run_to_end, small_pipeline, torqued};

struct Asking<'a>(&'a Product);

impl Asking<'_> {
    fn ask(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        run_to_end(torqued(arguments).args(["--server", &self.0.url]))
    }

    /// Standard output of a command that must succeed.
    fn output(&self, arguments: &[&str]) -> String {
        let (code, output, errors) = self.ask(arguments);
        assert_eq!(code, Some(0), "{arguments:?}: {errors}");
        output
    }

    fn json(&self, arguments: &[&str]) -> Value {
        serde_json::from_str(&self.output(arguments)).unwrap()
    }
}

fn json_lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[tokio::test]
async fn the_program_knows_the_presets_that_its_server_lists() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start_with(folder.path(), &["--workers", "0"]);
    let asking = Asking(&product);
    let alone = |arguments: &[&str]| {
        let (code, output, errors) = run_to_end(torqued(arguments).env_remove("TORQUED_SERVER"));
        assert_eq!(code, Some(0), "{arguments:?}: {errors}");
        output
    };
    assert_eq!(alone(&["presets"]), asking.output(&["presets"]));
    assert_eq!(alone(&["presets", "D1-chirp"]), asking.output(&["presets", "D1-chirp"]));
    let listed: Value = serde_json::from_str(&alone(&["presets", "--json"])).unwrap();
    assert_eq!(listed, product.get("/v1/presets").await);
}

#[tokio::test]
async fn everything_that_a_pipeline_leaves_is_listed_shown_and_downloaded() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let asking = Asking(&product);

    let mut submit = torqued(&["submit", "-", "--watch", "--json", "--server", &product.url]);
    let mut submit = submit.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let spec = small_pipeline().to_string();
    submit.stdin.take().unwrap().write_all(spec.as_bytes()).unwrap();
    let submitted = submit.wait_with_output().unwrap();
    assert_eq!(submitted.status.code(), Some(0));
    let changes = json_lines(&String::from_utf8(submitted.stdout).unwrap());
    let pipeline = changes.last().unwrap();
    let id = pipeline["id"].to_string();
    assert_eq!(pipeline, &product.get(&format!("/v1/jobs/{id}")).await);
    assert_eq!(pipeline["state"], "succeeded");

    for (command, columns) in [
        ("jobs", "id  name"),
        ("datasets", "trajectories"),
        ("runs", "step"),
        ("checkpoints", "validation RMSE"),
        ("evaluations", "cells"),
        ("workers", "offers"),
    ] {
        let table = asking.output(&[command]);
        assert!(table.lines().count() > 1 && table.contains(columns), "{table}");
        if command != "workers" {
            let answer = product.get(&format!("/v1/{command}?limit=20")).await;
            assert_eq!(asking.json(&[command, "--json"]), answer);
        }
    }
    let table = asking.output(&["datasets", "--limit", "1"]);
    assert!(table.contains("older ones: torqued datasets --before 2"), "{table}");

    let labelled = asking.json(&[
        "label",
        "run",
        "1",
        "--name",
        "first",
        "--note",
        "line\nline",
        "--tag",
        "x",
        "--tag",
        "lr=1",
        "--json",
    ]);
    assert_eq!(labelled, product.get("/v1/runs/1").await);
    let shown = asking.output(&["label", "run", "1", "--remove-tag", "x"]);
    assert!(shown.contains("lr=1") && shown.contains("note  "), "{shown}");
    let table = asking.output(&["runs", "--tag", "lr=1", "--text", "FIRST", "--kind", "train"]);
    assert!(table.contains("first") && table.lines().count() == 2, "{table}");
    let csv = asking.output(&["runs", "--text", "first", "--csv", "--column", "steps"]);
    let lines: Vec<&str> = csv.lines().collect();
    assert!(lines.len() == 2 && lines[0].ends_with(",created,steps,tags"), "{csv}");
    assert!(
        lines[1].starts_with("1,first,train,succeeded,") && lines[1].ends_with(",lr=1"),
        "{csv}"
    );
    let table = asking.output(&["jobs", "--limit", "1", "--sort", "name"]);
    let (_, cursor) = table.trim().rsplit_once(' ').unwrap();
    let rest = asking.output(&["jobs", "--sort", "name", "--cursor", cursor, "--all"]);
    assert_eq!(rest.lines().count(), 5, "{rest}");
    assert!(asking.ask(&["label", "run", "1"]).0 == Some(2), "nothing to change");
    let (code, _, errors) = asking.ask(&["label", "run", "1", "--tag", "a b"]);
    assert!(code == Some(1) && errors.contains("add_tags[0]"), "{errors}");
    let again = torqued(&["submit", "-", "--tag", "again", "--json", "--server", &product.url])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let mut again = again.unwrap();
    again.stdin.take().unwrap().write_all(spec.as_bytes()).unwrap();
    let again = again.wait_with_output().unwrap();
    let again: Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!((&again["id"], &again["tags"]), (&pipeline["id"], &json!(["again"])));
    assert_eq!(
        asking.json(&["jobs", "--tag", "again", "--json"])["jobs"].as_array().unwrap().len(),
        5
    );

    let simulation = member(pipeline, "train-set").to_string();
    let training = member(pipeline, "train");
    let dataset = product.get(&format!("/v1/jobs/{simulation}")).await["dataset"].to_string();
    let run = product.get(&format!("/v1/jobs/{training}")).await["run"].to_string();
    let evaluation = member(pipeline, "evaluate").to_string();
    let checkpoint = product.get("/v1/checkpoints").await["checkpoints"][0]["id"].to_string();
    for (kind, id, words) in [
        ("job", &id, "train-set"),
        ("dataset", &dataset, "trajectories-00003.parquet"),
        ("run", &run, "train/loss"),
        ("checkpoint", &checkpoint, "model.safetensors"),
        ("evaluation", &evaluation, "hold-last"),
    ] {
        let text = asking.output(&["show", kind, id]);
        assert!(text.contains(words), "no {words:?} in {text}");
        let answer = product.get(&format!("/v1/{kind}s/{id}")).await;
        assert_eq!(asking.json(&["show", kind, id, "--json"]), answer);
    }
    let spec = asking.json(&["show", "dataset", &dataset, "--spec"]);
    assert_eq!(spec["trajectories"], 2000);

    let metrics = asking.output(&["metrics", &run, "train/loss"]);
    assert!(metrics.starts_with("key,step,time,value\ntrain/loss,"), "{metrics}");
    let metrics = json_lines(&asking.output(&["metrics", &run, "--json"]));
    assert!(metrics.iter().any(|metric| metric["key"] == "validation/rmse_deg"), "{metrics:?}");
    assert!(asking.output(&["metrics", &run, "--figure"]).contains("<svg"));
    assert!(asking.output(&["summary", &dataset]).contains("2 000 trajectories"));
    assert_eq!(asking.output(&["trajectory", &dataset, "7"]).lines().count(), 1 + 60);
    assert!(asking.output(&["tasks", &simulation]).contains("shard 00003"));
    let logs = json_lines(&asking.output(&["logs", &simulation, "--json"]));
    assert_eq!(logs[0]["label"], "shard 00000");
    assert!(asking.output(&["queue"]).contains("0 tasks wait, 0 run"));
    assert!(asking.output(&["health"]).starts_with("ok: torqued "));
    assert_eq!(asking.output(&["health", "--ready"]), "ready\n");
    let opened = asking.output(&["open", "run", &run, "--print"]);
    assert_eq!(opened, format!("{}/runs/{run}\n", product.url));
    let (code, _, errors) = asking.ask(&["download", "run", &run]);
    assert!(code == Some(1) && errors.contains("left no files of its own"), "{errors}");
    let (code, _, errors) = asking.ask(&["submit", "D1-chirp", "--tag", "a b"]);
    assert!(code == Some(1) && errors.contains("tags or aliases are not allowed"), "{errors}");
    assert!(errors.contains("\n  tag is a b, allowed: "), "{errors}");
    let (code, _, errors) = asking.ask(&["export", "--mlflow", &product.url, "--all"]);
    assert!(code == Some(1) && errors.contains("has these runs already"), "{errors}");
    export_and_delete_an_alias(&asking, &checkpoint, folder.path());
    download_and_go_on(&asking, &dataset, folder.path());
}

fn export_and_delete_an_alias(asking: &Asking<'_>, checkpoint: &str, folder: &Path) {
    asking.output(&["label", "checkpoint", checkpoint, "--alias", "champion"]);
    let model = folder.join("model");
    asking.output(&["export", "--hugging-face", "champion", model.to_str().unwrap()]);
    assert!(model.join("model.safetensors").is_file());
    let foretold = asking.output(&["delete", "checkpoint", "champion", "--dry-run"]);
    assert!(foretold.starts_with(&format!("checkpoint {checkpoint}: ")), "{foretold}");
    let deleted = asking.output(&["delete", "checkpoint", "champion", "--force"]);
    assert!(deleted.starts_with(&format!("checkpoint {checkpoint} is in the trash")), "{deleted}");
    asking.output(&["undelete", "checkpoint", checkpoint]);
}

/// Downloads a dataset, leaves a part of a file as after an interruption, and downloads it again.
fn download_and_go_on(asking: &Asking<'_>, dataset: &str, folder: &Path) {
    let out = folder.join("download");
    let arguments = ["download", "dataset", dataset, out.to_str().unwrap()];
    let text = asking.output(&arguments);
    assert!(text.contains("9 files") && text.contains("digest is right"), "{text}");

    let whole = out.join("trajectories-00001.parquet");
    let part = out.join("trajectories-00001.parquet.part");
    let bytes = fs::read(&whole).unwrap();
    fs::remove_file(&whole).unwrap();
    fs::write(&part, &bytes[..bytes.len() / 3]).unwrap();
    let text = asking.output(&arguments);
    assert!(text.contains("8 were there before") && !part.exists(), "{text}");
    assert_eq!(fs::read(&whole).unwrap(), bytes);

    // A part with wrong bytes does not become a file, and another file is not replaced.
    fs::remove_file(&whole).unwrap();
    fs::write(&part, vec![0; bytes.len() / 3]).unwrap();
    let (code, _, errors) = asking.ask(&arguments);
    assert!(code == Some(1) && errors.contains("checksum mismatch"), "{errors}");
    assert!(!part.exists() && !whole.exists());
    fs::write(&whole, b"mine").unwrap();
    let (code, _, errors) = asking.ask(&arguments);
    assert!(code == Some(1) && errors.contains("differs from the server's"), "{errors}");
    assert_eq!(fs::read(&whole).unwrap(), b"mine");
}

#[tokio::test]
async fn an_exit_code_says_what_happened() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start_with(folder.path(), &["--workers", "0"]);
    let asking = Asking(&product);
    product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    assert_eq!(asking.json(&["cancel", "1", "--json"])["state"], "cancelled");
    let (code, output, _) = asking.ask(&["watch", "1"]);
    assert_eq!((code, output.contains("job 1 cancelled")), (Some(3), true), "{output}");
    let (code, output, _) = asking.ask(&["watch", "1", "--json"]);
    assert_eq!((code, json_lines(&output)[0]["state"].clone()), (Some(3), json!("cancelled")));
    assert_eq!(asking.ask(&["health"]).0, Some(1), "nobody executes tasks");
    for (arguments, expected, words) in [
        (["show", "job", "9"], 1, "there is no job 9"),
        (["download", "job", "1"], 1, "no files of its own"),
        (["show", "jbo", "9"], 2, "job"),
    ] {
        let (code, _, errors) = asking.ask(&arguments);
        assert!(code == Some(expected) && errors.contains(words), "{code:?} {errors}");
    }
    let nobody = ["jobs", "--server", "http://127.0.0.1:1"];
    let (code, _, errors) = run_to_end(&mut torqued(&nobody));
    assert!(code == Some(4) && errors.contains("is `torqued serve` running there?"), "{errors}");
}

#[test]
fn shells_complete_commands_and_the_manual_has_a_page_for_each() {
    for shell in ["bash", "zsh", "fish"] {
        let (code, script, _) = run_to_end(&mut torqued(&["completions", shell]));
        assert!(code == Some(0) && script.contains("undrain"), "{script}");
    }
    let folder = tempfile::tempdir().unwrap();
    let (code, page, _) = run_to_end(&mut torqued(&["man"]));
    assert!(code == Some(0) && page.contains("Exit codes"), "{page}");
    let dir = folder.path().to_str().unwrap();
    let (code, _, errors) = run_to_end(&mut torqued(&["man", "--dir", dir]));
    assert_eq!(code, Some(0), "{errors}");
    let page = fs::read_to_string(folder.path().join("torqued-download.1")).unwrap();
    assert!(page.contains("Only this file"), "{page}");
}
