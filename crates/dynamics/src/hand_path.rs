//! Paths of the hand, and the joint motions that follow from them.
//!
//! The joints' motion is integrated when a path is drawn, see [`crate::inverse_kinematics`]. Between
//! the steps of the integration they follow the polynomial of degree 5 with the same positions,
//! velocities and accelerations.

use std::f64::consts::TAU;
use std::fmt;

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use spec::{HandPaths, MAX_JOINTS, PathShape, Range};

use crate::Joints;
use crate::draws::Draws;
use crate::kinematics::{Kinematics, Row};
use crate::planner::polynomials;
use crate::reference::{ReferenceState, sin_cos, whole};
use crate::room::Limits;

/// A path of the hand: p = center + ρ (cos 2πft e₁ + sin 2πft e₂). A line lacks the second part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HandPath {
    /// Its shape.
    pub shape: PathShape,
    /// f, Hz.
    pub frequency_hz: f64,
    /// ρ at the start, m.
    pub radius_m: f64,
    /// m, in the world.
    pub center_m: [f64; 3],
    /// e₁ and e₂, orthogonal and of length 1, in the world.
    pub axes: [[f64; 3]; 2],
    /// Whether the hand keeps its orientation at the start.
    pub keeps_orientation: bool,
    /// The posture at the start, rad.
    pub start_rad: Joints<f64>,
    /// The joints' motion at each step.
    #[serde(skip)]
    states: Vec<ReferenceState>,
    /// Duration of a step, s.
    #[serde(skip)]
    step_s: f64,
    /// The reason why the joints cannot follow, if they cannot.
    #[serde(skip)]
    lost: Option<LostPath>,
}

/// The reason why joints cannot follow a path of the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LostPath {
    /// The reason why the motion ends early.
    pub end: PathEnd,
    /// The time since the start of the motion, s.
    pub time_s: f64,
}

/// The end of a path that joints cannot follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// The posture is singular: there is a direction in which the hand cannot move.
    Singular,
    /// This joint, from 1, reaches its limit.
    Limit(usize),
    /// This joint, from 1, would be too fast.
    Speed(usize),
}

impl fmt::Display for PathEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Singular => f.write_str("the posture was singular"),
            Self::Limit(joint) => write!(f, "joint {joint} came too close to its limit"),
            Self::Speed(joint) => write!(f, "joint {joint} was faster than its share of the limit"),
        }
    }
}

/// Steps of the integration per second at least, and per turn of a path.
const STEPS_PER_SECOND: f64 = 20.0;
const STEPS_PER_TURN: f64 = 40.0;
/// Turns of a spiral until its radius is that of the start again.
pub(crate) const SPIRAL_TURNS: f64 = 5.0;
/// The smallest radius of a spiral, as a share of the largest.
pub(crate) const SPIRAL_LEAST: f64 = 0.2;

impl HandPath {
    /// The reference at time `t` from the start of the motion, s.
    #[inline(always)]
    pub(crate) fn at(&self, t: f64) -> ReferenceState {
        let h = self.step_s;
        let step = whole(t / h).min(self.states.len() - 2);
        let s = t / h - step as f64;
        let [c0, c1, c2, c3, c4, c5] = polynomials(h, &self.states[step], &self.states[step + 1]);
        let (mut r, mut rd, mut rdd) = (c0, c0, c0);
        for j in 0..MAX_JOINTS {
            r[j] = c0[j] + s * (c1[j] + s * (c2[j] + s * (c3[j] + s * (c4[j] + s * c5[j]))));
            let slope = 2.0 * c2[j] + s * (3.0 * c3[j] + s * (4.0 * c4[j] + s * 5.0 * c5[j]));
            rd[j] = (c1[j] + s * slope) / h;
            let curvature = 6.0 * c3[j] + s * (12.0 * c4[j] + s * 20.0 * c5[j]);
            rdd[j] = (2.0 * c2[j] + s * curvature) / (h * h);
        }
        ReferenceState::from_padded(self.start_rad.len(), r, rd, rdd)
    }

    /// The reason why the joints cannot follow, if they cannot.
    pub fn lost(&self) -> Option<LostPath> {
        self.lost
    }

