//! `torqued study` refuses wrong flags before it computes anything.

use crate::product::{run_to_end, torqued};

/// Runs a study that must be refused. Gives what it says.
fn refusal(arguments: &[&str]) -> String {
    let data = tempfile::tempdir().unwrap();
    let mut command = torqued(&["study", "--listen", "127.0.0.1:0", "--exit"]);
    command.arg("--data").arg(data.path().join("data"));
    command.arg("--out").arg(data.path().join("report"));
    let (code, _, errors) = run_to_end(command.args(arguments));
    assert!(code.is_some_and(|code| code != 0), "exit code {code:?}");
    assert!(!data.path().join("data").exists(), "nothing was begun");
    errors
}

#[test]
fn an_edition_without_that_scale_says_which_it_has() {
    let errors = refusal(&["--edition", "real", "--scale", "paper"]);
    assert!(errors.contains("the edition real has tiny and small"), "{errors}");
}

#[test]
fn recordings_that_are_not_there_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_string_lossy();
    let errors = refusal(&["--edition", "real", "--scale", "tiny", "--recordings", &path]);
    assert!(errors.contains(&*path) && errors.contains("panda_exciting.csv"), "{errors}");
    let errors = refusal(&["--scale", "tiny", "--recordings", &path]);
    assert!(errors.contains("only --edition real asks about recordings"), "{errors}");
}
