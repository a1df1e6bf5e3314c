//! A recording: checks its timing, and hands its rows to the resampling.

use std::fmt;
use std::ops::RangeInclusive;

use spec::{ImportSpec, Resampling, TimeUnit};

use crate::error::{Place, RowError};
use crate::lengths::{Periods, RecordingLength};
use crate::resampling::{Resampler, SAME_TIME};
use crate::samples::Sample;

/// The part of a period by which a period may be wrong without resampling.
const PERIOD_TOLERANCE: f64 = 0.1;

/// The part of a recording by which its length may differ from its number of samples.
const RATE_TOLERANCE: f64 = 0.01;

/// Periods that robots record with, s: 4 kHz to 10 Hz. Units differ by more than that, so at most one
/// of them fits.
const USUAL_PERIODS_S: RangeInclusive<f64> = 2.5e-4..=0.1;

/// Below this mean period no robot records, s.
const LEAST_PERIOD_S: f64 = 2e-5;

/// From this multiple of the dataset's rate on, a recording whose samples are left out without a
/// low-pass is doubtful.
const MUCH_FASTER: f64 = 2.0;

pub(crate) struct Recording {
    pub name: Option<String>,
    /// The place of its first row.
    pub first: Place,
    pub rows: u64,
    start_s: f64,
    last_s: f64,
    last: Place,
    /// The unit of times that the spec says; `None` if the file says its own.
    unit: Option<TimeUnit>,
    measured_periods: Periods,
    resampler: Resampler,
    /// Number of samples handed out.
    pub samples: u64,
}

impl Recording {
    pub fn new(
        name: Option<String>,
        first: Place,
        unit: Option<TimeUnit>,
        spec: &ImportSpec,
    ) -> Self {
        Self {
            name,
            first,
            rows: 0,
            start_s: 0.0,
            last_s: 0.0,
            last: first,
            unit,
            measured_periods: Periods::default(),
            resampler: Resampler::new(spec),
            samples: 0,
        }
    }

    /// Whether the next row has the time of the row before.
    #[expect(clippy::float_cmp, reason = "a row that was written twice has the same number")]
    pub fn repeats(&self, sample: &Sample) -> bool {
        self.rows > 0 && sample.time_s == self.last_s
    }

    /// # Errors
    /// When the next row has a wrong time.
    pub fn check(&self, sample: &Sample, spec: &ImportSpec) -> Result<(), RowError> {
        if self.rows == 0 {
            return Ok(());
        }
        self.check_period(sample.time_s - self.last_s, sample.place, spec)
    }

    /// Accepts the next row, after [`Self::advance`] has nothing more to hand out.
    ///
    /// # Errors
    /// When the recording is too fast for the low-pass.
    pub fn accept(&mut self, sample: Sample) -> Result<(), RowError> {
        if self.rows == 0 {
            self.start_s = sample.time_s;
        } else {
            self.measured_periods.add(sample.time_s - self.last_s);
        }
        (self.last_s, self.last) = (sample.time_s, sample.place);
        self.rows += 1;
        self.resampler.accept(sample).map_err(|error| self.with_unit(error))
    }

    /// Tells that no rows follow.
    ///
    /// # Errors
    /// As [`Self::accept`].
    pub fn finish(&mut self) -> Result<(), RowError> {
        self.resampler.finish().map_err(|error| self.with_unit(error))
    }

    /// Its length and its rate, as its rows and its samples are so far.
    pub fn length(&self) -> RecordingLength {
        RecordingLength {
            name: self.name.clone().unwrap_or_default(),
            rows: self.rows,
            seconds: self.last_s - self.start_s,
            median_rate_hz: self.measured_periods.median_s().map(|period_s| 1.0 / period_s),
            samples: self.samples,
        }
    }

    /// The unit that its times probably have, if no robot records as fast as the spec says.
    pub fn likely_unit(&self) -> Option<LikelyUnit> {
        let period_s = (self.last_s - self.start_s) / self.periods();
        (period_s < LEAST_PERIOD_S).then(|| likely_unit(period_s, self.unit?))?
    }

    fn with_unit(&self, mut error: RowError) -> RowError {
        if let Some(unit) = self.likely_unit() {
            error.allowed.push_str(&format!("; {unit}"));
        }
        error
    }

    /// The next sample of the dataset, as far as rows were accepted.
    pub fn advance(&mut self) -> Option<Sample> {
        let sample = self.resampler.advance()?;
        self.samples += 1;
        Some(sample)
    }

    /// Whether its samples passed the low-pass.
    pub fn is_filtered(&self) -> bool {
        self.resampler.is_filtered()
    }

