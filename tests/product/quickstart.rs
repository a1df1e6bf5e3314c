//! The README's command, run as a user types it, and then a second time.

use std::time::{Duration, Instant};

use crate::product::{run_to_end, torqued};

#[test]
fn quickstart_prints_the_table_and_a_second_run_reuses_everything_in_seconds() {
    let data = tempfile::tempdir().unwrap();
    let quickstart = || {
        let mut command = torqued(&["quickstart", "--exit", "--listen", "127.0.0.1:0", "--data"]);
        run_to_end(command.arg(data.path()))
    };
    let (code, table, progress) = quickstart();
    assert_eq!(code, Some(0), "{progress}");
    let expected = ["in distribution", "out of distribution", "hold-last", "identification"];
    for words in expected.into_iter().chain(["robomorph", "lagrangian", "via-points", "1.25"]) {
        assert!(table.contains(words), "{words:?} is not in\n{table}");
    }
    assert!(table.contains("better than hold-last in distribution"), "{table}");
    assert!(table.contains(&*data.path().to_string_lossy()), "{table}");
    for stage in ["train-set", "test-grid", "train", "evaluate"] {
        let said = progress.lines().any(|line| line.starts_with(stage) && line.contains("done"));
        assert!(said, "{stage} is not done in\n{progress}");
    }

    let started = Instant::now();
    let (code, table_again, progress) = quickstart();
    assert_eq!(code, Some(0), "{progress}");
    assert!(started.elapsed() < Duration::from_secs(10), "took {:?}", started.elapsed());
    assert!(progress.contains("nothing to compute"), "{progress}");
    let numbers = |text: &str| text.split("page").next().unwrap_or_default().to_owned();
    assert_eq!(numbers(&table_again), numbers(&table));
}
