//! Checks that systemd and the program accept the units and scripts in `deploy`.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::product::{run_to_end, skip, torqued};

fn deploy(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(name)
}

fn text(name: &str) -> String {
    std::fs::read_to_string(deploy(name)).unwrap()
}

const UNITS: [&str; 2] = ["torqued.service", "torqued-worker@.service"];

#[test]
fn systemd_finds_nothing_wrong_with_the_units() {
    let test = "systemd_finds_nothing_wrong_with_the_units";
    let there = Command::new("systemd-analyze").arg("--version").output();
    if !there.is_ok_and(|output| output.status.success()) {
        return skip(test, "systemd-analyze is not installed");
    }
    // The check looks for the program, which lies elsewhere here.
    let folder = tempfile::tempdir().unwrap();
    let start = format!("ExecStart={}", env!("CARGO_BIN_EXE_torqued"));
    let mut files = Vec::new();
    for unit in UNITS {
        let file = folder.path().join(unit.replace('@', "@1"));
        let unit = text(&format!("systemd/{unit}")).replace("ExecStart=torqued", &start);
        std::fs::write(&file, unit).unwrap();
        files.push(file);
    }
    let mut verify = Command::new("systemd-analyze");
    let (code, output, errors) = run_to_end(verify.args(["verify", "--man=no"]).args(files));
    // It may report problems of the machine's other units.
    let ours: Vec<&str> = errors.lines().filter(|line| line.contains("torqued")).collect();
    assert!(code == Some(0) && ours.is_empty(), "{output}{errors}");
}

/// Checks that the program accepts the flags of a command line. With `--help` it parses them and
/// does nothing.
fn check_flags(line: &str) {
    let words: Vec<&str> =
        line.split_whitespace().skip(1).map(|word| word.trim_matches('"')).collect();
    // Values that the shell or systemd would insert.
    let filled = |word| if str::contains(word, ['$', '%']) { "1" } else { word };
    let words: Vec<&str> = words.into_iter().map(filled).collect();
    let (code, _, errors) = run_to_end(torqued(&words).arg("--help"));
    assert_eq!(code, Some(0), "{line}: {errors}");
}

#[test]
fn the_program_takes_the_flags_that_units_scripts_and_manifests_give_it() {
    for unit in UNITS {
        let unit = text(&format!("systemd/{unit}"));
        let line = unit.lines().find_map(|line| line.strip_prefix("ExecStart=")).unwrap();
        check_flags(line);
    }
    let script = text("slurm/workers.sbatch").replace("\\\n", "");
    check_flags(script.lines().find_map(|line| line.strip_prefix("exec ")).unwrap());
    for (manifest, command) in
        [("server.yaml", "serve"), ("worker.yaml", "worker"), ("migration.yaml", "migrate")]
    {
        let manifest = text(&format!("kubernetes/{manifest}"));
        let arguments: Vec<&str> = manifest
            .lines()
            .filter_map(|line| line.trim().strip_prefix("- "))
            .filter(|word| *word == command || word.starts_with("--"))
            .collect();
        assert!(arguments.len() > 1 && arguments[0] == command, "{arguments:?}");
        check_flags(&format!("torqued {}", arguments.join(" ")));
    }
}
