//! Samples of a recording at the dataset's rate.
//!
//! A recording that is faster than the dataset passes a low-pass without delay before samples are
//! left out, so that nothing from above half of the dataset's rate is folded into it. The filter
//! runs forwards and backwards, over blocks that overlap by more than it remembers. So memory does
//! not grow with a recording, and a block's ends are felt nowhere.

use std::collections::VecDeque;

use series::LowPass;
use spec::{ImportSpec, LowPassHz, Resampling};

use crate::error::{Place, RowError};
use crate::recording::rounded;
use crate::rows::channel_count;
use crate::samples::Sample;

/// Times that differ by less than this part of a period are equal. Seconds in f32, and decimals
/// with a few digits, are not more precise.
pub(crate) const SAME_TIME: f64 = 1e-3;

/// Number of rows at the beginning of a recording that tell its rate.
const RATE_ROWS: usize = 1024;

/// Up to this multiple of the dataset's rate, hardly a sample is left out.
const NEARLY_AS_FAST: f64 = 1.1;

/// The largest number of rows per sample that can be filtered: a second of 60 kHz, for one sample.
const MAX_ROWS_PER_SAMPLE: f64 = 1024.0;

/// The memory of the low-pass, in periods of its edge frequency. The slowest pole of a Butterworth filter of
/// order 4 decays by exp(-2.4) in one period, so e^-24 is left.
const REMEMBERED_PERIODS: f64 = 10.0;

/// Turns rows into samples at the dataset's rate.
pub(crate) struct Resampler {
    options: Options,
    stage: Stage,
}

/// What a spec says about resampling.
#[derive(Clone, Copy)]
struct Options {
    rate_hz: f64,
    resampling: Resampling,
    edge_hz: Option<f64>,
    joints: usize,
    channels: usize,
}

enum Stage {
    /// The first rows, until the recording's rate is known.
    Unknown(VecDeque<Sample>),
    Plain(Box<Plain>),
    Filtered(Box<Filtered>),
}

impl Resampler {
    pub fn new(spec: &ImportSpec) -> Self {
        let options = Options {
            rate_hz: spec.rate_hz,
            resampling: spec.resampling,
            edge_hz: spec.low_pass_hz.and_then(LowPassHz::edge),
            joints: spec.joints(),
            channels: channel_count(spec),
        };
        let is_mean = spec.resampling == Resampling::Mean;
        let stage = if is_mean || options.edge_hz.is_some() {
            Stage::Unknown(VecDeque::new())
        } else {
            Stage::Plain(Box::default())
        };
        Self { options, stage }
    }

    pub fn is_filtered(&self) -> bool {
        matches!(&self.stage, Stage::Filtered(dense) if dense.filter.is_some())
    }

    /// Accepts the next row, which is later than the one before.
    ///
    /// # Errors
    /// When the recording is too fast for the low-pass.
    pub fn accept(&mut self, sample: Sample) -> Result<(), RowError> {
        match &mut self.stage {
            Stage::Unknown(rows) => {
                rows.push_back(sample);
                if rows.len() == RATE_ROWS {
                    self.decide()?;
                }
            }
            Stage::Plain(plain) => plain.incoming.push_back(sample),
            Stage::Filtered(filtered) => filtered.accept(sample),
        }
        Ok(())
    }

    /// Tells that no rows follow.
    ///
    /// # Errors
    /// As [`Self::accept`].
    pub fn finish(&mut self) -> Result<(), RowError> {
        if matches!(self.stage, Stage::Unknown(_)) {
            self.decide()?;
        }
        if let Stage::Filtered(filtered) = &mut self.stage {
            filtered.filter(0);
        }
        Ok(())
    }

    /// The next sample of the dataset, as far as rows were accepted.
    pub fn advance(&mut self) -> Option<Sample> {
        match &mut self.stage {
            Stage::Unknown(_) => None,
            Stage::Plain(plain) => plain.advance(&self.options),
            Stage::Filtered(filtered) => filtered.ready.pop_front(),
        }
    }

