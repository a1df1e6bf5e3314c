//! The series that a network is told beside measured positions.

use burn::tensor::Tensor;
use spec::Residual;

use crate::architecture::ModelInput;

/// Logarithms of units lie between about -10 and 0, and count in this.
const PER_LOGARITHM: f64 = 0.25;

/// The series that a network is told, context and horizon.
///
/// Answers beside a path say neither where the arm is, on which its inertia depends, nor how large they are: the path
/// and the unit say both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Told {
    /// Normalized torques.
    Torques,
    /// Torques, the path as normalized positions, and a quarter of the logarithm of the unit in them.
    TorquesPathAndUnit,
}

impl Told {
    /// The series for a model whose answers are relative to `residual`.
    pub fn of(residual: Residual) -> Self {
        match residual {
            Residual::None => Self::Torques,
            Residual::Integrator(_) | Residual::LaggedIntegrator(_) => Self::TorquesPathAndUnit,
        }
    }

    /// Channels of an arm of `joints`, of which the first are the torques.
    pub const fn channels(self, joints: usize) -> usize {
        match self {
            Self::Torques => joints,
            Self::TorquesPathAndUnit => 3 * joints,
        }
    }

    /// `[batch, sample, channel]`.
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
