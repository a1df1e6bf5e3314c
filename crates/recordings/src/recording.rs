//! A recording: checks its timing, or resamples it to the dataset's rate.

use spec::{ImportSpec, Resampling, TimeUnit};

use crate::error::{Place, RowError};
use crate::samples::Sample;

/// Times that differ by less than this part of a period are equal. Seconds in f32, and decimals
/// with a few digits, are not more precise.
const SAME_TIME: f64 = 1e-3;

/// The part of a period by which a period may be wrong without resampling.
const PERIOD_TOLERANCE: f64 = 0.1;

/// The part of a recording by which its length may differ from its number of samples.
const RATE_TOLERANCE: f64 = 0.01;

#[derive(Debug)]
pub(crate) struct Recording {
    pub name: Option<String>,
    /// The place of its first row.
    pub first: Place,
    pub rows: u64,
    start_s: f64,
    last: Option<Sample>,
    /// The accepted sample that was not handed out yet.
    incoming: Option<Sample>,
    /// Number of samples handed out.
    pub samples: u64,
}

impl Recording {
    pub const fn new(name: Option<String>, first: Place) -> Self {
        Self { name, first, rows: 0, start_s: 0.0, last: None, incoming: None, samples: 0 }
    }

    /// # Errors
    /// When the next row has a wrong time.
    pub fn check(&self, sample: &Sample, spec: &ImportSpec) -> Result<(), RowError> {
        let Some(last) = self.last else { return Ok(()) };
        self.check_period(sample.time_s - last.time_s, sample.place, spec)
    }

    /// Accepts the next row, after [`Self::advance`] has nothing more to hand out.
    pub const fn accept(&mut self, sample: Sample) {
        if self.last.is_none() {
            self.start_s = sample.time_s;
        }
        self.rows += 1;
        self.incoming = Some(sample);
    }

    /// The next sample of the dataset, as far as rows were accepted.
    pub fn advance(&mut self, spec: &ImportSpec) -> Option<Sample> {
        let next = self.incoming?;
        let Some(last) = self.last.filter(|_| spec.resampling == Resampling::Linear) else {
            self.last = self.incoming.take();
            self.samples += 1;
            return Some(next);
        };
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 samples")]
        let at = self.start_s + self.samples as f64 / spec.rate_hz;
        let tolerance = SAME_TIME / spec.rate_hz;
        if at > next.time_s + tolerance {
            self.last = self.incoming.take();
            return None;
        }
        self.samples += 1;
        Some(if at >= next.time_s - tolerance {
            next
        } else {
            between(&last, &next, at, spec.joints())
        })
    }

    fn check_period(&self, period: f64, place: Place, spec: &ImportSpec) -> Result<(), RowError> {
        let expected = 1.0 / spec.rate_hz;
        let off = |allowed: String| {
            let found = format!("{} s after the row before", rounded(period));
            self.error(place, found, allowed, spec)
        };
        if period <= 0.0 {
            return Err(off("times that rise within a recording".to_owned()));
        }
        match spec.resampling {
            Resampling::None if (period - expected).abs() > PERIOD_TOLERANCE * expected => {
                let mut allowed = format!(
                    "1/rate_hz = {} s, a tenth more or less; or resampling \"linear\"",
                    rounded(expected)
                );
                if let Some(unit) = likely_unit(period, expected, spec.units.time) {
                    allowed.push_str("; it would fit units.time ");
                    allowed.push_str(unit.as_str());
                }
                Err(off(allowed))
            }
            Resampling::Linear if period > spec.max_gap_s + SAME_TIME * expected => {
                let limit = spec.max_gap_s;
                let allowed = format!("at most max_gap_s = {limit}; a pause ends a recording");
                Err(off(allowed))
            }
            Resampling::None | Resampling::Linear => Ok(()),
        }
    }

    /// # Errors
    /// When its periods are right one by one, but wrong together.
    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 rows")]
    pub fn check_rate(&self, spec: &ImportSpec) -> Result<(), RowError> {
        let Some(last) = self.last.filter(|_| spec.resampling == Resampling::None) else {
            return Ok(());
        };
        let periods = self.rows.saturating_sub(1) as f64;
        let expected = periods / spec.rate_hz;
        let duration = last.time_s - self.start_s;
        let tolerance = RATE_TOLERANCE * expected + PERIOD_TOLERANCE / spec.rate_hz;
        if (duration - expected).abs() <= tolerance {
            return Ok(());
        }
        let found = format!("{periods} periods in {} s", rounded(duration));
        let rate = rounded(periods / duration);
        let allowed = format!(
            "{} s, a hundredth more or less; the file has {rate} Hz: another rate_hz, or \
             resampling \"linear\"",
            rounded(expected)
        );
        Err(self.error(last.place, found, allowed, spec))
    }

    fn error(&self, place: Place, found: String, allowed: String, spec: &ImportSpec) -> RowError {
        RowError {
            recording: self.name.clone(),
            place,
            column: spec.columns.time.clone(),
            found,
            allowed,
        }
    }
}

/// Interpolates positions and velocities linearly between two samples. The first `joints` values,
/// the torques, are held.
fn between(last: &Sample, next: &Sample, at: f64, joints: usize) -> Sample {
    let share = (at - last.time_s) / (next.time_s - last.time_s);
    let mut sample = Sample { time_s: at, ..*last };
    for (value, next) in sample.values.iter_mut().zip(next.values).skip(joints) {
        *value += share * (next - *value);
    }
    sample
}

