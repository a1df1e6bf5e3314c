//! The child process of this crate's tests. With a spec as its argument it decodes its standard
//! input, like the product's own child. Without one it decodes one file after the other.
//!
//! Each file follows its spec in JSON. Both come after their length in 4 bytes, little-endian.

use std::io::{self, Read};

fn main() -> io::Result<()> {
    match std::env::args().nth(1) {
        Some(spec) => recordings::decode_standard_input(&spec),
        None => decode_many(),
    }
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
