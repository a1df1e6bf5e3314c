//! A linear law of motion without an arm: autoregression with exogenous inputs.

use nalgebra::{DMatrix, DVector};

use crate::motion::{Motion, whole};
use crate::torques::ROWS_PER_SECOND;

/// v[k] = Σ a_i v[k-i] + Σ b_ij u_j[k+1-i] + c, i = 1 .. order, for each joint, in mean velocities v
/// and mean torques u over periods of 40 ms (Ljung 1999, "System Identification", section 4.2). It
/// is fitted to all recordings by ridge regression.
#[derive(Clone, Debug)]
pub(crate) struct Arx {
    order: usize,
    /// Samples of a period.
    every: usize,
    /// A column per joint: Σ over lags of velocities, then of the torques of each joint, then 1.
    coefficients: DMatrix<f64>,
}

/// Orders that are tried, if the uncertain ends of a recording have room for the periods before a
/// window.
const ORDERS: [usize; 4] = [1, 2, 4, 6];
/// Ridges relative to the mean square of each regressor.
const RIDGES: [f64; 3] = [1e-6, 1e-3, 1e-1];

impl Arx {
    /// The laws of every order and ridge. Recordings that are too short give none.
    pub(crate) fn laws(motions: &[Motion]) -> Vec<Self> {
        let room = motions[0].uncertain() / samples_of_period(motions[0].rate_hz);
        let orders = ORDERS.into_iter().filter(|order| *order <= room);
        orders.flat_map(|order| Self::of_order(order, motions)).collect()
    }

    fn of_order(order: usize, motions: &[Motion]) -> Vec<Self> {
        let (joints, rate_hz) = (motions[0].joints, motions[0].rate_hz);
        let every = samples_of_period(rate_hz);
        let width = order * (1 + joints) + 1;
        let mut grams = vec![DMatrix::zeros(width, width); joints];
        let mut moments = vec![DVector::zeros(width); joints];
        let mut rows = 0_u32;
        for motion in motions {
            let first = motion.uncertain().max(order * every);
            let last = motion.samples().saturating_sub(motion.uncertain() + every);
            for sample in first..last {
                let past = Past::at(motion, sample, order, every);
                let torques = past.torques_with(&mean_torques(motion, sample, every));
                for joint in 0..joints {
                    let row = past.row(joint, &torques);
                    let next = velocity(motion, sample, every, joint);
                    grams[joint].ger(1.0, &row, &row, 1.0);
                    moments[joint].axpy(next, &row, 1.0);
                }
                rows += 1;
            }
        }
        if f64::from(rows) < 2.0 * width as f64 {
            return Vec::new();
        }
        let law = |ridge: f64| {
            let mut coefficients = DMatrix::zeros(width, joints);
            for joint in 0..joints {
                let mut gram = grams[joint].clone();
                for k in 0..width - 1 {
                    gram[(k, k)] += ridge * gram[(k, k)] + f64::MIN_POSITIVE;
                }
                coefficients.set_column(joint, &gram.cholesky()?.solve(&moments[joint]));
            }
            Some(Self { order, every, coefficients })
        };
        RIDGES.into_iter().filter_map(law).collect()
    }

    /// Positions from a sample on, `[sample, joint]`, rad: `count` samples, the first of which is
    /// measured. The torques are those that were recorded.
    pub(crate) fn rollout(&self, motion: &Motion, start: usize, count: usize) -> Vec<f64> {
        let Self { order, every, ref coefficients } = *self;
        let mut past = Past::at(motion, start, order, every);
        let mut position = motion.q[start].clone();
        let mut positions = Vec::with_capacity(count * motion.joints);
        let mut sample = start;
        while positions.len() < count * motion.joints {
            let torques = past.torques_with(&mean_torques(motion, sample, every));
            let velocities: Vec<f64> = (0..motion.joints)
                .map(|joint| past.row(joint, &torques).dot(&coefficients.column(joint)))
                .collect();
            for _ in 0..every {
                positions.extend(&position);
                for (position, velocity) in position.iter_mut().zip(&velocities) {
                    *position += velocity / motion.rate_hz;
                }
            }
            past.advance(velocities, torques);
            sample += every;
        }
        positions.truncate(count * motion.joints);
        positions
    }
}

fn samples_of_period(rate_hz: f64) -> usize {
    whole(rate_hz / ROWS_PER_SECOND).max(1)
}

/// Velocities and torques of the periods before one, the last first.
struct Past {
    /// `[lag][joint]`, rad/s.
    velocities: Vec<Vec<f64>>,
    /// `[lag][joint]`, N·m.
    torques: Vec<Vec<f64>>,
}

impl Past {
    fn at(motion: &Motion, sample: usize, order: usize, every: usize) -> Self {
        let begin = |lag: usize| sample - lag * every;
        let velocities = |lag: usize| {
            (0..motion.joints).map(|joint| velocity(motion, begin(lag), every, joint)).collect()
        };
        Self {
            velocities: (1..=order).map(velocities).collect(),
            torques: (1..order).map(|lag| mean_torques(motion, begin(lag), every)).collect(),
        }
    }

    /// The torques of this period and of those before.
    fn torques_with(&self, now: &[f64]) -> Vec<Vec<f64>> {
        std::iter::once(now.to_vec()).chain(self.torques.iter().cloned()).collect()
    }

    fn row(&self, joint: usize, torques: &[Vec<f64>]) -> DVector<f64> {
        let velocities = self.velocities.iter().map(|velocities| velocities[joint]);
        let torques = torques.iter().flatten().copied();
        let width = self.velocities.len() + torques.clone().count() + 1;
        DVector::from_iterator(width, velocities.chain(torques).chain([1.0]))
    }

    fn advance(&mut self, velocities: Vec<f64>, mut torques: Vec<Vec<f64>>) {
        self.velocities.pop();
        self.velocities.insert(0, velocities);
        torques.pop();
        self.torques = torques;
    }
}

/// The mean velocity of a joint over the period that begins at a sample, rad/s.
fn velocity(motion: &Motion, sample: usize, every: usize, joint: usize) -> f64 {
    (motion.q[sample + every][joint] - motion.q[sample][joint]) * motion.rate_hz / every as f64
}

/// The mean torques over the period that begins at a sample, or what a recording has of it, N·m.
fn mean_torques(motion: &Motion, sample: usize, every: usize) -> Vec<f64> {
    let end = (sample + every).min(motion.samples());
    let rows = &motion.recorded_u[sample.min(end - 1)..end];
    (0..motion.joints)
        .map(|joint| rows.iter().map(|row| row[joint]).sum::<f64>() / rows.len() as f64)
        .collect()
}
