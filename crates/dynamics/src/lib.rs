//! The arm: randomization, excitation, controllers, forward dynamics on SIMD lanes, integrators,
//! trajectories.
//!
//! [`simulate`] turns a [`spec::SimulateSpec`] and a range of trajectory indices into torques and
//! joint positions. Trajectory `i` is a function of (spec, `i`): every random number is keyed by
//! (seed, index, purpose, draw), and every lane type does the same fused arithmetic in the same
//! order. So ranges, threads, neighbours and processors do not change the result. [`Replay`] moves
//! given robots by given torques, on the same lanes.
//!
//! Symbols are those of the manipulator equation
//! `(M(q) + A) q̈ + C(q, q̇) q̇ + g(q) + D q̇ + τ_f(q̇) = u`, in SI units, with armature `A`, damping `D`
//! and friction `τ_f`.
//!
//! A robot is data: an arm comes from its description (`spec::RobotDescription`), never from code.
//! There are kernels compiled for one structure of twists and lengths, chosen by a description's
//! structure, and general ones for all others. Both have the same bits as the separate functions.
//!
//! An option that a spec leaves off draws nothing, and every option has its own purpose. So a
//! payload or measurement noise, for example, changes nothing else of any robot. A robot that is
//! given again moves to the same bits.

#![warn(missing_docs)]
#![expect(
    clippy::needless_range_loop,
    reason = "closures do not inline into functions compiled for other instructions; loops over indices do"
)]

mod angle;
mod block;
mod closed_loop;
mod compiled;
mod dispatch;
mod draws;
mod error;
mod excitation;
mod forward_dynamics;
mod friction;
mod gains;
mod general;
mod hand;
mod hand_path;
mod hand_task;
mod inertia;
mod integrators;
mod inverse_kinematics;
mod joints;
mod kernels;
mod kinematics;
mod limit_cycle;
mod measurement;
mod model;
#[cfg(test)]
mod operations;
#[cfg(test)]
mod pinocchio;
mod planner;
mod randomization;
mod reference;
mod regressor;
mod replay;
mod robot;
mod room;
mod scenario;
mod simulate;
mod single;
mod spatial;
mod structure;
mod sweep;
mod task_matrix;
mod tracking;

pub use angle::Angle;
pub use error::{DynamicsError, LostTrack};
pub use excitation::{Chirp, Multisine, Pulses, Steps, Torques};
pub use friction::Friction;
pub use gains::Gains;
pub use hand_path::{HandPath, LostPath, PathEnd};
pub use inertia::RigidBody;
pub use joints::{ArmState, Joints};
pub use kinematics::{Base, Kinematics, Pose, Row};
pub use measurement::add_position_noise;
pub use reference::{
    FourierSeries, Harmonic, PointToPointMoves, Reference, ReferenceState, ViaPoints,
};
pub use regressor::{LINK_PARAMETERS, torque_regressor};
pub use replay::{Anchor, Motion, Replay};
pub use robot::{Payload, Robot};
pub use scenario::{Excitation, Scenario, Scenarios};
pub use simd::InstructionSet;
pub use simulate::{Trajectories, simulate, simulate_into, simulate_on, simulate_scenarios};
pub use single::{
    Evaluation, bias_forces, forward_dynamics, gravity, inverse_dynamics, mass_matrix,
};
pub use tracking::Tracking;