    /// Filters the recording if it is faster than the dataset.
    fn decide(&mut self) -> Result<(), RowError> {
        let Stage::Unknown(rows) = &mut self.stage else { return Ok(()) };
        let rows = std::mem::take(rows);
        self.stage = match Filtered::of(&rows, &self.options)? {
            Some(mut filtered) => {
                rows.into_iter().for_each(|sample| filtered.accept(sample));
                Stage::Filtered(Box::new(filtered))
            }
            None => Stage::Plain(Box::new(Plain { incoming: rows, ..Plain::default() })),
        };
        Ok(())
    }
}

/// Takes rows as they are, or interpolates between them.
#[derive(Default)]
struct Plain {
    last: Option<Sample>,
    /// Accepted rows that were not handed out yet.
    incoming: VecDeque<Sample>,
    start_s: f64,
    samples: u64,
}

impl Plain {
    fn advance(&mut self, options: &Options) -> Option<Sample> {
        loop {
            let next = *self.incoming.front()?;
            let Some(last) = self.last.filter(|_| options.resampling.makes_samples()) else {
                self.last = self.incoming.pop_front();
                self.samples += 1;
                self.start_s = next.time_s;
                return Some(next);
            };
            let at = self.start_s + seconds(self.samples, options.rate_hz);
            let tolerance = SAME_TIME / options.rate_hz;
            if at > next.time_s + tolerance {
                self.last = self.incoming.pop_front();
                continue;
            }
            self.samples += 1;
            return Some(if at >= next.time_s - tolerance {
                next
            } else {
                between(&last, &next, at, options.joints)
            });
        }
    }
}

/// Interpolates positions and velocities linearly between two samples. The first `held` values stay
/// those of `last`.
fn between(last: &Sample, next: &Sample, at: f64, held: usize) -> Sample {
    let share = (at - last.time_s) / (next.time_s - last.time_s);
    let mut sample = Sample { time_s: at, ..*last };
    for (value, next) in sample.values.iter_mut().zip(next.values).skip(held) {
        *value += share * (next - *value);
    }
    sample
}

#[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 samples")]
fn seconds(samples: u64, rate_hz: f64) -> f64 {
    samples as f64 / rate_hz
}

/// Interpolates rows at even times, filters them if asked, and keeps one of every `per_sample`.
struct Filtered {
    filter: Option<LowPass>,
    rate_hz: f64,
    /// Number of leading channels, the torques, whose samples are means until the next sample.
    means: usize,
    /// Number of even times per sample of the dataset.
    per_sample: u64,
    /// Number of even times that the filter remembers.
    margin: usize,
    start_s: f64,
    last: Option<Sample>,
    /// Unfiltered values at even times, one list per channel.
    values: Vec<Vec<f64>>,
    /// Index of the first of `values` among all even times.
    first: u64,
    /// Index of the first even time that was not filtered yet.
    next: u64,
    /// The row at or before each sample that was not filtered yet.
    rows: VecDeque<Sample>,
    ready: VecDeque<Sample>,
}

