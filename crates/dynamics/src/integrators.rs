//! One sampling period, with the torque held.
//!
//! All schemes sum *increments* to the state at the start of a step, and add them once to a
//! position that is kept with the rounding error of the last addition. In f32 this makes the result
//! as accurate as f64, because the increments and their rounding errors are small.

use simd::Lanes;
use spec::Integrator;

use crate::Joints;
use crate::forward_dynamics::Dynamics;
use crate::kernels::{Accelerations, AccelerationsAt, MassMatrixAndBias};
use crate::model::Model;
use crate::spatial::Turn;
use crate::structure::Structure;

/// A scheme that integrates over one sampling period.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Scheme {
    /// Euler with implicit damping in sequences of 1, 2, .. `order` steps, extrapolated.
    Extrapolated { order: usize, substeps: u32 },
    /// Runge-Kutta of order 4, damping explicit.
    Rk4 { substeps: u32 },
    /// One evaluation per step, half a step ahead.
    Midpoint { substeps: u32 },
}

impl From<Integrator> for Scheme {
    fn from(integrator: Integrator) -> Self {
        match integrator {
            Integrator::Extrapolated { order, substeps } => {
                Self::Extrapolated { order: (order as usize).clamp(1, MAX_ORDER), substeps }
            }
            Integrator::Rk4 { substeps } => Self::Rk4 { substeps },
            Integrator::Midpoint { substeps } => Self::Midpoint { substeps },
            // The paper's simulator: two semi-implicit Euler steps per period.
            Integrator::Reference => Self::Extrapolated { order: 1, substeps: 2 },
        }
    }
}

const MAX_ORDER: usize = 4;

/// Positions and velocities of the joints.
pub(crate) struct State<L, const N: usize> {
    pub(crate) q: [L; N],
    /// The accumulated rounding error of `q` (Kahan summation).
    pub(crate) q_remainder: [L; N],
    pub(crate) qd: [L; N],
    /// The acceleration of the last midpoint step; 0 before the first one, and with other schemes.
    pub(crate) qdd: [L; N],
}

#[derive(Clone, Copy)]
struct Increment<L, const N: usize> {
    q: [L; N],
    qd: [L; N],
}

impl<L: Lanes, const N: usize> State<L, N> {
    #[inline(always)]
    pub(crate) fn zero() -> Self {
        let zero = [L::splat(0.0); N];
        Self { q: zero, q_remainder: zero, qd: zero, qdd: zero }
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, lane: usize, q: &Joints<f64>, qd: &Joints<f64>) {
        self.set_position(lane, q);
        for (joint, &qd) in qd.iter().enumerate() {
            self.qd[joint].set_lane(lane, qd);
            self.qdd[joint].set_lane(lane, 0.0);
        }
    }

    #[inline(always)]
    pub(crate) fn set_position(&mut self, lane: usize, q: &Joints<f64>) {
        for (joint, &q) in q.iter().enumerate() {
            self.q[joint].set_lane(lane, q);
            self.q_remainder[joint].set_lane(lane, 0.0);
        }
    }

    #[inline(always)]
    fn velocity_after(&self, joints: usize, increment: &Increment<L, N>, qd: &mut [L; N]) {
        for joint in 0..joints {
            qd[joint] = self.qd[joint] + increment.qd[joint];
        }
    }

    #[inline(always)]
    fn add(&mut self, joints: usize, increment: &Increment<L, N>) {
        for joint in 0..joints {
            let change = increment.q[joint] + self.q_remainder[joint];
            let q = self.q[joint] + change;
            self.q_remainder[joint] = change - (q - self.q[joint]);
            self.q[joint] = q;
            self.qd[joint] = self.qd[joint] + increment.qd[joint];
        }
    }
}

impl<L: Lanes, const N: usize> Increment<L, N> {
    #[inline(always)]
    fn set_zero(&mut self, joints: usize) {
        for joint in 0..joints {
            self.q[joint] = L::splat(0.0);
            self.qd[joint] = L::splat(0.0);
        }
    }

    /// A step of semi-implicit Euler: the new velocity moves the position.
    #[inline(always)]
    fn euler_step(&mut self, joints: usize, start: &State<L, N>, h: L, qdd: &[L; N]) {
        for joint in 0..joints {
            self.qd[joint] = h.mul_add(qdd[joint], self.qd[joint]);
            let qd = start.qd[joint] + self.qd[joint];
            self.q[joint] = h.mul_add(qd, self.q[joint]);
        }
    }

