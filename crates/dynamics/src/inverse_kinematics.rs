//! The motions of joints that follow paths of the hand, several paths at a time.
//!
//! Differential inverse kinematics of the nominal arm, q̇ = J⁺ (ẋ + K e) + (1 − J⁺ J) (q_start − q) k,
//! is integrated with Runge-Kutta's method. One path is in each lane. Whenever one ends, or the
//! joints cannot follow it, the next one takes its place.

use std::f64::consts::TAU;

use simd::{InstructionSet, Kernel, Lanes, MAX_LANES, align_stack, with_f64_lanes};
use spec::{MAX_JOINTS, PathShape};

use crate::general::General;
use crate::hand::{Axes, MOTION, Mount, Posture};
use crate::hand_path::{Attempt, PathEnd, SPIRAL_LEAST, SPIRAL_TURNS};
use crate::model::Model;
use crate::reference::ReferenceState;
use crate::room::Limits;
use crate::spatial::{Turn, Vector};
use crate::structure::Structure;
use crate::task_matrix::{Factors, Scratch};
use crate::{Joints, Robot};

/// K, 1/s.
const FEEDBACK_PER_S: f64 = 10.0;
/// k, 1/s.
const POSTURE_PER_S: f64 = 1.0;
/// A pivot of J Jᵀ below this share of the entry that it comes from makes a posture singular.
const LEAST_PIVOT: f64 = 1e-6;

/// The arm that follows paths, and what its joints may do.
#[derive(Clone, Copy)]
pub(crate) struct Following<'a> {
    pub(crate) arm: &'a Robot,
    pub(crate) limits: &'a Joints<Limits>,
    /// The largest speed of a joint, as a share of its limit.
    pub(crate) speed: f64,
    pub(crate) keeps_orientation: bool,
}

impl Following<'_> {
    /// Lets the joints follow all paths, or makes the paths say why they cannot. The instruction set
    /// changes the time, but never the result.
    pub(crate) fn follow(&self, instructions: InstructionSet, attempts: &mut [Attempt<'_>]) {
        let following = *self;
        with_f64_lanes!(instructions, L => L::run(Follow { following, attempts }));
    }
}

struct Follow<'a, 'b> {
    following: Following<'a>,
    attempts: &'a mut [Attempt<'b>],
}

impl<L: Lanes> Kernel<L> for Follow<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        align_stack();
        let Self { following, attempts } = self;
        let mut paths = Paths::<L>::new(&following);
        let mut running = [None; MAX_LANES];
        let mut waiting = 0..attempts.len();
        loop {
            for lane in 0..L::LANES {
                if running[lane].is_none() {
                    running[lane] = waiting.next();
                    if let Some(attempt) = running[lane] {
                        paths.set_lane(lane, &attempts[attempt]);
                    }
                }
            }
            if running == [None; MAX_LANES] {
                return;
            }
            let start = paths.q;
            let step = paths.step();
            for lane in 0..L::LANES {
                let Some(attempt) = running[lane] else { continue };
                let attempt = &mut attempts[attempt];
                if let Some(end) = following.end(lane, &start, &step) {
                    if attempt.retry(&following.arm.kinematics, end) {
                        paths.set_lane(lane, attempt);
                    } else {
                        running[lane] = None;
                    }
                } else if attempt.arrive(state(attempt.joints(), lane, &start, &step.qd)) {
                    running[lane] = None;
                }
            }
        }
    }
}

/// The rates at the start of a step of the integration.
struct Step<L> {
    /// rad/s.
    qd: [L; MAX_JOINTS],
    /// Above 0 where a posture of the step was singular.
    singular: L,
}

impl Following<'_> {
    /// The reason why the path of a lane ends at positions `q`.
    fn end<L: Lanes>(&self, lane: usize, q: &[L; MAX_JOINTS], step: &Step<L>) -> Option<PathEnd> {
        if step.singular.lane(lane) > 0.0 {
            return Some(PathEnd::Singular);
        }
        self.limits.iter().enumerate().find_map(|(joint, limits)| {
            if !(limits.least..=limits.most).contains(&q[joint].lane(lane)) {
                Some(PathEnd::Limit(joint + 1))
            } else if step.qd[joint].lane(lane).abs() > self.speed * limits.speed {
                Some(PathEnd::Speed(joint + 1))
            } else {
                None
            }
        })
    }
}

