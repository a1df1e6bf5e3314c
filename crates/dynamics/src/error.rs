//! The errors of simulations.

use std::ops::Range;

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
         limits; raise rejection.max_draws, lower rejection.position_margin_rad or the torques"
    )]
    EveryDrawRejected { index: u64, seed: u64, draws: u32, margin_rad: f64 },

    /// The state of a trajectory is not finite.
    #[error(
        "trajectory {index} (seed {seed}, draw {draw}): the joint positions at sample {sample} are not finite; \
         the integrator is unstable for this robot, use more substeps"
    )]
    NotFinite { index: u64, seed: u64, draw: u32, sample: usize },

    /// More samples than memory can address.
    #[error("{trajectories} trajectories of {samples} samples do not fit into memory")]
    TooLarge { trajectories: u64, samples: u32 },
}