/// The unit in which the times would have the expected period.
fn likely_unit(period: f64, expected: f64, declared: TimeUnit) -> Option<TimeUnit> {
    let written = period / declared.seconds();
    TimeUnit::ALL
        .into_iter()
        .find(|unit| (written * unit.seconds() - expected).abs() <= PERIOD_TOLERANCE * expected)
}

/// The number with six significant digits.
pub(crate) fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::rows::MAX_CHANNELS;

    fn spec(fields: &serde_json::Value) -> ImportSpec {
        let names = |prefix: &str| (1..=7).map(|i| format!("{prefix}{i}")).collect::<Vec<_>>();
        let mut spec = json!({
            "file": "0".repeat(64), "format": "csv", "rate_hz": 10.0,
            "columns": {"time": "t", "u": names("u"), "q": names("q")},
        });
        let fields = fields.as_object().unwrap().clone();
        spec.as_object_mut().unwrap().extend(fields);
        serde_json::from_value(spec).unwrap()
    }

    /// A sample whose torques and positions equal its number.
    fn sample(time_s: f64, row: u64) -> Sample {
        Sample { time_s, row, place: Place::Line(row + 2), values: [row as f64; MAX_CHANNELS] }
    }

    /// Time, torque and position of the resulting samples.
    fn run(times: &[f64], spec: &ImportSpec) -> Result<Vec<(f64, f64, f64)>, String> {
        let mut recording = Recording::new(Some("a".to_owned()), Place::Line(2));
        let mut samples = Vec::new();
        for (row, time) in (0..).zip(times) {
            let sample = sample(*time, row);
            recording.check(&sample, spec).map_err(|error| error.to_string())?;
            recording.accept(sample);
            while let Some(sample) = recording.advance(spec) {
                samples.push((rounded(sample.time_s), sample.values[0], rounded(sample.values[7])));
            }
        }
        recording.check_rate(spec).map_err(|error| error.to_string())?;
        Ok(samples)
    }

    #[test]
    fn resampling_draws_lines_through_positions_and_holds_torques() {
        let linear = spec(&json!({"resampling": "linear", "max_gap_s": 1.0}));
        let samples = run(&[5.0, 5.25, 5.4], &linear).unwrap();
        let expected = [
            (5.0, 0.0, 0.0),
            (5.1, 0.0, 0.4),
            (5.2, 0.0, 0.8),
            (5.3, 1.0, 1.33333),
            (5.4, 2.0, 2.0),
        ];
        assert_eq!(samples, expected);
    }

    /// Otherwise held torques would come one sample late wherever a time is rounded up.
    #[test]
    fn a_sample_at_nearly_the_time_asked_for_is_taken_whole() {
        let linear = spec(&json!({"resampling": "linear"}));
        let samples = run(&[0.0, 0.100_001, 0.199_999], &linear).unwrap();
        let torques: Vec<f64> = samples.iter().map(|(_, u, _)| *u).collect();
        assert_eq!(torques, [0.0, 1.0, 2.0]);
    }

    #[test]
    fn faster_recordings_are_thinned_out() {
        let linear = spec(&json!({"resampling": "linear"}));
        let times: Vec<f64> = (0..101).map(|k| f64::from(k) * 0.01).collect();
        let samples = run(&times, &linear).unwrap();
        assert_eq!(samples.len(), 11);
        assert_eq!(samples[10], (1.0, 100.0, 100.0));
    }

    #[test]
    fn a_pause_is_not_bridged() {
        let linear = spec(&json!({"resampling": "linear"}));
        let error = run(&[0.0, 0.1, 0.4], &linear).unwrap_err();
        assert!(error.contains("line 4, column \"t\": 0.3 s after"), "{error}");
        assert!(error.contains("max_gap_s = 0.1"), "{error}");
    }

    #[test]
    fn times_that_do_not_rise_are_refused_in_every_mode() {
        for resampling in ["none", "linear"] {
            let spec = spec(&json!({"resampling": resampling}));
            for times in [[0.0, 0.1, 0.1], [0.0, 0.1, 0.0]] {
                let error = run(&times, &spec).unwrap_err();
                assert!(error.contains("recording \"a\", line 4"), "{error}");
                assert!(error.contains("rise"), "{error}");
            }
        }
    }

    #[test]
    fn a_period_may_be_off_by_a_tenth() {
        let none = spec(&json!({}));
        assert_eq!(run(&[0.0, 0.109, 0.2, 0.3], &none).unwrap().len(), 4);
        let error = run(&[0.0, 0.1, 0.212], &none).unwrap_err();
        assert!(error.contains("1/rate_hz = 0.1 s"), "{error}");
        assert!(error.contains("resampling \"linear\""), "{error}");
    }

    #[test]
    fn a_wrong_unit_of_time_is_suggested() {
        let error = run(&[0.0, 100.0], &spec(&json!({}))).unwrap_err();
        assert!(error.contains("units.time ms"), "{error}");
    }

    /// Every period is within a tenth, but after 400 samples the recording is off by 36 samples.
    #[test]
    fn a_rate_that_is_off_all_the_time_is_refused() {
        let times: Vec<f64> = (0..400).map(|k| f64::from(k) / 10.9).collect();
        let error = run(&times, &spec(&json!({}))).unwrap_err();
        assert!(error.contains("399 periods"), "{error}");
        assert!(error.contains("10.9 Hz"), "{error}");
    }
}
