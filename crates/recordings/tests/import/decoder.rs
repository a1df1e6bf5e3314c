//! Child processes: one that is reused for many files, and one like the product's.

use std::cell::RefCell;
use std::io::{BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use recordings::{Decoder, DecoderProgram, Frames, ImportError, Rows};
use serde_json::json;
use spec::ImportSpec;

use super::{
    Imported, Recordings, convert, import, mcap, npz, parquet, parquet_of, small_pages, spec,
};

const PROGRAM: &str = env!("CARGO_BIN_EXE_decoder");

/// A child that decodes one file after the other.
struct Reused {
    process: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Reused {
    fn start() -> Self {
        let mut process = Command::new(PROGRAM)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let input = process.stdin.take();
        let output = BufReader::new(process.stdout.take().unwrap());
        Self { process, input, output }
    }

    /// Sends a file. If the child died over the file before, reading the answer detects it.
    fn say(&mut self, file: &[u8], spec: &ImportSpec) {
        let spec = serde_json::to_vec(spec).unwrap();
        let mut message = Vec::new();
        for piece in [&spec[..], file] {
            message.extend(u32::try_from(piece.len()).unwrap().to_le_bytes());
            message.extend(piece);
        }
        self.input.as_mut().unwrap().write_all(&message).unwrap();
    }
}

impl Drop for Reused {
    fn drop(&mut self) {
        drop(self.input.take());
        self.process.wait().unwrap();
    }
}

thread_local! {
    static REUSED: RefCell<Option<Reused>> = const { RefCell::new(None) };
}

/// Decodes a file with this thread's child, and passes its rows to `use_rows`.
///
/// A child that dies is replaced.
pub fn reused<T>(
    file: &[u8],
    spec: &ImportSpec,
    use_rows: impl FnOnce(&mut dyn Iterator<Item = Result<Rows, ImportError>>) -> Result<T, ImportError>,
) -> Result<T, ImportError> {
    REUSED.with_borrow_mut(|child| {
        let reused = child.get_or_insert_with(Reused::start);
        reused.say(file, spec);
        let mut rows = Frames::new(&mut reused.output, spec);
        let result = use_rows(&mut rows);
        // Unread rows would be taken for those of the next file.
        let rest = rows.find(|rows| matches!(rows, Err(ImportError::Pipe(_))));
        if rest.is_some() || matches!(result, Err(ImportError::Pipe(_))) {
            *child = None;
        }
        result
    })
}

fn program() -> DecoderProgram {
    DecoderProgram { program: PathBuf::from(PROGRAM), arguments: Vec::new() }
}

/// Decodes a file in the same way as the product.
pub fn import_alone(file: &[u8], spec: &ImportSpec) -> Result<Imported, ImportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    std::fs::write(&path, file).unwrap();
    let file = std::fs::File::open(path).unwrap();
    convert(Decoder::start(&program(), file, "arm.parquet", spec)?, spec)
}

#[test]
fn a_file_on_standard_input_is_decoded_as_one_in_memory() {
    let recordings = Recordings::of(&[40, 40]);
    let one = Recordings::of(&[40]);
    let spec = |format: &str, columns: serde_json::Value| match columns {
        serde_json::Value::Null => spec(format, &json!({})),
        columns => spec(format, &json!({"columns": columns})),
    };
    let lists = parquet_of(parquet::with_lists(&recordings), small_pages());
    for (file, spec) in [
        (recordings.csv().into_bytes(), spec("csv", json!(null))),
        (recordings.parquet(small_pages()), spec("parquet", json!(null))),
        (lists, spec("parquet", parquet::of_lists())),
        (npz::archive(&recordings, true), spec("npz", npz::columns())),
        (mcap::file(&one, "zstd"), spec("mcap", mcap::columns())),
        (mcap::file(&one, "lz4"), spec("mcap", mcap::columns())),
    ] {
        let (alone, reused) = (import_alone(&file, &spec).unwrap(), import(file, &spec).unwrap());
        assert_eq!(alone.samples, reused.samples);
        assert_eq!(alone.table, reused.table);
    }
}

#[test]
fn a_refusal_arrives_as_the_child_words_it() {
    let spec = spec("parquet", &json!({}));
    let error = import_alone(b"PAR1........PAR1", &spec).err().unwrap();
    assert!(matches!(error, ImportError::Undecodable(_)) && !error.may_pass(), "{error:?}");
    assert!(error.to_string().contains("footer claims"), "{error}");
}

/// Has the child try to reach a file, a server and a socket that exist. Returns its report of each
/// attempt.
#[cfg(target_os = "linux")]
fn attacks(how: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("secret"), "of another user").unwrap();
    let server = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let _socket = std::os::unix::net::UnixListener::bind(path("socket")).unwrap();
    let address = server.local_addr().unwrap().to_string();
    let words = ["attack", how, &path("secret"), &address, &path("socket")];
    let arguments = words.map(str::to_owned).to_vec();
    let program = DecoderProgram { program: PathBuf::from(PROGRAM), arguments };
    let file = std::fs::File::open("/dev/null").unwrap();
    let mut decoder = Decoder::start(&program, file, "a", &spec("csv", &json!({}))).unwrap();
    match decoder.next().unwrap() {
        Err(ImportError::Died { said, .. }) => said.lines().map(str::to_owned).collect(),
        other => panic!("{other:?}"),
    }
}

