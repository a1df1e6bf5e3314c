//! Limits on the sizes of a model, which are checked before it is built.

use crate::ModelError;

/// Larger sizes are taken for mistakes. Within these limits no count in this crate overflows.
pub(crate) const LARGEST_WIDTH: u32 = 1 << 14;
pub(crate) const MOST_LAYERS: u32 = 1 << 8;
pub(crate) const LARGEST_RATIO: u32 = 1 << 6;
pub(crate) const MOST_STAGES: usize = 8;
pub(crate) const MOST_SAMPLES: u32 = 1 << 20;

pub(crate) fn within(
    field: &'static str,
    value: u32,
    least: u32,
    most: u32,
) -> Result<(), ModelError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let allowed = format!("{least} to {most}");
    Err(ModelError::Size { field, value: value.into(), allowed })
}

/// Checks that `divisor`, named `field`, divides `value`, named `of`.
pub(crate) fn divides(
    field: &'static str,
    divisor: u32,
    of: &'static str,
    value: u32,
) -> Result<(), ModelError> {
    if divisor > 0 && value > 0 && value.is_multiple_of(divisor) {
        return Ok(());
    }
    let allowed = format!("divisors of the {of}, which is {value}");
    Err(ModelError::Size { field, value: divisor.into(), allowed })
}

/// Checks that `value`, named `field`, is a multiple of `divisor`. `what` describes the divisor.
pub(crate) fn multiple(
    field: &'static str,
    value: u32,
    divisor: u32,
    what: &str,
) -> Result<(), ModelError> {
    if value > 0 && value.is_multiple_of(divisor) {
        return Ok(());
    }
    let allowed = format!("multiples of {divisor}, {what}");
    Err(ModelError::Size { field, value: value.into(), allowed })
}
