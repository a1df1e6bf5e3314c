//! The random choices of each trajectory: robot, initial state, and torques or reference.

use simd::InstructionSet;
use spec::{Cell, Family, Frequency, InitialState, Range, SimulateSpec};

use crate::draws::{Draws, Purpose};
use crate::excitation::{Torques, draw_chirps, draw_multisines, draw_pulses, draw_steps};
use crate::gains::Known;
use crate::hand_path::{Attempt, HandPath};
use crate::inverse_kinematics::Following;
use crate::randomization::draw_robot;
use crate::reference::{Reference, ReferenceState, whole};
use crate::robot::Nominal;
use crate::room::{Limits, Room};
use crate::structure::Kind;
use crate::tracking::Tracking;
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
    /// Its torques, or its controller.
    pub excitation: Excitation,
}

/// The cause of a robot's motion: torques, or a controller.
#[expect(clippy::large_enum_variant, reason = "all scenarios of a simulation have the same one")]
#[derive(Clone, Debug, PartialEq)]
pub enum Excitation {
    /// The torque law of each joint, open loop.
    OpenLoop(Torques),
    /// A controller that follows a reference.
    ClosedLoop(Box<Tracking>),
}

impl Excitation {
    /// The torque laws of an arm without a controller.
    pub fn torques(&self) -> Option<&Torques> {
        match self {
            Self::OpenLoop(torques) => Some(torques),
            Self::ClosedLoop(_) => None,
        }
    }

    /// The reference and the gains of an arm with a controller.
    pub fn tracking(&self) -> Option<&Tracking> {
        match self {
            Self::OpenLoop(_) => None,
            Self::ClosedLoop(tracking) => Some(tracking),
        }
    }
}

/// The scenarios of a spec, by index.
pub struct Scenarios<'a> {
    spec: &'a SimulateSpec,
    cells: Vec<Cell>,
    parts: Nominal,
    nominal: Robot,
    /// For controllers.
    known: Option<Known>,
}

impl<'a> Scenarios<'a> {
    /// The scenarios of a checked spec.
    pub fn new(spec: &'a SimulateSpec) -> Self {
        let parts = Nominal::of(spec.robot.description());
        let known = spec.controller.as_ref().map(|controller| Known::new(spec, controller));
        Self { spec, cells: spec.cells(), parts, nominal: Robot::nominal(&spec.robot), known }
    }

    /// The nominal arm around which all robots are drawn.
    pub(crate) fn nominal(&self) -> &Robot {
        &self.nominal
    }

    /// The nominal arm that controllers know.
    pub(crate) fn known(&self) -> Option<&Known> {
        self.known.as_ref()
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
        let path = self.draw_hand_paths(index..index + 1, draw).pop();
        self.draw_with_path(index, draw, path)
    }

    /// The scenarios of consecutive trajectories at their first draw. It takes less time to draw
    /// paths of the hand together.
    pub(crate) fn draw_all(&self, indices: std::ops::Range<u64>) -> Vec<Scenario> {
        let mut paths = self.draw_hand_paths(indices.clone(), 1).into_iter();
        indices
            .map(|index| {
                let path = self.follows_hand_path(index).then(|| paths.next()).flatten();
                self.draw_with_path(index, 1, path)
            })
            .collect()
    }

    /// The paths of the hand of those trajectories that follow one, one after another.
    fn draw_hand_paths(&self, indices: std::ops::Range<u64>, draw: u32) -> Vec<HandPath> {
        let (Some(paths), Some(known)) = (&self.spec.excitation.hand_paths, &self.known) else {
            return Vec::new();
        };
        let (arm, limits) = (&known.arm, &self.limits());
        let mut attempts = Vec::new();
        for index in indices {
            let draws = |purpose, draw| Draws::new(self.spec.seed, index, purpose, draw);
            let (Law::HandPaths, frequency_hz) = self.design(index, &mut draws(Purpose::Design, 0))
            else {
                continue;
            };
            let draws = draws(Purpose::Reference, draw);
            let duration_s = self.duration_s();
            let kinematics = &arm.kinematics;
            let attempt = Attempt::new(kinematics, limits, paths, frequency_hz, duration_s, draws);
            attempts.push(attempt);
        }
        let keeps_orientation = paths.keeps_orientation(limits.len());
        Following { arm, limits, speed: paths.speed, keeps_orientation }
            .follow(InstructionSet::best(), &mut attempts);
        attempts.into_iter().map(|attempt| attempt.path).collect()
    }