/// Without the confinement, every one of these succeeds.
#[cfg(target_os = "linux")]
#[test]
fn a_decoder_opens_no_other_file_and_no_connection() {
    let verdicts = |how: &str| -> Vec<(String, bool)> {
        let told = attacks(how).join(" ");
        let attempts = [
            "reads a file",
            "measures a file",
            "writes a file",
            "makes a file",
            "lists a folder",
            "reads its parent's variables",
            "connects:",
            "sends a datagram",
            "connects to a socket",
            "starts a program",
            "starts a thread",
            "signals its parent",
        ];
        let verdict = |attempt: &str| {
            let (_, rest) = told.split_once(attempt).unwrap_or_else(|| panic!("{attempt}: {told}"));
            rest.trim_start_matches(':').trim_start().starts_with("done")
        };
        attempts.into_iter().map(|attempt| (attempt.to_owned(), verdict(attempt))).collect()
    };
    for (attempt, succeeds) in verdicts("free") {
        assert!(succeeds, "{attempt} without confinement");
    }
    for (attempt, succeeds) in verdicts("confined") {
        assert!(!succeeds, "{attempt} in spite of the confinement");
    }
}

/// The variables of a worker have the token, and the keys of the database and of the bucket.
#[cfg(target_os = "linux")]
#[test]
fn a_decoder_gets_no_variable_of_the_worker() {
    assert!(std::env::var_os("CARGO_MANIFEST_DIR").is_some(), "this process has variables");
    let told = attacks("confined").join(" ");
    let words: Vec<&str> = told.split_whitespace().collect();
    let found: Vec<&str> =
        words.windows(2).filter(|pair| pair[0] == "variable").map(|pair| pair[1]).collect();
    assert!(found.contains(&"RUST_BACKTRACE"), "{told}");
    for variable in found {
        let allowed = ["RUST_BACKTRACE", "MIMALLOC_ARENA_EAGER_COMMIT", "LD_LIBRARY_PATH"];
        assert!(allowed.contains(&variable), "{variable}");
    }
}

#[test]
fn a_program_that_cannot_be_started_may_be_there_at_the_next_attempt() {
    let program = DecoderProgram { program: "/no/such/program".into(), arguments: Vec::new() };
    let file = std::fs::File::open("/dev/null").unwrap();
    let error = Decoder::start(&program, file, "a", &spec("csv", &json!({}))).err().unwrap();
    assert!(matches!(error, ImportError::Start(_)) && error.may_pass(), "{error:?}");
}