    /// Position and velocity of the hand at time `t`, m and m/s.
    pub fn hand_at(&self, t: f64) -> ([f64; 3], [f64; 3]) {
        let w = TAU * self.frequency_hz;
        let (sin, cos) = sin_cos(w * t);
        let (mut radius, mut growing) = (self.radius_m, 0.0);
        if self.shape == PathShape::Spiral {
            let slow = w / SPIRAL_TURNS;
            let (sin, cos) = sin_cos(slow * t);
            let half = 0.5 * (1.0 - SPIRAL_LEAST) * self.radius_m;
            radius = SPIRAL_LEAST * self.radius_m + half * (1.0 + cos);
            growing = -half * slow * sin;
        }
        let along = [radius * cos, growing * cos - radius * w * sin];
        let across = match self.shape {
            PathShape::Line => [0.0, 0.0],
            PathShape::Circle | PathShape::Spiral => {
                [radius * sin, growing * sin + radius * w * cos]
            }
        };
        let [e1, e2] = self.axes;
        let sum = |order: usize, axis: usize| along[order] * e1[axis] + across[order] * e2[axis];
        let position = std::array::from_fn(|axis| self.center_m[axis] + sum(0, axis));
        (position, std::array::from_fn(|axis| sum(1, axis)))
    }

    /// Duration of a step of the integration, s.
    pub(crate) fn step_s(&self) -> f64 {
        self.step_s
    }

    fn finish(&mut self) {
        if self.states.len() < 2 {
            // A path that is lost at once is never followed.
            let zero = Joints::splat(self.start_rad.len(), 0.0);
            self.states = vec![ReferenceState { r: self.start_rad, rd: zero, rdd: zero }; 2];
        }
        self.set_accelerations();
    }

    /// Accelerations from positions and velocities of neighbouring steps: of order 4, and of order
    /// 2 at both ends.
    fn set_accelerations(&mut self) {
        let h = self.step_s;
        let last = self.states.len() - 1;
        let known: Vec<_> = self.states.iter().map(|state| (state.r, state.rd)).collect();
        for (step, state) in self.states.iter_mut().enumerate() {
            for joint in 0..state.r.len() {
                let r = |step: usize| known[step].0[joint];
                let rd = |step: usize| known[step].1[joint];
                state.rdd[joint] = if step == 0 {
                    6.0 * (r(1) - r(0)) / (h * h) - (4.0 * rd(0) + 2.0 * rd(1)) / h
                } else if step == last {
                    (2.0 * rd(last - 1) + 4.0 * rd(last)) / h
                        - 6.0 * (r(last) - r(last - 1)) / (h * h)
                } else {
                    2.0 * (r(step + 1) - 2.0 * r(step) + r(step - 1)) / (h * h)
                        - (rd(step + 1) - rd(step - 1)) / (2.0 * h)
                };
            }
        }
    }
}

/// The hand of an arm in a posture, in the world.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    position: Vector3<f64>,
    rotation: Matrix3<f64>,
    /// Axes of the last link.
    pub(crate) link: Matrix3<f64>,
    /// The origin of the first joint.
    pub(crate) first_joint: Vector3<f64>,
}

impl Place {
    fn of(arm: &Kinematics, q: &Joints<f64>) -> Self {
        let rotation = Matrix3::from_fn(|row, column| arm.base.rotation[row][column]);
        let position = arm.base.position_m.into();
        let mut place = Self { position, rotation, link: rotation, first_joint: position };
        for (joint, row) in arm.joints.iter().enumerate() {
            place.enter(row, q[joint]);
            if joint == 0 {
                place.first_joint = place.position;
            }
        }
        place.link = place.rotation;
        place.enter(&arm.hand, 0.0);
        place
    }

    fn enter(&mut self, row: &Row, q: f64) {
        self.position += self.rotation * Vector3::from(row.origin());
        self.rotation *= row.turn_by(sin_cos(q)).matrix();
    }
}

/// A path that is being drawn: at other places and with half the radius as long as joints cannot
/// follow it. If they never can, the path says so.
pub(crate) struct Attempt<'a> {
    pub(crate) path: HandPath,
    /// The hand at the start.
    pub(crate) place: Place,
    spec: &'a HandPaths,
    limits: &'a Joints<Limits>,
    draws: Draws,
    places: u32,
    halvings: u32,
    /// Steps until the path ends.
    steps: usize,
}

impl<'a> Attempt<'a> {
    pub(crate) fn new(
        arm: &Kinematics,
        limits: &'a Joints<Limits>,
        spec: &'a HandPaths,
        frequency_hz: f64,
        duration_s: f64,
        mut draws: Draws,
    ) -> Self {
        let joints = limits.len();
        let shape = spec.shapes[whole(draws.unit() * spec.shapes.len() as f64)];
        let step_s = 1.0 / STEPS_PER_SECOND.max(STEPS_PER_TURN * frequency_hz);
        let steps = whole(duration_s / step_s) + 2;
        let start_rad = Joints::splat(joints, 0.0);
        let path = HandPath {
            shape,
            frequency_hz,
            radius_m: 0.0,
            center_m: [0.0; 3],
            axes: [[0.0; 3]; 2],
            keeps_orientation: spec.keeps_orientation(joints),
            start_rad,
            states: Vec::with_capacity(steps),
            step_s,
            lost: None,
        };
        let place = Place::of(arm, &start_rad);
        let mut attempt = Self { path, place, spec, limits, draws, places: 0, halvings: 0, steps };
        attempt.draw_place(arm);
        attempt
    }