    fn follows_hand_path(&self, index: u64) -> bool {
        let mut draws = Draws::new(self.spec.seed, index, Purpose::Design, 0);
        self.spec.excitation.hand_paths.is_some()
            && matches!(self.design(index, &mut draws), (Law::HandPaths, _))
    }

    fn draw_with_path(&self, index: u64, draw: u32, path: Option<HandPath>) -> Scenario {
        let draws = |purpose, draw| Draws::new(self.spec.seed, index, purpose, draw);
        let (law, frequency_hz) = self.design(index, &mut draws(Purpose::Design, 0));
        let robot = draw_robot(&self.spec.robot, &self.parts, |purpose| draws(purpose, draw));
        let draws = |purpose| draws(purpose, draw);
        let excitation = self.draw_excitation(&law, frequency_hz, path, draws);
        let (family, (q0, qd0)) = match &excitation {
            Excitation::OpenLoop(torques) => {
                let joint1 = self.spec.robot.description().joints[0].position_rad;
                let mut draws = draws(Purpose::InitialState);
                let start = draw_initial_state(&self.spec.initial_state, joint1, &mut draws);
                (torques.family(), start)
            }
            Excitation::ClosedLoop(tracking) => {
                let start = tracking.reference.at(0.0);
                (tracking.reference.family(), (start.r, start.rd))
            }
        };
        Scenario { index, draws: draw, robot, family, frequency_hz, q0, qd0, excitation }
    }

    fn draw_excitation(
        &self,
        law: &Law<'_>,
        frequency_hz: f64,
        path: Option<HandPath>,
        draws: impl Fn(Purpose) -> Draws,
    ) -> Excitation {
        let joints = self.spec.joints();
        let torques = |torques| Excitation::OpenLoop(torques);
        let reference = |reference| {
            let (Some(controller), Some(known)) = (&self.spec.controller, &self.known) else {
                unreachable!("a checked spec with references has a controller")
            };
            let gains = known.draw_gains(controller, &mut draws(Purpose::Controller));
            Excitation::ClosedLoop(Box::new(Tracking { reference, gains, added_nm: Vec::new() }))
        };
        match law {
            Law::Chirp(chirp) => {
                torques(draw_chirps(chirp, joints, frequency_hz, &mut draws(Purpose::Excitation)))
            }
            Law::Multisine(multisine) => {
                torques(draw_multisines(multisine, frequency_hz, &mut draws(Purpose::Excitation)))
            }
            Law::Steps(steps) => {
                torques(draw_steps(steps, joints, frequency_hz, &mut draws(Purpose::Steps)))
            }
            Law::Pulses(pulses) => {
                torques(draw_pulses(pulses, joints, frequency_hz, &mut draws(Purpose::Pulses)))
            }
            Law::Fourier(series) => reference(self.room().draw_fourier(
                series,
                frequency_hz,
                &mut draws(Purpose::Reference),
            )),
            Law::PointToPoint(moves) => reference(self.room().draw_moves(
                moves,
                frequency_hz,
                self.duration_s(),
                &mut draws(Purpose::Reference),
            )),
            Law::ViaPoints(spline) => reference(self.room().draw_spline(
                spline,
                frequency_hz,
                self.duration_s(),
                &mut draws(Purpose::Reference),
            )),
            Law::HandPaths => {
                let Some(path) = path else { unreachable!("the path of the hand is drawn first") };
                reference(Reference::HandPath(Box::new(path)))
            }
        }
    }

