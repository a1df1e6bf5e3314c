//! The fit of a chain to the motions of many arms: variable projection (Golub and Pereyra 1973). For
//! each chain the numbers of each arm have their least squares, and the steps of Levenberg and
//! Marquardt are those of the residual torques that these leave.

use kernels::Interrupt;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use simd::InstructionSet;
use spec::Gravity;

use super::Chain;
use super::arm::{Arm, SHAPE_MOVES};
use crate::lagrangian::recorded::Recorded;

/// Numbers of a joint besides the moments of its link and its frictions: damping, rotor, offset, and
/// how much later its torque acts.
const OWN: usize = 4;
/// The weight of numbers of 0 beside the data, as a share of each number's own squares, and of all.
const RIDGE: f64 = 1e-6;
/// A move that is made for a derivative, rad, m or rad/s. Torques are computed in f32.
const STEP: f64 = 2e-3;
/// Damping of steps where a fit begins, where it ends, and its changes.
const DAMPING: f64 = 1e-3;
const LEAST_DAMPING: f64 = 1e-7;
const LESS_DAMPING: f64 = 1.0 / 3.0;
const MORE_DAMPING: f64 = 4.0;
/// The share of the mean curvature that is added to each one's, for moves that change nothing.
const FLOOR: f64 = 1e-4;
/// The least torque that counts as 1, N·m, and as a share of the largest one.
const LEAST_UNIT: f64 = 1e-6;
const LEAST_SHARE: f64 = 1e-3;
/// Steps that are tried with ever more damping.
const TRIES: usize = 10;
/// A fit whose step takes less off the cost than this share has ended.
const LEAST_GAIN: f64 = 1e-5;

/// The motions of many arms with the same chain, and their torques.
pub(in crate::lagrangian) struct Motions {
    joints: usize,
    gravity: Gravity,
    /// `[robot, point, joint]`: rad, rad/s, rad/s².
    states: [Vec<f32>; 3],
    /// The increase of the torque over the next sampling time, in the same order, N·m.
    increases: Vec<f32>,
    /// The torques of each robot, N·m, `[point · joint]`.
    torques: Vec<Vec<f64>>,
    /// The root mean square of each joint's torques, N·m.
    torque_rms: Vec<f64>,
}

/// Numbers that many robots have in common: moments of links, and of each joint the damping in
/// N·m·s/rad, the friction in N·m and the rotor inertia in kg m².
pub(in crate::lagrangian) struct CommonNumbers {
    pub moments: Vec<f64>,
    pub dampings: Vec<f64>,
    pub frictions: Vec<f64>,
    pub rotors: Vec<f64>,
}

/// An arm and how well it fits.
#[derive(Clone)]
pub(super) struct Candidate {
    pub arm: Arm,
    /// The torque of each joint that counts as 1, N·m.
    units: Vec<f64>,
    /// Mean square of the residual torques, in these units.
    cost: f64,
    /// Mean logarithm over joints of the residual torque, as a share of the joint's torques.
    pub misfit: f64,
    damping: f64,
    has_ended: bool,
}

/// The least squares of one robot.
struct LeastSquares {
    /// `[point · joint, number]`, in the joints' units.
    design: DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
    numbers: DVector<f64>,
    residuals: DVector<f64>,
}

impl Motions {
    /// Takes about `points` samples of each recording, evenly spread.
    pub fn new(recordings: &[Recorded<'_>], points: usize, gravity: Gravity) -> Self {
        let joints = recordings.first().map_or(0, |recorded| recorded.joints);
        let mut states: [Vec<f32>; 3] = Default::default();
        let mut increases = Vec::new();
        let of_recording = |recorded: &Recorded<'_>| {
            let end = recorded.samples().saturating_sub(1);
            let stride = (end.saturating_sub(1) / points).max(1);
            let mut torques = Vec::new();
            for sample in (1..end).step_by(stride).take(points) {
                for joint in 0..joints {
                    let motion = recorded.motion(sample, joint);
                    states[0].push(recorded.y[sample * joints + joint]);
                    states[1].push(motion.middle());
                    states[2].push(motion.change * recorded.rate_hz);
                    increases.push(motion.step);
                    torques.push(f64::from(motion.torque_at(0.5)));
                }
            }
            torques
        };
        let torques: Vec<Vec<f64>> = recordings.iter().map(of_recording).collect();
        let mut squares = vec![0.0; joints];
        for torques in &torques {
            for (row, torque) in torques.iter().enumerate() {
                squares[row % joints] += torque * torque;
            }
        }
        let rows = (states[0].len() / joints.max(1)).max(1) as f64;
        let rms: Vec<f64> = squares.into_iter().map(|square| (square / rows).sqrt()).collect();
        let least = LEAST_SHARE * rms.iter().copied().fold(LEAST_UNIT, f64::max);
        let torque_rms = rms.into_iter().map(|rms| rms.max(least)).collect();
        Self { joints, gravity, states, increases, torques, torque_rms }
    }

