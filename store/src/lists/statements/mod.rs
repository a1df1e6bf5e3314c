//! Statements of lists.

pub(crate) mod listing;
