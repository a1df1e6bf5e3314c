//! The files of a dataset: their layout, how they are written and read, and what they contain.

pub(crate) mod description;
pub(crate) mod file_content;
pub(crate) mod layout;
pub(crate) mod shard_summary;
pub(crate) mod table_reader;
pub(crate) mod table_writer;
pub(crate) mod trajectories;
