//! Where a store is: its data folder, the identity of its objects, and the health of both.

pub(crate) mod data_dir;
pub(crate) mod disk;
pub(crate) mod health;
pub(crate) mod identity;
pub(crate) mod location;
pub(crate) mod new_place;
