//! The summary of a shard: ranges of its channels, and spectra of its first trajectories.

use arrow_array::types::Float32Type;
use arrow_array::{Array, Float32Array, RecordBatch};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use store::{ChannelSummary, ShardSummary, Spectrum};

/// Number of trajectories with a spectrum: enough for a smooth mean, and few enough to cost almost
/// nothing.
const SPECTRA_OF: usize = 64;

/// Largest number of bands of a spectrum. A figure cannot show more.
const BANDS: usize = 256;

/// Collects a [`ShardSummary`] from rows as they are written.
pub(crate) struct SummaryBuilder {
    samples: usize,
    rate_hz: f64,
    rows: u64,
    rejected: u64,
    channels: Vec<(String, Moments)>,
    torques: PowerSpectrum,
    positions: PowerSpectrum,
}

impl SummaryBuilder {
    /// A builder for trajectories of this many samples at this rate.
    pub fn new(samples: u32, rate_hz: f64) -> Self {
        let samples = samples as usize;
        Self {
            samples,
            rate_hz,
            rows: 0,
            rejected: 0,
            channels: Vec::new(),
            torques: PowerSpectrum::new(samples),
            positions: PowerSpectrum::new(samples),
        }
    }

    pub fn add_rejected(&mut self, draws: u64) {
        self.rejected += draws;
    }

    /// Adds whole trajectories. Every f32 column is a channel.
    pub fn add(&mut self, rows: &RecordBatch) {
        let schema = rows.schema_ref();
        let channels: Vec<_> = schema
            .fields()
            .iter()
            .zip(rows.columns())
            .filter_map(|(field, column)| Some((field.name(), f32_column(column)?)))
            .collect();
        let moments: Vec<Moments> =
            channels.par_iter().map(|(_, values)| Moments::of(values.values())).collect();
        if self.channels.is_empty() {
            self.channels =
                channels.iter().map(|(name, _)| ((*name).clone(), Moments::default())).collect();
        }
        for ((_, all), new) in self.channels.iter_mut().zip(moments) {
            all.merge(&new);
        }
        self.rows += rows.num_rows() as u64;
        for (spectrum, signal) in [(&mut self.torques, "u"), (&mut self.positions, "q")] {
            let column = |joint: u32| rows.column_by_name(&format!("{signal}{joint}"));
            let joints = (1..).map_while(|joint| column(joint).and_then(f32_column));
            spectrum.add(&joints.collect::<Vec<_>>());
        }
    }

    pub fn finish(self) -> ShardSummary {
        let spectra = [("u", self.torques), ("q", self.positions)];
        ShardSummary {
            trajectories: self.rows / (self.samples as u64).max(1),
            samples: self.rows,
            rejected: self.rejected,
            channels: self
                .channels
                .into_iter()
                .map(|(name, moments)| moments.channel(name))
                .collect(),
            spectra: spectra
                .into_iter()
                .map(|(signal, spectrum)| spectrum.finish(signal, self.rate_hz))
                .collect(),
        }
    }
}

fn f32_column(column: &arrow_array::ArrayRef) -> Option<&Float32Array> {
    column.as_any().downcast_ref::<arrow_array::PrimitiveArray<Float32Type>>()
}

/// Range, mean and sum of squared deviations of some values.
#[derive(Clone, Copy, Debug)]
struct Moments {
    count: u64,
    min: f32,
    max: f32,
    mean: f64,
    squares: f64,
}

impl Default for Moments {
    fn default() -> Self {
        Self { count: 0, min: f32::INFINITY, max: f32::NEG_INFINITY, mean: 0.0, squares: 0.0 }
    }
}

impl Moments {
    fn of(values: &[f32]) -> Self {
        /// Number of values per block, small enough that sums in f32 keep six digits.
        const BLOCK: usize = 1024;
        let mut all = Self::default();
        for block in values.chunks(BLOCK) {
            all.merge(&Self::of_block(block));
        }
        all
    }