fn state<L: Lanes>(
    joints: usize,
    lane: usize,
    q: &[L; MAX_JOINTS],
    qd: &[L; MAX_JOINTS],
) -> ReferenceState {
    ReferenceState {
        r: Joints::from_fn(joints, |joint| q[joint].lane(lane)),
        rd: Joints::from_fn(joints, |joint| qd[joint].lane(lane)),
        rdd: Joints::splat(joints, 0.0),
    }
}

/// Paths of the hand and the joints that follow them, one per lane.
struct Paths<L> {
    structure: General<MAX_JOINTS>,
    model: Model<L, MAX_JOINTS>,
    mount: Mount<L>,
    /// 1 if the hand keeps its orientation, and 0 otherwise.
    turning: L,
    has_freedom: bool,
    q: [L; MAX_JOINTS],
    start: [L; MAX_JOINTS],
    /// Axes of the last link at the start.
    axes: Axes<L>,
    /// The center from the first joint, m.
    center: Vector<L>,
    e1: Vector<L>,
    /// 0 of a line.
    e2: Vector<L>,
    /// 2πf, and that of a spiral's radius.
    frequencies: [L; 2],
    /// The radius is the first number, plus the second times 1 + cos.
    radii: [L; 2],
    /// Duration of a step, s.
    h: L,
    /// Steps so far.
    steps: L,
    scratch: Scratch<L, MAX_JOINTS>,
}

impl<L: Lanes> Paths<L> {
    fn new(following: &Following<'_>) -> Self {
        let joints = following.limits.len();
        let structure = General::new(joints);
        let (zero, none) = (L::splat(0.0), [L::splat(0.0); 3]);
        let mount = Mount::new(&following.arm.kinematics, 0.0);
        let keeps = following.keeps_orientation;
        Self {
            structure,
            model: Model::splat(structure, following.arm),
            mount,
            turning: L::splat(if keeps { 1.0 } else { 0.0 }),
            has_freedom: joints > if keeps { MOTION } else { MOTION / 2 },
            q: [zero; MAX_JOINTS],
            start: [zero; MAX_JOINTS],
            axes: Axes([none; 3]),
            center: none,
            e1: none,
            e2: none,
            frequencies: [zero; 2],
            radii: [zero; 2],
            h: zero,
            steps: zero,
            scratch: Scratch::new(),
        }
    }

    /// Puts a path into a lane, from its start.
    fn set_lane(&mut self, lane: usize, attempt: &Attempt<'_>) {
        let path = &attempt.path;
        for joint in 0..path.start_rad.len() {
            self.q[joint].set_lane(lane, path.start_rad[joint]);
            self.start[joint].set_lane(lane, path.start_rad[joint]);
        }
        let round = if path.shape == PathShape::Line { 0.0 } else { 1.0 };
        for coordinate in 0..3 {
            for axis in 0..3 {
                let part = attempt.place.link[(coordinate, axis)];
                self.axes.0[axis][coordinate].set_lane(lane, part);
            }
            let center = path.center_m[coordinate] - attempt.place.first_joint[coordinate];
            self.center[coordinate].set_lane(lane, center);
            self.e1[coordinate].set_lane(lane, path.axes[0][coordinate]);
            self.e2[coordinate].set_lane(lane, round * path.axes[1][coordinate]);
        }
        let (w, radius) = (TAU * path.frequency_hz, path.radius_m);
        let (least, half) = match path.shape {
            PathShape::Spiral => (SPIRAL_LEAST * radius, 0.5 * (1.0 - SPIRAL_LEAST) * radius),
            PathShape::Circle | PathShape::Line => (radius, 0.0),
        };
        self.frequencies[0].set_lane(lane, w);
        self.frequencies[1].set_lane(lane, w / SPIRAL_TURNS);
        self.radii[0].set_lane(lane, least);
        self.radii[1].set_lane(lane, half);
        self.h.set_lane(lane, path.step_s());
        self.steps.set_lane(lane, 0.0);
    }