    pub(crate) fn joints(&self) -> usize {
        self.path.start_rad.len()
    }

    /// Draws a start, directions and a radius.
    fn draw_place(&mut self, arm: &Kinematics) {
        let Self { path, draws, spec, limits, .. } = self;
        path.start_rad =
            limits.iter().map(|limits| draws.uniform(limits.within(spec.reach))).collect();
        path.axes = draw_axes(draws);
        path.radius_m = draws.uniform(spec.radius_m);
        self.place = Place::of(arm, &path.start_rad);
        self.places += 1;
        self.halvings = 0;
        self.put_center();
    }

    fn put_center(&mut self) {
        let Self { path, place, .. } = self;
        let e1 = path.axes[0];
        path.center_m = std::array::from_fn(|axis| place.position[axis] - path.radius_m * e1[axis]);
    }

    /// Makes the path another one after it ended early. Returns whether it is to be followed.
    pub(crate) fn retry(&mut self, arm: &Kinematics, end: PathEnd) -> bool {
        const PLACES: u32 = 4;
        const HALVINGS: u32 = 4;

        let path = &mut self.path;
        let time_s = path.states.len() as f64 * path.step_s;
        path.radius_m *= 0.5;
        if self.halvings == HALVINGS && self.places == PLACES {
            path.lost = Some(LostPath { end, time_s });
            path.finish();
            return false;
        }
        path.states.clear();
        if self.halvings == HALVINGS {
            self.draw_place(arm);
        } else {
            self.halvings += 1;
            self.put_center();
        }
        true
    }

    /// Adds a state to the path. Returns whether it was the last one.
    pub(crate) fn arrive(&mut self, state: ReferenceState) -> bool {
        self.path.states.push(state);
        let is_last = self.path.states.len() == self.steps;
        if is_last {
            self.path.finish();
        }
        is_last
    }
}

/// Two orthogonal directions, both uniform over all.
fn draw_axes(draws: &mut Draws) -> [[f64; 3]; 2] {
    let angle = Range::new(0.0, TAU);
    let height = draws.uniform(Range::new(-1.0, 1.0));
    let (sin, cos) = sin_cos(draws.uniform(angle));
    let flat = (1.0 - height * height).max(0.0).sqrt();
    let first = Vector3::new(flat * cos, flat * sin, height);
    // Any direction across the first one, and then a turn about it.
    let other = if height.abs() < 0.5 { Vector3::z() } else { Vector3::x() };
    let across = first.cross(&other);
    let across = across / across.norm();
    let (sin, cos) = sin_cos(draws.uniform(angle));
    let second = across * cos + first.cross(&across) * sin;
    [first.into(), second.into()]
}

#[cfg(test)]
mod tests {
    use simd::InstructionSet;
    use spec::{Frequency, RobotSpec};

    use super::*;
    use crate::Robot;
    use crate::draws::Purpose;
    use crate::inverse_kinematics::Following;

    fn arm() -> (Robot, Joints<Limits>) {
        let spec = RobotSpec::default();
        let description = spec.description();
        let centers = &description.initial_state.center_rad;
        let limits = description.joints.iter().zip(centers).map(|(joint, &center)| Limits {
            least: joint.position_rad.min,
            center,
            most: joint.position_rad.max,
            speed: joint.velocity_rad_s,
        });
        (Robot::nominal(&spec), limits.collect())
    }

    fn path(seed: u64, shape: PathShape, keeps_orientation: bool) -> HandPath {
        let spec = HandPaths {
            frequency_hz: Frequency::Fixed(0.4),
            shapes: vec![shape],
            radius_m: Range::new(0.05, 0.1),
            reach: 0.2,
            speed: 0.6,
            orientation: Some(keeps_orientation),
        };
        drawn(&spec, 0.4, 15.0, seed)
    }

    fn drawn(spec: &HandPaths, frequency_hz: f64, duration_s: f64, seed: u64) -> HandPath {
        let mut paths =
            drawn_together(InstructionSet::best(), spec, frequency_hz, duration_s, [seed]);
        paths.remove(0)
    }

