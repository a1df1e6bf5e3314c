//! From random motions to the best one.

use std::collections::VecDeque;

use dynamics::Joints;
use nalgebra::DVector;
use random::{ChaCha8Rng, keyed, normal, unit};
use rayon::prelude::*;

use super::objective::Objective;
use super::steps::{BARRIERS, GOING_ON, STEPS, Steps, TRIED, TRIED_BARRIERS};

/// The first part of the keys of random numbers.
const MOTIONS: u64 = 2;

/// The steps of one maximization. Those that it does not need are done at its end.
struct Remaining<'a> {
    steps: &'a Steps<'a>,
    left: u64,
}

impl Remaining<'_> {
    fn step(&mut self) {
        self.left = self.left.saturating_sub(1);
        self.steps.done(1);
    }
}

impl Drop for Remaining<'_> {
    fn drop(&mut self) {
        self.steps.done(self.left);
    }
}

/// A motion within the limits, and its log det.
#[derive(Clone)]
pub(crate) struct Candidate {
    pub(crate) variables: DVector<f64>,
    pub(crate) information: f64,
}

/// Random motions, each as large as the limits allow, around postures that are allowed. The best
/// come first.
pub(crate) fn random_motions(
    objective: &Objective<'_>,
    postures: &[Joints<f64>],
    steps: &Steps<'_>,
) -> Vec<Candidate> {
    let drawn = postures.par_iter().enumerate();
    let mut motions: Vec<Candidate> = drawn
        .filter_map(|(number, posture)| {
            steps.done(1);
            let is_wanted = !steps.are_stopped();
            is_wanted.then(|| random_motion(objective, posture, number as u64)).flatten()
        })
        .collect();
    motions.sort_by(|a, b| b.information.total_cmp(&a.information));
    motions
}

fn random_motion(
    objective: &Objective<'_>,
    posture: &Joints<f64>,
    number: u64,
) -> Option<Candidate> {
    /// The share of the largest motion that leaves room for steps.
    const ROOM: f64 = 0.95;
    const HALVINGS: i32 = 12;

    let mut generator = keyed::<ChaCha8Rng>([MOTIONS, number, 0, 0]);
    let basis = objective.basis;
    let limits = objective.limits;
    let of_joint = basis.of_joint();
    let mut rest = DVector::zeros(basis.variables());
    let mut wave = DVector::zeros(basis.variables());
    for joint in 0..posture.len() {
        rest[joint * of_joint] = (posture[joint] - limits.middle[joint]) / limits.half[joint];
        for k in 1..of_joint {
            wave[joint * of_joint + k] = normal(&mut generator);
        }
    }
    // Each joint alone is as fast and as wide as its limits allow.
    let states = basis.states(&wave);
    for joint in 0..posture.len() {
        let largest = states.iter().fold(0.0_f64, |largest, state| {
            let q = state.q[joint] - limits.middle[joint];
            let from_end = match q > 0.0 {
                true => limits.middle[joint] + limits.half[joint] - posture[joint],
                false => posture[joint] - limits.middle[joint] + limits.half[joint],
            };
            largest
                .max(q.abs() / from_end)
                .max(state.qd[joint].abs() / limits.velocity[joint])
                .max(state.qdd[joint].abs() / limits.acceleration[joint])
        });
        wave.rows_mut(joint * of_joint + 1, of_joint - 1).scale_mut(1.0 / largest);
    }
    // All joints together keep torques and the height over the table.
    let is_allowed = |size: f64| objective.is_allowed(basis.states(&(&rest + &wave * size)));
    let (mut allowed, mut refused) = (0.0, 1.0);
    if is_allowed(1.0) {
        allowed = 1.0;
    } else {
        for _ in 0..HALVINGS {
            let size = 0.5 * (allowed + refused);
            *(if is_allowed(size) { &mut allowed } else { &mut refused }) = size;
        }
    }
    let variables = rest + wave * (ROOM * allowed);
    let information = objective.information(&variables)?;
    Some(Candidate { variables, information })
}

/// Postures within the limits, evenly at random. The first is the middle.
pub(crate) fn random_posture(middle: &Joints<f64>, half: &Joints<f64>, number: u64) -> Joints<f64> {
    /// A motion needs room on both sides.
    const SHARE: f64 = 0.8;
    const POSTURES: u64 = 3;

    if number == 0 {
        return *middle;
    }
    let mut generator = keyed::<ChaCha8Rng>([POSTURES, number, 0, 0]);
    let drawn =
        |(middle, half): (&f64, &f64)| middle + SHARE * half * (2.0 * unit(&mut generator) - 1.0);
    middle.iter().zip(half).map(drawn).collect()
}

