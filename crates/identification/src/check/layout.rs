//! Which columns of a recording belong to which joint, and which positions have the other sign.

use dynamics::Joints;
use rayon::prelude::*;
use spec::MAX_JOINTS;

use super::regression::Regression;
use super::rows::States;
use crate::arm::Prior;

/// Rows that a layout is judged by.
pub const ROWS: usize = 500;

/// This many consecutive rows count as one, as is usual for motions of a robot.
const ALIKE: f64 = 4.0;

/// A channel that is explained up to this share of its variance is explained. Two layouts that are
/// as usual are told apart further.
const EXPLAINED: f64 = 1e-3;
const BEST_EXPLAINED: f64 = 1e-4;

/// What a layout costs for each joint whose positions have the other sign, for each joint with
/// positions of another one, and for each joint whose torques are not those of the same joint as
/// its positions. An unusual layout must explain torques so much better: by logarithms of what is
/// left, one for each joint that is explained.
const FLIPPED: f64 = 1.0;
const MOVED: f64 = 0.5;
const PARTED: f64 = 0.5;

/// One of two layouts that are as usual explains torques clearly better by so much.
const CLEARLY: f64 = 0.5;

/// The columns of each joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// The column of q, and 1, or -1 if it has the other sign.
    pub positions: Vec<(usize, f64)>,
    /// The column of u.
    pub torques: Vec<usize>,
}

impl Layout {
    pub fn declared(joints: usize) -> Self {
        let positions = (0..joints).map(|joint| (joint, 1.0)).collect();
        Self { positions, torques: (0..joints).collect() }
    }

