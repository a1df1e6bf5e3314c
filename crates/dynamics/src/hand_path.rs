//! Paths of the hand, and the joint motions that follow from them.
//!
//! The joints follow by differential inverse kinematics of the nominal arm, q̇ = J⁺ (ẋ + K e) +
//! (1 − J⁺ J) (q_start − q) k, which is integrated when a path is drawn. Between the steps of the
//! integration they follow the polynomial of degree 5 with the same positions, velocities and
//! accelerations.

use std::f64::consts::TAU;
use std::fmt;

use nalgebra::{Matrix3, Matrix6, OMatrix, U6, U8, Vector3, Vector6};
use serde::Serialize;
use spec::{HandPaths, MAX_JOINTS, PathShape, Range};

use crate::Joints;
use crate::draws::Draws;
use crate::kinematics::{Kinematics, Row};
use crate::planner::polynomials;
use crate::reference::{ReferenceState, sin_cos, whole};
use crate::room::Room;

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
/// K, 1/s.
const FEEDBACK_PER_S: f64 = 10.0;
/// k, 1/s.
const POSTURE_PER_S: f64 = 1.0;
/// Turns of a spiral until its radius is that of the start again.
const SPIRAL_TURNS: f64 = 5.0;
/// The smallest radius of a spiral, as a share of the largest.
const SPIRAL_LEAST: f64 = 0.2;
/// A pivot of J Jᵀ below this share of the entry that it comes from makes a posture singular.
const LEAST_PIVOT: f64 = 1e-6;

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

    /// Lets the joints follow the path for `duration_s`, as far as they can.
    fn follow(&mut self, arm: &Kinematics, room: &Room, speed: f64, duration_s: f64) {
        self.step_s = 1.0 / STEPS_PER_SECOND.max(STEPS_PER_TURN * self.frequency_hz);
        let orientation = Place::of(arm, &self.start_rad).rotation;
        let steps = whole(duration_s / self.step_s) + 2;
        let joints = self.start_rad.len();
        let zero = Joints::splat(joints, 0.0);
        self.states = Vec::with_capacity(steps);
        self.lost = None;
        let mut q = self.start_rad;
        for step in 0..steps {
            let h = self.step_s;
            let t = step as f64 * h;
            let moved = |by: f64, qd: &Joints<f64>| Joints::from_fn(joints, |j| q[j] + by * qd[j]);
            let slope = |q: &Joints<f64>, t: f64| self.velocity(arm, &orientation, q, t);
            let stages = slope(&q, t).and_then(|k1| {
                let k2 = slope(&moved(0.5 * h, &k1), t + 0.5 * h)?;
                let k3 = slope(&moved(0.5 * h, &k2), t + 0.5 * h)?;
                let k4 = slope(&moved(h, &k3), t + h)?;
                Some([k1, k2, k3, k4])
            });
            let end = match &stages {
                None => Some(PathEnd::Singular),
                Some([qd, ..]) => room.limits.iter().enumerate().find_map(|(joint, limits)| {
                    if !(limits.least..=limits.most).contains(&q[joint]) {
                        Some(PathEnd::Limit(joint + 1))
                    } else if qd[joint].abs() > speed * limits.speed {
                        Some(PathEnd::Speed(joint + 1))
                    } else {
                        None
                    }
                }),
            };
            let (Some([k1, k2, k3, k4]), None) = (stages, end) else {
                self.lost = end.map(|end| LostPath { end, time_s: t });
                break;
            };
            self.states.push(ReferenceState { r: q, rd: k1, rdd: zero });
            q = Joints::from_fn(joints, |j| {
                q[j] + h / 6.0 * (k1[j] + 2.0 * (k2[j] + k3[j]) + k4[j])
            });
        }
        if self.states.len() < 2 {
            // A path that is lost at once is never followed.
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

    /// q̇ of the differential inverse kinematics; `None` in a singular posture.
    fn velocity(
        &self,
        arm: &Kinematics,
        orientation: &Matrix3<f64>,
        q: &Joints<f64>,
        t: f64,
    ) -> Option<Joints<f64>> {
        let joints = q.len();
        let dims = if self.keeps_orientation { 6 } else { 3 };
        let hand = Place::of(arm, q);
        let jacobian = hand.jacobian(joints);
        let (position, velocity) = self.hand_at(t);
        let mut turn = Vector3::zeros();
        for axis in 0..3 {
            turn += 0.5 * hand.rotation.column(axis).cross(&orientation.column(axis));
        }
        let away = Vector3::from(position) - hand.position;
        let mut wanted = Vector6::zeros();
        for axis in 0..3 {
            wanted[axis] = velocity[axis] + FEEDBACK_PER_S * away[axis];
            wanted[3 + axis] = FEEDBACK_PER_S * turn[axis];
        }
        let mut qd = Joints::splat(joints, 0.0);
        if joints > dims {
            for joint in 0..joints {
                qd[joint] = POSTURE_PER_S * (self.start_rad[joint] - q[joint]);
                for row in 0..dims {
                    wanted[row] -= jacobian[(row, joint)] * qd[joint];
                }
            }
        }
        let force = solve_gram(&jacobian, joints, dims, &wanted)?;
        for joint in 0..joints {
            for row in 0..dims {
                qd[joint] += jacobian[(row, joint)] * force[row];
            }
        }
        Some(qd)
    }
}

type Jacobian = OMatrix<f64, U6, U8>;

/// Solves J Jᵀ x = b for the first `dims` rows. `None` where it is singular.
fn solve_gram(
    jacobian: &Jacobian,
    joints: usize,
    dims: usize,
    b: &Vector6<f64>,
) -> Option<Vector6<f64>> {
    let mut lower = Matrix6::zeros();
    let mut x = *b;
    for row in 0..dims {
        for column in 0..=row {
            let mut entry = 0.0;
            for joint in 0..joints {
                entry += jacobian[(row, joint)] * jacobian[(column, joint)];
            }
            let whole = entry;
            for earlier in 0..column {
                entry -= lower[(row, earlier)] * lower[(column, earlier)];
            }
            if row > column {
                lower[(row, column)] = entry / lower[(column, column)];
            } else if entry > LEAST_PIVOT * whole {
                lower[(row, row)] = entry.sqrt();
            } else {
                return None;
            }
        }
        for earlier in 0..row {
            x[row] -= lower[(row, earlier)] * x[earlier];
        }
        x[row] /= lower[(row, row)];
    }
    for row in (0..dims).rev() {
        for later in row + 1..dims {
            x[row] -= lower[(later, row)] * x[later];
        }
        x[row] /= lower[(row, row)];
    }
    Some(x)
}

/// The hand of an arm in a posture, and what its joints turn about, in the world.
struct Place {
    position: Vector3<f64>,
    rotation: Matrix3<f64>,
    origins: [Vector3<f64>; MAX_JOINTS],
    axes: [Vector3<f64>; MAX_JOINTS],
}

impl Place {
    fn of(arm: &Kinematics, q: &Joints<f64>) -> Self {
        let base = &arm.base;
        let zero = Vector3::zeros();
        let mut place = Self {
            position: base.position_m.into(),
            rotation: Matrix3::from_fn(|row, column| base.rotation[row][column]),
            origins: [zero; MAX_JOINTS],
            axes: [zero; MAX_JOINTS],
        };
        for (joint, row) in arm.joints.iter().enumerate() {
            place.enter(row, q[joint]);
            place.origins[joint] = place.position;
            place.axes[joint] = place.rotation.column(2).into();
        }
        place.enter(&arm.hand, 0.0);
        place
    }

    fn enter(&mut self, row: &Row, q: f64) {
        self.position += self.rotation * Vector3::from(row.origin());
        self.rotation *= row.turn_by(sin_cos(q)).matrix();
    }

    fn jacobian(&self, joints: usize) -> Jacobian {
        let mut jacobian = Jacobian::zeros();
        for joint in 0..joints {
            let axis = self.axes[joint];
            let linear = axis.cross(&(self.position - self.origins[joint]));
            for row in 0..3 {
                jacobian[(row, joint)] = linear[row];
                jacobian[(3 + row, joint)] = axis[row];
            }
        }
        jacobian
    }
}

impl Room {
    /// Draws a path, at other places and with half the radius as long as joints cannot follow it. If
    /// they never can, the path says so.
    pub(crate) fn draw_hand_path(
        &self,
        arm: &Kinematics,
        spec: &HandPaths,
        frequency_hz: f64,
        duration_s: f64,
        draws: &mut Draws,
    ) -> HandPath {
        const PLACES: u32 = 4;
        const HALVINGS: u32 = 4;

        let joints = self.limits.len();
        let shape = spec.shapes[whole(draws.unit() * spec.shapes.len() as f64)];
        let mut path = HandPath {
            shape,
            frequency_hz,
            radius_m: 0.0,
            center_m: [0.0; 3],
            axes: [[0.0; 3]; 2],
            keeps_orientation: spec.keeps_orientation(joints),
            start_rad: Joints::splat(joints, 0.0),
            states: Vec::new(),
            step_s: 0.0,
            lost: None,
        };
        for _ in 0..PLACES {
            path.start_rad =
                self.limits.iter().map(|limits| draws.uniform(limits.within(spec.reach))).collect();
            path.axes = draw_axes(draws);
            path.radius_m = draws.uniform(spec.radius_m);
            let start = Place::of(arm, &path.start_rad).position;
            for _ in 0..=HALVINGS {
                let e1 = path.axes[0];
                path.center_m = std::array::from_fn(|axis| start[axis] - path.radius_m * e1[axis]);
                path.follow(arm, self, spec.speed, duration_s);
                if path.lost.is_none() {
                    return path;
                }
                path.radius_m *= 0.5;
            }
        }
        path
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
    use spec::{Frequency, RobotSpec};

    use super::*;
    use crate::Robot;
    use crate::draws::Purpose;
    use crate::room::Limits;

    fn arm() -> (Robot, Room) {
        let spec = RobotSpec::default();
        let description = spec.description();
        let centers = &description.initial_state.center_rad;
        let limits = description.joints.iter().zip(centers).map(|(joint, &center)| Limits {
            least: joint.position_rad.min,
            center,
            most: joint.position_rad.max,
            speed: joint.velocity_rad_s,
        });
        (Robot::nominal(&spec), Room { limits: limits.collect() })
    }

    fn path(seed: u64, shape: PathShape, keeps_orientation: bool) -> HandPath {
        let (robot, room) = arm();
        let spec = HandPaths {
            frequency_hz: Frequency::Fixed(0.4),
            shapes: vec![shape],
            radius_m: Range::new(0.05, 0.1),
            reach: 0.2,
            speed: 0.6,
            orientation: Some(keeps_orientation),
        };
        let mut draws = Draws::new(seed, 0, Purpose::Reference, 1);
        room.draw_hand_path(&robot.kinematics, &spec, 0.4, 15.0, &mut draws)
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
        let (robot, room) = arm();
        let spec = HandPaths {
            frequency_hz: Frequency::Fixed(0.5),
            shapes: vec![PathShape::Circle],
            radius_m: Range::new(2.0, 3.0),
            reach: 0.1,
            speed: 0.02,
            orientation: None,
        };
        let mut draws = Draws::new(1, 0, Purpose::Reference, 1);
        let path = room.draw_hand_path(&robot.kinematics, &spec, 0.5, 5.0, &mut draws);
        let lost = path.lost().expect("a circle of 25 cm at 2 % of the speeds");
        assert!(matches!(lost.end, PathEnd::Speed(_)), "{lost:?}");
        assert!(lost.end.to_string().contains("faster than"), "{}", lost.end);
    }
}
