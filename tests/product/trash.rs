//! `torqued delete`, `undelete`, `trash` and `gc`, and servers that are killed while they empty the
//! trash.

use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use crate::product::{Product, run_to_end, torqued};

/// Simulations of ten shards each.
fn simulations(count: u64) -> Value {
    let simulation = |seed: u64| {
        let spec = json!({
            "preset": "D1-multisine", "seed": seed, "trajectories": 40, "samples": 60,
            "shard_trajectories": 4,
        });
        (format!("s{seed}"), spec)
    };
    let jobs: serde_json::Map<String, Value> = (0..count).map(simulation).collect();
    json!({"kind": "pipeline", "name": "many", "jobs": jobs})
}

fn ask(product: &Product, arguments: &[&str]) -> (Option<i32>, String, String) {
    run_to_end(torqued(arguments).args(["--server", &product.url]))
}

fn answer(product: &Product, arguments: &[&str]) -> String {
    let (code, output, errors) = ask(product, arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {errors}");
    output
}

fn gc(data: &Path, more: &[&str]) -> String {
    let (code, output, errors) = run_to_end(torqued(&["gc", "--data"]).arg(data).args(more));
    assert_eq!(code, Some(0), "{more:?}: {errors}");
    output
}

/// Checks that every file of a row exists with its digest.
fn assert_whole(data: &Path) {
    let nobody = ["--bytes", "--server", "http://127.0.0.1:1"];
    let (code, output, errors) = run_to_end(torqued(&["doctor", "--data"]).arg(data).args(nobody));
    assert_eq!(code, Some(0), "{output}{errors}");
}

#[tokio::test]
async fn a_server_that_is_killed_while_it_empties_the_trash_leaves_no_row_without_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    // Everything may be purged at once, and a server purges when it starts.
    let flags = ["--workers", "0", "--trash-days", "0"];
    let product = Product::start(&data);
    let id = product.submit(&simulations(12)).await;
    product.succeeded(id).await;
    product.end_by("TERM");
    let product = Product::start_with(&data, &flags);
    answer(&product, &["delete", "job", &id.to_string()]);
    product.end_by("KILL");
    for delay in (0..240).step_by(12) {
        let product = Product::start_with(&data, &flags);
        tokio::time::sleep(Duration::from_millis(delay)).await;
        product.end_by("KILL");
        assert_whole(&data);
    }
    let product = Product::start_with(&data, &flags);
    product.when("/v1/trash", |trash| trash["items"] == json!([])).await;
    product.when("/v1/jobs", |jobs| jobs["jobs"] == json!([])).await;
    let (status, _) = product.try_get(&format!("/v1/jobs/{id}")).await;
    assert!(status == 404 || status == 410, "{status}");
    assert_whole(&data);
}

#[tokio::test]
async fn what_gc_foretells_it_deletes_and_until_then_everything_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let id = product.submit(&simulations(2)).await;
    product.succeeded(id).await;
    let training = json!({
        "kind": "train", "data": {"dataset": 1}, "context": 40, "steps": 20, "batch_size": 16,
        "model": {
            "architecture": "robomorph", "d_model": 16, "heads": 2,
            "encoder_layers": 1, "decoder_layers": 1, "patch": 5,
        },
    });
    let training = product.submit(&training).await;
    product.succeeded(training).await;

    let foretold = answer(&product, &["delete", "dataset", "1", "--dry-run"]);
    let reader = format!("train job {training} (");
    assert!(foretold.contains(&reader) && foretold.contains("reads it: --force"), "{foretold}");
    let (code, _, errors) = ask(&product, &["delete", "dataset", "1"]);
    assert!(code == Some(1) && errors.contains("reads it"), "{errors}");
    let files = product.get("/v1/datasets/1").await;
    let done = answer(&product, &["delete", "dataset", "1", "2", "--force"]);
    assert_eq!(done.matches(" is in the trash until ").count(), 2, "{done}");
    let listed = answer(&product, &["trash"]);
    assert_eq!(listed.matches("dataset ").count(), 2, "{listed}");
    assert_eq!(gc(folder.path(), &[]), "deleted 0 things, 0 files, 0 B\n");
    answer(&product, &["undelete", "dataset", "1"]);
    assert_eq!(product.get("/v1/datasets/1").await, files);

    answer(&product, &["delete", "job", &training.to_string()]);
    let foretold = gc(folder.path(), &["--older-than", "0", "--dry-run", "--json"]);
    assert!(foretold.lines().count() >= 3, "{foretold}");
    let table = gc(folder.path(), &["--older-than", "0", "--dry-run"]);
    assert!(table.contains("would delete") && table.contains("checkpoint"), "{table}");
    let deleted = gc(folder.path(), &["--older-than", "0", "--json"]);
    assert_eq!(deleted, foretold);
    assert_eq!(gc(folder.path(), &["--older-than", "0", "--json"]), "");
    let (code, _, errors) = ask(&product, &["undelete", "dataset", "2"]);
    assert!(code == Some(1) && errors.contains("purged from the trash"), "{errors}");
    let (code, output, errors) = run_to_end(
        torqued(&["doctor", "--bytes", "--server", &product.url, "--data"]).arg(folder.path()),
    );
    assert_eq!(code, Some(0), "{output}{errors}");
}

#[tokio::test]
async fn a_server_keeps_as_many_checkpoints_as_it_is_told_and_gc_foretells_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let training = json!({
        "kind": "train", "data": {"stream": {"preset": "D1-multisine"}}, "context": 40, "steps": 20,
        "batch_size": 16, "checkpoint_every_steps": 4, "keep_checkpoints": 9,
        "model": {
            "architecture": "robomorph", "d_model": 16, "heads": 2,
            "encoder_layers": 1, "decoder_layers": 1, "patch": 5,
        },
    });
    let training = product.submit(&training).await;
    product.succeeded(training).await;
    let checkpoints = product.get("/v1/checkpoints").await["checkpoints"].clone();
    let old = |checkpoint: &&Value| {
        checkpoint["final"] == false && checkpoint["best"] == false && checkpoint["step"] != 16
    };
    let ids = |found: &Value, field: &str| {
        let items = found[field].as_array().unwrap().iter();
        let mut ids: Vec<i64> = items.map(|item| item["id"].as_i64().unwrap()).collect();
        ids.sort_unstable();
        ids
    };
    let old: Vec<Value> = checkpoints.as_array().unwrap().iter().filter(old).cloned().collect();
    let old = ids(&json!({"old": old}), "old");
    assert!(old.len() >= 2, "{checkpoints:#}");
    let foretold = gc(folder.path(), &["--dry-run", "--keep-checkpoints", "2"]);
    for id in &old {
        assert!(foretold.contains(&format!("a server will move checkpoint {id} (")), "{foretold}");
    }
    assert_eq!(foretold.matches("a server will move").count(), old.len(), "{foretold}");
    product.end_by("TERM");
    let flags = ["--workers", "0", "--keep-checkpoints", "2", "--keep-logs-days", "1"];
    let product = Product::start_with(folder.path(), &flags);
    let is_all = |trash: &Value| trash["items"].as_array().unwrap().len() == old.len();
    let trash = product.when("/v1/trash", is_all).await;
    assert_eq!(ids(&trash, "items"), old);
    assert_eq!(
        trash["items"][0]["reason"],
        "a training keeps its 2 newest checkpoints and the best"
    );
}
