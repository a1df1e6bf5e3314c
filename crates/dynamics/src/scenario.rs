//! The random choices of each trajectory: robot, initial state and torques.

use spec::{Cell, Family, Frequency, InitialState, Range, SimulateSpec};

use crate::draws::{Draws, Purpose};
use crate::excitation::{Torques, draw_chirps, draw_multisines, draw_steps};
use crate::randomization::draw_robot;
use crate::robot::Nominal;
use crate::structure::Kind;
use crate::{Joints, Robot};

/// The random choices of one trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Index of the trajectory in its dataset.
    pub index: u64,
    /// Number of draws: 1 when the first was accepted.
    pub draws: u32,
    /// The drawn robot.
    pub robot: Robot,
    /// The family of the excitation.
    pub family: Family,
    /// The master frequency.
    pub frequency_hz: f64,
    /// Positions at t = 0, rad.
    pub q0: Joints<f64>,
    /// Velocities at t = 0, rad/s.
    pub qd0: Joints<f64>,
    /// The torque law of each joint.
    pub torques: Torques,
}

/// The scenarios of a spec, by index.
pub struct Scenarios<'a> {
    spec: &'a SimulateSpec,
    cells: Vec<Cell>,
    parts: Nominal,
    nominal: Robot,
}

impl<'a> Scenarios<'a> {
    /// The scenarios of a checked spec.
    pub fn new(spec: &'a SimulateSpec) -> Self {
        let parts = Nominal::of(spec.robot.description());
        Self { spec, cells: spec.cells(), parts, nominal: Robot::nominal(&spec.robot) }
    }

    /// The nominal arm around which all robots are drawn.
    pub(crate) fn nominal(&self) -> &Robot {
        &self.nominal
    }

    /// The kernels for all robots. Lengths that are zero in the nominal arm are zero in all.
    pub(crate) fn kind(&self) -> Kind {
        Kind::of([&self.nominal])
    }

    /// The spec that scenarios are drawn by.
    pub fn spec(&self) -> &'a SimulateSpec {
        self.spec
    }

    /// The scenario of trajectory `index` at its `draw`th draw, 1 for the first.
    ///
    /// Excitation family and master frequency belong to the trajectory and are the same at every
    /// draw, so that rejection cannot shift their shares. Robot, initial state and torques are
    /// drawn again.
    ///
    /// Indices beyond the spec's `trajectories` are allowed and continue the dataset. With a
    /// frequency grid they belong to the last cell.
    pub fn draw(&self, index: u64, draw: u32) -> Scenario {
        let draws = |purpose, draw| Draws::new(self.spec.seed, index, purpose, draw);
        let (excitation, frequency_hz) = self.design(index, &mut draws(Purpose::Design, 0));
        let robot = draw_robot(&self.spec.robot, &self.parts, |purpose| draws(purpose, draw));
        let joint1 = self.spec.robot.description().joints[0].position_rad;
        let (q0, qd0) = draw_initial_state(
            &self.spec.initial_state,
            joint1,
            &mut draws(Purpose::InitialState, draw),
        );
        let joints = self.spec.joints();
        let draws = |purpose| draws(purpose, draw);
        let torques = match excitation {
            Law::Chirp(chirp) => {
                draw_chirps(chirp, joints, frequency_hz, &mut draws(Purpose::Excitation))
            }
            Law::Multisine(multisine) => {
                draw_multisines(multisine, frequency_hz, &mut draws(Purpose::Excitation))
            }
            Law::Steps(steps) => {
                draw_steps(steps, joints, frequency_hz, &mut draws(Purpose::Steps))
            }
        };
        let family = torques.family();
        Scenario { index, draws: draw, robot, family, frequency_hz, q0, qd0, torques }
    }

    /// The excitation law and the master frequency of a trajectory.
    fn design(&self, index: u64, draws: &mut Draws) -> (Law<'a>, f64) {
        let excitation = &self.spec.excitation;
        let drawn = draws.unit() < excitation.chirp_fraction;
        let cell = self.cells.iter().rfind(|cell| cell.first <= index);
        let chirp = excitation.chirp.as_ref().map(|chirp| (Law::Chirp(chirp), &chirp.frequency_hz));
        let multisine = || {
            excitation
                .multisine
                .as_ref()
                .map(|multisine| (Law::Multisine(multisine), &multisine.frequency_hz))
        };
        let steps =
            || excitation.steps.as_ref().map(|steps| (Law::Steps(steps), &steps.frequency_hz));
        let law = match cell.map(|cell| cell.family) {
            Some(Family::Chirp) => chirp,
            Some(Family::Multisine) => multisine(),
            Some(Family::Steps) => steps(),
            None if drawn => chirp.or_else(multisine).or_else(steps),
            None => multisine().or(chirp).or_else(steps),
        };
        let Some((law, frequency)) = law else {
            unreachable!("a checked spec has at least one excitation family")
        };
        let frequency_hz = match frequency {
            Frequency::Fixed(frequency_hz) => *frequency_hz,
            Frequency::Uniform(range) => draws.uniform(*range),
            Frequency::Grid(grid) => cell.map_or(grid[0], |cell| cell.frequency_hz),
        };
        (law, frequency_hz)
    }
}

enum Law<'a> {
    Chirp(&'a spec::Chirp),
    Multisine(&'a spec::Multisine),
    Steps(&'a spec::Steps),
}

/// Draws positions (rad) and velocities (rad/s) at t = 0 by the law of [`InitialState`]. `joint1`
/// has the limits of the first joint.
pub(crate) fn draw_initial_state(
    spec: &InitialState,
    joint1: Range,
    draws: &mut Draws,
) -> (Joints<f64>, Joints<f64>) {
    const UNIT: Range = Range::new(0.0, 1.0);

    let joints = spec.center_rad.len();
    let mut q = Joints::splat(joints, 0.0);
    q[0] = draws.uniform(spec.joint1_scale) * draws.sign() * draws.uniform(joint1);
    let sign = draws.sign();
    for (q, center) in q.iter_mut().zip(&spec.center_rad).skip(1) {
        *q = center + sign * spec.spread_rad * draws.uniform(UNIT);
    }

    let mut qd = Joints::splat(joints, 0.0);
    let scale = draws.uniform(spec.velocity_scale);
    qd[0] = scale * draws.sign() * spec.joint1_velocity_rad_s * draws.uniform(UNIT);
    let sign = draws.sign();
    for qd in qd.iter_mut().skip(1) {
        *qd = scale * sign * spec.velocity_rad_s * draws.uniform(UNIT);
    }
    (q, qd)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draws::Purpose;

    #[test]
    fn joints_2_to_7_leave_their_centers_to_the_same_side() {
        const LIMITS: Range = Range::new(-2.8973, 2.8973);
        let spec = InitialState::default();
        for trajectory in 0..200 {
            let (q, qd) = draw_initial_state(
                &spec,
                LIMITS,
                &mut Draws::new(0, trajectory, Purpose::InitialState, 1),
            );
            let sides: Vec<f64> =
                (1..7).map(|joint| (q[joint] - spec.center_rad[joint]).signum()).collect();
            assert!(sides.iter().all(|side| *side == sides[0]));
            assert!(
                (1..7).all(|joint| (q[joint] - spec.center_rad[joint]).abs() <= spec.spread_rad)
            );
            assert!(q[0].abs() <= 0.8 * 2.8973);
            assert!(qd[0].abs() <= 0.8 * 0.5);
            assert!(qd[1..].iter().all(|other| other.abs() <= 0.8 * 2.0));
            assert!(qd[1..].iter().all(|other| other.signum() == qd[1].signum()));
        }
    }
}