    pub fn joints(&self) -> usize {
        self.joints
    }

    /// The same motions of the first robots.
    pub fn of_first(&self, robots: usize) -> Self {
        let torques: Vec<Vec<f64>> = self.torques.iter().take(robots).cloned().collect();
        let values = torques.iter().map(Vec::len).sum();
        let states = self.states.each_ref().map(|states| states[..values].to_vec());
        let increases = self.increases[..values].to_vec();
        let torque_rms = self.torque_rms.clone();
        Self { states, increases, torques, torque_rms, ..*self }
    }

    /// The torques of each moment, N·m, `[robot, point · joint, moment]`, and how many moments there
    /// are.
    fn torques_of_moments(&self, chain: &Chain) -> (Vec<f32>, usize) {
        let kinematics = chain.kinematics(self.gravity);
        let states = self.states.each_ref().map(Vec::as_slice);
        let torques = kinematics.torques_of_moments(InstructionSet::best(), states);
        (torques, kinematics.particles())
    }

    /// The first value of each robot and the number of its values.
    fn parts(&self) -> Vec<(usize, usize)> {
        let parts = self.torques.iter().scan(0, |next, torques| {
            *next += torques.len();
            Some((*next - torques.len(), torques.len()))
        });
        parts.collect()
    }

    /// The torques of each number in the joints' units, a matrix for each robot.
    fn designs(&self, arm: &Arm, units: &[f64]) -> Vec<DMatrix<f64>> {
        let joints = self.joints;
        let kinds = arm.frictions_per_joint();
        let own = OWN + kinds;
        let (torques, moments) = self.torques_of_moments(&arm.chain);
        let [_, velocity, acceleration] = &self.states;
        let of_part = |(first, rows): (usize, usize)| {
            let mut design = DMatrix::zeros(rows, moments + own * joints);
            for row in 0..rows {
                let (at, joint) = (first + row, row % joints);
                let weight = 1.0 / units[joint];
                for moment in 0..moments {
                    design[(row, moment)] = weight * f64::from(torques[at * moments + moment]);
                }
                let speed = f64::from(velocity[at]);
                let [acceleration, increase] =
                    [acceleration[at], self.increases[at]].map(f64::from);
                let own = [speed, acceleration, 1.0, -increase];
                let frictions = (0..kinds).map(|kind| arm.friction(joint, kind, speed));
                let factors = own.into_iter().chain(frictions);
                for (kind, factor) in factors.enumerate() {
                    design[(row, moments + kind * joints + joint)] = weight * factor;
                }
            }
            design
        };
        self.parts().into_par_iter().map(of_part).collect()
    }

    /// The torques of a robot in the joints' units.
    fn in_units(&self, torques: &[f64], units: &[f64]) -> DVector<f64> {
        let each =
            torques.iter().enumerate().map(|(row, torque)| torque / units[row % self.joints]);
        DVector::from_iterator(torques.len(), each)
    }

    /// The least squares of each robot.
    fn fit(&self, arm: &Arm, units: &[f64]) -> Vec<LeastSquares> {
        let designs = self.designs(arm, units);
        let each = designs.into_par_iter().zip(&self.torques);
        each.filter_map(|(design, torques)| {
            LeastSquares::new(design, &self.in_units(torques, units))
        })
        .collect()
    }

