//! The search for a chain among many random ones: races, in which ever fewer go on.

use random::ChaCha8Rng;
use rayon::prelude::*;

use super::Chain;
use super::arm::Arm;
use super::fit::{Candidate, Motions};

/// A round of a race.
struct Round {
    /// The chains that take part, the best of the round before.
    runners: usize,
    /// Robots whose motions they fit.
    robots: usize,
    /// Steps that each takes.
    steps: usize,
    /// Whether joints count by how well they are explained. Otherwise they count by their torques,
    /// which leads to the neighbourhood of a solution, and leaves light joints wrong.
    by_residuals: bool,
}

const RACE: [Round; 4] = [
    Round { runners: 32, robots: 6, steps: 6, by_residuals: false },
    Round { runners: 16, robots: 6, steps: 8, by_residuals: false },
    Round { runners: 8, robots: 8, steps: 10, by_residuals: false },
    Round { runners: 8, robots: 8, steps: 10, by_residuals: true },
];
/// The winner of the races goes on alone. From here on the shapes of frictions are fitted, too. Without
/// them the residual torques of a wrong joint that is light are small beside those of friction.
const POLISH: Round = Round { runners: 1, robots: 12, steps: 30, by_residuals: true };
/// Then each joint is tried with other axes: with the opposite one and with random ones. A joint may
/// have come to rest at a wrong axis while all others found theirs.
const RETRY: Round = Round { runners: usize::MAX, robots: 12, steps: 15, by_residuals: true };
const RANDOM_AXES: usize = 2;
/// Rounds of such tries, as long as the misfit falls by [`GAIN`] or more.
const RETRIES: usize = 6;
const GAIN: f64 = 0.05;
/// The last steps fit the motions of more robots, with new units each time.
const LAST: Round = Round { runners: 1, robots: 48, steps: 15, by_residuals: true };
const LAST_ROUNDS: usize = 3;
/// The most races. On Pandas as they are used two races of three find the arm.
const RACES: usize = 4;
/// The arm is found when the winner is this much better than the median runner: its residual torques
/// are e times smaller. Runners that are wrong in some joint are much alike.
const CLEAR: f64 = 1.0;
/// It is found as well when this share of its torques is left. Of an arm of few joints all runners may
/// be right.
const LEFT: f64 = 0.005;

/// The arm that fits the motions best.
pub(in crate::lagrangian) fn find(motions: &Motions, generator: &mut ChaCha8Rng) -> Arm {
    let Raced { mut winner, mut is_found } = Raced::new(motions, generator);
    for _ in 1..RACES {
        if is_found {
            break;
        }
        let next = Raced::new(motions, generator);
        is_found = next.is_found;
        if next.winner.misfit < winner.misfit {
            winner = next.winner;
        }
    }
    let mut best = POLISH.winner(motions, vec![winner.arm.with_fitted_frictions()]);
    for _ in 0..RETRIES {
        let mut tries = Vec::new();
        for joint in 0..motions.joints() {
            tries.push(best.arm.with_opposite_axis(joint));
            for _ in 0..RANDOM_AXES {
                tries.push(best.arm.with_random_axis(joint, generator));
            }
        }
        let tried = POLISH.winner(motions, vec![RETRY.winner(motions, tries).arm]);
        if tried.misfit > best.misfit - GAIN {
            break;
        }
        best = tried;
    }
    for _ in 0..LAST_ROUNDS {
        best = LAST.winner(motions, vec![best.arm]);
    }
    best.arm.gathered()
}

/// The end of a race.
struct Raced {
    winner: Candidate,
    /// Whether the winner is the arm, as far as its misfit tells.
    is_found: bool,
}

impl Raced {
    /// A race of random chains.
    fn new(motions: &Motions, generator: &mut ChaCha8Rng) -> Self {
        let start = |_| Arm::new(Chain::random(motions.joints(), generator));
        let mut field = (0..RACE[0].runners).map(start).collect();
        let mut ranked = Vec::new();
        for round in &RACE {
            ranked = round.run(motions, field);
            field = ranked.iter().map(|candidate| candidate.arm.clone()).collect();
        }
        let median = ranked[ranked.len() / 2].misfit;
        let winner = ranked.swap_remove(0);
        let is_found = winner.misfit < f64::max(median - CLEAR, LEFT.ln());
        Self { winner, is_found }
    }
}

impl Round {
    /// The runners after the round, the best one first.
    fn run(&self, motions: &Motions, mut field: Vec<Arm>) -> Vec<Candidate> {
        let motions = motions.of_first(self.robots);
        field.truncate(self.runners);
        let run = |arm: Arm| {
            let mut candidate = motions.candidate(arm);
            if self.by_residuals {
                candidate = candidate.in_units_of_residuals(&motions);
            }
            motions.improve(&mut candidate, self.steps);
            candidate
        };
        let mut ranked: Vec<Candidate> = field.into_par_iter().map(run).collect();
        ranked.sort_by(|one, other| one.misfit.total_cmp(&other.misfit));
        ranked
    }

    fn winner(&self, motions: &Motions, field: Vec<Arm>) -> Candidate {
        self.run(motions, field).swap_remove(0)
    }
}