    /// Computed in lanes, so that the compiler vectorizes it. Values are taken relative to the
    /// first one, so that large squares do not hide small deviations.
    fn of_block(values: &[f32]) -> Self {
        const LANES: usize = 8;
        let Some(&pivot) = values.first() else { return Self::default() };
        let (mut sums, mut squares) = ([0.0f32; LANES], [0.0f32; LANES]);
        let (mut min, mut max) = ([pivot; LANES], [pivot; LANES]);
        let (rows, rest) = values.as_chunks::<LANES>();
        let padded = std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or(pivot));
        for row in rows.iter().chain([&padded]) {
            for lane in 0..LANES {
                let value = row[lane];
                let deviation = value - pivot;
                sums[lane] += deviation;
                squares[lane] += deviation * deviation;
                min[lane] = if value < min[lane] { value } else { min[lane] };
                max[lane] = if value > max[lane] { value } else { max[lane] };
            }
        }
        let count = values.len() as f64;
        let sum: f64 = sums.into_iter().map(f64::from).sum();
        let squares: f64 = squares.into_iter().map(f64::from).sum();
        Self {
            count: values.len() as u64,
            min: min.into_iter().fold(pivot, f32::min),
            max: max.into_iter().fold(pivot, f32::max),
            mean: f64::from(pivot) + sum / count,
            squares: (squares - sum * sum / count).max(0.0),
        }
    }

    fn merge(&mut self, other: &Self) {
        let count = self.count + other.count;
        if count == 0 {
            return;
        }
        let share = other.count as f64 / count as f64;
        let distance = other.mean - self.mean;
        self.squares += other.squares + distance * distance * share * self.count as f64;
        self.mean += share * distance;
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.count = count;
    }

    fn channel(self, name: String) -> ChannelSummary {
        ChannelSummary {
            name,
            min: f64::from(self.min),
            max: f64::from(self.max),
            mean: self.mean,
            std: (self.squares / self.count.max(1) as f64).sqrt(),
        }
    }
}

/// Power of all joints, summed over trajectories.
struct PowerSpectrum {
    samples: usize,
    /// A Hann window.
    window: Vec<f64>,
    trajectories: usize,
    /// The number of joints and trajectories together.
    transformed: usize,
    power: Vec<f64>,
}

impl PowerSpectrum {
    fn new(samples: usize) -> Self {
        let turn = std::f64::consts::TAU / samples as f64;
        let window = (0..samples).map(|k| 0.5 - 0.5 * (turn * k as f64).cos()).collect();
        Self { samples, window, trajectories: 0, transformed: 0, power: vec![0.0; samples / 2 + 1] }
    }

    /// Adds the first trajectories, until there are enough of them.
    fn add(&mut self, joints: &[&Float32Array]) {
        let Some(rows) = joints.first().map(|values| values.len()) else { return };
        let count = (rows / self.samples).min(SPECTRA_OF - self.trajectories);
        if count == 0 {
            return;
        }
        let transform = RealFftPlanner::<f64>::new().plan_fft_forward(self.samples);
        let (mut input, mut output) = (transform.make_input_vec(), transform.make_output_vec());
        for values in joints {
            for trajectory in values.values().chunks_exact(self.samples).take(count) {
                let mean = trajectory.iter().copied().map(f64::from).sum::<f64>();
                let mean = mean / self.samples as f64;
                for ((input, value), window) in input.iter_mut().zip(trajectory).zip(&self.window) {
                    *input = (f64::from(*value) - mean) * window;
                }
                if transform.process(&mut input, &mut output).is_ok() {
                    for (power, value) in self.power.iter_mut().zip(&output) {
                        *power += value.norm_sqr();
                    }
                }
            }
        }
        self.trajectories += count;
        self.transformed += count * joints.len();
    }

