//! Simulation of trajectories on all threads, in blocks of consecutive indices.

use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;
use series::{Series, Shape};
use simd::InstructionSet;
use spec::SimulateSpec;

use crate::block::Block;
use crate::dispatch;
use crate::kinematics::POSE;
use crate::measurement::measure;
use crate::{DynamicsError, Scenario, Scenarios};

/// Trajectories that are drawn together: a multiple of all lanes.
const DRAWN_TOGETHER: usize = 32;

/// Simulated trajectories with consecutive indices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectories {
    /// Index of the first.
    pub first: u64,
    /// Torques in N·m and positions in rad. Torque k is held from sample k to k + 1. It is bit for
    /// bit the torque that acted: the excitation, plus g(q\[k\]) where gravity is compensated.
    /// Position k is the state at k / rate, before torque k acts. Where the spec asks for noise,
    /// the series has the measured values beside these true ones. Under a controller, torque k is
    /// the mean of the torques that acted until the next sample.
    pub series: Series,
    /// References of the controller in rad, [trajectory, sample, joint], if the spec has one.
    pub reference: Option<Vec<f32>>,
    /// Velocities in rad/s, [trajectory, sample, joint], when the spec asks for them.
    pub qd: Option<Vec<f32>>,
    /// Pose of the hand's frame in the base's at the recorded positions, [trajectory, sample, 7], when
    /// the spec asks for it: x, y, z in m and a unit quaternion qx, qy, qz, qw that begins with qw ≥ 0
    /// and never jumps to its negative.
    pub end_effector: Option<Vec<f32>>,
    /// The random choices of each trajectory, of the draw that was accepted.
    pub scenarios: Vec<Scenario>,
    /// Number of draws that came too close to a joint limit, over all trajectories.
    pub rejected: u64,
}

/// Simulates trajectories `range` of `spec` on all threads of the current rayon pool.
///
/// Those threads call `progress` with the number of finished trajectories, up to once per
/// trajectory. If it breaks, the simulation stops.
///
/// # Errors
///
/// The simulation was cancelled, no draw of a trajectory was accepted, or the integration diverged.
pub fn simulate(
    spec: &SimulateSpec,
    range: Range<u64>,
    progress: &(dyn Fn(u64) -> ControlFlow<()> + Sync),
) -> Result<Trajectories, DynamicsError> {
    simulate_on(InstructionSet::best(), spec, range, progress)
}

/// Like [`simulate`], with a given instruction set. The result is the same.
///
/// # Errors
///
/// Those of [`simulate`].
pub fn simulate_on(
    instructions: InstructionSet,
    spec: &SimulateSpec,
    range: Range<u64>,
    progress: &(dyn Fn(u64) -> ControlFlow<()> + Sync),
) -> Result<Trajectories, DynamicsError> {
    let mut trajectories = Trajectories::default();
    simulate_into(instructions, spec, range, progress, &mut trajectories)?;
    Ok(trajectories)
}

/// Like [`simulate_on`], in the memory of trajectories that are no longer needed. Repeated calls
/// then spend no time on fresh pages.
///
/// # Errors
///
/// Those of [`simulate`]. `trajectories` are then empty.
pub fn simulate_into(
    instructions: InstructionSet,
    spec: &SimulateSpec,
    range: Range<u64>,
    progress: &(dyn Fn(u64) -> ControlFlow<()> + Sync),
    trajectories: &mut Trajectories,
) -> Result<(), DynamicsError> {
    let result = fill(instructions, spec, range, progress, trajectories);
    if result.is_err() {
        trajectories.resize(spec, 0)?;
        trajectories.scenarios.clear();
    }
    result
}

/// Simulates scenarios of `spec` as they are, with other arms for example. None is drawn again.
///
/// # Errors
///
/// One of them came too close to a joint limit, lost its reference, or diverged.
pub fn simulate_scenarios(
    spec: &SimulateSpec,
    scenarios: &[Scenario],
) -> Result<Trajectories, DynamicsError> {
    let mut spec = spec.clone();
    spec.rejection.max_draws = 1;
    let mut trajectories =
        Trajectories { scenarios: scenarios.to_vec(), ..Trajectories::default() };
    let range = 0..scenarios.len() as u64;
    let go_on = |_| ControlFlow::Continue(());
    trajectories.make_room(&spec, &range)?;
    move_scenarios(
        InstructionSet::best(),
        &Scenarios::new(&spec),
        range,
        &go_on,
        &mut trajectories,
    )?;
    Ok(trajectories)
}

fn fill(
    instructions: InstructionSet,
    spec: &SimulateSpec,
    range: Range<u64>,
    progress: &(dyn Fn(u64) -> ControlFlow<()> + Sync),
    trajectories: &mut Trajectories,
) -> Result<(), DynamicsError> {
    trajectories.make_room(spec, &range)?;
    let source = Scenarios::new(spec);
    let count = trajectories.series.robots();
    let parts = (0..count.div_ceil(DRAWN_TOGETHER)).into_par_iter();
    let drawn: Vec<Vec<Scenario>> = parts
        .map(|part| {
            let start = range.start + (part * DRAWN_TOGETHER) as u64;
            source.draw_all(start..range.end.min(start + DRAWN_TOGETHER as u64))
        })
        .collect();
    trajectories.scenarios.clear();
    trajectories.scenarios.extend(drawn.into_iter().flatten());
    move_scenarios(instructions, &source, range, progress, trajectories)
}

