//! Runs Slurm's commands.

use std::ffi::OsStr;
use std::io;
use std::process::Stdio;
use std::time::Duration;

use tokio::io::AsyncWriteExt;
use tokio::process::Command;

use crate::{EngineError, SERVERS_TOKEN};

/// Time limit of a command. Slurm's own commands give up on an absent controller after about 10 to
/// 100 s.
const LIMIT: Duration = Duration::from_secs(30);

/// The largest part of an output that an error quotes, in characters.
const QUOTED: usize = 500;

pub struct Program {
    name: &'static str,
    command: Command,
}

impl Program {
    pub fn new(name: &'static str) -> Self {
        let mut command = Command::new(name);
        command.env("LC_ALL", "C").kill_on_drop(true);
        // The operator's own settings must not change the output. Slurm could show the token to
        // everybody who may see a job.
        let settings = ["SQUEUE_FORMAT", "SQUEUE_FORMAT2", "SQUEUE_STATES", "SBATCH_EXPORT"];
        for variable in settings.into_iter().chain([SERVERS_TOKEN]) {
            command.env_remove(variable);
        }
        Self { name, command }
    }

    pub fn arg(mut self, argument: impl AsRef<OsStr>) -> Self {
        self.command.arg(argument);
        self
    }

    pub fn args(mut self, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Self {
        self.command.args(arguments);
        self
    }

    pub fn envs(mut self, variables: &[(String, String)]) -> Self {
        self.command.envs(variables.iter().map(|(name, value)| (name, value)));
        self
    }

    /// Runs the command with `input` on standard input. Returns its output.
    ///
    /// # Errors
    /// When it cannot be started, takes too long or fails.
    pub async fn run(mut self, input: Vec<u8>) -> Result<String, EngineError> {
        let program = self.name;
        self.command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let run = async {
            let mut child = self.command.spawn()?;
            if let Some(mut stdin) = child.stdin.take() {
                // A command that does not read to the end says why when it ends.
                let _ = stdin.write_all(&input).await;
            }
            child.wait_with_output().await
        };
        let output = tokio::time::timeout(LIMIT, run)
            .await
            .map_err(|_| EngineError::ProgramSilent { program, limit: LIMIT })?
            .map_err(|source: io::Error| EngineError::Program { program, source })?;
        if output.status.success() {
            return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
        }
        let said = String::from_utf8_lossy(&output.stderr);
        let lines: Vec<&str> = said.lines().map(|line| line.trim_start_matches(program)).collect();
        let message: String = lines.join("; ").chars().take(QUOTED).collect();
        let message = match message.trim_start_matches(": ").trim_start_matches("error: ") {
            "" => output.status.to_string(),
            message => message.to_owned(),
        };
        Err(EngineError::ProgramFailed { program, message })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_command_that_fails_says_why_without_its_name() {
        let error = |script: &'static str| async move {
            let program = Program::new("sh").args(["-c", script]);
            program.run(Vec::new()).await.unwrap_err().to_string()
        };
        let said = error("echo 'sh: error: Invalid partition' >&2; exit 1").await;
        assert_eq!(said, "Slurm's sh failed: Invalid partition");
        assert_eq!(error("exit 3").await, "Slurm's sh failed: exit status: 3");
        let absent = Program::new("squeue-of-nobody").run(Vec::new()).await.unwrap_err();
        assert!(matches!(absent, EngineError::Program { .. }), "{absent}");
    }

    #[tokio::test]
    async fn a_command_is_given_its_input_and_answers_with_its_output() {
        let printed = Program::new("cat").run(b"#!/bin/sh\n".to_vec()).await.unwrap();
        assert_eq!(printed, "#!/bin/sh\n");
    }
}