    /// The numbers that fit the motions of all robots together. 0 if none do.
    pub fn common_numbers(&self, arm: &Arm) -> CommonNumbers {
        let units = self.candidate(arm.clone()).in_units_of_residuals(self).units;
        let designs = self.designs(arm, &units);
        let rows = designs.iter().map(DMatrix::nrows).sum();
        let columns = designs.first().map_or(0, DMatrix::ncols);
        let mut design = DMatrix::zeros(rows, columns);
        let mut first = 0;
        for of_robot in &designs {
            design.rows_mut(first, of_robot.nrows()).copy_from(of_robot);
            first += of_robot.nrows();
        }
        let fitted = LeastSquares::new(design, &self.in_units(&self.torques.concat(), &units));
        let numbers =
            fitted.map_or_else(|| vec![0.0; columns], |fitted| fitted.numbers.as_slice().to_vec());
        let own = OWN + arm.frictions_per_joint();
        let (moments, own) = numbers.split_at(columns.saturating_sub(own * self.joints));
        let of = |kind: usize| &own[kind * self.joints..][..self.joints];
        CommonNumbers {
            moments: moments.to_vec(),
            dampings: of(0).to_vec(),
            rotors: of(1).to_vec(),
            frictions: (0..self.joints)
                .map(|joint| own[OWN * self.joints + joint..].iter().step_by(self.joints).sum())
                .collect(),
        }
    }

    /// The squares of residuals and their number, for each joint, in its unit. None if a robot has no
    /// least squares.
    fn squares(&self, fits: &[LeastSquares]) -> Option<(Vec<f64>, f64)> {
        let mut squares = vec![0.0; self.joints];
        let mut rows = 0;
        for fit in fits {
            rows += fit.residuals.len();
            for (row, residual) in fit.residuals.iter().enumerate() {
                squares[row % self.joints] += residual * residual;
            }
        }
        let each = (rows / self.joints.max(1)).max(1) as f64;
        (fits.len() == self.torques.len()).then_some((squares, each))
    }

    /// How well a chain fits: [`Candidate::misfit`].
    #[cfg(test)]
    pub fn misfit(&self, chain: &Chain) -> f64 {
        self.candidate(Arm::new(chain.clone())).misfit
    }

    /// An arm with the joints' torques as units.
    pub(super) fn candidate(&self, arm: Arm) -> Candidate {
        self.judged(arm, self.torque_rms.clone())
    }

    fn judged(&self, arm: Arm, units: Vec<f64>) -> Candidate {
        let fits = self.fit(&arm, &units);
        let mut candidate = Candidate {
            arm,
            units,
            cost: f64::INFINITY,
            misfit: f64::INFINITY,
            damping: DAMPING,
            has_ended: false,
        };
        candidate.judge(self, &fits);
        candidate.has_ended = !candidate.cost.is_finite();
        candidate
    }

    /// The cost of an arm in these units.
    fn cost(&self, fits: &[LeastSquares]) -> f64 {
        self.squares(fits).map_or(f64::INFINITY, |(squares, each)| {
            squares.iter().sum::<f64>() / (each * self.joints as f64)
        })
    }

    /// Takes up to `steps` steps towards a lower cost.
    pub(super) fn improve(&self, candidate: &mut Candidate, steps: usize) {
        let interrupt = Interrupt::current();
        let mut fits = self.fit(&candidate.arm, &candidate.units);
        for _ in 0..steps {
            if candidate.has_ended {
                break;
            }
            interrupt.leave_if_raised();
            let (curvature, slope) = self.expansion(candidate, &fits);
            let before = candidate.cost;
            let floor = FLOOR * curvature.trace() / curvature.nrows() as f64;
            for _ in 0..TRIES {
                let mut damped = curvature.clone();
                for at in 0..damped.nrows() {
                    damped[(at, at)] += candidate.damping * (curvature[(at, at)] + floor);
                }
                let Some(factor) = damped.cholesky() else { break };
                let arm = candidate.arm.moved((-factor.solve(&slope)).as_slice());
                let moved = self.fit(&arm, &candidate.units);
                let cost = self.cost(&moved);
                if cost < candidate.cost {
                    candidate.arm = arm;
                    candidate.cost = cost;
                    candidate.damping = (candidate.damping * LESS_DAMPING).max(LEAST_DAMPING);
                    fits = moved;
                    break;
                }
                candidate.damping *= MORE_DAMPING;
            }
            candidate.has_ended = candidate.cost > (1.0 - LEAST_GAIN) * before;
        }
        candidate.judge(self, &fits);
    }