impl Filtered {
    /// `None` for a recording that is not faster than the dataset.
    ///
    /// # Errors
    /// When it is too fast.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "both counts are positive and bounded by the rows per sample"
    )]
    fn of(rows: &VecDeque<Sample>, options: &Options) -> Result<Option<Self>, RowError> {
        let (Some(first), Some(last)) = (rows.front(), rows.back()) else { return Ok(None) };
        let rate_hz = (rows.len() - 1) as f64 / (last.time_s - first.time_s);
        let rows_per_sample = rate_hz / options.rate_hz;
        if rows_per_sample <= NEARLY_AS_FAST || rows_per_sample.is_nan() {
            return Ok(None);
        }
        if rows_per_sample > MAX_ROWS_PER_SAMPLE {
            return Err(too_fast(first.place, rate_hz, options.rate_hz));
        }
        // A rate that is measured is not exactly a multiple of the dataset's.
        let per_sample = ((1.0 - SAME_TIME) * rows_per_sample).ceil().max(2.0);
        let dense_hz = per_sample * options.rate_hz;
        let filter = match options.edge_hz.map(|edge_hz| LowPass::new(edge_hz, dense_hz)) {
            Some(None) => return Ok(None),
            filter => filter.flatten(),
        };
        let remembered = options.edge_hz.map_or(0.0, |edge_hz| REMEMBERED_PERIODS / edge_hz);
        let is_mean = options.resampling == Resampling::Mean;
        Ok(Some(Self {
            filter,
            rate_hz: options.rate_hz,
            means: if is_mean { options.joints } else { 0 },
            per_sample: per_sample as u64,
            margin: ((remembered * dense_hz).ceil() as usize).max(per_sample as usize),
            start_s: first.time_s,
            last: None,
            values: vec![Vec::new(); options.channels],
            first: 0,
            next: 0,
            rows: VecDeque::new(),
            ready: VecDeque::new(),
        }))
    }

    fn accept(&mut self, sample: Sample) {
        let last = *self.last.get_or_insert(sample);
        let tolerance = SAME_TIME / self.rate_hz;
        loop {
            let index = self.first + self.values[0].len() as u64;
            let at = self.start_s + seconds(index, self.rate_hz) / self.per_sample as f64;
            if at > sample.time_s + tolerance {
                break;
            }
            let is_sample = at >= sample.time_s - tolerance;
            let row = if is_sample { sample } else { between(&last, &sample, at, 0) };
            for (values, value) in self.values.iter_mut().zip(row.values) {
                values.push(value);
            }
            if index.is_multiple_of(self.per_sample) {
                self.rows.push_back(row);
            }
        }
        self.last = Some(sample);
        if self.values[0].len() >= 4 * self.margin {
            self.filter(self.margin);
        }
    }

    /// The values behind the filter. At the ends of the recording, they go on as their own odd
    /// reflections until the filter has forgotten how it began.
    fn filtered(&self, values: &[f64], is_end: bool) -> Vec<f64> {
        let (Some(first), Some(last)) = (values.first(), values.last()) else { return Vec::new() };
        let end = values.len() - 1;
        let reach = self.margin.min(end);
        let before = if self.first == 0 { reach } else { 0 };
        let after = if is_end { reach } else { 0 };
        let reflected = |values: &[f64], middle: f64| -> Vec<f64> {
            values.iter().rev().map(|value| 2.0 * middle - value).collect()
        };
        let mut extended = reflected(&values[1..=before], *first);
        extended.extend(values);
        extended.extend(reflected(&values[end - after..end], *last));
        match self.filter.as_ref().and_then(|filter| filter.apply(&extended)) {
            Some(filtered) => filtered[before..=before + end].to_vec(),
            None => values.to_vec(),
        }
    }

    /// Filters all values, and hands out samples except for the last `kept` values, which do not
    /// know yet what follows.
    #[expect(clippy::cast_possible_truncation, reason = "places in lists in memory")]
    fn filter(&mut self, kept: usize) {
        let is_end = kept == 0;
        let filtered: Vec<_> =
            self.values.iter().map(|values| self.filtered(values, is_end)).collect();
        let end = self.first + (self.values[0].len() - kept) as u64;
        while self.next < end {
            if self.next.is_multiple_of(self.per_sample)
                && let Some(row) = self.rows.pop_front()
            {
                let place = (self.next - self.first) as usize;
                let time_s = self.start_s + seconds(self.next / self.per_sample, self.rate_hz);
                let mut sample = Sample { time_s, ..row };
                for (channel, (value, filtered)) in
                    sample.values.iter_mut().zip(&filtered).enumerate()
                {
                    *value = if channel < self.means {
                        mean(&filtered[place..], self.per_sample as usize)
                    } else {
                        filtered[place]
                    };
                }
                self.ready.push_back(sample);
            }
            self.next += 1;
        }
        let done = (self.next - self.first) as usize;
        let gone = done.saturating_sub(self.margin);
        self.values.iter_mut().for_each(|values| drop(values.drain(..gone)));
        self.first += gone as u64;
    }
}

