//! Standard output. Throughout the program, [`print!`] and [`println!`] are those of this module:
//! the standard library's panic when nobody reads any more, as in `torqued jobs | head`.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::process;

use serde::Serialize;

/// The exit code that a shell reports for a program ended by SIGPIPE, as other tools are.
const NOBODY_READS: i32 = 128 + 13;

macro_rules! print {
    ($($argument:tt)*) => { $crate::output::write(format_args!($($argument)*)) };
}

macro_rules! println {
    ($($argument:tt)*) => {
        $crate::output::write(format_args!("{}\n", format_args!($($argument)*)))
    };
}

/// Writes to standard output. Ends this process quietly when nobody reads the output.
///
/// # Panics
/// When writing fails for another reason.
pub fn write(text: Arguments<'_>) {
    let mut output = io::stdout().lock();
    match output.write_fmt(text).and_then(|()| output.flush()) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => process::exit(NOBODY_READS),
        Err(error) => panic!("cannot write to standard output: {error}"),
    }
}

/// Writes a document of the API as one line.
///
/// # Errors
/// When it cannot be written as JSON. Every document of the API can.
pub fn write_json(document: &impl Serialize) -> serde_json::Result<()> {
    println!("{}", serde_json::to_string(document)?);
    Ok(())
}

/// Writes binary data to standard output.
///
/// # Errors
/// When writing fails. If nobody reads the output, that is no error.
pub fn write_bytes(bytes: &[u8]) -> io::Result<()> {
    let mut output = io::stdout().lock();
    match output.write_all(bytes).and_then(|()| output.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => process::exit(NOBODY_READS),
        written => written,
    }
}