    /// Rows per second, if samples were left out of them that nobody filtered or meant to leave
    /// out.
    pub fn folded_rate_hz(&self, spec: &ImportSpec) -> Option<f64> {
        let is_stated = spec.low_pass_hz.is_some();
        let rate_hz = self.periods() / (self.last_s - self.start_s);
        let is_folded = spec.resampling.makes_samples() && !is_stated;
        (is_folded && rate_hz > MUCH_FASTER * spec.rate_hz).then_some(rate_hz)
    }

    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 rows")]
    fn periods(&self) -> f64 {
        self.rows.saturating_sub(1) as f64
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
                if let Some(unit) = fitting_unit(period, expected, spec.units.time) {
                    allowed.push_str("; it would fit units.time ");
                    allowed.push_str(unit.as_str());
                } else if let Some(unit) = self.first_unit(period) {
                    allowed.push_str(&format!("; {unit}"));
                }
                Err(off(allowed))
            }
            Resampling::Linear | Resampling::Mean
                if period > spec.max_gap_s + SAME_TIME * expected =>
            {
                let limit = spec.max_gap_s;
                let reason = match self.first_unit(period) {
                    Some(unit) => unit.to_string(),
                    None => "a pause ends a recording".to_owned(),
                };
                Err(off(format!("at most max_gap_s = {limit}; {reason}")))
            }
            Resampling::None | Resampling::Linear | Resampling::Mean => Ok(()),
        }
    }

    /// The unit that the times probably have if the first period is unusual. A later one is a pause.
    fn first_unit(&self, period: f64) -> Option<LikelyUnit> {
        (self.rows == 1).then(|| likely_unit(period, self.unit?))?
    }

    /// # Errors
    /// When its periods are right one by one, but wrong together.
    pub fn check_rate(&self, spec: &ImportSpec) -> Result<(), RowError> {
        if self.rows == 0 || spec.resampling.makes_samples() {
            return Ok(());
        }
        let periods = self.periods();
        let expected = periods / spec.rate_hz;
        let duration = self.last_s - self.start_s;
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
        Err(self.error(self.last, found, allowed, spec))
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

/// A unit in which a recording has a usual period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LikelyUnit {
    unit: TimeUnit,
    period_s: f64,
}

impl fmt::Display for LikelyUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { unit, period_s } = self;
        write!(f, "with units.time {:?} rows are {} s apart", unit.as_str(), rounded(*period_s))
    }
}

/// The unit in which the times would have a usual period, if they have an unusual one.
fn likely_unit(period_s: f64, declared: TimeUnit) -> Option<LikelyUnit> {
    let written = period_s / declared.seconds();
    let of = |unit: TimeUnit| LikelyUnit { unit, period_s: written * unit.seconds() };
    let mut units = TimeUnit::ALL.into_iter().map(of);
    units
        .find(|likely| USUAL_PERIODS_S.contains(&likely.period_s))
        .filter(|likely| likely.unit != declared)
}

/// The unit in which the times would have the expected period.
fn fitting_unit(period: f64, expected: f64, declared: TimeUnit) -> Option<TimeUnit> {
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
        let unit = Some(spec.units.time);
        let mut recording = Recording::new(Some("a".to_owned()), Place::Line(2), unit, spec);
        let mut samples = Vec::new();
        for (row, time) in (0..).zip(times) {
            let sample = sample(*time, row);
            recording.check(&sample, spec).map_err(|error| error.to_string())?;
            recording.accept(sample).map_err(|error| error.to_string())?;
            while let Some(sample) = recording.advance() {
                samples.push((rounded(sample.time_s), sample.values[0], rounded(sample.values[7])));
            }
        }
        recording.finish().map_err(|error| error.to_string())?;
        let rest = std::iter::from_fn(|| recording.advance());
        samples.extend(rest.map(|sample| (sample.time_s, sample.values[0], sample.values[7])));
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
            let error = run(&[0.0, 0.1, 0.0], &spec).unwrap_err();
            assert!(error.contains("recording \"a\", line 4"), "{error}");
            assert!(error.contains("rise"), "{error}");
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

    #[test]
    fn an_unusual_first_period_suggests_a_unit() {
        let linear = |unit: &str| spec(&json!({"resampling": "linear", "units": {"time": unit}}));
        for (unit, period, likely) in [("s", 2.0, "ms"), ("s", 2000.0, "us"), ("ms", 2000.0, "ns")]
        {
            let error = run(&[0.0, period], &linear(unit)).unwrap_err();
            let expected = format!("with units.time {likely:?} rows are 0.002 s apart");
            assert!(error.ends_with(&expected), "{error}");
        }
        let none = run(&[0.0, 2.0], &spec(&json!({}))).unwrap_err();
        assert!(none.ends_with("with units.time \"ms\" rows are 0.002 s apart"), "{none}");
        let pause = run(&[0.0, 0.1, 2.1], &linear("s")).unwrap_err();
        assert!(pause.ends_with("a pause ends a recording"), "{pause}");
    }

    #[test]
    fn an_impossible_rate_suggests_a_unit() {
        let spec = spec(&json!({}));
        let likely = |unit: Option<TimeUnit>, period_s: f64| {
            let mut recording = Recording::new(None, Place::Line(2), unit, &spec);
            for row in 0..10_u32 {
                recording.accept(sample(f64::from(row) * period_s, row.into())).unwrap();
            }
            recording.likely_unit().map(|likely| likely.unit)
        };
        assert_eq!(likely(Some(TimeUnit::Us), 2e-6), Some(TimeUnit::Ms));
        assert_eq!(likely(Some(TimeUnit::S), 2e-6), None);
        assert_eq!(likely(Some(TimeUnit::Us), 1e-4), None);
        assert_eq!(likely(None, 2e-6), None);
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
