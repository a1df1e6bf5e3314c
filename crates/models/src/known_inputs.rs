//! The known series that a network sees beside measured positions.

use burn::tensor::Tensor;
use spec::Residual;

use crate::architecture::ModelInput;

/// Factor for the logarithms of units, which lie between about -10 and 0.
const PER_LOGARITHM: f64 = 0.25;

/// The known series of a network, over context and horizon.
///
/// Answers relative to a path contain neither the arm's pose, on which its inertia depends, nor the
/// size of their unit. The path and the unit give both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum KnownInputs {
    /// Normalized torques.
    Torques,
    /// Torques, the path as normalized positions, and a quarter of the logarithm of the unit in them.
    TorquesPathAndUnit,
}

impl KnownInputs {
    /// The known series for a model whose answers are relative to `residual`.
    pub fn of(residual: Residual) -> Self {
        match residual {
            Residual::None => Self::Torques,
            Residual::Integrator(_) | Residual::LaggedIntegrator(_) => Self::TorquesPathAndUnit,
        }
    }

    /// Channels for an arm of `joints` joints. The torques come first.
    pub const fn channels(self, joints: usize) -> usize {
        match self {
            Self::Torques => joints,
            Self::TorquesPathAndUnit => 3 * joints,
        }
    }

    /// The known series `[batch, sample, channel]`.
    pub fn series(self, input: &ModelInput) -> Tensor<3> {
        match self {
            Self::Torques => input.u.clone(),
            Self::TorquesPathAndUnit => {
                let unit = input.unit.clone().log() * PER_LOGARITHM;
                Tensor::cat(vec![input.u.clone(), input.path.clone(), unit], 2)
            }
        }
    }
}
