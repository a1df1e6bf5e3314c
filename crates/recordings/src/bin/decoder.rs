//! The child process of this crate's tests. With a spec as its argument it decodes its standard
//! input, like the product's own child. Without one it decodes one file after the other.
//!
//! Each file follows its spec in JSON. Both come after their length in 4 bytes, little-endian.
//!
//! As `decoder attack confined FILE ADDRESS SOCKET` it tries to get out of its confinement, and
//! tells on standard error what succeeds. With `free` instead of `confined` it is not confined.

use std::fs::{self, File};
use std::io::{self, Read};
use std::net::{TcpStream, UdpSocket};
use std::os::unix::net::UnixStream;
use std::os::unix::process::parent_id;
use std::process::Command;
use std::thread;

fn main() -> io::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["attack", how, file, address, socket, ..] => attack(how, file, address, socket),
        [spec] => recordings::decode_standard_input(spec),
        _ => decode_many(),
    }
}

fn attack(how: &str, file: &str, address: &str, socket: &str) -> io::Result<()> {
    for (variable, _) in std::env::vars_os() {
        eprintln!("variable {}", variable.display());
    }
    let parent = parent_id();
    if how == "confined" {
        // The output is not used.
        recordings::confine(io::stdout())?;
    }
    tell("reads a file", fs::read(file));
    tell("measures a file", fs::metadata(file));
    tell("writes a file", File::options().append(true).open(file));
    tell("makes a file", File::create(format!("{file}.{how}")));
    tell("lists a folder", fs::read_dir("/"));
    tell("reads its parent's variables", fs::read(format!("/proc/{parent}/environ")));
    tell("connects", TcpStream::connect(address));
    tell(
        "sends a datagram",
        UdpSocket::bind("127.0.0.1:0").and_then(|udp| udp.send_to(b"x", address)),
    );
    tell("connects to a socket", UnixStream::connect(socket));
    tell("starts a program", Command::new("/bin/true").spawn());
    tell("starts a thread", thread::Builder::new().spawn(|| ()));
    tell("signals its parent", signal(parent));
    Ok(())
}

fn tell<T>(what: &str, result: io::Result<T>) {
    match result {
        Ok(_) => eprintln!("{what}: done"),
        Err(error) => eprintln!("{what}: refused, {error}"),
    }
}

/// Asks whether the parent could get a signal.
fn signal(parent: u32) -> io::Result<()> {
    let parent = libc::pid_t::try_from(parent).map_err(io::Error::other)?;
    // SAFETY: signal 0 reaches nobody.
    if unsafe { libc::kill(parent, 0) } == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

fn decode_many() -> io::Result<()> {
    let mut output = recordings::confine(io::stdout().lock())?;
    std::panic::set_hook(Box::new(|_| {}));
    let mut input = io::stdin().lock();
    while let Some(spec) = read_piece(&mut input)? {
        let spec = serde_json::from_slice(&spec)?;
        let file = read_piece(&mut input)?.unwrap_or_default();
        recordings::decode(bytes::Bytes::from(file), &spec, &mut output)?;
    }
    Ok(())
}

/// Reads one piece; `None` at the end of the input.
fn read_piece(input: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut length = [0; 4];
    match input.read_exact(&mut length) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        other => other?,
    }
    let mut piece = vec![0; u32::from_le_bytes(length) as usize];
    input.read_exact(&mut piece)?;
    Ok(Some(piece))
}
