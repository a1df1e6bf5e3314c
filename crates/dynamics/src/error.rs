//! The errors of simulations.

use std::ops::Range;

use crate::hand_path::PathEnd;

/// The reason why a simulation has no result.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "messages say what the fields mean")]
pub enum DynamicsError {
    /// The progress callback asked to stop.
    #[error("the simulation of trajectories {} to {} was cancelled", range.start, range.end)]
    Cancelled { range: Range<u64> },

    /// No draw of a trajectory stayed clear of the joint limits.
    #[error(
        "trajectory {index} (seed {seed}): none of {draws} draws stayed {margin_rad} rad clear of the joint \
         limits; lower the torques or rejection.position_margin_rad, raise rejection.max_draws, or give the \
         simulation a controller: torques alone do not hold an arm with little damping"
    )]
    EveryDrawRejected { index: u64, seed: u64, draws: u32, margin_rad: f64 },

    /// No draw of a trajectory followed its reference.
    #[error(
        "trajectory {index} (seed {seed}): none of {draws} draws followed its reference; in the last \
         one, {lost}: joint {joint} was {off_rad:.3} rad off its reference {time_s:.2} s after the \
         start, with kp {kp:.4}, kd {kd:.4} and a delay of {delay_periods} control periods; change the \
         controller's gains or delay, lower the reach or the speed of references, or raise \
         rejection.max_draws"
    )]
    NoDrawTracked {
        index: u64,
        seed: u64,
        draws: u32,
        lost: LostTrack,
        joint: usize,
        off_rad: f64,
        time_s: f64,
        kp: f64,
        kd: f64,
        delay_periods: u32,
    },

    /// No draw of a trajectory has a path that joints can follow.
    #[error(
        "trajectory {index} (seed {seed}): joints can follow no path of the hand of {draws} draws; in \
         the last one {end} {time_s:.2} s after the start, with a radius of {radius_m:.4} m; lower \
         reach, radius_m or frequency_hz of excitation.hand_paths, or raise its speed"
    )]
    NoPathFollowed { index: u64, seed: u64, draws: u32, end: PathEnd, time_s: f64, radius_m: f64 },

    /// The state of a trajectory is not finite.
    #[error(
        "trajectory {index} (seed {seed}, draw {draw}): the joint positions at sample {sample} are not finite; \
         the integrator is unstable for this robot; use more substeps, or give joints with little inertia a \
         damping or an armature, or the simulation a controller"
    )]
    NotFinite { index: u64, seed: u64, draw: u32, sample: usize },

    /// More samples than memory can address.
    #[error("{trajectories} trajectories of {samples} samples do not fit into memory")]
    TooLarge { trajectories: u64, samples: u32 },
}

/// The reason why a draw under control was not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LostTrack {
    /// Positions or torques are not finite.
    Diverged,
    /// A joint is far from its reference.
    OffReference,
    /// A joint came too close to its limit.
    AtLimit,
    /// The posture is singular for a controller of the hand.
    Singular,
    /// The torque of a joint, counted from 0, swings from limit to limit.
    Unstable {
        /// The joint.
        joint: usize,
    },
}

impl std::fmt::Display for LostTrack {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Diverged => "the motion diverged",
            Self::OffReference => "the arm lost its reference",
            Self::AtLimit => "a joint came too close to its limit",
            Self::Unstable { .. } => {
                "its controller is unstable (the torque of a joint swings from limit to limit)"
            }
            Self::Singular => "the hand could not move in some direction (a singular posture)",
        })
    }
}