    /// The squares of the derivatives of residuals by the moves, and their products with the residuals.
    fn expansion(
        &self,
        Candidate { arm, units, .. }: &Candidate,
        fits: &[LeastSquares],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let of_chain = arm.chain.moves();
        let shapes = arm.friction_shapes().unwrap_or_default();
        let moves = of_chain + SHAPE_MOVES * shapes.len();
        let moved = (0..of_chain).map(|at| {
            let mut step = vec![0.0; of_chain];
            step[at] = STEP;
            self.torques_of_moments(&arm.chain.moved(&step)).0
        });
        let moved: Vec<Vec<f32>> = moved.collect();
        let (here, moments) = self.torques_of_moments(&arm.chain);
        let [_, velocity, _] = &self.states;
        let parts = self.parts();
        let of_robot = |(robot, fit): (usize, &LeastSquares)| {
            let (first, rows) = parts[robot];
            let numbers = fit.numbers.as_slice();
            let frictions = &numbers[moments + OWN * self.joints..];
            let change = |row: usize, at: usize| -> f64 {
                let joint = row % self.joints;
                let Some(of_shapes) = at.checked_sub(of_chain) else {
                    let range = (first + row) * moments..(first + row + 1) * moments;
                    let each = moved[at][range.clone()].iter().zip(&here[range]).zip(numbers);
                    let change =
                        each.map(|((moved, here), number)| f64::from(moved - here) * number);
                    return change.sum();
                };
                if of_shapes / SHAPE_MOVES != joint {
                    return 0.0;
                }
                let mut step = [0.0; SHAPE_MOVES];
                step[of_shapes % SHAPE_MOVES] = STEP;
                let (shape, velocity) = (shapes[joint], f64::from(velocity[first + row]));
                frictions[joint] * (shape.moved(step).at(velocity) - shape.at(velocity))
            };
            let derivative = DMatrix::from_fn(rows, moves, |row, at| {
                change(row, at) / (STEP * units[row % self.joints])
            });
            let explained = fit.factor.solve(&(fit.design.transpose() * &derivative));
            let derivative = derivative - &fit.design * explained;
            let transposed = derivative.transpose();
            (&transposed * derivative, transposed * &fit.residuals)
        };
        let parts: Vec<_> = fits.par_iter().enumerate().map(of_robot).collect();
        let mut sums = (DMatrix::zeros(moves, moves), DVector::zeros(moves));
        for (curvature, slope) in parts {
            sums.0 += curvature;
            sums.1 += slope;
        }
        sums
    }
}

impl Candidate {
    /// Judges the arm by the least squares of all robots.
    fn judge(&mut self, motions: &Motions, fits: &[LeastSquares]) {
        let Some((squares, each)) = motions.squares(fits) else { return };
        let joints = squares.len().max(1) as f64;
        let shares = squares.iter().zip(&self.units).zip(&motions.torque_rms);
        let logs = shares.map(|((square, unit), torque)| {
            ((unit * (square / each).sqrt()).max(LEAST_UNIT) / torque).ln()
        });
        self.misfit = logs.sum::<f64>() / joints;
        self.cost = squares.iter().sum::<f64>() / (each * joints);
    }

    /// The same arm with its residual torques as units, so that joints count by how well they are
    /// explained.
    pub fn in_units_of_residuals(self, motions: &Motions) -> Self {
        let fits = motions.fit(&self.arm, &self.units);
        let Some((squares, each)) = motions.squares(&fits) else { return self };
        let units = self.units.iter().zip(squares);
        let units =
            units.map(|(unit, square)| (unit * (square / each).sqrt()).max(LEAST_UNIT)).collect();
        motions.judged(self.arm, units)
    }
}

impl LeastSquares {
    /// `None` for torques of numbers that are not finite.
    fn new(design: DMatrix<f64>, torques: &DVector<f64>) -> Option<Self> {
        // A product of two matrices is faster than nalgebra's `tr_mul`.
        let transposed = design.transpose();
        let mut squares = &transposed * &design;
        let floor = RIDGE * squares.trace() / squares.nrows() as f64;
        for at in 0..squares.nrows() {
            squares[(at, at)] += RIDGE * (squares[(at, at)] + floor);
        }
        let factor = squares.cholesky()?;
        let numbers = factor.solve(&(transposed * torques));
        let residuals = &design * &numbers - torques;
        let is_finite = residuals.iter().all(|residual| residual.is_finite());
        is_finite.then_some(Self { design, factor, numbers, residuals })
    }
}
