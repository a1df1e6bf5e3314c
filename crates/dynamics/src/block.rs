//! Consecutive trajectories, carried through the lanes of one thread.
//!
//! Lanes work like a conveyor: each has its own trajectory and its own sample, and whenever one is
//! finished or rejected the next scenario takes its place at once. Nothing waits for the slowest
//! lane, and a rejected draw costs only the samples until its rejection.

use std::ops::ControlFlow;

use simd::{Lanes, MAX_LANES};
use spec::{Gravity, Rejection, SimulateSpec};

use crate::forward_dynamics::Dynamics;
use crate::integrators::{Scheme, Scratch, State};
use crate::kernels::{Advance, MassMatrixAndBias};
use crate::kinematics::POSE;
use crate::model::Model;
use crate::spatial::Turn;
use crate::structure::Structure;
use crate::{DynamicsError, Scenario, Scenarios};

/// Trajectories `first`, `first + 1`, .., one per element of `scenarios`.
pub(crate) struct Block<'a> {
    pub(crate) source: &'a Scenarios<'a>,
    /// The first draws. The accepted draws replace rejected ones.
    pub(crate) scenarios: &'a mut [Scenario],
    /// Torques, [trajectory, sample, joint].
    pub(crate) u: &'a mut [f32],
    /// Positions, [trajectory, sample, joint].
    pub(crate) q: &'a mut [f32],
    /// Velocities, [trajectory, sample, joint].
    pub(crate) qd: Option<&'a mut [f32]>,
    /// References of a controller, [trajectory, sample, joint].
    pub(crate) reference: Option<&'a mut [f32]>,
    /// Positions as a controller measured them, [trajectory, sample, joint].
    pub(crate) measured: Option<&'a mut [f32]>,
    /// Poses of the hand, [trajectory, sample, 7].
    pub(crate) end_effector: Option<&'a mut [f32]>,
    /// Gets the number of newly finished trajectories, and may ask to stop.
    pub(crate) finished: &'a (dyn Fn(u64) -> ControlFlow<()> + Sync),
}

/// The state of a lane.
#[derive(Clone, Copy)]
pub(crate) enum LaneState {
    Idle,
    /// The lane starts the trajectory in this row of the block.
    Starting {
        row: usize,
    },
    /// The lane is at `sample` of the trajectory in `row`.
    Running {
        row: usize,
        sample: usize,
    },
}

/// Fills the block's series. Returns early when `finished` says so.
#[inline(always)]
pub(crate) fn simulate<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    block: &mut Block<'_>,
) -> Result<(), DynamicsError> {
    let joints = structure.joints();
    let spec = block.source.spec();
    let scheme = Scheme::from(spec.integrator);
    let period = 1.0 / spec.rate_hz;
    let samples = spec.samples as usize;
    let row_len = samples * joints;
    let clearance = Clearance::<L, N>::new(spec);
    let compensated = spec.robot.gravity == Gravity::Compensated;
    let records_velocities = block.qd.is_some();

    let mut model = Model::splat(structure, block.source.nominal());
    let mut state = State::<L, N>::zero();
    let mut scratch = Scratch::new();
    let mut lanes = [LaneState::Idle; MAX_LANES];
    let mut waiting = 0..block.scenarios.len();

    loop {
        let mut running = false;
        for lane in 0..L::LANES {
            if matches!(lanes[lane], LaneState::Idle)
                && let Some(row) = waiting.next()
            {
                lanes[lane] = LaneState::Starting { row };
            }
            if let LaneState::Starting { row } = lanes[lane] {
                let scenario = &block.scenarios[row];
                let u = &mut block.u[row * row_len..][..row_len];
                if let Some(torques) = scenario.excitation.torques() {
                    torques.sample::<L::Double>(joints, spec.rate_hz, u);
                }
                model.set_lane(structure, lane, &scenario.robot);
                state.set_lane(lane, &scenario.q0, &scenario.qd0);
                lanes[lane] = LaneState::Running { row, sample: 0 };
            }
            running |= matches!(lanes[lane], LaneState::Running { .. });
        }
        if !running {
            return Ok(());
        }

        let mut torques = [[0.0; MAX_LANES]; N];
        for lane in 0..L::LANES {
            let LaneState::Running { row, sample } = lanes[lane] else { continue };
            let u = &block.u[row * row_len + sample * joints..][..joints];
            for joint in 0..joints {
                torques[joint][lane] = u[joint];
            }
        }
        if compensated {
            add_gravity_torques(structure, &model, &state.q, &mut torques);
        }
        let mut positions = [[0.0; MAX_LANES]; N];
        let mut velocities = [[0.0; MAX_LANES]; N];
        let mut zeros = L::splat(0.0);
        for joint in 0..joints {
            state.q[joint].store(&mut positions[joint]);
            zeros = zeros + times_zero::<L>(&positions[joint]);
        }
        if records_velocities {
            for joint in 0..joints {
                state.qd[joint].store(&mut velocities[joint]);
                zeros = zeros + times_zero::<L>(&velocities[joint]);
            }
        }
        let mut zero_if_finite = [0.0; MAX_LANES];
        zeros.store(&mut zero_if_finite);
        let mut excess = [0.0; MAX_LANES];
        clearance.excess(joints, &state.q).store(&mut excess);

        let mut finished = 0;
        for lane in 0..L::LANES {
            let LaneState::Running { row, sample } = lanes[lane] else { continue };
            let at = row * row_len + sample * joints;
            let q = &mut block.q[at..][..joints];
            for joint in 0..joints {
                q[joint] = positions[joint][lane];
            }
            if compensated {
                let u = &mut block.u[at..][..joints];
                for joint in 0..joints {
                    u[joint] = torques[joint][lane];
                }
            }
            if let Some(qd) = &mut block.qd {
                let qd = &mut qd[at..][..joints];
                for joint in 0..joints {
                    qd[joint] = velocities[joint][lane];
                }
            }
            if zero_if_finite[lane] != 0.0 {
                return Err(not_finite(&block.scenarios[row], spec.seed, sample));
            }
            if excess[lane] > 0.0 {
                redraw(block.source, &spec.rejection, &mut block.scenarios[row])?;
                lanes[lane] = LaneState::Starting { row };
            } else if sample + 1 == samples {
                if let Some(poses) = &mut block.end_effector {
                    let q = &block.q[row * row_len..][..row_len];
                    let poses = &mut poses[row * samples * POSE..][..samples * POSE];
                    block.scenarios[row].robot.kinematics.record_poses::<L::Double>(q, poses);
                }
                lanes[lane] = LaneState::Idle;
                finished += 1;
            } else {
                lanes[lane] = LaneState::Running { row, sample: sample + 1 };
            }
        }
        if finished > 0 && (block.finished)(finished).is_break() {
            return Ok(());
        }

        let mut torque = state.qd;
        for joint in 0..joints {
            torque[joint] = L::load(&torques[joint]);
        }
        L::run(Advance {
            structure,
            scheme,
            period,
            model: &model,
            torque: &torque,
            state: &mut state,
            scratch: &mut scratch,
        });
    }
}

