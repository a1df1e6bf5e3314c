//! Joints and numbers in sentences.

/// `joint 3`, or `joints 1, 2 and 5`. `None` without any.
pub(crate) fn joints(numbers: impl IntoIterator<Item = usize>) -> Option<String> {
    let mut names: Vec<String> = numbers.into_iter().map(|number| number.to_string()).collect();
    let last = names.pop()?;
    Some(if names.is_empty() {
        format!("joint {last}")
    } else {
        format!("joints {} and {last}", names.join(", "))
    })
}

/// The least and the largest number, or one if they look the same.
pub(crate) fn range(numbers: impl Iterator<Item = f64> + Clone) -> String {
    let least = digits(numbers.clone().fold(f64::INFINITY, f64::min));
    let largest = digits(numbers.fold(f64::NEG_INFINITY, f64::max));
    if least == largest { least } else { format!("{least} to {largest}") }
}

/// The number with three significant digits.
pub(crate) fn digits(number: f64) -> String {
    let rounded: f64 = format!("{number:.2e}").parse().unwrap_or(number);
    rounded.to_string()
}

/// The number with three decimals at most.
pub(crate) fn rounded(number: f64) -> f64 {
    (1e3 * number).round() / 1e3
}
