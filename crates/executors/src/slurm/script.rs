//! The script of a job. Everybody who may see the job can read it.

use std::os::unix::ffi::OsStrExt;

use crate::{Ask, WorkerCommand};

/// The script replaces itself by the worker (exec), so that Slurm's signals reach the worker.
pub fn of(command: &WorkerCommand, ask: &Ask) -> Vec<u8> {
    let mut script = b"#!/bin/sh\nexec".to_vec();
    let mut push = |word: &[u8]| {
        script.push(b' ');
        script.extend(quoted(word));
    };
    push(command.program.as_os_str().as_bytes());
    push(b"worker");
    command.store.iter().for_each(|word| push(word.as_bytes()));
    command.flags_of(ask).iter().for_each(|word| push(word.as_bytes()));
    script.push(b'\n');
    script
}

/// The names of the worker's variables. Their values are passed from the environment of `sbatch` to
/// that of the job.
pub fn variables(command: &WorkerCommand) -> String {
    let names: Vec<&str> = command.environment.iter().map(|(name, _)| name.as_str()).collect();
    if names.is_empty() { "NIL".to_owned() } else { names.join(",") }
}

/// A word in quotes, so that a shell reads it as one word.
fn quoted(word: &[u8]) -> Vec<u8> {
    let mut quoted = vec![b'\''];
    for &byte in word {
        if byte == b'\'' {
            quoted.extend(br"'\''");
        } else {
            quoted.push(byte);
        }
    }
    quoted.push(b'\'');
    quoted
}

#[cfg(test)]
mod tests {
    use std::process::Command;
    use std::time::Duration;

    use spec::Resources;

    use super::*;

    #[test]
    fn the_script_becomes_the_worker_and_holds_no_secret() {
        let command = WorkerCommand {
            program: "/opt/it's here/torqued".into(),
            store: vec!["--data".into(), "/lab/$HOME data".into()],
            device: "cpu".to_owned(),
            gpu_device: "cuda".to_owned(),
            lease_seconds: 15,
            log: "info".to_owned(),
            idle_exit: Duration::from_secs(300),
            environment: vec![("TORQUED_DATABASE".to_owned(), "postgres://u:secret@db".to_owned())],
        };
        let tags = ["fast".to_owned()].into();
        let resources = Resources { cpus: Some(4), gpus: 1, memory_gb: Some(8.5), tags };
        let ask = Ask { name: "torqued-ab-cd".to_owned(), resources, stays: false };
        let script = String::from_utf8(of(&command, &ask)).unwrap();
        assert!(!script.contains("secret"), "{script}");
        assert_eq!(variables(&command), "TORQUED_DATABASE");
        // The shell prints the command instead of running it.
        let printing = script.replace("exec '", "printf '%s\\n' '");
        let output = Command::new("sh").args(["-c", &printing]).output().unwrap();
        let words = String::from_utf8(output.stdout).unwrap();
        let expected = "/opt/it's here/torqued worker --data /lab/$HOME data --name torqued-ab-cd --threads 4 \
                        --device cuda --lease-seconds 15 --log info --gpus 1 --memory-gb 8.5 --tag fast --idle-exit 300";
        assert_eq!(words.lines().collect::<Vec<_>>().join(" "), expected);
        let staying = String::from_utf8(of(&command, &Ask { stays: true, ..ask })).unwrap();
        assert!(!staying.contains("idle-exit"), "{staying}");
    }
}
