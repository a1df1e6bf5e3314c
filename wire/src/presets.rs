//! Named starting points of specs.

use serde::{Deserialize, Serialize};
use spec::Preset;
use utoipa::ToSchema;

/// Every preset with the spec it stands for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Presets {
    pub presets: Vec<Preset>,
}
