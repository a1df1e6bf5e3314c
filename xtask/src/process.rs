//! Runs other programs, shows their output and keeps it.

use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::thread;

use anyhow::{Context, ensure};

use crate::places::repository;

/// The output of a program that ended, and whether it succeeded.
#[derive(Debug)]
pub struct Finished {
    pub success: bool,
    /// Lines of standard output and standard error, in order of arrival.
    pub text: String,
}

/// A command that runs in the repository's folder.
///
/// It does not inherit the variables that cargo sets for this program. Some build scripts read
/// these, so that a build by hand would compile such crates, and everything that depends on them,
/// again.
pub fn command(program: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.args(arguments).current_dir(repository()).stdin(Stdio::null());
    for (name, _) in std::env::vars_os() {
        if name.to_str().is_some_and(is_of_this_package) {
            command.env_remove(name);
        }
    }
    command
}

/// Whether cargo sets a variable for the package that it runs.
fn is_of_this_package(variable: &str) -> bool {
    variable.starts_with("CARGO_PKG_") || variable.starts_with("CARGO_MANIFEST_")
}

/// Runs a command to its end and copies every line to standard error.
///
/// # Errors
/// The program cannot be started.
pub fn run(command: &mut Command) -> anyhow::Result<Finished> {
    run_named("", command)
}

/// Runs a command like [`run`], with `label` in front of every line that it copies. The output that
/// it returns has no labels.
///
/// # Errors
/// The program cannot be started.
pub fn run_named(label: &str, command: &mut Command) -> anyhow::Result<Finished> {
    let program = command.get_program().to_string_lossy().into_owned();
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot run {program}"))?;
    let (sender, lines) = mpsc::channel();
    let streams: [Option<Box<dyn Read + Send>>; 2] = [
        child.stdout.take().map(|stream| Box::new(stream) as _),
        child.stderr.take().map(|stream| Box::new(stream) as _),
    ];
    for stream in streams.into_iter().flatten() {
        let sender = sender.clone();
        thread::spawn(move || pass_on(stream, &sender));
    }
    drop(sender);
    let mut text = String::new();
    for line in lines {
        eprintln!("{label}{line}");
        text.push_str(&line);
        text.push('\n');
    }
    let status = child.wait().with_context(|| format!("cannot wait for {program}"))?;
    Ok(Finished { success: status.success(), text })
}

/// Runs a command that must succeed.
///
/// # Errors
/// The command cannot be started or fails. The error has the command line.
pub fn succeed(command: &mut Command) -> anyhow::Result<()> {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let line = words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
    let finished = run(command).with_context(|| line.clone())?;
    ensure!(finished.success, "`{line}` failed");
    Ok(())
}

fn pass_on(stream: impl Read, sender: &mpsc::Sender<String>) {
    let mut lines = BufReader::new(stream);
    let mut line = Vec::new();
    while lines.read_until(b'\n', &mut line).is_ok_and(|count| count > 0) {
        let text = String::from_utf8_lossy(&line).trim_end().to_owned();
        if sender.send(text).is_err() {
            return;
        }
        line.clear();
    }
}

/// Whether `program` can be found.
pub fn exists(program: &str) -> bool {
    std::env::var_os("PATH").is_some_and(|path| {
        std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_hear_nothing_of_this_package_and_everything_else() {
        // cargo and cargo-nextest set it for tests.
        assert!(std::env::var_os("CARGO_MANIFEST_DIR").is_some());
        let env = command("env", &[]).output().unwrap();
        let text = String::from_utf8(env.stdout).unwrap();
        assert!(
            !text.contains("CARGO_MANIFEST_DIR=") && !text.contains("CARGO_PKG_NAME="),
            "{text}"
        );
        assert!(text.contains("PATH="), "{text}");
    }
}
