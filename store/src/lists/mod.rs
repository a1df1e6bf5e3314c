pub(crate) mod census;
pub(crate) mod labels;
pub(crate) mod listing;
