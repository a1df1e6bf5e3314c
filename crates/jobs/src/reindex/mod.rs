//! Rebuilds a database from objects whose files describe themselves.
//!
//! Every job is submitted again as it was, under its old id. Its tasks are completed with the
//! objects that were found. So the new database has only rows that a server would have written.
//! Objects that do not describe themselves are left out and listed by name.

mod found;
mod rebuilding;
mod shards;
mod trainings;
mod work;

pub use found::find_objects;
pub use rebuilding::rebuild;
pub use work::{FoundObjects, LeftOut, Rebuilt, ReindexError};
