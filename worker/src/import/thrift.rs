//! The compact protocol of Thrift, as far as it takes to look through a Parquet footer or page
//! header without believing it: nothing is allocated, and nesting has a limit.
//!
//! <https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md>

/// Bytes being read from the front. `None` from any method means that they are no Thrift, or end
/// too early.
#[derive(Clone, Copy, Debug)]
pub(super) struct Thrift<'a> {
    bytes: &'a [u8],
    position: usize,
}

/// A field of a structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Field {
    pub id: i16,
    pub kind: u8,
}

/// Types of fields and elements.
pub(super) mod kind {
    pub const TRUE: u8 = 1;
    pub const FALSE: u8 = 2;
    pub const BYTE: u8 = 3;
    pub const I16: u8 = 4;
    pub const I32: u8 = 5;
    pub const I64: u8 = 6;
    pub const DOUBLE: u8 = 7;
    pub const BINARY: u8 = 8;
    pub const LIST: u8 = 9;
    pub const SET: u8 = 10;
    pub const MAP: u8 = 11;
    pub const STRUCT: u8 = 12;
    pub const UUID: u8 = 13;
}

/// How deep structures and lists may lie in each other; Parquet's own need 6.
const MAX_DEPTH: u32 = 32;

impl<'a> Thrift<'a> {
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Bytes read so far.
    pub const fn position(&self) -> usize {
        self.position
    }

    /// The next field of a structure, after one with id `last` (0 at its begin); `Some(None)` at
    /// its end.
    pub fn field(&mut self, last: i16) -> Option<Option<Field>> {
        let header = self.byte()?;
        let kind = header & 0x0f;
        if kind == 0 {
            return Some(None);
        }
        let delta = i16::from(header >> 4);
        let id = match delta {
            0 => i16::try_from(self.signed()?).ok()?,
            delta => last.checked_add(delta)?,
        };
        Some(Some(Field { id, kind }))
    }

    /// Type and number of the elements of a list.
    pub fn list(&mut self) -> Option<(u8, u64)> {
        let header = self.byte()?;
        let count = match header >> 4 {
            15 => self.unsigned()?,
            count => u64::from(count),
        };
        Some((header & 0x0f, count))
    }

    /// A zigzag integer of any width.
    pub fn signed(&mut self) -> Option<i64> {
        let value = self.unsigned()?;
        let magnitude = i64::try_from(value >> 1).ok()?;
        Some(if value & 1 == 0 { magnitude } else { -magnitude - 1 })
    }

    /// The value of a field of an integer type.
    pub fn integer(&mut self, field: Field) -> Option<i64> {
        match field.kind {
            kind::I16 | kind::I32 | kind::I64 => self.signed(),
            _ => None,
        }
    }

    /// Passes over a value inside a structure.
    pub fn skip(&mut self, kind: u8) -> Option<()> {
        self.skip_nested(kind, 0)
    }

    fn skip_nested(&mut self, kind: u8, depth: u32) -> Option<()> {
        if depth > MAX_DEPTH {
            return None;
        }
        match kind {
            kind::TRUE | kind::FALSE => Some(()),
            kind::BYTE => self.take(1),
            kind::I16 | kind::I32 | kind::I64 => self.unsigned().map(|_| ()),
            kind::DOUBLE => self.take(8),
            kind::UUID => self.take(16),
            kind::BINARY => {
                let length = self.unsigned()?;
                self.take(usize::try_from(length).ok()?)
            }
            kind::LIST | kind::SET => {
                let (element, count) = self.list()?;
                (0..count).try_for_each(|_| self.skip_element(element, depth + 1))
            }
            kind::MAP => {
                let count = self.unsigned()?;
                if count == 0 {
                    return Some(());
                }
                let kinds = self.byte()?;
                (0..count).try_for_each(|_| {
                    self.skip_element(kinds >> 4, depth + 1)?;
                    self.skip_element(kinds & 0x0f, depth + 1)
                })
            }
            kind::STRUCT => {
                let mut last = 0;
                while let Some(field) = self.field(last)? {
                    last = field.id;
                    self.skip_nested(field.kind, depth + 1)?;
                }
                Some(())
            }
            _ => None,
        }
    }

    /// An element of a list or map, where a boolean takes a byte.
    fn skip_element(&mut self, kind: u8, depth: u32) -> Option<()> {
        match kind {
            kind::TRUE | kind::FALSE => self.take(1),
            kind => self.skip_nested(kind, depth),
        }
    }

    fn unsigned(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f).checked_shl(shift)?;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn byte(&mut self) -> Option<u8> {
        let byte = *self.bytes.get(self.position)?;
        self.position += 1;
        Some(byte)
    }

    fn take(&mut self, count: usize) -> Option<()> {
        let end = self.position.checked_add(count)?;
        if end > self.bytes.len() {
            return None;
        }
        self.position = end;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_zigzag_in_groups_of_seven_bits() {
        let of = |bytes: &[u8]| Thrift::new(bytes).signed();
        assert_eq!(of(&[0x00]), Some(0));
        assert_eq!(of(&[0x01]), Some(-1));
        assert_eq!(of(&[0xac, 0x02]), Some(150));
        assert_eq!(of(&[0x80]), None);
        assert_eq!(of(&[0xff; 11]), None);
    }

    #[test]
    fn fields_are_found_behind_values_of_every_type() {
        let bytes = [
            0x11, // 1: true
            0x15, 0x04, // 2: i32 2
            0x18, 0x02, b'o', b'k', // 3: binary
            0x19, 0x25, 0x02, 0x04, // 4: list of two i32
            0x1b, 0x01, 0x85, 0x01, b'k', 0x06, // 5: map of binary to i32
            0x1c, 0x15, 0x02, 0x00, // 6: struct of an i32
            0x17, 0, 0, 0, 0, 0, 0, 0, 0, // 7: double
            0x16, 0x0a, // 8: i64 5
            0x00,
        ];
        let mut thrift = Thrift::new(&bytes);
        let mut last = 0;
        let mut found = Vec::new();
        while let Some(field) = thrift.field(last).unwrap() {
            last = field.id;
            found.push(match field.kind {
                kind::I32 | kind::I64 => thrift.integer(field).unwrap(),
                other => thrift.skip(other).map(|()| -1).unwrap(),
            });
        }
        assert_eq!(found, [-1, 2, -1, -1, -1, -1, -1, 5]);
        assert_eq!(thrift.position(), bytes.len());
    }

    #[test]
    fn nesting_without_end_is_refused() {
        let nested = [0x1c; 1000];
        assert_eq!(Thrift::new(&nested).skip(kind::STRUCT), None);
    }

    #[test]
    fn a_length_beyond_the_end_is_refused() {
        let bytes = [0xff, 0xff, 0xff, 0xff, 0x0f, b'x'];
        assert_eq!(Thrift::new(&bytes).skip(kind::BINARY), None);
    }
}
