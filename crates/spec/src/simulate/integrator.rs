use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The integration of one sampling period. Torques are held, and joint damping is implicit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "scheme", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Integrator {
    /// Implicit-damping Euler with Richardson extrapolation over 1, 2, .. `order` steps.
    Extrapolated {
        /// Number of extrapolated solutions.
        #[serde(default = "four")]
        order: u32,
        /// Number of equal parts of a period, each of which is extrapolated.
        #[serde(default = "one")]
        substeps: u32,
    },
    /// Classical Runge-Kutta of order 4 with explicit damping.
    Rk4 {
        /// Number of equal parts of a period.
        #[serde(default = "six")]
        substeps: u32,
    },
    /// A method of order 2 that evaluates the dynamics once per step: at the position half a step
    /// ahead, and at the velocity there that the last acceleration foretells. It is for the short
    /// steps of control periods.
    Midpoint {
        /// Number of equal parts of a period.
        #[serde(default = "one")]
        substeps: u32,
    },
    /// Semi-implicit Euler with 2 substeps, which is equivalent to the paper's simulator settings.
    Reference,
}

/// The most equal parts of a period.
pub(super) const MAX_SUBSTEPS: u32 = 64;

impl Default for Integrator {
    fn default() -> Self {
        Self::Extrapolated { order: four(), substeps: one() }
    }
}

impl fmt::Display for Integrator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Extrapolated { order, substeps } => {
                write!(f, "extrapolated, order {order}, substeps {substeps}")
            }
            Self::Rk4 { substeps } => write!(f, "rk4, substeps {substeps}"),
            Self::Midpoint { substeps } => write!(f, "midpoint, substeps {substeps}"),
            Self::Reference => write!(f, "reference"),
        }
    }
}

/// The precision of the simulation. Datasets hold f32 in either case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// Numbers of 32 bits.
    #[default]
    F32,
    /// Numbers of 64 bits.
    F64,
}

const fn one() -> u32 {
    1
}
const fn four() -> u32 {
    4
}
const fn six() -> u32 {
    6
}
