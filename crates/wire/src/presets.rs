//! Presets: named starting points of specs.

use serde::{Deserialize, Serialize};
use spec::Preset;
use utoipa::ToSchema;

/// Every preset, with its spec.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Presets {
    /// The presets, grouped by what they are for.
    pub presets: Vec<Preset>,
}
