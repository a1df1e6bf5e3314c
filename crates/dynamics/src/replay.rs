//! Moves given robots from given states by given torques.
//!
//! Identification and control use it. Every robot of a batch has a lane, and nothing is drawn,
//! rejected or compensated.

use rayon::prelude::*;
use simd::{InstructionSet, Lanes, MAX_LANES};
use spec::{Integrator, Precision, SimulateSpec};

use crate::dispatch;
use crate::integrators::{Scheme, Scratch, State};
use crate::kernels::Advance;
use crate::model::Model;
use crate::structure::{Kind, Structure};
use crate::{ArmState, Joints, Robot};

/// One robot with its initial state and its torques.
#[derive(Clone, Copy, Debug)]
pub struct Motion<'a> {
    /// The robot that moves.
    pub robot: &'a Robot,
    /// Positions at the first sample, rad.
    pub q0: Joints<f64>,
    /// Velocities at the first sample, rad/s.
    pub qd0: Joints<f64>,
    /// All torques that act, `[sample, joint]` in N·m. They include those of a controller that
    /// compensates gravity. Each is held until the next sample.
    pub u: &'a [f32],
    /// Anchors along the motion, in the order of samples.
    pub anchors: &'a [Anchor],
}

/// A position, and perhaps a velocity, to which the arm is set at a sample. Anchors keep a simulation close to
/// a measured motion. Under gravity, the motions of two slightly different arms would otherwise
/// diverge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// The sample at which the arm is set.
    pub sample: usize,
    /// rad.
    pub q: Joints<f64>,
    /// rad/s; `None` keeps the velocity that the arm has there.
    pub qd: Option<Joints<f64>>,
}

/// The settings of a replay. With the fields of a [`SimulateSpec`], a drawn robot moves as it did
/// in the simulation, bit for bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Replay {
    /// Samples per second.
    pub rate_hz: f64,
    /// The scheme between two samples.
    pub integrator: Integrator,
    /// The format of the numbers.
    pub precision: Precision,
    /// The instruction set. It changes the time, but not the result.
    pub instructions: InstructionSet,
}

/// Motions that fit into the lanes of one vector.
pub(crate) struct MotionBatch<'a> {
    replay: &'a Replay,
    motions: &'a [Motion<'a>],
    /// `[motion, sample, joint]`.
    q: &'a mut [f32],
    /// `[motion]`.
    ends: &'a mut [ArmState],
}

impl Replay {
    /// The settings of a simulation, on the best instruction set.
    pub fn of(spec: &SimulateSpec) -> Self {
        Self {
            rate_hz: spec.rate_hz,
            integrator: spec.integrator,
            precision: spec.precision,
            instructions: InstructionSet::best(),
        }
    }

    /// Positions `[motion, sample, joint]` in rad, at the sample of every torque, before the torque
    /// acts and before an anchor applies. All threads of the current rayon pool compute them.
    ///
    /// A motion that diverges has values that are not finite from some sample on. It does not
    /// affect the others.
    ///
    /// # Panics
    /// If motions differ in their number of torques or joints.
    pub fn run(&self, motions: &[Motion<'_>]) -> Vec<f32> {
        self.run_through(motions).0
    }

    /// The positions of [`Replay::run`], and the state of each motion at the end of its last
    /// torque.
    ///
    /// # Panics
    /// If motions differ in their number of torques or joints.
    pub fn run_through(&self, motions: &[Motion<'_>]) -> (Vec<f32>, Vec<ArmState>) {
        let length = motions.first().map_or(0, |motion| motion.u.len());
        let joints = motions.first().map_or(1, |motion| motion.robot.joints());
        let alike =
            |motion: &Motion<'_>| motion.u.len() == length && motion.robot.joints() == joints;
        assert!(motions.iter().all(alike), "motions of equal length, of equally many joints");
        let mut q = vec![0.0; motions.len() * length];
        let mut ends: Vec<ArmState> =
            motions.iter().map(|motion| ArmState { q: motion.q0, qd: motion.qd0 }).collect();
        if length == 0 {
            return (q, ends);
        }
        let kind = Kind::of(motions.iter().map(|motion| motion.robot));
        let lanes = dispatch::lanes(self.instructions, self.precision);
        let chunks = motions.par_chunks(lanes).zip(q.par_chunks_mut(lanes * length));
        chunks.zip(ends.par_chunks_mut(lanes)).for_each(|((motions, q), ends)| {
            let mut together = MotionBatch { replay: self, motions, q, ends };
            dispatch::replay(self.instructions, self.precision, kind, &mut together);
        });
        (q, ends)
    }
}

/// Computes the positions of at most as many motions as there are lanes.
#[inline(always)]
pub(crate) fn replay<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    together: &mut MotionBatch<'_>,
) {
    let joints = structure.joints();
    let MotionBatch { replay, motions, q, ends } = together;
    let scheme = Scheme::from(replay.integrator);
    let period = 1.0 / replay.rate_hz;
    let samples = motions[0].u.len() / joints;
    // Lanes without a motion of their own repeat the first robot, at rest.
    let mut model = Model::splat(structure, motions[0].robot);
    let mut state = State::<L, N>::zero();
    let mut scratch = Scratch::new();
    for lane in 0..motions.len() {
        let motion = &motions[lane];
        model.set_lane(structure, lane, motion.robot);
        state.set_lane(lane, &motion.q0, &motion.qd0);
    }
    let mut anchored = [0; MAX_LANES];
    for sample in 0..samples {
        let mut positions = [[0.0; MAX_LANES]; N];
        for joint in 0..joints {
            state.q[joint].store(&mut positions[joint]);
        }
        let mut torques = [[0.0; MAX_LANES]; N];
        for lane in 0..motions.len() {
            let u = &motions[lane].u[sample * joints..][..joints];
            let q = &mut q[(lane * samples + sample) * joints..][..joints];
            for joint in 0..joints {
                q[joint] = positions[joint][lane];
                torques[joint][lane] = u[joint];
            }
            if let Some(anchor) = motions[lane].anchors.get(anchored[lane])
                && anchor.sample == sample
            {
                match &anchor.qd {
                    None => state.set_position(lane, &anchor.q),
                    Some(qd) => state.set_lane(lane, &anchor.q, qd),
                }
                anchored[lane] += 1;
            }
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
    for lane in 0..motions.len() {
        ends[lane] = state.of_lane(joints, lane);
    }
}

impl<L: Lanes, const N: usize> State<L, N> {
    #[inline(always)]
    fn of_lane(&self, joints: usize, lane: usize) -> ArmState {
        let mut arm = ArmState { q: Joints::splat(joints, 0.0), qd: Joints::splat(joints, 0.0) };
        for joint in 0..joints {
            arm.q[joint] = self.q[joint].lane(lane) + self.q_remainder[joint].lane(lane);
            arm.qd[joint] = self.qd[joint].lane(lane);
        }
        arm
    }
}
