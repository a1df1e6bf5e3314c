//! Numbers as text.

/// The number with the fewest digits that are read back as the same number.
pub(crate) fn shortest(number: f64) -> String {
    // Without the sign of zero.
    let number = number + 0.0;
    if number == 0.0 || (1e-3..1e16).contains(&number.abs()) {
        format!("{number}")
    } else {
        format!("{number:e}")
    }
}

/// Whether a text has these numbers, with white space between them.
pub(crate) fn says(text: &str, numbers: &[f64]) -> bool {
    text.split_ascii_whitespace().map(str::parse).eq(numbers.iter().copied().map(Ok))
}

/// Numbers with spaces between them.
pub(crate) fn spaced(numbers: impl IntoIterator<Item = f64>) -> String {
    numbers.into_iter().map(shortest).collect::<Vec<String>>().join(" ")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_number_is_read_back(bits in any::<u64>()) {
            let number = f64::from_bits(bits);
            prop_assume!(number.is_finite());
            prop_assert_eq!(shortest(number).parse::<f64>().unwrap(), number);
        }
    }

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, -0.0, 2.0, 0.1, -0.001, 1.5e-4, 1e20].map(shortest);
        assert_eq!(texts, ["0", "0", "2", "0.1", "-0.001", "1.5e-4", "1e20"]);
        assert_eq!(spaced([1.0, 0.25]), "1 0.25");
    }

    #[test]
    fn a_number_is_the_same_however_it_is_written() {
        assert!(says(" 0.0\t2.50 1e-3\n", &[0.0, 2.5, 0.001]));
        assert!(!says("0 1", &[0.0]) && !says("0", &[0.0, 1.0]) && !says("O", &[0.0]));
    }
}
