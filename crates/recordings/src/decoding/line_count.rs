//! Counts the lines of a text as an editor does.

use std::collections::VecDeque;

/// Counts the line breaks of a file that is read ahead of its records. `\n`, `\r\n` and `\r` are
/// one break each.
///
/// The CSV reader also counts lines. But in a file with `\r\n`, or after an empty line, it gives a
/// record the number of the line before.
#[derive(Debug, Default)]
pub(super) struct Lines {
    /// Number of bytes seen.
    bytes: u64,
    ends_in_return: bool,
    ends_in_break: bool,
    /// Positions of the breaks that were seen and not passed.
    ahead: VecDeque<u64>,
    passed: u64,
}

impl Lines {
    /// Takes the next bytes of the file.
    pub fn see(&mut self, bytes: &[u8]) {
        for (position, byte) in (self.bytes..).zip(bytes) {
            if is_break(*byte, self.ends_in_return) {
                self.ahead.push_back(position);
            }
            self.ends_in_return = *byte == b'\r';
            self.ends_in_break = self.ends_in_return || *byte == b'\n';
        }
        self.bytes += bytes.len() as u64;
    }

    /// Advances to the end of a record, `end` bytes into the file. Returns the line of the record's
    /// last byte.
    pub fn pass(&mut self, end: u64) -> u64 {
        // The break that ends the record belongs to its line.
        while self.ahead.front().is_some_and(|position| position + 1 < end) {
            self.ahead.pop_front();
            self.passed += 1;
        }
        self.last()
    }

    /// The line of the last byte that was passed.
    pub fn last(&self) -> u64 {
        self.passed + 1
    }

    /// Whether the bytes seen so far do not end with a break.
    pub fn ends_open(&self) -> bool {
        self.bytes > 0 && !self.ends_in_break
    }

    /// Breaks within a value.
    pub fn within(value: &[u8]) -> u64 {
        let mut lines = Self::default();
        lines.see(value);
        lines.ahead.len() as u64
    }
}

fn is_break(byte: u8, is_after_return: bool) -> bool {
    byte == b'\r' || (byte == b'\n' && !is_after_return)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_break_counts_once() {
        for text in ["a\nb\nc", "a\r\nb\r\nc", "a\rb\rc", "a\r\nb\nc"] {
            assert_eq!(Lines::within(text.as_bytes()), 2, "{text:?}");
        }
    }

    #[test]
    fn a_text_ends_open_unless_a_break_ends_it() {
        for (text, is_open) in [("", false), ("a", true), ("a\n", false), ("a\r", false)] {
            let mut lines = Lines::default();
            lines.see(text.as_bytes());
            assert_eq!(lines.ends_open(), is_open, "{text:?}");
        }
    }

    #[test]
    fn a_break_between_two_reads_counts_once() {
        let mut lines = Lines::default();
        lines.see(b"a\r");
        lines.see(b"\nb\n");
        assert_eq!((lines.pass(2), lines.pass(5)), (1, 2));
    }
}
