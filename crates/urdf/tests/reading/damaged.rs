//! Damaged texts: an arm or an error, never a panic, soon.
//!
//! `PROPTEST_CASES=6250 cargo test -p urdf damaged` tries 100 000.

use proptest::prelude::*;
use random::{ChaCha8Rng, below, keyed};
use urdf::{Options, read};

use crate::refused::ARM;
use crate::robots::Robot;

/// Damages of one text in a case.
const DAMAGES: usize = 16;

/// One to three damages: bytes changed, slices lost or doubled, numbers replaced.
pub fn damaged(text: &str, draws: &mut ChaCha8Rng) -> String {
    const NUMBERS: [&str; 12] = [
        "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "0", "-0", "1e4", "9999", "", "1 2 3 4",
    ];
    const WORDS: [&str; 12] = [
        "<robot>",
        "</link>",
        "<joint",
        "/>",
        "\"",
        "<!--",
        "]]>",
        "&amp;",
        "&#0;",
        "<?",
        "prismatic",
        "\0",
    ];

    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=below(draws, 3) {
        let at = below(draws, bytes.len());
        let end = (at + 1 + below(draws, 200)).min(bytes.len());
        match below(draws, 6) {
            0 => bytes[at] = u8::try_from(below(draws, 256)).unwrap(),
            1 => drop(bytes.drain(at..end)),
            2 => {
                let slice = bytes[at..end].to_vec();
                let to = below(draws, bytes.len());
                bytes.splice(to..to, slice);
            }
            3 => {
                let word = WORDS[below(draws, WORDS.len())].bytes();
                bytes.splice(at..at, word);
            }
            4 => bytes.truncate(at.max(1)),
            _ => {
                let is_number = |byte: &u8| b"0123456789.-e".contains(byte);
                let Some(first) = bytes[at..].iter().position(is_number) else { continue };
                let first = at + first;
                let length = bytes[first..].iter().take_while(|byte| is_number(byte)).count();
                bytes.splice(first..first + length, NUMBERS[below(draws, NUMBERS.len())].bytes());
            }
        }
        if bytes.is_empty() {
            bytes.push(b' ');
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

proptest! {
    #[test]
    fn a_damaged_text_gives_an_arm_or_an_error(seed in any::<u64>()) {
        let whole = if seed % 2 == 0 { ARM.to_owned() } else { Robot::random(seed, 9.0).urdf(seed) };
        let mut draws: ChaCha8Rng = keyed([seed, 4, 0, 0]);
        for _ in 0..DAMAGES {
            let text = damaged(&whole, &mut draws);
            let options = Options { nearest_physical: below(&mut draws, 2) == 0, ..Options::default() };
            match read(&text, &options) {
                Ok(arm) => prop_assert!(arm.description.checked().is_ok()),
                Err(error) => prop_assert!(!error.to_string().is_empty()),
            }
        }
    }
}
