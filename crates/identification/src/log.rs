//! Logs of an arm at the times of their rows.

use series::LowPass;

use crate::Recording;

/// The highest rate of recordings from logs, Hz. Arms move far more slowly.
const MAX_RATE_HZ: f64 = 250.0;

/// The edge of the low-pass that a faster log passes, as a share of the recording's rate.
const EDGE: f64 = 0.4;

/// Rows of a log, whose times rise.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// A name for reports and errors.
    pub name: String,
    /// At least two rows.
    pub rows: Vec<LogRow>,
}

/// A row of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LogRow {
    /// Its time from any origin, s.
    pub time_s: f64,
    /// The position of each joint, rad.
    pub q: Vec<f64>,
    /// The torque of each joint, N·m.
    pub u: Vec<f64>,
}

impl Log {
    /// Samples per second for recordings: the log's own, at most 250.
    pub fn rate_hz(&self) -> f64 {
        self.own_rate_hz().min(MAX_RATE_HZ)
    }

    /// One over the median time between rows.
    fn own_rate_hz(&self) -> f64 {
        let mut periods: Vec<f64> =
            self.rows.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
        periods.sort_by(f64::total_cmp);
        1.0 / periods[periods.len() / 2]
    }

    /// The log at even times. A log with a higher rate than `rate_hz` passes a low-pass without
    /// delay before, so that nothing from above half of the rate is folded into it.
    pub fn recording(&self, rate_hz: f64) -> Recording {
        let own_rate_hz = self.own_rate_hz();
        match LowPass::new(EDGE * rate_hz, own_rate_hz) {
            Some(filter) if own_rate_hz > rate_hz => {
                let dense = self.at_even_times(own_rate_hz);
                let rows = (0_u32..)
                    .zip(filter.apply_to_columns(&dense.q))
                    .zip(filter.apply_to_columns(&dense.u))
                    .map(|((sample, q), u)| LogRow {
                        time_s: f64::from(sample) / own_rate_hz,
                        q,
                        u,
                    })
                    .collect();
                Self { name: dense.name, rows }.at_even_times(rate_hz)
            }
            _ => self.at_even_times(rate_hz),
        }
    }

    /// The log at even times. Values between two rows are interpolated.
    fn at_even_times(&self, rate_hz: f64) -> Recording {
        let (first, last) = (self.rows[0].time_s, self.rows[self.rows.len() - 1].time_s);
        let mut recording =
            Recording { name: self.name.clone(), rate_hz, q: Vec::new(), u: Vec::new() };
        let mut at = 0;
        let times = (0_u32..).map(|sample| first + f64::from(sample) / rate_hz);
        for time_s in times.take_while(|time_s| *time_s < last) {
            while at + 2 < self.rows.len() && self.rows[at + 1].time_s <= time_s {
                at += 1;
            }
            let (before, after) = (&self.rows[at], &self.rows[at + 1]);
            let share = (time_s - before.time_s) / (after.time_s - before.time_s);
            let between = |before: &[f64], after: &[f64]| {
                before
                    .iter()
                    .zip(after)
                    .map(|(before, after)| before + share * (after - before))
                    .collect()
            };
            recording.q.push(between(&before.q, &after.q));
            recording.u.push(between(&before.u, &after.u));
        }
        recording
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(rate_hz: f64, rows: u32, value: impl Fn(f64) -> [f64; 2]) -> Log {
        let row = |k: u32| {
            let time_s = f64::from(k) / rate_hz;
            let [q, u] = value(time_s);
            LogRow { time_s, q: vec![q], u: vec![u] }
        };
        Log { name: "log".to_owned(), rows: (0..rows).map(row).collect() }
    }

    #[test]
    fn values_between_rows_are_interpolated() {
        let recording = log(100.0, 3, |t| [200.0 * t, 300.0 * t]).recording(200.0);
        assert_eq!(recording.q.len(), 4);
        assert!((recording.q[1][0] - 1.0).abs() < 1e-12);
        assert!((recording.u[3][0] - 4.5).abs() < 1e-12);
    }

    #[test]
    fn a_faster_log_is_filtered_before_samples_are_left_out() {
        // 1 Hz, and 240 Hz, which would become 10 Hz at 250 samples per second.
        let log = log(1000.0, 2000, |t| {
            [1.0, 240.0].map(|hz: f64| (std::f64::consts::TAU * hz * t).sin())
        });
        assert!((log.rate_hz() - 250.0).abs() < 1e-6);
        let recording = log.recording(250.0);
        for (k, (q, u)) in recording.q.iter().zip(&recording.u).enumerate().skip(50).take(400) {
            let expected = (std::f64::consts::TAU * k as f64 / 250.0).sin();
            assert!((q[0] - expected).abs() < 1e-3, "{k}: {} {expected}", q[0]);
            assert!(u[0].abs() < 0.02, "{k}: {}", u[0]);
        }
    }
}