/// The error when the child is `sh -c SCRIPT`.
fn end_of(script: &str) -> ImportError {
    let arguments = vec!["-c".to_owned(), script.to_owned()];
    let program = DecoderProgram { program: "/bin/sh".into(), arguments };
    let file = std::fs::File::open("/dev/null").unwrap();
    let mut decoder = Decoder::start(&program, file, "arm.csv", &spec("csv", &json!({}))).unwrap();
    let error = decoder.next().unwrap().err().unwrap();
    assert!(decoder.next().is_none(), "an error is the last thing said");
    error
}

#[test]
fn a_child_that_dies_is_told_with_the_file_and_what_ended_it() {
    let memory = end_of("echo 'memory allocation of 7 bytes failed' >&2; kill -ABRT $$");
    assert!(memory.to_string().contains("\"arm.csv\" cannot be imported"), "{memory}");
    assert!(memory.to_string().contains("more than 1024 MiB of memory"), "{memory}");
    let time = end_of("kill -XCPU $$");
    assert!(
        time.to_string().contains("\"arm.csv\"") && time.to_string().contains("60 s"),
        "{time}"
    );
    let killed = end_of("echo 'so long' >&2; kill -KILL $$");
    assert!(killed.to_string().contains("SIGKILL") && killed.to_string().contains("so long"));
    assert!(!memory.may_pass() && !time.may_pass() && !killed.may_pass());
}

#[test]
fn a_child_that_says_something_else_is_not_believed() {
    let error = end_of("printf 'r\\377\\377\\377\\377'; exec sleep 600");
    assert!(matches!(error, ImportError::Pipe(_)), "{error:?}");
}

#[test]
fn a_decoder_that_nobody_wants_any_more_ends() {
    let folder = tempfile::tempdir().unwrap();
    let pid_file = folder.path().join("pid");
    let script = format!("echo $$ > {}; exec sleep 600", pid_file.display());
    let program =
        DecoderProgram { program: "/bin/sh".into(), arguments: vec!["-c".to_owned(), script] };
    let file = std::fs::File::open("/dev/null").unwrap();
    let decoder = Decoder::start(&program, file, "a", &spec("csv", &json!({}))).unwrap();
    let pid = loop {
        match std::fs::read_to_string(&pid_file) {
            Ok(pid) if pid.ends_with('\n') => break pid,
            _ => std::thread::yield_now(),
        }
    };
    drop(decoder);
    assert!(!std::path::Path::new("/proc").join(pid.trim()).exists());
}

/// The child's standard input, which this test holds, is still open. A shell replaces the standard
/// input of background commands, so it is passed as descriptor 3.
#[cfg(target_os = "linux")]
#[test]
fn a_decoder_ends_with_the_process_that_started_it() {
    use std::io::BufRead;

    let mut parent = Command::new("sh")
        .args(["-c", "exec 3<&0; \"$0\" <&3 & echo $!; wait", PROGRAM])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pid = String::new();
    BufReader::new(parent.stdout.take().unwrap()).read_line(&mut pid).unwrap();
    let child = PathBuf::from("/proc").join(pid.trim());
    let is_confined = || {
        let limits = std::fs::read_to_string(child.join("limits")).unwrap();
        let time = limits.lines().find_map(|line| line.strip_prefix("Max cpu time"));
        !time.unwrap().trim_start().starts_with("unlimited")
    };
    wait_until(is_confined);
    parent.kill().unwrap();
    wait_until(|| {
        let state = std::fs::read_to_string(child.join("stat")).unwrap_or_default();
        state.is_empty() || state.contains(") Z ")
    });
    parent.wait().unwrap();
}

#[cfg(target_os = "linux")]
fn wait_until(reached: impl Fn() -> bool) {
    for _ in 0..1000 {
        if reached() {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    panic!("still waiting");
}