    /// Takes a step of Runge-Kutta's method.
    #[inline(always)]
    fn step(&mut self) -> Step<L> {
        /// The weight of each stage's slope, and the place of the next stage along it.
        const STAGES: [(f64, f64); 4] =
            [(1.0 / 6.0, 0.5), (1.0 / 3.0, 0.5), (1.0 / 3.0, 1.0), (1.0 / 6.0, 0.0)];

        let joints = self.structure.joints();
        let start = self.q;
        let mut end = start;
        let mut step = Step { qd: start, singular: L::splat(-1.0) };
        let mut ahead = L::splat(0.0);
        for stage in 0..STAGES.len() {
            let (weight, reach) = STAGES[stage];
            let t = (self.steps + ahead) * self.h;
            let (qd, singular) = self.velocity(t);
            step.singular = step.singular.max(singular);
            if stage == 0 {
                step.qd = qd;
            }
            ahead = L::splat(reach);
            let (weight, reach) = (L::splat(weight) * self.h, ahead * self.h);
            for joint in 0..joints {
                end[joint] = weight.mul_add(qd[joint], end[joint]);
                self.q[joint] = reach.mul_add(qd[joint], start[joint]);
            }
        }
        self.q = end;
        self.steps = self.steps + L::splat(1.0);
        step
    }

    /// q̇ at time `t`, and above 0 where the posture is singular.
    #[inline(always)]
    fn velocity(&mut self, t: L) -> ([L; MAX_JOINTS], L) {
        let joints = self.structure.joints();
        let mut turns = [Turn::none(); MAX_JOINTS];
        self.structure.all_turns(&self.model, &self.q, &mut turns);
        let posture = Posture::of(self.structure, &self.model, &self.mount, &turns);
        posture.write_jacobian(joints, self.turning, &mut self.scratch.jacobian);
        let (position, velocity) = self.hand_at(t);
        let away = posture.error_to(&position, &self.axes);
        let feedback = L::splat(FEEDBACK_PER_S);
        let mut wanted = away;
        for row in 0..MOTION {
            let ahead = if row < 3 { velocity[row] } else { L::splat(0.0) };
            wanted[row] = feedback.mul_add(away[row], ahead);
        }
        let mut qd = [L::splat(0.0); MAX_JOINTS];
        if self.has_freedom {
            for joint in 0..joints {
                qd[joint] = L::splat(POSTURE_PER_S) * (self.start[joint] - self.q[joint]);
            }
            let given = self.scratch.jacobian.times(joints, &qd);
            for row in 0..MOTION {
                wanted[row] = wanted[row] - given[row];
            }
        }
        let factors = Factors::of(self.scratch.gram(joints), self.turning, LEAST_PIVOT);
        factors.solve(&mut wanted);
        self.scratch.jacobian.add_force(joints, &wanted, &mut qd);
        (qd, factors.singular)
    }

    /// [`HandPath::hand_at`](crate::HandPath::hand_at), with the position from the first joint.
    #[inline(always)]
    fn hand_at(&self, t: L) -> (Vector<L>, Vector<L>) {
        let [w, slow] = self.frequencies;
        let (sin, cos) = (w * t).sin_cos();
        let (slow_sin, slow_cos) = (slow * t).sin_cos();
        let [least, half] = self.radii;
        let radius = half.mul_add(L::splat(1.0) + slow_cos, least);
        let growing = -(half * slow * slow_sin);
        let speed = radius * w;
        let (x, y) = (radius * cos, radius * sin);
        let (xd, yd) = (speed.neg_mul_add(sin, growing * cos), speed.mul_add(cos, growing * sin));
        let (mut position, mut velocity) = (self.center, self.center);
        for axis in 0..3 {
            let (e1, e2) = (self.e1[axis], self.e2[axis]);
            position[axis] = y.mul_add(e2, x.mul_add(e1, position[axis]));
            velocity[axis] = yd.mul_add(e2, xd * e1);
        }
        (position, velocity)
    }
}
