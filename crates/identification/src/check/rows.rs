//! The states of motions at which torques are compared, and the torques there.

use dynamics::{Joints, LINK_PARAMETERS, torque_regressor};
use nalgebra::{DMatrix, DVector};

use super::layout::Layout;
use crate::arm::{NUMBERS, Prior};
use crate::motion::{Motion, whole};
use crate::torques::ROWS_PER_SECOND;

/// The most rows that are compared together: those of three minutes.
pub const MOST: usize = 4500;

/// Speeds at which two kinds of Coulomb friction bend, rad/s. A sum of both has any bend between.
pub const FRICTION_SPEEDS_RAD_S: [f64; 2] = [0.02, 0.15];

/// How much more the links may differ from the description than [`Prior`] says. Signs and units are
/// to be told for arms that nobody has identified.
const SPREAD: f64 = 1.5;

/// With fewer rows, nothing is told.
const LEAST_ROWS: usize = 25;

/// A sample of a motion.
#[derive(Clone, Copy)]
struct Row {
    motion: usize,
    sample: usize,
}

/// Positions, velocities, accelerations, and two kinds of Coulomb friction of 1 N·m, as recorded.
#[derive(Clone, Copy)]
struct State([Joints<f64>; 5]);

/// Samples of motions.
pub struct States<'a> {
    motions: &'a [Motion],
    rows: Vec<Row>,
    states: Vec<State>,
    /// Where each motion begins in the rows.
    pub begins: Vec<usize>,
}

/// The columns of a regression on a joint's torque that are no deviations of links.
pub const GRAVITY: usize = 0;
pub const REST: usize = 1;
pub const FRICTION: [usize; 3] = [2, 3, 4];
pub const OFFSET: usize = 6;
pub const OWN: usize = 7;

/// The columns of a regression on one joint's torque, N·m.
pub struct JointRows {
    /// The description's torque against gravity and the rest of it, then friction, rotor and offset.
    own: DMatrix<f64>,
    /// What deviations of the links add, one standard deviation each: gravity, and the rest.
    gravity: DMatrix<f64>,
    rest: DMatrix<f64>,
}

impl JointRows {
    /// The columns if a share of the arm's weight is in the torques.
    pub fn design(&self, gravity: f64) -> DMatrix<f64> {
        let mut design = DMatrix::zeros(self.own.nrows(), OWN + self.rest.ncols());
        design.columns_mut(0, OWN).copy_from(&self.own);
        let links = &self.rest + &self.gravity * gravity;
        design.columns_mut(OWN, links.ncols()).copy_from(&links);
        design
    }

    /// These rows alone.
    pub fn kept(&self, places: &[usize]) -> Self {
        let of = |matrix: &DMatrix<f64>| matrix.select_rows(places);
        Self { own: of(&self.own), gravity: of(&self.gravity), rest: of(&self.rest) }
    }
}

impl<'a> States<'a> {
    /// [`ROWS_PER_SECOND`], or fewer if there were more than `most` rows.
    pub fn new(motions: &'a [Motion], most: usize) -> Self {
        let seconds: f64 = motions.iter().map(Motion::seconds).sum();
        let rows_per_second = ROWS_PER_SECOND.min(most as f64 / seconds);
        let (mut rows, mut states, mut begins) = (Vec::new(), Vec::new(), Vec::new());
        for (at, motion) in motions.iter().enumerate() {
            begins.push(rows.len());
            let every = whole(motion.rate_hz / rows_per_second).max(1);
            let known = motion.uncertain()..motion.samples().saturating_sub(motion.uncertain());
            let coulomb =
                FRICTION_SPEEDS_RAD_S.map(|speed| motion.coulomb(&vec![speed; motion.joints]));
            for sample in known.step_by(every) {
                let all = [&motion.q, &motion.qd, &motion.qdd, &coulomb[0], &coulomb[1]];
                states.push(State(all.map(|rows| Joints::from(rows[sample].as_slice()))));
                rows.push(Row { motion: at, sample });
            }
        }
        Self { motions, rows, states, begins }
    }

    /// Not more than so many of the rows, evenly.
    pub fn thinned(&self, most: usize) -> Self {
        let every = self.rows.len().div_ceil(most).max(1);
        Self {
            motions: self.motions,
            rows: self.rows.iter().copied().step_by(every).collect(),
            states: self.states.iter().copied().step_by(every).collect(),
            begins: vec![0],
        }
    }

    /// The places of the rows at which a column of torques is not cut off, if it is at others.
    pub fn without_cuts(&self, column: usize) -> Option<Vec<usize>> {
        let near: Vec<Vec<bool>> =
            self.motions.iter().map(|motion| motion.near_cuts(column)).collect();
        if near.iter().all(Vec::is_empty) {
            return None;
        }
        let is_kept = |row: &Row| near[row.motion].get(row.sample) != Some(&true);
        let places = self.rows.iter().enumerate().filter(|(_, row)| is_kept(row));
        Some(places.map(|(place, _)| place).collect())
    }

    /// These rows alone. Each gap begins another series.
    pub fn kept(&self, places: &[usize]) -> Self {
        let follows = |at: usize| {
            at > 0 && places[at] == places[at - 1] + 1 && !self.begins.contains(&places[at])
        };
        Self {
            motions: self.motions,
            rows: places.iter().map(|place| self.rows[*place]).collect(),
            states: places.iter().map(|place| self.states[*place]).collect(),
            begins: (0..places.len()).filter(|at| !follows(*at)).collect(),
        }
    }

