//! Text whose columns are separated by any number of spaces.

use std::io::{self, Read};

/// A text in which one space stands for several spaces and tabs, and none at the ends of lines. The
/// breaks of lines stay.
pub(super) struct OneSpace<R> {
    inner: R,
    /// Whether spaces follow the last byte.
    is_pending: bool,
    is_in_line: bool,
}

impl<R> OneSpace<R> {
    pub const fn new(inner: R) -> Self {
        Self { inner, is_pending: false, is_in_line: false }
    }
}

impl<R: Read> Read for OneSpace<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // A pending space may come before the bytes.
        let mut bytes = vec![0; buffer.len().saturating_sub(1)];
        loop {
            let read = self.inner.read(&mut bytes)?;
            let mut written = 0;
            let mut write = |byte| {
                buffer[written] = byte;
                written += 1;
            };
            for byte in &bytes[..read] {
                match byte {
                    b' ' | b'\t' => self.is_pending = self.is_in_line,
                    b'\r' | b'\n' => {
                        (self.is_pending, self.is_in_line) = (false, false);
                        write(*byte);
                    }
                    _ => {
                        if std::mem::take(&mut self.is_pending) {
                            write(b' ');
                        }
                        self.is_in_line = true;
                        write(*byte);
                    }
                }
            }
            if read == 0 || written > 0 {
                return Ok(written);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_space_stands_for_all_of_them_however_they_are_read() {
        let text = "  a \t b\r\n\n c  d  \n e";
        for size in [2, 3, 5, 100] {
            let mut spaced = OneSpace::new(text.as_bytes());
            let mut found = Vec::new();
            let mut buffer = vec![0; size];
            loop {
                match spaced.read(&mut buffer).unwrap() {
                    0 => break,
                    read => found.extend(&buffer[..read]),
                }
            }
            assert_eq!(String::from_utf8(found).unwrap(), "a b\r\n\nc d\ne", "{size}");
        }
    }
}