/// 0 where the recorded f32 value is finite, and NaN where it is not.
#[inline(always)]
pub(crate) fn times_zero<L: Lanes>(recorded: &[f32; MAX_LANES]) -> L {
    L::load(recorded) * L::splat(0.0)
}

/// Adds g(q) of each lane's robot to the torques in f32, so that the recorded torques are those
/// that act.
#[inline(always)]
fn add_gravity_torques<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    model: &Model<L, N>,
    q: &[L; N],
    torques: &mut [[f32; MAX_LANES]; N],
) {
    let mut at_rest = Dynamics::zero();
    let mut at_q = [Turn::none(); N];
    structure.turns(model, q, &mut at_q);
    let (turns, qd, dynamics) = (&at_q, &[L::splat(0.0); N], &mut at_rest);
    L::run(MassMatrixAndBias { structure, model, turns, qd, dynamics });
    for joint in 0..structure.joints() {
        (L::load(&torques[joint]) + at_rest.bias[joint]).store(&mut torques[joint]);
    }
}

#[cold]
fn redraw(
    source: &Scenarios<'_>,
    rejection: &Rejection,
    scenario: &mut Scenario,
) -> Result<(), DynamicsError> {
    let Scenario { index, draws, .. } = *scenario;
    if draws >= rejection.max_draws {
        return Err(DynamicsError::EveryDrawRejected {
            index,
            seed: source.spec().seed,
            draws,
            margin_rad: rejection.position_margin_rad.unwrap_or_default(),
        });
    }
    *scenario = source.draw(index, draws + 1);
    Ok(())
}

#[cold]
fn not_finite(scenario: &Scenario, seed: u64, sample: usize) -> DynamicsError {
    DynamicsError::NotFinite { index: scenario.index, seed, draw: scenario.draws, sample }
}

/// The bounds that every sample of a trajectory must keep.
pub(crate) struct Clearance<L, const N: usize> {
    lower: [L; N],
    upper: [L; N],
}

impl<L: Lanes, const N: usize> Clearance<L, N> {
    #[inline(always)]
    pub(crate) fn new(spec: &SimulateSpec) -> Self {
        let unlimited = L::splat(f64::INFINITY);
        let mut clearance = Self { lower: [-unlimited; N], upper: [unlimited; N] };
        if let Some(margin) = spec.rejection.position_margin_rad {
            for (joint, description) in spec.robot.description().joints.iter().enumerate() {
                let limits = description.position_rad;
                clearance.lower[joint] = L::splat(limits.min + margin);
                clearance.upper[joint] = L::splat(limits.max - margin);
            }
        }
        clearance
    }

    /// The largest distance of a joint beyond its bounds, in rad. It is negative if all are inside.
    #[inline(always)]
    pub(crate) fn excess(&self, joints: usize, q: &[L; N]) -> L {
        let mut excess = (q[0] - self.upper[0]).max(self.lower[0] - q[0]);
        for joint in 1..joints {
            let beyond = (q[joint] - self.upper[joint]).max(self.lower[joint] - q[joint]);
            excess = excess.max(beyond);
        }
        excess
    }
}
