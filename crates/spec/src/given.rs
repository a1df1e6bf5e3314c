use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The series that predictors are given beside the positions of the context: over context and
/// horizon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Given {
    /// The torques that act, N·m. The question is how the arm moves under them.
    #[default]
    Torques,
    /// The references of a controller that predictors do not know, rad. The question is how the arm
    /// moves under that controller.
    References,
}

impl Given {
    /// Whether torques are given: the default, which specs and reports leave out.
    pub fn is_torques(&self) -> bool {
        *self == Self::Torques
    }

    /// The word in specs.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Torques => "torques",
            Self::References => "references",
        }
    }
}

impl fmt::Display for Given {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