    pub const fn count(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are enough rows to tell anything.
    pub const fn are_enough(&self) -> bool {
        self.count() >= LEAST_ROWS
    }

    /// The longest period of the recordings, s.
    pub fn period_s(&self) -> f64 {
        self.motions.iter().map(|motion| 1.0 / motion.rate_hz).fold(0.0, f64::max)
    }

    /// The range of a column of positions, rad.
    pub fn range_rad(&self, column: usize) -> f64 {
        let positions = || self.states.iter().map(|state| state.0[0][column]);
        positions().fold(f64::NEG_INFINITY, f64::max) - positions().fold(f64::INFINITY, f64::min)
    }

    /// A column of positions, rad.
    pub fn positions(&self, column: usize) -> DVector<f64> {
        DVector::from_iterator(self.rows.len(), self.states.iter().map(|state| state.0[0][column]))
    }

    /// A column of torques, `later_s` after each row.
    pub fn torques(&self, column: usize, later_s: f64) -> DVector<f64> {
        let of = |row: &Row| {
            let motion = &self.motions[row.motion];
            interpolated(&motion.u, column, row.sample, later_s * motion.rate_hz)
        };
        DVector::from_iterator(self.rows.len(), self.rows.iter().map(of))
    }

    /// The columns of each joint's regression if the recording has this layout.
    pub fn columns(&self, arm: &Prior, layout: &Layout) -> Vec<JointRows> {
        let robot = arm.arm.nominal();
        let joints = robot.joints();
        let (linear, derivatives) = (arm.arm.linear(), arm.arm.derivatives());
        // The torques of a link's description, and of one standard deviation of each of its numbers.
        let links: Vec<DMatrix<f64>> = (0..joints)
            .map(|link| {
                let at = link * NUMBERS;
                let mut all = DMatrix::zeros(LINK_PARAMETERS, 1 + LINK_PARAMETERS);
                all.column_mut(0).copy_from(&linear.rows(at, LINK_PARAMETERS));
                for k in 0..LINK_PARAMETERS {
                    let derivative = derivatives.view((at, at + k), (LINK_PARAMETERS, 1));
                    let deviation = SPREAD * arm.deviations[at + k];
                    all.column_mut(1 + k).copy_from(&(derivative * deviation));
                }
                all
            })
            .collect();
        let count = self.count();
        let mut columns: Vec<JointRows> = (0..joints)
            .map(|joint| JointRows {
                own: DMatrix::zeros(count, OWN),
                gravity: DMatrix::zeros(count, (joints - joint) * LINK_PARAMETERS),
                rest: DMatrix::zeros(count, (joints - joint) * LINK_PARAMETERS),
            })
            .collect();
        let still = Joints::splat(joints, 0.0);
        let [mut weight, mut all] = [(); 2].map(|()| vec![0.0; joints * joints * LINK_PARAMETERS]);
        for (row, state) in self.states.iter().enumerate() {
            let [q, qd, qdd, slow, fast] = state.0.map(|values| layout.applied(&values));
            torque_regressor(&robot.kinematics, robot.gravity, &q, &still, &still, &mut weight);
            torque_regressor(&robot.kinematics, robot.gravity, &q, &qd, &qdd, &mut all);
            for (joint, columns) in columns.iter_mut().enumerate() {
                let own = [slow[joint], fast[joint], qd[joint], qdd[joint], 1.0];
                for (k, value) in own.into_iter().enumerate() {
                    columns.own[(row, REST + 1 + k)] = value;
                }
                for (link, of_link) in links.iter().enumerate().skip(joint) {
                    let at = (joint * joints + link) * LINK_PARAMETERS;
                    let place = (link - joint) * LINK_PARAMETERS;
                    for k in 0..=LINK_PARAMETERS {
                        let of = |regressor: &[f64]| -> f64 {
                            let entries = regressor[at..at + LINK_PARAMETERS].iter();
                            entries.zip(of_link.column(k).iter()).map(|(y, x)| y * x).sum()
                        };
                        let gravity = of(&weight);
                        let rest = of(&all) - gravity;
                        match k.checked_sub(1) {
                            None => {
                                columns.own[(row, GRAVITY)] += gravity;
                                columns.own[(row, REST)] += rest;
                            }
                            Some(k) => {
                                columns.gravity[(row, place + k)] = gravity;
                                columns.rest[(row, place + k)] = rest;
                            }
                        }
                    }
                }
            }
        }
        columns
    }
}

/// A column at a fraction of a sample, by the polynomial through the six samples around it.
fn interpolated(rows: &[Vec<f64>], column: usize, sample: usize, later: f64) -> f64 {
    let place = sample as f64 + later;
    let before = whole(place.floor());
    let share = place - before as f64;
    let last = rows.len() - 1;
    let nodes = [-2.0, -1.0, 0.0, 1.0, 2.0, 3.0];
    let value = |node: usize| rows[(before + node).saturating_sub(2).min(last)][column];
    let weight = |node: usize| -> f64 {
        let others = nodes.iter().enumerate().filter(|(other, _)| *other != node);
        others.map(|(_, other)| (share - other) / (nodes[node] - other)).product()
    };
    (0..nodes.len()).map(|node| weight(node) * value(node)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_series_is_known_between_its_samples() {
        let wave = |place: f64| (0.6 * place).sin();
        let rows: Vec<Vec<f64>> = (0..40).map(|sample| vec![wave(f64::from(sample))]).collect();
        for later in [-5.3, -0.5, 0.0, 0.25, 7.9] {
            let value = interpolated(&rows, 0, 20, later);
            assert!((value - wave(20.0 + later)).abs() < 1e-3, "{later}: {value}");
        }
    }
}