    /// The one-sided density, in bands of equal width.
    fn finish(self, signal: &str, rate_hz: f64) -> Spectrum {
        let taken = self.transformed.max(1) as f64;
        let energy: f64 = self.window.iter().map(|window| window * window).sum();
        let last = self.power.len() - 1;
        let density = |(k, power): (usize, &f64)| {
            let alone = k == 0 || (k == last && self.samples.is_multiple_of(2));
            let sides = if alone { 1.0 } else { 2.0 };
            sides * power / (taken * energy * rate_hz)
        };
        let density: Vec<f64> = self.power.iter().enumerate().map(density).collect();
        let width = density.len().div_ceil(BANDS);
        #[expect(clippy::cast_possible_truncation, reason = "f32 is enough to draw it")]
        let mean = |band: &[f64]| (band.iter().sum::<f64>() / band.len() as f64) as f32;
        Spectrum {
            signal: signal.to_owned(),
            trajectories: self.trajectories as u64,
            step_hz: width as f64 * rate_hz / self.samples as f64,
            density: density.chunks(width).map(mean).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::ArrayRef;

    use super::*;

    /// 200 samples at 50 Hz. Each joint is a constant plus amplitude · cos at one frequency.
    fn waves(amplitude: f64, frequency_hz: f64, trajectories: usize) -> RecordBatch {
        let value = |k: usize| {
            let turn = std::f64::consts::TAU * frequency_hz * (k % 200) as f64 / 50.0;
            #[expect(clippy::cast_possible_truncation, reason = "what a file holds")]
            let value = (3.0 + amplitude * turn.cos()) as f32;
            value
        };
        let column = || -> ArrayRef {
            Arc::new(Float32Array::from_iter_values((0..200 * trajectories).map(value)))
        };
        let names = ["u", "q"].into_iter();
        let names = names.flat_map(|signal| (1..=7).map(move |joint| format!("{signal}{joint}")));
        RecordBatch::try_from_iter(names.map(|name| (name, column()))).unwrap()
    }

    #[test]
    fn channels_have_the_range_mean_and_deviation_of_all_samples() {
        let mut builder = SummaryBuilder::new(200, 50.0);
        builder.add(&waves(2.0, 5.0, 3));
        builder.add(&waves(1.0, 5.0, 1));
        let summary = builder.finish();
        assert_eq!((summary.trajectories, summary.samples), (4, 800));
        let names: Vec<_> = summary.channels.iter().map(|channel| channel.name.as_str()).collect();
        assert_eq!((names.len(), names[0], names[13]), (14, "u1", "q7"));
        let q4 = &summary.channels[10];
        assert!((q4.min - 1.0).abs() < 1e-6 && (q4.max - 5.0).abs() < 1e-6, "{q4:?}");
        let variance: f64 = (3.0 * 2.0 + 0.5) / 4.0;
        assert!((q4.mean - 3.0).abs() < 1e-6, "{q4:?}");
        assert!((q4.std - variance.sqrt()).abs() < 1e-6, "{q4:?}");
    }

    #[test]
    fn small_deviations_about_a_large_mean_are_not_lost() {
        let values: Vec<f32> = (0..5000).map(|k| 1000.0 + [0.0, 0.25][k % 2]).collect();
        let moments = Moments::of(&values);
        assert!((moments.mean - 1000.125).abs() < 1e-6);
        assert!(((moments.squares / 5000.0).sqrt() - 0.125).abs() < 1e-6);
    }

    #[test]
    fn a_spectrum_has_its_power_where_the_signal_is_and_integrates_to_the_variance() {
        let mut builder = SummaryBuilder::new(200, 50.0);
        builder.add(&waves(2.0, 5.0, 40));
        builder.add(&waves(2.0, 5.0, 40));
        let spectra = builder.finish().spectra;
        assert_eq!((spectra[0].signal.as_str(), spectra[1].signal.as_str()), ("u", "q"));
        for spectrum in spectra {
            assert_eq!((spectrum.trajectories, spectrum.step_hz), (64, 0.25));
            assert_eq!(spectrum.density.len(), 101);
            let highest = spectrum.density.iter().copied().fold(0.0, f32::max);
            assert_eq!(spectrum.density[20], highest, "5 Hz");
            let power: f64 = spectrum.density.iter().copied().map(f64::from).sum();
            assert!((power * spectrum.step_hz - 2.0).abs() < 1e-3, "{power}");
        }
    }

    #[test]
    fn long_trajectories_have_no_more_bands_than_short_ones() {
        let spectrum = PowerSpectrum::new(10_000).finish("q", 100.0);
        assert!(spectrum.density.len() <= BANDS);
        let reach = spectrum.step_hz * spectrum.density.len() as f64;
        assert!((50.0..51.0).contains(&reach), "{reach}");
    }
}
