//! Sizes that several architectures share.

use crate::check::Violations;

/// Number of groups in group normalization. Each has the same share of a width's channels.
pub const GROUPS: u32 = 8;

/// Checks sizes that all Transformers have. `layers` has fields with their values.
pub(super) fn check_transformer(
    violations: &mut Violations,
    d_model: u32,
    heads: u32,
    layers: &[(&'static str, u32)],
    ratio: u32,
) {
    violations.within("d_model", d_model, 8..=4096);
    violations.within("heads", heads, 1..=64);
    for &(field, count) in layers {
        violations.within(field, count, 1..=64);
    }
    violations.within("mlp_ratio", ratio, 1..=16);
    if heads > 0 && !d_model.is_multiple_of(heads) {
        violations.add("d_model", d_model, format!("a multiple of heads, which is {heads}"));
    }
}

/// Checks sizes that CDCNN and flow share.
pub(super) fn check_unet(violations: &mut Violations, embedding: u32, widths: &[u32]) {
    violations.within("embedding", embedding, 4..=4096);
    if !embedding.is_multiple_of(2) {
        violations.add("embedding", embedding, "a multiple of 2, for sine and cosine");
    }
    violations.length("widths.length", widths.len(), 1..=8);
    for (i, &width) in widths.iter().enumerate() {
        check_width(violations, &format!("widths[{i}]"), width);
    }
}

/// Checks a width of a U-Net, which group normalization divides.
pub(super) fn check_width(violations: &mut Violations, field: &str, width: u32) {
    violations.within(field, width, GROUPS..=4096);
    if !width.is_multiple_of(GROUPS) {
        let allowed = format!("a multiple of the groups of its normalization, which are {GROUPS}");
        violations.add(field, width, allowed);
    }
}

pub(super) const fn one() -> u32 {
    1
}

pub(super) const fn four() -> u32 {
    4
}

pub(super) const fn five() -> u32 {
    5
}
