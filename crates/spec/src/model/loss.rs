use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The loss of a model that predicts one number for each position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PointLoss {
    /// The mean squared error of predictions. With a residual the errors are in its unit, so every
    /// trajectory counts the same, however far it moves.
    #[default]
    MeanSquare,
    /// The root mean square over the horizon of each joint's error in normalized positions, like
    /// the metric.
    RootMeanSquare,
}

impl PointLoss {
    pub(super) fn is_default(&self) -> bool {
        *self == Self::MeanSquare
    }
}
