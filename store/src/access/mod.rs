//! Who may ask: tokens, sessions, and the log of what was changed.

pub(crate) mod audit;
pub(crate) mod tokens;