/// The mean of the first `count` values. The last one is held.
fn mean(values: &[f64], count: usize) -> f64 {
    let held = values.last().into_iter().cycle();
    values.iter().chain(held).take(count).sum::<f64>() / count as f64
}

fn too_fast(place: Place, rate_hz: f64, wanted_hz: f64) -> RowError {
    let rate = rounded(rate_hz);
    let found = format!("the recording that begins here has {rate} Hz");
    let allowed = format!(
        "at most {MAX_ROWS_PER_SAMPLE} times rate_hz = {wanted_hz} with a low-pass; a higher rate_hz, or \
         low_pass_hz \"none\""
    );
    RowError { recording: None, place, column: None, found, allowed }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use serde_json::json;

    use super::*;
    use crate::rows::MAX_CHANNELS;

    fn spec(fields: &serde_json::Value) -> ImportSpec {
        let names = |prefix: &str| (1..=7).map(|i| format!("{prefix}{i}")).collect::<Vec<_>>();
        let mut spec = json!({
            "file": "0".repeat(64), "format": "csv", "rate_hz": 50.0, "resampling": "linear",
            "columns": {"time": "t", "u": names("u"), "q": names("q")},
        });
        spec.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        serde_json::from_value(spec).unwrap()
    }

    /// The samples of rows at these times, whose channels all have this value.
    fn samples(spec: &ImportSpec, times: &[f64], value: impl Fn(f64) -> f64) -> Vec<Sample> {
        let mut resampler = Resampler::new(spec);
        let mut samples = Vec::new();
        for (row, time_s) in (0..).zip(times) {
            let place = Place::Row(row + 1);
            let values = [value(*time_s); MAX_CHANNELS];
            resampler.accept(Sample { time_s: *time_s, row, place, values }).unwrap();
            samples.extend(std::iter::from_fn(|| resampler.advance()));
        }
        resampler.finish().unwrap();
        samples.extend(std::iter::from_fn(|| resampler.advance()));
        samples
    }

    fn even(rate_hz: f64, periods: u32) -> Vec<f64> {
        (0..=periods).map(|k| 7.0 + f64::from(k) / rate_hz).collect()
    }

    #[test]
    fn what_the_dataset_cannot_hold_is_filtered_and_the_rest_keeps_its_time() {
        let filtered = spec(&json!({"low_pass_hz": 20.0}));
        // 190 Hz would become 10 Hz at 50 samples per second.
        let slow = |t: f64| (TAU * 1.3 * t).sin();
        let both = |t: f64| slow(t) + 0.5 * (TAU * 190.0 * t).sin();
        let times = even(1000.0, 20_000);
        let of_both = samples(&filtered, &times, both);
        assert_eq!(of_both.len(), 1001);
        for (k, sample) in of_both.iter().enumerate() {
            let time_s = 7.0 + k as f64 / 50.0;
            assert!((sample.time_s - time_s).abs() < 1e-9 && sample.row == 20 * k as u64);
            let tolerance = if (10..990).contains(&k) { 1e-4 } else { 0.02 };
            for value in [sample.values[0], sample.values[7]] {
                assert!((value - slow(time_s)).abs() < tolerance, "{k}: {value}");
            }
        }
        let raw = samples(&spec(&json!({"low_pass_hz": "none"})), &times, both);
        assert!(raw[13..900].iter().any(|s| (s.values[7] - slow(s.time_s)).abs() > 0.3));
    }

    /// The blocks of a long recording end nowhere in particular.
    #[test]
    fn blocks_are_felt_nowhere() {
        let spec = spec(&json!({"low_pass_hz": 24.0}));
        let wave = |t: f64| (TAU * 3.1 * t).sin() + (TAU * 29.0 * t * t / 30.0).sin() + t;
        let times = even(400.0, 12_000);
        let in_blocks = samples(&spec, &times, wave);
        let values: Vec<f64> = times.iter().map(|t| wave(*t)).collect();
        let whole = LowPass::new(24.0, 400.0).unwrap().apply(&values).unwrap();
        assert_eq!(in_blocks.len(), 1501);
        // The reflections at the ends differ in their length.
        for (sample, value) in in_blocks.iter().zip(whole.iter().step_by(8)).skip(50).take(1400) {
            assert!((sample.values[3] - value).abs() < 1e-8, "{} {value}", sample.values[3]);
        }
    }

    #[test]
    fn a_mean_torque_keeps_the_impulse_and_positions_keep_their_time() {
        let wave = |t: f64| (TAU * 3.0 * t).sin();
        let integral = |t: f64| -(TAU * 3.0 * t).cos() / (TAU * 3.0);
        for low_pass_hz in [json!("none"), json!(20.0)] {
            let spec = spec(&json!({"resampling": "mean", "low_pass_hz": low_pass_hz}));
            let found = samples(&spec, &even(1000.0, 6_000), wave);
            assert_eq!(found.len(), 301);
            for sample in &found[20..280] {
                let [begin, end] = [sample.time_s, sample.time_s + 0.02];
                // A row's torque is held until the next row, half a millisecond late in the mean.
                let impulse = integral(end - 5e-4) - integral(begin - 5e-4);
                let error = sample.values[0] - 50.0 * impulse;
                assert!(error.abs() < 2e-3, "{low_pass_hz} {begin}: {error}");
                assert!((sample.values[7] - wave(begin)).abs() < 2e-3, "{low_pass_hz} {begin}");
            }
        }
        // The last torque is held.
        let spec = spec(&json!({"resampling": "mean", "low_pass_hz": "none"}));
        let last = *samples(&spec, &even(1000.0, 100), |t| t).last().unwrap();
        assert!((last.values[0] - 7.1).abs() < 1e-9 && (last.values[7] - 7.1).abs() < 1e-9);
    }

    #[test]
    fn a_steady_motion_is_the_same_up_to_its_ends() {
        let spec = spec(&json!({"low_pass_hz": 20.0}));
        for sample in samples(&spec, &even(1000.0, 3_000), |t| 2.0 - 1.5 * t) {
            let error = sample.values[8] - (2.0 - 1.5 * sample.time_s);
            assert!(error.abs() < 1e-8, "{}: {error}", sample.time_s);
        }
    }

    #[test]
    fn uneven_times_are_filtered_at_even_ones() {
        let spec = spec(&json!({"low_pass_hz": 20.0}));
        let slow = |t: f64| (TAU * 0.4 * t).sin();
        let mut times = even(500.0, 4_000);
        times.iter_mut().enumerate().for_each(|(k, t)| *t += 8e-4 * (k as f64 * 1.7).sin());
        for sample in samples(&spec, &times, slow) {
            let error = sample.values[9] - slow(sample.time_s);
            let tolerance = if (7.2..14.8).contains(&sample.time_s) { 1e-4 } else { 5e-3 };
            assert!(error.abs() < tolerance, "{}: {error}", sample.time_s);
        }
    }

    #[test]
    fn a_recording_that_is_hardly_faster_or_hardly_longer_than_a_sample_passes_as_it_is() {
        let filtered = spec(&json!({"low_pass_hz": 20.0}));
        let raw = spec(&json!({}));
        let wave = |t: f64| (TAU * 11.0 * t).sin();
        let (nearly, short) = (even(54.0, 1_080), even(1000.0, 0));
        for times in [nearly, short, Vec::new()] {
            assert_eq!(samples(&filtered, &times, wave), samples(&raw, &times, wave));
        }
        assert_eq!(samples(&filtered, &even(1000.0, 10), wave).len(), 1);
    }

    #[test]
    fn a_recording_that_is_a_thousand_times_faster_is_refused() {
        let mut resampler = Resampler::new(&spec(&json!({"low_pass_hz": 20.0})));
        let rows = even(60_000.0, 6_000).into_iter().map(|time_s| {
            let values = [0.0; MAX_CHANNELS];
            resampler.accept(Sample { time_s, row: 0, place: Place::Row(1), values })
        });
        let error = rows.filter_map(Result::err).next().unwrap().to_string();
        assert!(error.contains("60000 Hz") && error.contains("rate_hz = 50"), "{error}");
    }
}