    /// Adds `factor` times the derivatives of position and velocity.
    #[inline(always)]
    fn add_scaled(&mut self, joints: usize, factor: L, qd: &[L; N], qdd: &[L; N]) {
        for joint in 0..joints {
            self.q[joint] = factor.mul_add(qd[joint], self.q[joint]);
            self.qd[joint] = factor.mul_add(qdd[joint], self.qd[joint]);
        }
    }
}

/// Intermediate results of a step. A simulation allocates them once, because filling them with
/// zeros at every step took 3 % of a trajectory's time.
pub(crate) struct Scratch<L, const N: usize> {
    table: [Increment<L, N>; MAX_ORDER],
    start: Dynamics<L, N>,
    start_turns: [Turn<L>; N],
    later_turns: [Turn<L>; N],
    qd: [L; N],
    qdd: [L; N],
}

impl<L: Lanes, const N: usize> Scratch<L, N> {
    #[inline(always)]
    pub(crate) fn new() -> Self {
        let zero = [L::splat(0.0); N];
        Self {
            table: [Increment { q: zero, qd: zero }; MAX_ORDER],
            start: Dynamics::zero(),
            start_turns: [Turn::none(); N],
            later_turns: [Turn::none(); N],
            qd: zero,
            qdd: zero,
        }
    }
}

/// Advances `state` by `period` seconds under `torque` (N·m).
#[inline(always)]
pub(crate) fn advance<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    scheme: Scheme,
    period: f64,
    model: &Model<L, N>,
    torque: &[L; N],
    state: &mut State<L, N>,
    scratch: &mut Scratch<L, N>,
) {
    match scheme {
        Scheme::Extrapolated { order, substeps } => {
            let step = period / f64::from(substeps);
            for _ in 0..substeps {
                extrapolated_step(structure, order, step, model, torque, state, scratch);
            }
        }
        Scheme::Midpoint { substeps } => {
            let step = period / f64::from(substeps);
            for _ in 0..substeps {
                midpoint_step(structure, step, model, torque, state, scratch);
            }
        }
        Scheme::Rk4 { substeps } => {
            let step = period / f64::from(substeps);
            for _ in 0..substeps {
                runge_kutta_step(structure, step, model, torque, state, scratch);
            }
        }
    }
}

/// Richardson extrapolation of the implicit-damping Euler method (Hairer, Nørsett and Wanner 1993,
/// "Solving Ordinary Differential Equations I", section II.9, harmonic sequence): order `order`
/// from order · (order + 1) / 2 evaluations, however stiff the damping.
#[inline(always)]
fn extrapolated_step<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    order: usize,
    step: f64,
    model: &Model<L, N>,
    torque: &[L; N],
    state: &mut State<L, N>,
    scratch: &mut Scratch<L, N>,
) {
    let joints = structure.joints();
    let Scratch { table, start, start_turns, later_turns, qd, qdd } = scratch;

    // Every sequence starts from the same state, so its dynamics are computed once. The first steps
    // of all sequences come first, because they do not depend on each other.
    structure.turns(model, &state.q, start_turns);
    L::run(MassMatrixAndBias {
        structure,
        model,
        turns: start_turns,
        qd: &state.qd,
        dynamics: start,
    });
    for steps in 1..=order {
        let h = L::splat(step / steps as f64);
        let increment = &mut table[steps - 1];
        L::run(Accelerations {
            structure,
            model,
            dynamics: start,
            qd: &state.qd,
            torque,
            step: h,
            qdd,
        });
        increment.set_zero(joints);
        increment.euler_step(joints, state, h, qdd);
    }
    for steps in 2..=order {
        let h = L::splat(step / steps as f64);
        let increment = &mut table[steps - 1];
        for _ in 1..steps {
            state.velocity_after(joints, increment, qd);
            structure.later_turns(start_turns, &increment.q, later_turns);
            let turns = &*later_turns;
            L::run(AccelerationsAt { structure, model, turns, qd, torque, step: h, qdd });
            increment.euler_step(joints, state, h, qdd);
        }
    }

    // Aitken and Neville: T(j, k) = T(j, k-1) + (T(j, k-1) − T(j-1, k-1)) / (n_j / n_(j-k) − 1), n_j = j.
    for column in 1..order {
        for row in (column..order).rev() {
            let ratio = (row + 1) as f64 / (row + 1 - column) as f64;
            let weight = L::splat(1.0 / (ratio - 1.0));
            let [.., above, entry] = &mut table[..=row] else { continue };
            for joint in 0..joints {
                let (q, qd) = (entry.q[joint], entry.qd[joint]);
                entry.q[joint] = weight.mul_add(q - above.q[joint], q);
                entry.qd[joint] = weight.mul_add(qd - above.qd[joint], qd);
            }
        }
    }
    state.add(joints, &table[order - 1]);
}