/// Fills the series of scenarios. Those that are rejected are replaced by the next draws of `source`.
fn move_scenarios(
    instructions: InstructionSet,
    source: &Scenarios<'_>,
    range: Range<u64>,
    progress: &(dyn Fn(u64) -> ControlFlow<()> + Sync),
    trajectories: &mut Trajectories,
) -> Result<(), DynamicsError> {
    let spec = source.spec();
    let samples = spec.samples as usize;
    let row_len = samples * spec.joints();
    let pose_len = samples * POSE;
    let Trajectories { series, reference, qd, end_effector, scenarios, rejected, .. } =
        trajectories;
    let mut measured = (spec.controller.is_some() && spec.observations.measures_positions())
        .then(|| vec![0.0; series.y().len()]);
    let count = series.robots();
    let kind = source.kind();

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

    let rows = block_rows(count, dispatch::lanes(instructions, spec.precision));
    let (u, q) = series.both_mut();
    let mut u = u.chunks_mut(rows * row_len);
    let mut q = q.chunks_mut(rows * row_len);
    let mut reference = reference.as_mut().map(|series| series.chunks_mut(rows * row_len));
    let mut measured_rows = measured.as_mut().map(|series| series.chunks_mut(rows * row_len));
    let mut qd = qd.as_mut().map(|qd| qd.chunks_mut(rows * row_len));
    let mut end_effector = end_effector.as_mut().map(|poses| poses.chunks_mut(rows * pose_len));
    let mut blocks = Vec::with_capacity(count.div_ceil(rows));
    for scenarios in scenarios.chunks_mut(rows) {
        blocks.push(Block {
            source,
            scenarios,
            u: u.next().unwrap_or_default(),
            q: q.next().unwrap_or_default(),
            qd: qd.as_mut().and_then(Iterator::next),
            reference: reference.as_mut().and_then(Iterator::next),
            measured: measured_rows.as_mut().and_then(Iterator::next),
            end_effector: end_effector.as_mut().and_then(Iterator::next),
            finished: &finished,
        });
    }
    blocks.into_par_iter().try_for_each(|mut block| {
        if cancelled.load(Ordering::Relaxed) {
            return Ok(());
        }
        match spec.controller {
            None => dispatch::simulate(instructions, spec.precision, kind, &mut block),
            Some(_) => {
                dispatch::simulate_closed_loop(instructions, spec.precision, kind, &mut block)
            }
        }
    })?;
    if cancelled.into_inner() {
        return Err(DynamicsError::Cancelled { range });
    }
    measure(series, spec, range.start, measured.as_deref());
    *rejected = scenarios.iter().map(|scenario| u64::from(scenario.draws - 1)).sum();
    Ok(())
}

impl Trajectories {
    /// Makes room for trajectories `range` of `spec`, and for everything that it records.
    fn make_room(&mut self, spec: &SimulateSpec, range: &Range<u64>) -> Result<(), DynamicsError> {
        let observations = &spec.observations;
        self.first = range.start;
        self.qd = observations.joint_velocities.then(|| self.qd.take().unwrap_or_default());
        self.end_effector =
            observations.end_effector_pose.then(|| self.end_effector.take().unwrap_or_default());
        self.reference =
            spec.controller.is_some().then(|| self.reference.take().unwrap_or_default());
        self.resize(spec, range.end.saturating_sub(range.start))
    }

    /// Makes room for `trajectories` trajectories of `spec`, whose values will be overwritten.
    fn resize(&mut self, spec: &SimulateSpec, trajectories: u64) -> Result<(), DynamicsError> {
        let too_large = || DynamicsError::TooLarge { trajectories, samples: spec.samples };
        let robots = usize::try_from(trajectories).map_err(|_| too_large())?;
        let shape = Shape { robots, samples: spec.samples as usize, joints: spec.joints() };
        self.rejected = 0;
        self.series.reshape(shape, spec.rate_hz).map_err(|_| too_large())?;
        if let Some(qd) = &mut self.qd {
            resize(qd, self.series.y().len());
        }
        if let Some(reference) = &mut self.reference {
            resize(reference, self.series.y().len());
        }
        if let Some(end_effector) = &mut self.end_effector {
            let poses = Shape { joints: POSE, ..shape };
            resize(end_effector, poses.values().map_err(|_| too_large())?);
        }
        Ok(())
    }
}

fn resize(values: &mut Vec<f32>, len: usize) {
    if values.capacity() < len {
        // The allocator gives zeros, which cost nothing if the system provides zeroed pages.
        *values = vec![0.0; len];
    } else {
        values.resize(len, 0.0);
    }
}

/// Trajectories per block: a few blocks per thread, so that threads end at the same time, and a
/// multiple of the lanes, so that lanes do as well.
fn block_rows(count: usize, lanes: usize) -> usize {
    const BLOCKS_PER_THREAD: usize = 4;
    const LARGEST: usize = 512;
    let even = count.div_ceil(BLOCKS_PER_THREAD * rayon::current_num_threads());
    even.clamp(1, LARGEST).next_multiple_of(lanes)
}