    /// The references of a scenario at the control periods from recorded sample `first` on, as many as
    /// the recording has. `None` without a controller.
    pub fn references(&self, scenario: &Scenario, first: u32) -> Option<Vec<ReferenceState>> {
        let reference = &scenario.excitation.tracking()?.reference;
        let (controller, rate_hz) = (self.spec.controller.as_ref()?, self.spec.rate_hz);
        let periods = controller.periods(rate_hz);
        let before = controller.settling_samples(rate_hz) * periods;
        let recorded = first as usize * periods..self.spec.samples as usize * periods;
        let at = |period: usize| reference.at((before + period) as f64 / controller.rate_hz);
        Some(recorded.map(at).collect())
    }

    /// The torques, N·m, that the controller of this simulation gives to an arm that is on its
    /// reference, without its integral. `None` without a controller.
    pub fn torques_on_reference(&self, state: &ReferenceState) -> Option<Joints<f64>> {
        let controller = self.spec.controller.as_ref()?;
        Some(self.known.as_ref()?.on_reference(&controller.law, state))
    }

    /// The limits that references keep.
    fn room(&self) -> Room {
        Room { limits: self.limits() }
    }

    fn limits(&self) -> Joints<Limits> {
        let joints = &self.spec.robot.description().joints;
        let margin = self.spec.rejection.position_margin_rad.unwrap_or_default();
        let limits = joints.iter().zip(&self.spec.initial_state.center_rad);
        let limits = limits.map(|(joint, &center)| Limits {
            least: (joint.position_rad.min + margin).min(center),
            center,
            most: (joint.position_rad.max - margin).max(center),
            speed: joint.velocity_rad_s,
        });
        limits.collect()
    }

    /// The time from the start of a motion to the sample after the last one, s.
    fn duration_s(&self) -> f64 {
        let settling =
            |controller: &spec::Controller| controller.settling_samples(self.spec.rate_hz);
        let settling = self.spec.controller.as_deref().map_or(0, settling);
        (self.spec.samples as usize + settling + 1) as f64 / self.spec.rate_hz
    }

    /// The excitation law and the master frequency of a trajectory.
    fn design(&self, index: u64, draws: &mut Draws) -> (Law<'a>, f64) {
        let excitation = &self.spec.excitation;
        let drawn = draws.unit();
        let cell = self.cells.iter().rfind(|cell| cell.first <= index);
        let law = match cell.map(|cell| cell.family) {
            Some(family) => self.law(family),
            None if self.spec.controller.is_some() => {
                let families: Vec<Family> = excitation.families().collect();
                let place = whole(drawn * families.len() as f64);
                families.get(place).and_then(|family| self.law(*family))
            }
            None => {
                let [chirp, multisine] = [Family::Chirp, Family::Multisine];
                let others = [Family::Steps, Family::Pulses];
                let first = if drawn < excitation.chirp_fraction {
                    [chirp, multisine]
                } else {
                    [multisine, chirp]
                };
                first.into_iter().chain(others).find_map(|family| self.law(family))
            }
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

    /// The law of a family and its master frequencies, if the family occurs.
    fn law(&self, family: Family) -> Option<(Law<'a>, &'a Frequency)> {
        let excitation = &self.spec.excitation;
        let law = match family {
            Family::Chirp => Law::Chirp(excitation.chirp.as_ref()?),
            Family::Multisine => Law::Multisine(excitation.multisine.as_ref()?),
            Family::Steps => Law::Steps(excitation.steps.as_deref()?),
            Family::Pulses => Law::Pulses(excitation.pulses.as_deref()?),
            Family::Fourier => Law::Fourier(excitation.fourier.as_deref()?),
            Family::PointToPoint => Law::PointToPoint(excitation.point_to_point.as_deref()?),
            Family::ViaPoints => Law::ViaPoints(excitation.via_points.as_deref()?),
            Family::HandPaths => {
                excitation.hand_paths.as_ref()?;
                Law::HandPaths
            }
        };
        Some((law, excitation.frequency_hz(family)?))
    }
}

enum Law<'a> {
    Chirp(&'a spec::Chirp),
    Multisine(&'a spec::Multisine),
    Steps(&'a spec::Steps),
    Pulses(&'a spec::Pulses),
    Fourier(&'a spec::FourierSeries),
    PointToPoint(&'a spec::PointToPointMoves),
    ViaPoints(&'a spec::ViaPoints),
    HandPaths,
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
