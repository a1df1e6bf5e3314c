//! The gains of a Kalman filter, which do not depend on the measured values.

use super::Filtered;

/// Position in rad, velocity in rad/s, acceleration in rad/s².
pub(crate) type State = [f64; 3];
type Matrix = [[f64; 3]; 3];

/// Initial standard deviations. The estimated position is then that of the first sample.
const INITIAL_DEVIATION: State = [1.0, 10.0, 1000.0];

#[derive(Clone, Debug)]
pub(crate) struct Gains {
    /// Sampling time, s.
    period: f64,
    /// The sum of the logarithms of the innovations' variances.
    log_variances: f64,
    samples: Vec<Sample>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    gain: State,
    /// 1 / variance of the innovation, rad⁻².
    precision: f64,
    /// Covariance of the state, given all samples up to this one.
    covariance: Matrix,
}

impl Gains {
    pub fn new(samples: usize, rate_hz: f64, deviation_rad: f64, intensity: f64) -> Self {
        let period = rate_hz.recip();
        let drift = drift(period, intensity);
        let mut covariance = [[0.0; 3]; 3];
        for (place, deviation) in INITIAL_DEVIATION.into_iter().enumerate() {
            covariance[place][place] = deviation * deviation;
        }
        let noise = deviation_rad * deviation_rad;
        let mut log_variances = 0.0;
        let samples = (0..samples).map(|sample| {
            if sample > 0 {
                covariance = predicted(&covariance, period, &drift);
            }
            let variance = covariance[0][0] + noise;
            let gain = covariance.map(|row| row[0] / variance);
            covariance = measured(&covariance, gain, noise, variance);
            log_variances += variance.ln();
            Sample { gain, precision: variance.recip(), covariance }
        });
        let samples = samples.collect();
        Self { period, log_variances, samples }
    }

    /// The negative log-likelihood of the measured positions, up to a constant.
    pub fn surprise(&self, measured: &[f64]) -> f64 {
        let mut surprise = self.log_variances;
        self.pass(measured, |sample, filtered| {
            surprise += filtered.innovation * filtered.innovation * sample.precision;
        });
        surprise / 2.0
    }

    pub fn filter(&self, measured: &[f64]) -> Vec<Filtered> {
        let mut all = Vec::with_capacity(measured.len());
        self.pass(measured, |_, filtered| all.push(filtered));
        all
    }

    fn pass(&self, measured: &[f64], mut visit: impl FnMut(&Sample, Filtered)) {
        let mut state = [measured.first().copied().unwrap_or_default(), 0.0, 0.0];
        for (number, (sample, measured)) in self.samples.iter().zip(measured).enumerate() {
            if number > 0 {
                state = moved(state, self.period);
            }
            let innovation = measured - state[0];
            for (value, gain) in state.iter_mut().zip(sample.gain) {
                *value += gain * innovation;
            }
            visit(sample, Filtered { state, innovation });
        }
    }

    /// The states, given all measured positions.
    pub fn smooth(&self, filtered: Vec<Filtered>) -> Vec<State> {
        let mut adjoint = [0.0; 3];
        let mut smoothed: Vec<State> = Vec::with_capacity(filtered.len());
        for (sample, Filtered { mut state, innovation }) in self.samples.iter().zip(filtered).rev()
        {
            for (value, row) in state.iter_mut().zip(&sample.covariance) {
                *value -= dot(row, &adjoint);
            }
            smoothed.push(state);
            // Back over the measurement, and then over the sampling time before it.
            adjoint[0] -= dot(&sample.gain, &adjoint) + innovation * sample.precision;
            let [q, v, a] = adjoint;
            let h = self.period;
            adjoint = [q, h.mul_add(q, v), (0.5 * h * h).mul_add(q, h.mul_add(v, a))];
        }
        smoothed.reverse();
        smoothed
    }
}

/// The state after a sampling time without jerk.
fn moved([q, v, a]: State, h: f64) -> State {
    [q + h * (v + 0.5 * h * a), v + h * a, a]
}

fn predicted(covariance: &Matrix, period: f64, drift: &Matrix) -> Matrix {
    // Columns, then rows.
    let columns = covariance.map(|row| moved(row, period));
    let transposed = |matrix: &Matrix| -> Matrix {
        std::array::from_fn(|row| std::array::from_fn(|column| matrix[column][row]))
    };
    let both = transposed(&columns).map(|row| moved(row, period));
    std::array::from_fn(|row| std::array::from_fn(|column| both[row][column] + drift[row][column]))
}

/// The covariance after a measurement, in Joseph's form, which stays positive.
fn measured(covariance: &Matrix, gain: State, noise: f64, variance: f64) -> Matrix {
    let left = [noise / variance, -gain[1], -gain[2]];
    // Subtracts the gain's share of the position.
    let less =
        |row: State| [left[0] * row[0], row[1] + left[1] * row[0], row[2] + left[2] * row[0]];
    let columns = covariance.map(less);
    let transposed: Matrix =
        std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row]));
    let both = transposed.map(less);
    std::array::from_fn(|row| {
        std::array::from_fn(|column| both[row][column] + noise * gain[row] * gain[column])
    })
}

/// Covariance that white jerk adds over a sampling time (Bar-Shalom, Li and Kirubarajan 2001,
/// section 6.2.3).
fn drift(h: f64, intensity: f64) -> Matrix {
    let [two, three, four, five] = [h * h, h.powi(3), h.powi(4), h.powi(5)];
    let entries = [
        [five / 20.0, four / 8.0, three / 6.0],
        [four / 8.0, three / 3.0, two / 2.0],
        [three / 6.0, two / 2.0, h],
    ];
    entries.map(|row| row.map(|entry| intensity * entry))
}

fn dot(a: &State, b: &State) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
