//! Messages of type `sensor_msgs/JointState` in CDR, the encoding of ROS 2.

/// A message. Lists have an element per name, or none.
#[derive(Debug, Default, PartialEq)]
pub(super) struct JointState {
    /// Time of the measurement, ns.
    pub stamp_ns: i64,
    pub names: Vec<String>,
    pub positions: Vec<f64>,
    pub velocities: Vec<f64>,
    pub efforts: Vec<f64>,
}

impl JointState {
    /// The message in these bytes. The error says what is wrong with it.
    pub fn of(message: &[u8]) -> Result<Self, &'static str> {
        let [_, encoding, _, _, content @ ..] = message else {
            return Err("it has no header");
        };
        // Plain CDR and the parameter list of XCDR2 differ; only the first is in use for ROS.
        let is_big_endian = match encoding {
            0 => true,
            1 => false,
            _ => return Err("it is not in plain CDR"),
        };
        let mut cdr = Cdr { content, at: 0, is_big_endian };
        cdr.message().ok_or("it was cut off")
    }
}

/// Reads values one after the other. Each is aligned to its own size.
struct Cdr<'a> {
    content: &'a [u8],
    at: usize,
    is_big_endian: bool,
}

impl<'a> Cdr<'a> {
    fn message(&mut self) -> Option<JointState> {
        let seconds = i64::from(self.number()?.cast_signed());
        let nanoseconds = i64::from(self.number()?);
        self.text()?;
        Some(JointState {
            stamp_ns: seconds * 1_000_000_000 + nanoseconds,
            names: self.list(|cdr| Some(String::from_utf8_lossy(cdr.text()?).into_owned()))?,
            positions: self.list(Self::float)?,
            velocities: self.list(Self::float)?,
            efforts: self.list(Self::float)?,
        })
    }

    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let bytes = self.content.get(self.at..end)?;
        self.at = end;
        Some(bytes)
    }

    fn aligned<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.at = self.at.next_multiple_of(N);
        self.bytes(N)?.try_into().ok()
    }

    fn number(&mut self) -> Option<u32> {
        let bytes = self.aligned()?;
        Some(if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn float(&mut self) -> Option<f64> {
        let bytes = self.aligned()?;
        Some(if self.is_big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
    }

    /// A text with its length, which counts the zero at its end.
    fn text(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.number()?).ok()?;
        let text = self.bytes(length)?;
        Some(text.strip_suffix(b"\0").unwrap_or(text))
    }

    /// A list with its length. Nothing is reserved for what it claims.
    fn list<T>(&mut self, element: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count = self.number()?;
        (0..count).map(|_| element(self)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As `rclpy.serialization.serialize_message` writes it.
    fn message(is_big_endian: bool) -> Vec<u8> {
        let mut content: Vec<u8> = Vec::new();
        let number = |content: &mut Vec<u8>, value: u32| {
            content.resize(content.len().next_multiple_of(4), 0);
            content.extend(if is_big_endian { value.to_be_bytes() } else { value.to_le_bytes() });
        };
        number(&mut content, 12);
        number(&mut content, 500_000_000);
        let text = |content: &mut Vec<u8>, text: &str| {
            number(content, u32::try_from(text.len()).unwrap() + 1);
            content.extend(text.as_bytes());
            content.push(0);
        };
        text(&mut content, "base");
        number(&mut content, 2);
        text(&mut content, "elbow");
        text(&mut content, "wrist_1");
        for values in [&[0.5, -1.5][..], &[], &[3.0, 4.0]] {
            number(&mut content, u32::try_from(values.len()).unwrap());
            for value in values {
                content.resize(content.len().next_multiple_of(8), 0);
                content.extend(if is_big_endian {
                    f64::to_be_bytes(*value)
                } else {
                    f64::to_le_bytes(*value)
                });
            }
        }
        [vec![0, u8::from(!is_big_endian), 0, 0], content].concat()
    }

    #[test]
    fn both_byte_orders_are_read() {
        for is_big_endian in [false, true] {
            let expected = JointState {
                stamp_ns: 12_500_000_000,
                names: vec!["elbow".to_owned(), "wrist_1".to_owned()],
                positions: vec![0.5, -1.5],
                velocities: Vec::new(),
                efforts: vec![3.0, 4.0],
            };
            assert_eq!(JointState::of(&message(is_big_endian)).unwrap(), expected);
        }
    }

    #[test]
    fn every_beginning_of_a_message_is_refused() {
        let whole = message(false);
        for length in 0..whole.len() {
            assert!(JointState::of(&whole[..length]).is_err(), "{length}");
        }
        let mut claims = whole;
        claims[24..28].fill(0xff);
        assert!(JointState::of(&claims).is_err());
    }
}
