//! The `Range` header of RFC 9110, section 14, for files of known size.

/// The bytes of a file that a request asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Requested {
    /// All bytes: there is no range, it cannot be read, or there are several (which a server may
    /// ignore).
    Whole,
    /// `first..=last`, which lies within the file.
    Part { first: u64, last: u64 },
    /// A range that begins beyond the end of the file.
    Unsatisfiable,
}

/// Reads a `Range` header for a file of `size` bytes.
pub fn requested(header: &str, size: u64) -> Requested {
    let Some((unit, ranges)) = header.split_once('=') else { return Requested::Whole };
    if !unit.trim().eq_ignore_ascii_case("bytes") || ranges.contains(',') {
        return Requested::Whole;
    }
    let Some((first, last)) = ranges.trim().split_once('-') else { return Requested::Whole };
    match (position(first), position(last)) {
        (Position::Absent, Position::At(0)) => Requested::Unsatisfiable,
        (Position::Absent, Position::At(_)) if size == 0 => Requested::Unsatisfiable,
        (Position::Absent, Position::At(suffix)) => {
            Requested::Part { first: size.saturating_sub(suffix), last: size - 1 }
        }
        (Position::At(first), Position::Absent) => within(first, u64::MAX, size),
        (Position::At(first), Position::At(last)) if first <= last => within(first, last, size),
        _ => Requested::Whole,
    }
}

fn within(first: u64, last: u64, size: u64) -> Requested {
    if first >= size {
        return Requested::Unsatisfiable;
    }
    Requested::Part { first, last: last.min(size - 1) }
}

enum Position {
    Absent,
    At(u64),
    Invalid,
}

fn position(digits: &str) -> Position {
    if digits.is_empty() {
        return Position::Absent;
    }
    if !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return Position::Invalid;
    }
    // The text has only digits, so the only error is a number beyond u64, which is also beyond any
    // file.
    Position::At(digits.parse().unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{Requested, requested};

    #[test]
    fn the_examples_of_rfc_9110_are_read() {
        let cases = [
            ("bytes=0-499", Requested::Part { first: 0, last: 499 }),
            ("bytes=500-999", Requested::Part { first: 500, last: 999 }),
            ("bytes=-500", Requested::Part { first: 9500, last: 9999 }),
            ("bytes=9500-", Requested::Part { first: 9500, last: 9999 }),
            ("Bytes=9999-20000", Requested::Part { first: 9999, last: 9999 }),
            ("bytes=-20000", Requested::Part { first: 0, last: 9999 }),
            ("bytes=10000-", Requested::Unsatisfiable),
            ("bytes=-0", Requested::Unsatisfiable),
            ("bytes=0-0,-1", Requested::Whole),
            ("bytes=2-1", Requested::Whole),
            ("bytes=-", Requested::Whole),
            ("bytes=+1-2", Requested::Whole),
            ("lines=0-1", Requested::Whole),
            ("bytes", Requested::Whole),
        ];
        for (header, expected) in cases {
            assert_eq!(requested(header, 10_000), expected, "{header}");
        }
    }

    #[test]
    fn no_part_of_an_empty_file_can_be_asked_for() {
        for header in ["bytes=0-", "bytes=0-0", "bytes=-1"] {
            assert_eq!(requested(header, 0), Requested::Unsatisfiable, "{header}");
        }
    }

    proptest! {
        #[test]
        fn a_part_always_lies_within_the_file(header in "(bytes=)?[0-9,-]{0,24}", size in 0u64..5000) {
            if let Requested::Part { first, last } = requested(&header, size) {
                prop_assert!(first <= last && last < size);
            }
        }
    }
}
