//! Values that a stored spec leaves out.

/// Whether a number is 0.
pub(crate) fn is_zero<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes what it skips by reference")]
pub(crate) const fn is_one(value: &u32) -> bool {
    *value == 1
}
