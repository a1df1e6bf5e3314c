//! A child process that decodes a file.

use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::thread::{self, JoinHandle};

use spec::ImportSpec;

use crate::ImportError;
use crate::frames::Frames;
use crate::rows::Rows;

/// How to start a process that calls [`crate::decode_standard_input`] with its last argument.
#[derive(Clone, Debug)]
pub struct DecoderProgram {
    /// The program: the product itself, or a small one in tests.
    pub program: PathBuf,
    /// The arguments before the spec.
    pub arguments: Vec<String>,
}

/// The rows of a file, decoded in a child process with limits on its memory and time. The child
/// ends with this value.
pub struct Decoder {
    process: Child,
    frames: Frames<BufReader<ChildStdout>>,
    /// Logs the child's messages. When the child has ended, returns the first of them.
    listener: Option<JoinHandle<String>>,
    /// The file's name, for errors.
    name: String,
}

/// Number of bytes kept from a child's messages before it dies.
const KEPT_BYTES: usize = 16 * 1024;

/// Number of bytes of a line that are read at once.
const LINE_BYTES: u64 = 4 * 1024;

/// The only variable that a child inherits. Where libraries are in unusual folders, the program
/// does not start without it. Others have the token and the keys of the database and the bucket.
const KEPT_VARIABLE: &str = "LD_LIBRARY_PATH";

impl Decoder {
    /// Starts `program` to decode `file`, which its sender called `name`.
    ///
    /// # Errors
    /// When no process can be started.
    pub fn start(
        program: &DecoderProgram,
        file: File,
        name: &str,
        spec: &ImportSpec,
    ) -> Result<Self, ImportError> {
        let mut process = Command::new(&program.program)
            .args(&program.arguments)
            .arg(serde_json::to_string(spec).map_err(|error| ImportError::Start(error.into()))?)
            .env_clear()
            .envs(std::env::var_os(KEPT_VARIABLE).map(|value| (KEPT_VARIABLE, value)))
            .env("RUST_BACKTRACE", "0")
            // Otherwise mimalloc, the product's allocator, would reserve memory by the gigabyte.
            .env("MIMALLOC_ARENA_EAGER_COMMIT", "0")
            .stdin(file)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(ImportError::Start)?;
        let stdout = process.stdout.take();
        let stdout = stdout.ok_or_else(|| ImportError::Start(ErrorKind::BrokenPipe.into()))?;
        let frames = Frames::new(BufReader::new(stdout), spec);
        let listener = process.stderr.take().map(|stderr| thread::spawn(|| listen(stderr)));
        Ok(Self { process, frames, listener, name: name.to_owned() })
    }

    /// Why the frames ended too early.
    fn death(&mut self, pipe: io::Error) -> ImportError {
        if pipe.kind() != ErrorKind::UnexpectedEof {
            return pipe.into();
        }
        let status = match self.process.wait() {
            Ok(status) => status,
            Err(error) => return error.into(),
        };
        let said = self.listener.take().and_then(|listener| listener.join().ok());
        let said = said.unwrap_or_default();
        let file = self.name.clone();
        // The message of Rust's allocation error. The decoders allocate little memory in other
        // ways.
        if said.contains("memory allocation of") {
            ImportError::Memory { file }
        } else if status.signal() == Some(libc::SIGXCPU) {
            ImportError::Time { file }
        } else {
            let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
            ImportError::Died { file, status, said }
        }
    }
}

/// Logs the messages of a child until it ends. If nobody read them, the child would block when the
/// pipe is full.
fn listen(stderr: ChildStderr) -> String {
    let mut lines = BufReader::new(stderr);
    let mut said = String::new();
    let mut line = Vec::new();
    while lines.by_ref().take(LINE_BYTES).read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
        let text = String::from_utf8_lossy(&line);
        tracing::warn!("the decoder says: {}", text.trim_end());
        if said.len() < KEPT_BYTES {
            said.push_str(&text);
        }
        line.clear();
    }
    said
}

impl Iterator for Decoder {
    type Item = Result<Rows, ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        let rows = self.frames.next()?;
        Some(rows.map_err(|error| match error {
            ImportError::Pipe(pipe) => self.death(pipe),
            other => other,
        }))
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        // Both fail only if the process has ended and was waited for.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
