//! Values as text for errors.

use std::io;

use serde_json::Value;

/// Characters of a value in an error about its shape.
const SHORT: usize = 60;

/// A value as text for an error; cut if it is long.
pub(crate) fn shorten(value: &Value) -> String {
    // No more of a long value is written than is shown.
    let mut begin = Begin { bytes: Vec::new(), most: 4 * SHORT };
    let is_whole = serde_json::to_writer(&mut begin, value).is_ok();
    let text = String::from_utf8_lossy(&begin.bytes);
    if is_whole && text.chars().count() <= SHORT {
        return text.into_owned();
    }
    text.chars().take(SHORT - 3).chain("...".chars()).collect()
}

/// Keeps the first bytes that are written, and refuses the others.
struct Begin {
    bytes: Vec<u8>,
    most: usize,
}

impl io::Write for Begin {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let room = self.most - self.bytes.len();
        if room == 0 {
            return Err(io::Error::other("no more is needed"));
        }
        let kept = bytes.len().min(room);
        self.bytes.extend_from_slice(&bytes[..kept]);
        Ok(kept)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_long_value_is_cut_to_sixty_characters() {
        assert_eq!(shorten(&json!({"a": [1, 2.5, "x"]})), r#"{"a":[1,2.5,"x"]}"#);
        let exact = json!("x".repeat(58));
        assert_eq!(shorten(&exact), exact.to_string());
        let cut = shorten(&json!("ü".repeat(59)));
        assert_eq!((cut.chars().count(), cut.ends_with("ü...")), (60, true));
        let nested = shorten(&json!(vec![json!({"a_m": 0}); 100_000]));
        assert_eq!(nested.chars().count(), 60);
    }
}
