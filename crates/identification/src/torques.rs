//! The regression on torques.

use dynamics::{Joints, LINK_PARAMETERS, torque_regressor};
use nalgebra::{DMatrix, DVector};

use crate::arm::{Arm, FRICTION, JOINT_NUMBERS, NUMBERS};
use crate::fourier::MotionState;
use crate::motion::{Motion, whole};
use crate::normal_equations::NormalEquations;
use crate::trace::Trace;

/// Rows of a regression per second of its recordings.
pub(crate) const ROWS_PER_SECOND: f64 = 25.0;

/// The regression on one joint's torque: rows `[sample, value]`, N·m.
struct JointRegression {
    rows: DMatrix<f64>,
    torques: DVector<f64>,
    /// Rows that do not count, because the torque is cut off there.
    left_out: Vec<usize>,
    /// rowsᵀ rows and rowsᵀ torques.
    gram: DMatrix<f64>,
    moment: DVector<f64>,
    /// Σ torques².
    square: f64,
    /// One over the variance of what the arm cannot explain, per sample that counts.
    weight: f64,
    /// Consecutive samples that count as one.
    alike: f64,
}

/// The regressions on the torques of all joints.
pub(crate) struct Torques {
    joints: Vec<JointRegression>,
    /// The speeds of the bends about which torques are linear, rad/s.
    bends_rad_s: Vec<f64>,
    /// Where each recording begins in the rows.
    begins: Vec<usize>,
    /// Samples from one row to the next, and before the first of a recording.
    every: usize,
    first: usize,
}

impl Torques {
    /// Rows at [`ROWS_PER_SECOND`], which is more than the motions' bandwidth needs.
    pub(crate) fn new(arm: &Arm, motions: &[Motion]) -> Self {
        let joints = arm.joints();
        let width = joints * NUMBERS;
        let mut rows: Vec<Vec<f64>> = vec![Vec::new(); joints];
        let mut torques: Vec<Vec<f64>> = vec![Vec::new(); joints];
        let mut left_out: Vec<Vec<usize>> = vec![Vec::new(); joints];
        let mut begins = Vec::new();
        let bends_rad_s = arm.bends_rad_s();
        let (mut every, mut first) = (1, 0);
        for motion in motions {
            begins.push(torques[0].len());
            every = whole(motion.rate_hz / ROWS_PER_SECOND).max(1);
            first = motion.uncertain();
            let (coulomb, of_bend) =
                (motion.coulomb(&bends_rad_s), motion.slopes_of_bends(&bends_rad_s));
            let known = motion.uncertain()..motion.samples() - motion.uncertain();
            let near_cuts: Vec<Vec<bool>> =
                (0..joints).map(|joint| motion.near_cuts(joint)).collect();
            let later = arm.delay_s.unwrap_or(0.0) * motion.rate_hz;
            for sample in known.step_by(every) {
                let u = motion.later_u(sample, arm.delay_s.unwrap_or(0.0));
                let [q, qd, qdd] = [&motion.q, &motion.qd, &motion.qdd]
                    .map(|rows| Joints::from(rows[sample].as_slice()));
                let state = MotionState { q, qd, qdd };
                let regressor = regressor(arm, &state, [&coulomb[sample], &of_bend[sample]]);
                for joint in 0..joints {
                    if near_cuts[joint].get(whole(sample as f64 + later)) == Some(&true) {
                        left_out[joint].push(torques[joint].len());
                    }
                    rows[joint].extend(&regressor[joint * width..][..width]);
                    torques[joint].push(u[joint]);
                }
            }
        }
        let joint = |((rows, torques), left_out): ((Vec<f64>, Vec<f64>), Vec<usize>)| {
            let rows = DMatrix::from_row_slice(torques.len(), width, &rows);
            JointRegression::new(rows, DVector::from_vec(torques), left_out)
        };
        let joints = rows.into_iter().zip(torques).zip(left_out).map(joint).collect();
        Self { joints, bends_rad_s, begins, every, first }
    }

    /// The same regressions, with the same weights, linear about the bends of `arm`.
    pub(crate) fn about(mut self, arm: &Arm, motions: &[Motion]) -> Self {
        let bends_rad_s = arm.bends_rad_s();
        let mut begin = 0;
        for motion in motions {
            let friction = [motion.coulomb(&bends_rad_s), motion.slopes_of_bends(&bends_rad_s)];
            let known = motion.uncertain()..motion.samples() - motion.uncertain();
            let samples: Vec<usize> = known.step_by(self.every).collect();
            for (at, joint) in self.joints.iter_mut().enumerate() {
                for (place, values) in FRICTION.into_iter().zip(&friction) {
                    for (row, &sample) in samples.iter().enumerate() {
                        joint.rows[(begin + row, at * NUMBERS + place)] = values[sample][at];
                    }
                }
            }
            begin += samples.len();
        }
        for joint in &mut self.joints {
            joint.sum();
        }
        Self { bends_rad_s, ..self }
    }

