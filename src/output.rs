//! Standard output. [`print!`] and [`println!`] are those of this module throughout the program: the standard library's
//! panic when nobody reads any more, as after `torqued jobs | head`.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::process;

use serde::Serialize;

/// The code that a shell reports for a program that SIGPIPE ended, as it ends other tools.
const NOBODY_READS: i32 = 128 + 13;

macro_rules! print {
    ($($argument:tt)*) => { $crate::output::write(format_args!($($argument)*)) };
}

macro_rules! println {
    ($($argument:tt)*) => {
        $crate::output::write(format_args!("{}\n", format_args!($($argument)*)))
    };
}

/// Writes to standard output; ends this process quietly when nobody reads what it writes.
///
/// # Panics
/// When it cannot be written for another reason.
pub fn write(text: Arguments<'_>) {
    let mut output = io::stdout().lock();
    match output.write_fmt(text).and_then(|()| output.flush()) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => process::exit(NOBODY_READS),
        Err(error) => panic!("cannot write to standard output: {error}"),
    }
}

/// Writes a document of the API in a line.
///
/// # Errors
/// When it has no JSON; every document of the API has.
pub fn write_json(document: &impl Serialize) -> serde_json::Result<()> {
    println!("{}", serde_json::to_string(document)?);
    Ok(())
}

/// Writes what is no text to standard output.
///
/// # Errors
/// When it cannot be written; nobody reading is none.
pub fn write_bytes(bytes: &[u8]) -> io::Result<()> {
    let mut output = io::stdout().lock();
    match output.write_all(bytes).and_then(|()| output.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => process::exit(NOBODY_READS),
        written => written,
    }
}