#[inline(always)]
fn runge_kutta_step<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    step: f64,
    model: &Model<L, N>,
    torque: &[L; N],
    state: &mut State<L, N>,
    scratch: &mut Scratch<L, N>,
) {
    /// The weight of each stage's slope in the result, and the position of the next stage along it.
    const STAGES: [(f64, f64); 4] =
        [(1.0 / 6.0, 0.5), (1.0 / 3.0, 0.5), (1.0 / 3.0, 1.0), (1.0 / 6.0, 0.0)];

    let joints = structure.joints();
    let Scratch { table: [total, stage, ..], start_turns, later_turns, qd, qdd, .. } = scratch;
    total.set_zero(joints);
    stage.set_zero(joints);
    structure.turns(model, &state.q, start_turns);
    for (weight, reach) in STAGES {
        state.velocity_after(joints, stage, qd);
        structure.later_turns(start_turns, &stage.q, later_turns);
        let (turns, step_ahead) = (&*later_turns, L::splat(0.0));
        L::run(AccelerationsAt { structure, model, turns, qd, torque, step: step_ahead, qdd });
        total.add_scaled(joints, L::splat(step * weight), qd, qdd);
        stage.set_zero(joints);
        stage.add_scaled(joints, L::splat(step * reach), qd, qdd);
    }
    state.add(joints, total);
}

/// The position and the velocity-dependent forces of half a step ahead give the acceleration of the
/// whole step: Störmer and Verlet's method, with the velocity there extrapolated by the last
/// acceleration. Damping is implicit.
#[inline(always)]
fn midpoint_step<L: Lanes, S: Structure<N>, const N: usize>(
    structure: S,
    step: f64,
    model: &Model<L, N>,
    torque: &[L; N],
    state: &mut State<L, N>,
    scratch: &mut Scratch<L, N>,
) {
    let joints = structure.joints();
    let Scratch { table: [increment, ..], start_turns, qd, qdd, .. } = scratch;
    let (h, half) = (L::splat(step), L::splat(0.5 * step));
    let mut q = state.q;
    let mut driving = *torque;
    for joint in 0..joints {
        q[joint] = q[joint] + half.mul_add(state.qd[joint], state.q_remainder[joint]);
        let foretold = half * state.qdd[joint];
        qd[joint] = state.qd[joint] + foretold;
        // Damping at the middle of the step is D (q̇ + h/2 q̈). The kernel adds D h/2 to the mass matrix,
        // and takes D times the foretold velocity from the torque.
        driving[joint] = model.damping[joint].mul_add(foretold, driving[joint]);
    }
    structure.turns(model, &q, start_turns);
    let (turns, torque) = (&*start_turns, &driving);
    L::run(AccelerationsAt { structure, model, turns, qd, torque, step: half, qdd });
    for joint in 0..joints {
        increment.qd[joint] = h * qdd[joint];
        increment.q[joint] = h * half.mul_add(qdd[joint], state.qd[joint]);
        state.qdd[joint] = qdd[joint];
    }
    state.add(joints, increment);
}

#[cfg(test)]
mod tests {
    use simd::F64Array;

    use super::*;
    use crate::compiled::Compiled;
    use crate::{Robot, mass_matrix};

    type Lane = F64Array<1>;

    const JOINTS: usize = 7;
    const TORQUE: [f64; JOINTS] = [2.0, -3.0, 1.0, 2.0, -0.5, 0.4, 0.3];
    const Q0: [f64; JOINTS] = [0.3, -0.4, 0.2, -1.7, 0.1, 1.9, -0.2];
    const QD0: [f64; JOINTS] = [0.2, -0.5, 0.4, 0.3, -0.6, 0.5, 0.8];