    /// The largest ratio of a bend's speed to that about which torques are linear, or of that to it.
    pub(crate) fn bent_by(&self, arm: &Arm) -> f64 {
        let bends_rad_s = arm.bends_rad_s();
        let each = bends_rad_s.iter().zip(&self.bends_rad_s);
        each.map(|(bend, about)| (bend / about).max(about / bend)).fold(1.0, f64::max)
    }

    /// The values of [`Arm::linear_about`] as each joint's sensor measures them.
    fn measured(&self, arm: &Arm) -> impl Iterator<Item = DVector<f64>> + use<> {
        let linear = arm.linear_about(&self.bends_rad_s);
        arm.gains().into_iter().map(move |gain| &linear * gain)
    }

    /// The root mean square of each joint's torque less the arm's, N·m.
    pub(crate) fn residuals_nm(&self, arm: &Arm) -> Vec<f64> {
        let of = |(joint, linear): (&JointRegression, DVector<f64>)| {
            (joint.square_of(&linear) / joint.count()).sqrt()
        };
        self.joints.iter().zip(self.measured(arm)).map(of).collect()
    }

    /// The torques of each joint of a recording, beside those of two arms.
    pub(crate) fn traces(motion: &Motion, described: &Arm, identified: &Arm) -> Vec<Trace> {
        let of = |arm: &Arm| {
            let torques = Self::new(arm, std::slice::from_ref(motion));
            let linear = torques.measured(arm);
            let predicted = torques.joints.iter().zip(linear).map(|(joint, linear)| {
                let predicted = &joint.rows * linear;
                predicted.as_slice().to_vec()
            });
            (predicted.collect::<Vec<Vec<f64>>>(), torques)
        };
        let ((described, _), (identified, torques)) = (of(described), of(identified));
        let trace = |(joint, (described, identified)): (&JointRegression, (_, _))| Trace {
            times_s: (0..joint.torques.len())
                .map(|row| (torques.first + row * torques.every) as f64 / motion.rate_hz)
                .collect(),
            measured: joint.torques.as_slice().to_vec(),
            described,
            identified,
        };
        torques.joints.iter().zip(described.into_iter().zip(identified)).map(trace).collect()
    }

    /// Standard deviation of each joint's torque, N·m.
    pub(crate) fn deviations_nm(&self) -> Vec<f64> {
        let of = |joint: &JointRegression| {
            let mean = joint.counting(joint.torques.clone()).sum() / joint.count();
            (joint.square / joint.count() - mean * mean).max(0.0).sqrt()
        };
        self.joints.iter().map(of).collect()
    }

    /// Weighs the torques of each joint by what `arm` leaves unexplained. Neighbouring samples are
    /// alike, so a sample counts only as much as its share of independent ones.
    pub(crate) fn weigh(&mut self, arm: &Arm) {
        /// No sensor is better, relative to the torques that it measures.
        const LEAST_DEVIATION: f64 = 1e-4;

        let (begins, measured) = (self.begins.clone(), self.measured(arm));
        for (joint, linear) in self.joints.iter_mut().zip(measured) {
            let residuals = joint.residuals(&linear);
            let mean_square = residuals.norm_squared() / joint.count();
            let least = LEAST_DEVIATION.powi(2) * joint.square / joint.count();
            joint.alike = samples_alike(residuals.as_slice(), &begins, &joint.left_out);
            joint.weight = 1.0 / (mean_square.max(least).max(f64::MIN_POSITIVE) * joint.alike);
        }
    }

    /// Weighs the torques of each joint by independent noise of this standard deviation, N·m.
    pub(crate) fn weighed_by(mut self, noise_nm: &[f64]) -> Self {
        for (joint, noise) in self.joints.iter_mut().zip(noise_nm) {
            joint.weight = noise.powi(-2);
        }
        self
    }

    /// As how many independent samples the torques of each joint count.
    pub(crate) fn independent_samples(&self) -> Vec<f64> {
        self.joints.iter().map(|joint| joint.count() / joint.alike).collect()
    }

    /// ½ Σ of the weighted squares at the arm's numbers.
    pub(crate) fn cost(&self, arm: &Arm) -> f64 {
        let of = |(joint, linear): (&JointRegression, DVector<f64>)| {
            0.5 * joint.weight * joint.square_of(&linear)
        };
        self.joints.iter().zip(self.measured(arm)).map(of).sum()
    }

    pub(crate) fn normal_equations(&self, arm: &Arm) -> NormalEquations {
        let (of_arm, gains) = (arm.derivatives_about(&self.bends_rad_s), arm.gains());
        let size = arm.numbers.len();
        let mut equations = NormalEquations {
            cost: self.cost(arm),
            gradient: DVector::zeros(size),
            curvature: DMatrix::zeros(size, size),
        };
        for (at, (joint, linear)) in self.joints.iter().zip(self.measured(arm)).enumerate() {
            let mut derivatives = &of_arm * gains[at];
            derivatives.set_column(Arm::gain_number(at), &linear);
            let slope = (&joint.gram * &linear - &joint.moment) * joint.weight;
            equations.gradient += derivatives.tr_mul(&slope);
            equations.curvature += derivatives.tr_mul(&(&joint.gram * joint.weight * &derivatives));
        }
        equations
    }
}

