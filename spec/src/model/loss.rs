use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The loss of a model that predicts a number for each position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PointLoss {
    /// The mean squared error of answers, in the unit of the residual where there is one: every trajectory weighs
    /// the same, however far it moves.
    #[default]
    MeanSquare,
    /// The root mean square over the horizon of each joint's error in normalized positions, as the metric.
    RootMeanSquare,
}

impl PointLoss {
    pub(super) fn is_default(&self) -> bool {
        *self == Self::MeanSquare
    }
}
