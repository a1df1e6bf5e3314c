//! Which columns of a recording belong to which joint, and which positions have the other sign.

use dynamics::Joints;
use rayon::prelude::*;
use spec::MAX_JOINTS;

use super::regression::Regression;
use super::rows::States;
use crate::arm::Prior;

/// Rows that a layout is judged by.
const ROWS: usize = 500;

/// This many consecutive rows count as one, as is usual for motions of a robot.
const ALIKE: f64 = 4.0;

/// A channel that is explained up to this share of its variance is explained.
const EXPLAINED: f64 = 0.01;

/// What a layout costs for each joint whose positions have the other sign, for each joint with
/// positions of another one, and for each joint whose torques are not those of the same joint as
/// its positions. An unusual layout must explain torques so much better: by logarithms of what is
/// left, one for each joint that is explained.
const FLIPPED: f64 = 1.0;
const MOVED: f64 = 0.5;
const PARTED: f64 = 0.5;

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
        let states = states.thinned(ROWS);
        let (cost, mut best) = declared.with_torques(arm, &states);
        let mut cost = cost;
        // A joint that is far from its place needs some exchanges.
        for _ in 0..joints {
            // Even a perfect explanation would not pay for a change.
            if cost - best.penalty() <= FLIPPED.min(2.0 * MOVED) {
                break;
            }
            let changed: Vec<(f64, Self)> = best
                .changes()
                .into_par_iter()
                .map(|changed| changed.with_torques(arm, &states))
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
            let mut flipped = self.clone();
            flipped.positions[joint].1 *= -1.0;
            changes.push(flipped);
            for other in joint + 1..joints {
                let mut exchanged = self.clone();
                exchanged.positions.swap(joint, other);
                changes.push(exchanged);
            }
        }
        changes
    }

    /// The same positions with the torques that fit best, and what that costs.
    fn with_torques(&self, arm: &Prior, states: &States<'_>) -> (f64, Self) {
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
                        let cost = 0.5 * (share.max(EXPLAINED) / EXPLAINED).ln();
                        let known = &mut costs[joint][column];
                        *known = if gravity > 0.5 { cost } else { known.min(cost) };
                    }
                }
            }
            for (column, cost) in costs[joint].iter_mut().enumerate() {
                if column != self.positions[joint].0 {
                    *cost += PARTED;
                }
            }
        }
        let (cost, torques) = assignment(&costs);
        let layout = Self { positions: self.positions.clone(), torques };
        (cost + layout.penalty_of_positions(), layout)
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
