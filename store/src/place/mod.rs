pub(crate) mod data_dir;
pub(crate) mod health;
pub(crate) mod identity;
pub(crate) mod location;
pub(crate) mod new_place;