    /// The layout that explains the torques best, after penalties.
    pub fn find(arm: &Prior, states: &States<'_>) -> Self {
        let joints = arm.arm.joints();
        let declared = Self::declared(joints);
        if !states.are_enough() {
            return declared;
        }
        let (mut cost, mut best) = declared.with_torques(arm, states);
        // A joint that is far from its place needs some exchanges.
        for _ in 0..joints {
            // Even a perfect explanation would not pay for a change.
            if cost - best.penalty() <= FLIPPED.min(2.0 * MOVED) {
                break;
            }
            let changed: Vec<(f64, Self)> = best
                .changes()
                .into_par_iter()
                .map(|changed| changed.with_torques(arm, states))
                .collect();
            match changed.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
                Some((lower, changed)) if lower < cost => (cost, best) = (lower, changed),
                _ => break,
            }
        }
        best
    }

    /// The values of the joints, from those of the columns.
    pub fn applied(&self, columns: &Joints<f64>) -> Joints<f64> {
        self.positions.iter().map(|&(column, sign)| sign * columns[column]).collect()
    }

    /// Layouts in which one column of positions has the other sign, or two are exchanged.
    fn changes(&self) -> Vec<Self> {
        let joints = self.positions.len();
        let mut changes = Vec::new();
        for joint in 0..joints {
            changes.push(self.flipped(joint));
            for other in joint + 1..joints {
                let mut exchanged = self.clone();
                exchanged.positions.swap(joint, other);
                changes.push(exchanged);
            }
        }
        changes
    }

    pub fn has_declared_sign(&self, joint: usize) -> bool {
        self.positions[joint].1 > 0.0
    }

    /// The layout whose positions of a joint have the other sign.
    pub fn flipped(&self, joint: usize) -> Self {
        let mut flipped = self.clone();
        flipped.positions[joint].1 *= -1.0;
        flipped
    }

    /// The layout that blames columns of q where this one blames columns of u, or the reverse. Each
    /// column of q keeps its column of u. `None` if columns of both are exchanged, or none.
    fn twin(&self) -> Option<Self> {
        let of_q = self.positions.iter().enumerate().all(|(joint, (column, _))| joint == *column);
        let of_u = self.torques.iter().enumerate().all(|(joint, column)| joint == *column);
        if of_q == of_u {
            return None;
        }
        let mut twin = self.clone();
        for (&position, &torque) in self.positions.iter().zip(&self.torques) {
            // The column that stays in its place.
            let joint = if of_q { torque } else { position.0 };
            twin.positions[joint] = position;
            twin.torques[joint] = torque;
        }
        Some(twin)
    }

    /// Takes its place if `other`, which is as usual, explains the torques clearly better. True if
    /// neither does.
    fn is_tied_with(&mut self, other: Self, arm: &Prior, states: &States<'_>) -> bool {
        let gain = self.misfit(arm, states) - other.misfit(arm, states);
        if gain > CLEARLY {
            *self = other;
        }
        gain.abs() <= CLEARLY
    }

    /// Blames columns of q for an exchange, or columns of u, whichever explains the torques better.
    /// True if both do about as well.
    pub fn settle_exchange(&mut self, arm: &Prior, states: &States<'_>) -> bool {
        self.twin().is_some_and(|twin| self.is_tied_with(twin, arm, states))
    }

    /// Blames q of a joint whose torques have the other sign, or its u, whichever explains the torques
    /// better. True if both do about as well.
    pub fn settle_sign(&mut self, joint: usize, arm: &Prior, states: &States<'_>) -> bool {
        self.is_tied_with(self.flipped(joint), arm, states)
    }

    /// Σ over joints of the logarithms of what is left.
    fn misfit(&self, arm: &Prior, states: &States<'_>) -> f64 {
        let costs = self.costs(arm, states, BEST_EXPLAINED);
        costs.iter().zip(&self.torques).map(|(costs, column)| costs[*column]).sum()
    }

    /// The same positions with the torques that fit best, and what that costs.
    fn with_torques(&self, arm: &Prior, states: &States<'_>) -> (f64, Self) {
        let mut costs = self.costs(arm, states, EXPLAINED);
        for (joint, costs) in costs.iter_mut().enumerate() {
            for (column, cost) in costs.iter_mut().enumerate() {
                if column != self.positions[joint].0 {
                    *cost += PARTED;
                }
            }
        }
        let (cost, torques) = assignment(&costs);
        let layout = Self { positions: self.positions.clone(), torques };
        (cost + layout.penalty_of_positions(), layout)
    }

    /// Logarithms of what each joint leaves of each column of torques, `[joint][column]`. 0 where that
    /// is not more than a share of `explained`.
    fn costs(&self, arm: &Prior, states: &States<'_>, explained: f64) -> Vec<Vec<f64>> {
        let joints = self.positions.len();
        let torques: Vec<_> = (0..joints).map(|column| states.torques(column, 0.0)).collect();
        // Logarithms of what joint and column leave, at most that of everything.
        let mut costs = vec![vec![0.0_f64; joints]; joints];
        for (joint, columns) in states.columns(arm, self).iter().enumerate() {
            for gravity in [1.0, 0.0] {
                let regression = Regression::new(columns.design(gravity), gravity);
                for (column, torques) in torques.iter().enumerate() {
                    let moments = regression.moments(torques);
                    let Some(fit) = regression.fit(&moments, ALIKE) else { continue };
                    let share = fit.left / (moments.variance() * states.count() as f64);
                    if share.is_finite() {
                        let cost = 0.5 * (share.max(explained) / explained).ln();
                        let known = &mut costs[joint][column];
                        *known = if gravity > 0.5 { cost } else { known.min(cost) };
                    }
                }
            }
        }
        costs
    }

    fn penalty_of_positions(&self) -> f64 {
        let of = |(joint, &(column, sign)): (usize, &(usize, f64))| {
            let moved = if column == joint { 0.0 } else { MOVED };
            moved + if sign < 0.0 { FLIPPED } else { 0.0 }
        };
        self.positions.iter().enumerate().map(of).sum()
    }

    fn penalty(&self) -> f64 {
        let parted = self.positions.iter().zip(&self.torques);
        let parted = parted.filter(|((position, _), torque)| position != *torque).count();
        self.penalty_of_positions() + PARTED * parted as f64
    }
}

/// The columns of all joints, each taken once, that cost least together: `costs[joint][column]`.
fn assignment(costs: &[Vec<f64>]) -> (f64, Vec<usize>) {
    let joints = costs.len();
    debug_assert!(joints <= MAX_JOINTS, "sets of columns are numbers");
    // The best of the first joints, for each set of as many columns.
    let mut best: Vec<(f64, Vec<usize>)> = vec![(f64::INFINITY, Vec::new()); 1 << joints];
    best[0].0 = 0.0;
    for set in 0..best.len() {
        let (cost, taken) = best[set].clone();
        let Some(of_joint) = costs.get(taken.len()) else { continue };
        for (column, more) in of_joint.iter().enumerate() {
            let larger = set | 1 << column;
            if larger != set && cost + more < best[larger].0 {
                let columns = taken.iter().copied().chain([column]).collect();
                best[larger] = (cost + more, columns);
            }
        }
    }
    best.pop().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_assignment_takes_each_column_once() {
        let costs = [vec![1.0, 0.0, 9.0], vec![2.0, 0.0, 9.0], vec![0.0, 5.0, 3.0]];
        assert_eq!(assignment(&costs), (3.0 + 1.0, vec![0, 1, 2]));
        assert_eq!(assignment(&[vec![0.5]]), (0.5, vec![0]));
    }
}
