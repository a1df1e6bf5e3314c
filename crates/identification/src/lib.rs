//! From recordings of an arm and its description to its physical parameters.
//!
//! [`identify`] begins with the arm's description, whose numbers a designer computed, and ends with
//! numbers that explain measured torques and motions. It has two steps.
//!
//! 1. **Torques.** Torques are linear in the links' inertial parameters, in friction, offsets and
//!    rotor inertias. A regression weighs each joint by what it cannot explain. Links are written
//!    with the logarithm of the Cholesky factor of their pseudo-inertia, so that only bodies which
//!    can exist are considered (Rucker and Wensing 2022, "Smooth parameterization of rigid-body
//!    inertia"). The description is the prior, so that what the data do not determine stays.
//! 2. **Motions.** The parameters change until simulated motions over [`HORIZONS_S`] follow the
//!    measured ones: Gauss-Newton steps whose derivatives are rollouts in the lanes of
//!    [`dynamics::Replay`].
//!
//! [`check_log`] says beforehand whether recordings can be those of the arm. [`excite`] designs the motion that such a recording should have.
//!
//! Everything is deterministic: random numbers have fixed keys, and sums have a fixed order.

#![warn(missing_docs)]

mod arm;
mod arx;
mod body;
mod check;
mod doubts;
mod error;
mod estimates;
mod excitation;
mod figure;
mod fourier;
mod horizons;
mod identify;
mod log;
mod motion;
mod normal_equations;
mod rollouts;
mod saturation;
mod torque_fit;
mod torques;
mod trace;
mod wording;

pub use arm::{Arm, JointParameter, Parameter};
pub use check::check_log;
pub use doubts::fits;
pub use error::IdentificationError;
pub use excitation::{
    Excitation, ExcitationError, ExcitationProgress, ExcitationReport, ExcitationSettings,
    JointExcitation, ParameterPrediction, RandomMotions, excite,
};
pub use figure::Curves;
pub use fourier::{Fourier, FourierJoint, MotionState};
pub use horizons::HORIZONS_S;
pub use identify::{Identification, Settings, identify, identify_load};
pub use log::{Log, LogRow};
pub use motion::Recording;
pub use torque_fit::Progress;
pub use trace::Trace;
