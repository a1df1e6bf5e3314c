//! Consecutive trajectories under control, carried through the lanes of one thread.
//!
//! This is [`crate::block`] with a controller. All lanes are at the start of a sampling period at
//! the same time. The control periods within it are computed without looking at single lanes.

use simd::{Lanes, MAX_LANES};

use crate::block::{Block, Clearance, LaneState, times_zero};
use crate::draws::{Draws, Purpose};
use crate::error::LostTrack;
use crate::integrators::{Scheme, Scratch, State};
use crate::kernels::Advance;
use crate::kinematics::POSE;
use crate::limit_cycle::LimitCycles;
use crate::model::Model;
use crate::planner::ReferenceAt;
use crate::reference::{Reference, ReferenceState};
use crate::structure::Structure;
use crate::tracking::{Controllers, Encoder, Tracking};
use crate::{DynamicsError, Scenario};

/// A trajectory is drawn again when a joint is this far from its reference, rad.
const LOST_RAD: f64 = 1.0;

/// The trajectory of a lane.
struct Course {
    /// The reference at the last sample.
    reference: ReferenceState,
    noise: Draws,
}

/// Fills the block's series. Returns early when `finished` says so.
///
/// # Panics
/// If the spec has no controller.
#[inline(always)]
pub(crate) fn simulate<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    block: &mut Block<'_>,
) -> Result<(), DynamicsError> {
    let joints = structure.joints();
    let spec = block.source.spec();
    let (Some(controller), Some(known)) = (&spec.controller, block.source.known()) else {
        unreachable!("only specs with a controller come here")
    };
    let scheme = Scheme::from(spec.integrator);
    let samples = spec.samples as usize;
    let settling = controller.settling_samples(spec.rate_hz);
    let periods = controller.periods(spec.rate_hz);
    let period = 1.0 / controller.rate_hz;
    let mean = L::splat(1.0 / periods as f64);
    let row_len = samples * joints;
    let clearance = Clearance::<L, N>::new(spec);
    let records_velocities = block.qd.is_some();
    let is_noisy = Encoder::new(spec).is_noisy();

    let mut controllers = Controllers::<L, N>::new(structure, spec, controller, known);
    let mut limit_cycles = LimitCycles::<N>::new(spec, controller);
    let mut model = Model::splat(structure, block.source.nominal());
    let mut state = State::<L, N>::zero();
    let mut scratch = Scratch::new();
    let mut lanes = [LaneState::Idle; MAX_LANES];
    let mut courses: [Option<Course>; MAX_LANES] = [const { None }; MAX_LANES];
    let mut normal = vec![0.0; periods * joints];
    let mut noise = vec![[[0.0; MAX_LANES]; N]; if is_noisy { periods } else { 0 }];
    let adds = block.scenarios.iter().any(|scenario| !tracking_of(scenario).added_nm.is_empty());
    let nothing = vec![0.0; periods * joints];
    let mut added = vec![[[0.0; MAX_LANES]; N]; if adds { periods } else { 0 }];
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
                while let Reference::HandPath(path) = &tracking_of(&block.scenarios[row]).reference
                    && let Some(lost) = path.lost()
                {
                    let scenario = &block.scenarios[row];
                    if scenario.draws >= spec.rejection.max_draws {
                        return Err(DynamicsError::NoPathFollowed {
                            index: scenario.index,
                            seed: spec.seed,
                            draws: scenario.draws,
                            end: lost.end,
                            time_s: lost.time_s,
                            radius_m: path.radius_m,
                        });
                    }
                    block.scenarios[row] = block.source.draw(scenario.index, scenario.draws + 1);
                }
                let scenario = &block.scenarios[row];
                let tracking = tracking_of(scenario);
                let start = tracking.reference.at(0.0);
                model.set_lane(structure, lane, &scenario.robot);
                state.set_lane(lane, &scenario.q0, &scenario.qd0);
                controllers.set_lane(lane, &tracking.gains, &start);
                limit_cycles.start(lane);
                let noise = Draws::new(spec.seed, scenario.index, Purpose::PositionNoise, 0);
                courses[lane] = Some(Course { reference: start, noise });
                lanes[lane] = LaneState::Running { row, sample: 0 };
            }
            let (LaneState::Running { row, sample }, Some(course)) =
                (lanes[lane], &mut courses[lane])
            else {
                continue;
            };
            running = true;
            let tracking = tracking_of(&block.scenarios[row]);
            let mut next = ReferenceState::default();
            let (reference, t) = (&tracking.reference, (sample + 1) as f64 / spec.rate_hz);
            L::run(ReferenceAt { reference, t, state: &mut next });
            controllers.set_reference(lane, &course.reference, &next);
            if let Some(reference) = &mut block.reference
                && let Some(sample) = sample.checked_sub(settling)
            {
                let at = row * row_len + sample * joints;
                record(&mut reference[at..][..joints], &course.reference);
            }
            course.reference = next;
            if is_noisy {
                course.noise.fill_normal_fast(&mut normal);
                scatter(&normal, joints, lane, &mut noise);
            }
            if adds {
                let all = &tracking.added_nm;
                let first = sample.checked_sub(settling).map(|it| it * periods * joints);
                let of_sample = first.and_then(|first| all.get(first..first + periods * joints));
                match of_sample {
                    Some(of_sample) => scatter(of_sample, joints, lane, &mut added),
                    None => scatter(&nothing, joints, lane, &mut added),
                }
            }
        }
        if !running {
            return Ok(());
        }

        let at_sample = state.q;
        let velocity_at_sample = state.qd;
        let mut measured_at_sample = state.q;
        let mut impulse = [L::splat(0.0); N];
        let mut torque = [L::splat(0.0); N];
        for period_of_sample in 0..periods {
            let noise = noise.get(period_of_sample);
            let added = added.get(period_of_sample);
            controllers.torques(structure, period_of_sample, &state.q, noise, added, &mut torque);
            if period_of_sample == 0 {
                measured_at_sample = *controllers.measured();
            }
            for joint in 0..joints {
                impulse[joint] = impulse[joint] + torque[joint];
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

        let mut positions = [[0.0; MAX_LANES]; N];
        let mut velocities = [[0.0; MAX_LANES]; N];
        let mut measured = [[0.0; MAX_LANES]; N];
        let mut torques = [[0.0; MAX_LANES]; N];
        let mut peaks = [[[0.0; MAX_LANES]; N]; 2];
        for (stored, peaks) in peaks.iter_mut().zip(controllers.take_peaks()) {
            for joint in 0..joints {
                peaks[joint].store(&mut stored[joint]);
            }
        }
        let mut zeros = L::splat(0.0);
        for joint in 0..joints {
            at_sample[joint].store(&mut positions[joint]);
            velocity_at_sample[joint].store(&mut velocities[joint]);
            measured_at_sample[joint].store(&mut measured[joint]);
            (impulse[joint] * mean).store(&mut torques[joint]);
            for recorded in [&positions, &velocities, &torques] {
                zeros = zeros + times_zero::<L>(&recorded[joint]);
            }
        }
        let mut zero_if_finite = [0.0; MAX_LANES];
        zeros.store(&mut zero_if_finite);
        let mut excess = [0.0; MAX_LANES];
        clearance.excess(joints, &at_sample).store(&mut excess);
        let mut off = [0.0; MAX_LANES];
        controllers.largest_error(joints, &at_sample).store(&mut off);
        let mut singular = [0.0; MAX_LANES];
        controllers.take_singular().store(&mut singular);

        let mut finished = 0;
        for lane in 0..L::LANES {
            let LaneState::Running { row, sample } = lanes[lane] else { continue };
            let scenario = &block.scenarios[row];
            // Torques that are added swing without being the controller's fault.
            let unstable = tracking_of(scenario)
                .added_nm
                .is_empty()
                .then(|| limit_cycles.add(joints, lane, &peaks))
                .flatten();
            // Infinite torques of an unstable loop come before positions that are not finite.
            let lost = if zero_if_finite[lane] != 0.0 {
                Some(LostTrack::Diverged)
            } else if singular[lane] > 0.0 {
                Some(LostTrack::Singular)
            } else if f64::from(off[lane]) > LOST_RAD {
                Some(LostTrack::OffReference)
            } else if excess[lane] > 0.0 {
                Some(LostTrack::AtLimit)
            } else {
                unstable.map(|joint| LostTrack::Unstable { joint })
            };
            if let Some(lost) = lost {
                let q: Vec<f64> = (0..joints).map(|joint| positions[joint][lane].into()).collect();
                let reference = tracking_of(scenario).reference.at(sample as f64 / spec.rate_hz);
                if scenario.draws >= spec.rejection.max_draws {
                    return Err(lost_track(scenario, spec, lost, sample, &q, &reference));
                }
                block.scenarios[row] = block.source.draw(scenario.index, scenario.draws + 1);
                lanes[lane] = LaneState::Starting { row };
                continue;
            }
            if let Some(recorded) = sample.checked_sub(settling) {
                let at = row * row_len + recorded * joints;
                for joint in 0..joints {
                    block.q[at + joint] = positions[joint][lane];
                    block.u[at + joint] = torques[joint][lane];
                }
                if let Some(series) = &mut block.measured {
                    for joint in 0..joints {
                        series[at + joint] = measured[joint][lane];
                    }
                }
                if records_velocities && let Some(qd) = &mut block.qd {
                    for joint in 0..joints {
                        qd[at + joint] = velocities[joint][lane];
                    }
                }
            }
            if sample + 1 == settling + samples {
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
    }
}

#[expect(clippy::cast_possible_truncation, reason = "series hold f32")]
fn record(series: &mut [f32], reference: &ReferenceState) {
    for (recorded, r) in series.iter_mut().zip(reference.r.iter()) {
        *recorded = *r as f32;
    }
}

/// Puts values `[period, joint]` of a sampling period into a lane.
fn scatter<const N: usize>(
    values: &[f32],
    joints: usize,
    lane: usize,
    lanes: &mut [[[f32; MAX_LANES]; N]],
) {
    for (lanes, values) in lanes.iter_mut().zip(values.chunks_exact(joints)) {
        for (lanes, value) in lanes.iter_mut().zip(values) {
            lanes[lane] = *value;
        }
    }
}

fn tracking_of(scenario: &Scenario) -> &Tracking {
    let tracking = scenario.excitation.tracking();
    tracking.unwrap_or_else(|| unreachable!("a controlled simulation tracks a reference"))
}

#[cold]
fn lost_track(
    scenario: &Scenario,
    spec: &spec::SimulateSpec,
    lost: LostTrack,
    sample: usize,
    q: &[f64],
    reference: &ReferenceState,
) -> DynamicsError {
    let off: Vec<f64> = q.iter().zip(reference.r.iter()).map(|(q, r)| (q - r).abs()).collect();
    let farthest = (0..off.len()).max_by(|&a, &b| off[a].total_cmp(&off[b])).unwrap_or_default();
    let worst = if let LostTrack::Unstable { joint } = lost { joint } else { farthest };
    let gains = &tracking_of(scenario).gains;
    DynamicsError::NoDrawTracked {
        index: scenario.index,
        seed: spec.seed,
        draws: scenario.draws,
        lost,
        joint: worst + 1,
        off_rad: off[worst],
        time_s: sample as f64 / spec.rate_hz,
        // Controllers of the hand have a gain for each direction, and not for each joint.
        kp: gains.kp.get(worst).copied().unwrap_or(gains.kp[0]),
        kd: gains.kd.get(worst).copied().unwrap_or(gains.kd[0]),
        delay_periods: gains.delay_periods,
    }
}