impl JointRegression {
    fn new(rows: DMatrix<f64>, torques: DVector<f64>, left_out: Vec<usize>) -> Self {
        let (gram, moment) = (DMatrix::zeros(0, 0), DVector::zeros(0));
        let mut joint =
            Self { rows, torques, left_out, gram, moment, square: 0.0, weight: 1.0, alike: 1.0 };
        joint.square = joint.counting(joint.torques.clone()).norm_squared();
        joint.sum();
        joint
    }

    /// Sums over the rows that count.
    fn sum(&mut self) {
        let mut counted = self.rows.clone();
        for row in &self.left_out {
            counted.row_mut(*row).fill(0.0);
        }
        self.gram = counted.tr_mul(&counted);
        self.moment = counted.tr_mul(&self.torques);
    }

    /// The values of the rows, with 0 where they do not count.
    fn counting(&self, mut values: DVector<f64>) -> DVector<f64> {
        for row in &self.left_out {
            values[*row] = 0.0;
        }
        values
    }

    /// The number of rows that count, at least 1.
    fn count(&self) -> f64 {
        (self.torques.len() - self.left_out.len()).max(1) as f64
    }

    /// Torque − row · linear, and 0 in rows that do not count.
    fn residuals(&self, linear: &DVector<f64>) -> DVector<f64> {
        self.counting(&self.torques - &self.rows * linear)
    }

    /// Σ (torque − row · linear)².
    fn square_of(&self, linear: &DVector<f64>) -> f64 {
        self.residuals(linear).norm_squared()
    }
}

/// The torques of all joints in a state, linear in the values of [`Arm::linear_about`]:
/// `[joint][value]`. `coulomb` is friction of 1 N·m, and `of_bend` its derivative by the logarithm of
/// the bend's speed.
pub(crate) fn regressor(
    arm: &Arm,
    state: &MotionState,
    [coulomb, of_bend]: [&[f64]; 2],
) -> Vec<f64> {
    let joints = arm.joints();
    let robot = arm.nominal();
    let MotionState { q, qd, qdd } = state;
    let mut of_links = vec![0.0; joints * joints * LINK_PARAMETERS];
    torque_regressor(&robot.kinematics, robot.gravity, q, qd, qdd, &mut of_links);
    let mut regressor = vec![0.0; joints * joints * NUMBERS];
    for joint in 0..joints {
        for link in 0..joints {
            let from = &of_links[(joint * joints + link) * LINK_PARAMETERS..][..LINK_PARAMETERS];
            regressor[(joint * joints + link) * NUMBERS..][..LINK_PARAMETERS].copy_from_slice(from);
        }
        let own = (joint * joints + joint) * NUMBERS + LINK_PARAMETERS;
        regressor[own..][..JOINT_NUMBERS].copy_from_slice(&[
            coulomb[joint],
            qd[joint],
            1.0,
            qdd[joint],
            0.0,
            of_bend[joint],
        ]);
    }
    regressor
}

/// How many consecutive samples count as one: 1 + 2 Σ ρ over the autocorrelations ρ before the first
/// negative one. The residuals of rows that are left out are 0.
pub(crate) fn samples_alike(residuals: &[f64], begins: &[usize], left_out: &[usize]) -> f64 {
    const LONGEST: usize = 200;

    let ends = begins.iter().skip(1).copied().chain([residuals.len()]);
    let recordings: Vec<&[f64]> =
        begins.iter().zip(ends).map(|(&begin, end)| &residuals[begin..end]).collect();
    let covariance = |lag: usize| -> f64 {
        let of = |values: &&[f64]| -> f64 {
            values.iter().zip(values.iter().skip(lag)).map(|(a, b)| a * b).sum()
        };
        recordings.iter().map(of).sum()
    };
    let variance = covariance(0);
    if variance == 0.0 {
        return 1.0;
    }
    let pairs = CountedPairs::new(residuals.len(), left_out);
    let correlations = (1..LONGEST).map(|lag| covariance(lag) / variance * pairs.correction(lag));
    1.0 + 2.0 * correlations.take_while(|correlation| *correlation > 0.0).sum::<f64>()
}

/// Pairs of rows that both count.
struct CountedPairs {
    counts: Vec<bool>,
    is_complete: bool,
}

impl CountedPairs {
    fn new(rows: usize, left_out: &[usize]) -> Self {
        let mut counts = vec![true; rows];
        for row in left_out {
            counts[*row] = false;
        }
        Self { counts, is_complete: left_out.is_empty() }
    }

    /// The factor by which sums over the pairs of rows `lag` apart are too small, beside the sum over
    /// all rows.
    fn correction(&self, lag: usize) -> f64 {
        if self.is_complete {
            return 1.0;
        }
        let share = |lag: usize| {
            let later = self.counts.iter().skip(lag);
            let both = self.counts.iter().zip(later).filter(|(a, b)| **a && **b).count();
            both as f64 / self.counts.len().saturating_sub(lag).max(1) as f64
        };
        let (pairs, rows) = (share(lag), share(0));
        if pairs > 0.0 { rows / pairs } else { 0.0 }
    }
}
