//! A database made again from objects whose files say what they are.
//!
//! Every job is submitted again as it was, under its old id, and its tasks are completed with the objects that were found. So the
//! new database has nothing in it that a server would not have written. What says nothing of itself is left out by name.

mod found;
mod rebuilding;
mod shards;
mod trainings;
mod work;

pub use found::find_objects;
pub use rebuilding::rebuild;
pub use work::{FoundObjects, LeftOut, Rebuilt, ReindexError};