    /// Position and velocity after `seconds` in periods of 1/60 s.
    fn run(scheme: Scheme, robot: &Robot, torque: [f64; JOINTS], seconds: f64) -> Vec<f64> {
        let model = Model::<Lane, JOINTS>::splat(Compiled, robot);
        let mut state = State { q: Q0.map(Lane::splat), qd: QD0.map(Lane::splat), ..State::zero() };
        let torque = torque.map(Lane::splat);
        let mut scratch = Scratch::new();
        let mut time = 0.0;
        while time < seconds - 1e-9 {
            advance(Compiled, scheme, 1.0 / 60.0, &model, &torque, &mut state, &mut scratch);
            time += 1.0 / 60.0;
        }
        state.q.iter().chain(&state.qd).map(|value| value.lane(0)).collect()
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    /// The order p of the scheme, from the errors with `substeps` and twice as many substeps.
    fn observed_order(scheme: impl Fn(u32) -> Scheme, substeps: u32) -> f64 {
        let robot = Robot { gravity: 9.81, damping: Joints::splat(JOINTS, 1.0), ..Robot::panda() };
        let exact = run(Scheme::Rk4 { substeps: 200 }, &robot, TORQUE, 0.2);
        let error = |substeps| distance(&run(scheme(substeps), &robot, TORQUE, 0.2), &exact);
        (error(substeps) / error(2 * substeps)).log2()
    }

    #[test]
    fn extrapolation_converges_with_its_order() {
        for order in 1..=4 {
            let substeps = if order < 3 { 32 } else { 8 };
            let observed =
                observed_order(|substeps| Scheme::Extrapolated { order, substeps }, substeps);
            assert!((observed - order as f64).abs() < 0.35, "order {order}: {observed}");
        }
    }

    #[test]
    fn runge_kutta_converges_with_order_4() {
        let observed = observed_order(|substeps| Scheme::Rk4 { substeps }, 12);
        assert!((observed - 4.0).abs() < 0.35, "{observed}");
    }

    #[test]
    fn the_midpoint_method_converges_with_order_2() {
        let observed = observed_order(|substeps| Scheme::Midpoint { substeps }, 32);
        assert!((observed - 2.0).abs() < 0.35, "{observed}");
    }

    #[test]
    fn energy_is_conserved_without_damping_torque_and_gravity() {
        let robot = Robot { damping: Joints::splat(JOINTS, 0.0), ..Robot::panda() };
        let kinetic_energy = |q: &[f64], qd: &[f64]| -> f64 {
            let m = mass_matrix(&robot, q);
            let momentum = m.map(|row| row.iter().zip(qd).map(|(m, qd)| m * qd).sum::<f64>());
            0.5 * momentum.iter().zip(qd).map(|(p, qd)| p * qd).sum::<f64>()
        };
        let before = kinetic_energy(&Q0, &QD0);
        for scheme in
            [Scheme::Rk4 { substeps: 12 }, Scheme::Extrapolated { order: 4, substeps: 12 }]
        {
            let end = run(scheme, &robot, [0.0; JOINTS], 2.0);
            let (q, qd) = end.split_at(JOINTS);
            let after = kinetic_energy(q, qd);
            assert!((after / before - 1.0).abs() < 1e-6, "{scheme:?}: {before} J, then {after} J");
        }
    }

    #[test]
    fn implicit_damping_is_stable_where_explicit_damping_is_not() {
        let robot = Robot { gravity: 9.81, ..Robot::panda() };
        let fine = run(Scheme::Extrapolated { order: 4, substeps: 2 }, &robot, TORQUE, 0.5);
        let stiff = run(Scheme::Extrapolated { order: 1, substeps: 1 }, &robot, TORQUE, 0.5);
        // One implicit step per period is coarse, but stays close where an explicit one diverges.
        assert!(distance(&fine[..JOINTS], &stiff[..JOINTS]) < 0.05);
        let explicit = run(Scheme::Rk4 { substeps: 1 }, &robot, TORQUE, 0.5);
        assert!(explicit.iter().any(|value| value.is_nan() || value.abs() > 1e3));
    }
}
