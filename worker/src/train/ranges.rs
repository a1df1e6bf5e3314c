use std::fmt;

/// Sorted numbers as text: `3, 17, 20 to 25`.
pub(super) struct Ranges<'a>(pub &'a [u64]);

/// Largest number of ranges that are written out. A batch can have thousands.
const SHOWN: usize = 64;

impl fmt::Display for Ranges<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut numbers = self.0.to_vec();
        numbers.sort_unstable();
        let ranges: Vec<&[u64]> = numbers.chunk_by(|a, b| a + 1 == *b).collect();
        for (index, range) in ranges.iter().take(SHOWN).enumerate() {
            if index > 0 {
                f.write_str(", ")?;
            }
            match range {
                [] => {}
                [number] => write!(f, "{number}")?,
                [first, .., last] => write!(f, "{first} to {last}")?,
            }
        }
        let hidden: usize = ranges.iter().skip(SHOWN).map(|range| range.len()).sum();
        if hidden > 0 { write!(f, " and {hidden} more") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::Ranges;

    #[test]
    fn numbers_in_a_row_are_shown_by_their_ends_and_too_many_are_counted() {
        assert_eq!(Ranges(&[22, 3, 20, 17, 21]).to_string(), "3, 17, 20 to 22");
        assert_eq!(Ranges(&[]).to_string(), "");
        let even: Vec<u64> = (0..100).map(|number| 2 * number).collect();
        assert!(Ranges(&even).to_string().ends_with("124, 126 and 36 more"), "{}", Ranges(&even));
    }
}
