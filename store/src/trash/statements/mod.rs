//! Statements about deleted items.

pub(crate) mod trash;