    fn drawn_together(
        instructions: InstructionSet,
        spec: &HandPaths,
        frequency_hz: f64,
        duration_s: f64,
        seeds: impl IntoIterator<Item = u64>,
    ) -> Vec<HandPath> {
        let (arm, limits) = arm();
        let attempt = |seed: u64| {
            let draws = Draws::new(seed, 0, Purpose::Reference, 1);
            Attempt::new(&arm.kinematics, &limits, spec, frequency_hz, duration_s, draws)
        };
        let mut attempts: Vec<_> = seeds.into_iter().map(attempt).collect();
        let keeps_orientation = spec.keeps_orientation(limits.len());
        let following =
            Following { arm: &arm, limits: &limits, speed: spec.speed, keeps_orientation };
        following.follow(instructions, &mut attempts);
        attempts.into_iter().map(|attempt| attempt.path).collect()
    }

    #[test]
    fn instructions_and_neighbours_change_no_path() {
        for orientation in [true, false] {
            // Some of these paths are halved or moved, and some are lost.
            let spec = HandPaths {
                frequency_hz: Frequency::Fixed(0.5),
                shapes: PathShape::ALL.to_vec(),
                radius_m: Range::new(0.05, 2.0),
                reach: 0.4,
                speed: 0.1,
                orientation: Some(orientation),
            };
            let alone: Vec<_> = (0..37).map(|seed| drawn(&spec, 0.5, 5.0, seed)).collect();
            let lost = alone.iter().filter(|path| path.lost.is_some()).count();
            assert!((1..37).contains(&lost), "{lost} of 37 paths are lost");
            for instructions in InstructionSet::available() {
                assert_eq!(drawn_together(instructions, &spec, 0.5, 5.0, 0..37), alone);
                assert_eq!(drawn_together(instructions, &spec, 0.5, 5.0, 5..24), alone[5..24]);
            }
        }
    }

    #[test]
    fn the_hand_stays_on_its_path_and_keeps_its_orientation() {
        for shape in PathShape::ALL {
            for seed in 0..20 {
                let path = path(seed, shape, true);
                assert_eq!(path.lost(), None, "{shape:?}, seed {seed}");
                let arm = arm().0.kinematics;
                let start = Place::of(&arm, &path.start_rad);
                for instant in 0..1500 {
                    let t = f64::from(instant) * 0.01;
                    let state = path.at(t);
                    let hand = Place::of(&arm, &state.r);
                    let off = (hand.position - Vector3::from(path.hand_at(t).0)).norm();
                    assert!(off < 5e-5, "{shape:?}, seed {seed}: {off} m off at {t} s");
                    let turned = (hand.rotation - start.rotation).norm();
                    assert!(turned < 2e-4, "{shape:?}, seed {seed}: turned by {turned} at {t} s");
                }
            }
        }
    }

    #[test]
    fn velocities_and_accelerations_are_derivatives() {
        const STEP: f64 = 1e-4;
        for (seed, shape) in (0..).zip(PathShape::ALL) {
            let path = path(seed, shape, false);
            for instant in 1..1400 {
                let t = f64::from(instant) * 0.0101;
                let [before, now, after] = [-STEP, 0.0, STEP].map(|step| path.at(t + step));
                for joint in 0..7 {
                    let slope = (after.r[joint] - before.r[joint]) / (2.0 * STEP);
                    assert!((slope - now.rd[joint]).abs() < 1e-5, "{slope} {:?}", now.rd);
                    let slope = (after.rd[joint] - before.rd[joint]) / (2.0 * STEP);
                    assert!((slope - now.rdd[joint]).abs() < 1e-3, "{slope} {:?}", now.rdd);
                }
                let hand = path.hand_at(t);
                let later = path.hand_at(t + STEP).0;
                for axis in 0..3 {
                    let slope = (later[axis] - hand.0[axis]) / STEP;
                    assert!((slope - hand.1[axis]).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn a_path_that_no_joint_can_follow_says_why() {
        let spec = HandPaths {
            frequency_hz: Frequency::Fixed(0.5),
            shapes: vec![PathShape::Circle],
            radius_m: Range::new(2.0, 3.0),
            reach: 0.1,
            speed: 0.02,
            orientation: None,
        };
        let path = drawn(&spec, 0.5, 5.0, 1);
        let lost = path.lost().expect("a circle of 25 cm at 2 % of the speeds");
        assert!(matches!(lost.end, PathEnd::Speed(_)), "{lost:?}");
        assert!(lost.end.to_string().contains("faster than"), "{}", lost.end);
    }
}