/// The best of `motions`, which are in falling order, and what the search makes of them, in falling
/// order. After each barrier comes a motion that is a little nearer to the limits.
pub(crate) fn improved(
    objective: &Objective<'_>,
    motions: &[Candidate],
    steps: &Steps<'_>,
) -> Vec<Candidate> {
    let (first, later) = BARRIERS.split_at(TRIED_BARRIERS);
    let through = |start: &Candidate, barriers: &[f64]| -> Vec<Candidate> {
        let mut variables = start.variables.clone();
        let mut after = Vec::with_capacity(barriers.len());
        for barrier in barriers {
            let slopes = |at: &DVector<f64>| objective.slopes(at, *barrier);
            let value = |at: &DVector<f64>| objective.value(at, *barrier);
            variables = maximized(variables, slopes, value, steps);
            if let Some(information) = objective.information(&variables) {
                after.push(Candidate { variables: variables.clone(), information });
            }
        }
        after
    };
    let tried: Vec<Vec<Candidate>> = motions[..motions.len().min(TRIED)]
        .par_iter()
        .map(|motion| through(motion, first))
        .collect();
    let mut going_on: Vec<&Candidate> = tried.iter().filter_map(|after| after.last()).collect();
    going_on.sort_by(|a, b| b.information.total_cmp(&a.information));
    going_on.truncate(GOING_ON);
    let found: Vec<Vec<Candidate>> =
        going_on.into_par_iter().map(|motion| through(motion, later)).collect();
    let mut all: Vec<Candidate> =
        found.into_iter().chain(tried).flatten().chain(motions.iter().cloned()).collect();
    all.sort_by(|a, b| b.information.total_cmp(&a.information));
    all
}

/// Moves `variables` uphill with limited-memory BFGS steps (Nocedal and Wright 2006, algorithm 7.4).
/// `slopes` gives the value with its gradient, `value` the value alone; both give `None` where it is
/// not defined.
fn maximized(
    mut variables: DVector<f64>,
    mut slopes: impl FnMut(&DVector<f64>) -> Option<(f64, DVector<f64>)>,
    mut value: impl FnMut(&DVector<f64>) -> Option<f64>,
    steps: &Steps<'_>,
) -> DVector<f64> {
    const REMEMBERED: usize = 12;
    /// The length of the first step.
    const FIRST: f64 = 0.02;
    const SUFFICIENT: f64 = 1e-4;
    const HALVINGS: usize = 25;
    /// A step that gains less ends the search.
    const LEAST_GAIN: f64 = 1e-3;

    let mut remaining = Remaining { steps, left: STEPS as u64 };
    let Some((mut height, mut gradient)) = slopes(&variables) else { return variables };
    // Steps, changes of the gradient, and one over their products.
    let mut memory: VecDeque<(DVector<f64>, DVector<f64>, f64)> = VecDeque::new();
    for _ in 0..STEPS {
        remaining.step();
        if steps.are_stopped() {
            return variables;
        }
        let mut direction = gradient.clone();
        let mut shares = Vec::with_capacity(memory.len());
        for (step, change, scale) in memory.iter().rev() {
            let share = scale * step.dot(&direction);
            direction.axpy(-share, change, 1.0);
            shares.push(share);
        }
        match memory.back() {
            Some((step, change, _)) => direction *= step.dot(change) / change.norm_squared(),
            None => direction *= FIRST / gradient.norm().max(f64::MIN_POSITIVE),
        }
        for ((step, change, scale), share) in memory.iter().zip(shares.into_iter().rev()) {
            let correction = share - scale * change.dot(&direction);
            direction.axpy(correction, step, 1.0);
        }
        let slope = gradient.dot(&direction);
        if slope.is_nan() || slope <= 0.0 {
            if memory.is_empty() {
                return variables;
            }
            memory.clear();
            continue;
        }
        let mut size = 1.0;
        let higher = (0..HALVINGS).find_map(|_| {
            let moved = &variables + &direction * size;
            let reached =
                value(&moved).filter(|reached| *reached >= height + SUFFICIENT * size * slope);
            if reached.is_none() {
                size *= 0.5;
            }
            reached.map(|reached| (moved, reached))
        });
        let Some((moved, reached)) = higher else {
            if memory.is_empty() {
                return variables;
            }
            memory.clear();
            continue;
        };
        let Some((_, next)) = slopes(&moved) else { return variables };
        // The pairs describe the negated function, which is convex near a maximum.
        let (step, change) = (&moved - &variables, &gradient - &next);
        let product = step.dot(&change);
        if product > 1e-10 * step.norm() * change.norm() {
            if memory.len() == REMEMBERED {
                memory.pop_front();
            }
            memory.push_back((step, change, 1.0 / product));
        }
        let gain = reached - height;
        (variables, height, gradient) = (moved, reached, next);
        if gain < LEAST_GAIN {
            return variables;
        }
    }
    variables
}
