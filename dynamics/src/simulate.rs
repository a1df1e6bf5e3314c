use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;
use spec::{JOINTS, SimulateSpec};

use crate::block::Block;
use crate::{DynamicsError, InstructionSet, Scenario, Scenarios};

/// Simulated trajectories with consecutive indices.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectories {
    /// Index of the first.
    pub first: u64,
    pub count: usize,
    /// Samples per trajectory.
    pub samples: usize,
    /// Torques in N·m, [trajectory, sample, joint]. `u[k]` is held from sample k to k + 1, and is to
    /// the last bit what acted.
    pub u: Vec<f32>,
    /// Positions in rad, [trajectory, sample, joint]. `q[k]` is the state at k / rate, before `u[k]`
    /// acts.
    pub q: Vec<f32>,
    pub scenarios: Vec<Scenario>,
    /// Draws that came too close to a joint limit, all trajectories together.
    pub rejected: u64,
}

/// Simulates trajectories `range` of `spec` on all threads of the current rayon pool.
///
/// `progress` is called from those threads with the number of trajectories finished so far, up to
/// once per trajectory, and stops the simulation by breaking.
///
/// # Errors
///
/// When cancelled, when no draw of a trajectory is accepted, or when the integration diverges.
pub fn simulate(
    spec: &SimulateSpec,
    range: Range<u64>,
    progress: &(dyn Fn(u64) -> ControlFlow<()> + Sync),
) -> Result<Trajectories, DynamicsError> {
    simulate_on(InstructionSet::best(), spec, range, progress)
}

/// As [`simulate`], with instructions of one's choice and the same result.
///
/// # Errors
///
/// As [`simulate`].
pub fn simulate_on(
    instructions: InstructionSet,
    spec: &SimulateSpec,
    range: Range<u64>,
    progress: &(dyn Fn(u64) -> ControlFlow<()> + Sync),
) -> Result<Trajectories, DynamicsError> {
    let trajectories = range.end.saturating_sub(range.start);
    let samples = spec.samples as usize;
    let row_len = samples * JOINTS;
    let too_large = || DynamicsError::TooLarge { trajectories, samples: spec.samples };
    let count = usize::try_from(trajectories).map_err(|_| too_large())?;
    let len = count.checked_mul(row_len).ok_or_else(too_large)?;
    let mut u = vec![0.0; len];
    let mut q = vec![0.0; len];

    let source = Scenarios::new(spec);
    let done = AtomicU64::new(0);
    let cancelled = AtomicBool::new(false);
    let finished = |count| {
        let all = done.fetch_add(count, Ordering::Relaxed) + count;
        if cancelled.load(Ordering::Relaxed) || progress(all).is_break() {
            cancelled.store(true, Ordering::Relaxed);
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    };

    let rows = block_rows(count, instructions.lanes(spec.precision));
    let indices: Vec<u64> = range.clone().collect();
    let blocks = indices
        .par_chunks(rows)
        .zip(u.par_chunks_mut(rows * row_len))
        .zip(q.par_chunks_mut(rows * row_len))
        .map(|((indices, u), q)| {
            if cancelled.load(Ordering::Relaxed) {
                return Ok(Vec::new());
            }
            let mut scenarios: Vec<_> =
                indices.iter().map(|&index| source.draw(index, 1)).collect();
            let mut block =
                Block { source: &source, scenarios: &mut scenarios, u, q, finished: &finished };
            instructions.simulate(spec.precision, &mut block)?;
            Ok(scenarios)
        })
        .collect::<Result<Vec<_>, DynamicsError>>()?;
    if cancelled.into_inner() {
        return Err(DynamicsError::Cancelled { range });
    }

    let scenarios = blocks.concat();
    let rejected = scenarios.iter().map(|scenario| u64::from(scenario.draws - 1)).sum();
    Ok(Trajectories { first: range.start, count, samples, u, q, scenarios, rejected })
}

/// Trajectories per block: a few blocks per thread, so that threads end together, and a multiple of
/// the lanes, so that lanes do.
fn block_rows(count: usize, lanes: usize) -> usize {
    const BLOCKS_PER_THREAD: usize = 4;
    const LARGEST: usize = 512;
    let even = count.div_ceil(BLOCKS_PER_THREAD * rayon::current_num_threads());
    even.clamp(1, LARGEST).next_multiple_of(lanes)
}
