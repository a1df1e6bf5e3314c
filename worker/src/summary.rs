//! The summary of a shard: ranges of its channels and of the parameters of its arms, and spectra of its first
//! trajectories.

use arrow_array::types::{ArrowPrimitiveType, Float32Type, Float64Type};
use arrow_array::{Array, ArrayRef, Float32Array, PrimitiveArray, RecordBatch};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use store::{ChannelSummary, ShardSummary, Spectrum};
use wire::ArmParameter;

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
    arms: Vec<(String, Moments)>,
    torques: PowerSpectrum,
    positions: PowerSpectrum,
    /// Whether there are spectra of single joints too.
    of_joints: bool,
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
            arms: Vec::new(),
            torques: PowerSpectrum::new(samples),
            positions: PowerSpectrum::new(samples),
            of_joints: false,
        }
    }

    /// With spectra of single joints, if these are the first trajectories of a dataset: those of every shard would take
    /// more to read than they tell.
    pub fn beginning_at(self, first: u64) -> Self {
        Self { of_joints: first == 0, ..self }
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
            .filter_map(|(field, column)| Some((field.name(), column_of::<Float32Type>(column)?)))
            .collect();
        let moments: Vec<Moments> =
            channels.par_iter().map(|(_, values)| Moments::of(values.values())).collect();
        let names = channels.into_iter().map(|(name, _)| name);
        merge(&mut self.channels, names.zip(moments));
        self.rows += rows.num_rows() as u64;
        for (spectrum, signal) in [(&mut self.torques, "u"), (&mut self.positions, "q")] {
            let column = |joint: u32| rows.column_by_name(&format!("{signal}{joint}"));
            let joints = (1..).map_while(|joint| column(joint).and_then(column_of::<Float32Type>));
            spectrum.add(&joints.collect::<Vec<_>>());
        }
    }

    /// Adds rows of the table of robots, of which the parameters of arms count.
    pub fn add_arms(&mut self, rows: &RecordBatch) {
        let fields = rows.schema_ref().fields().iter().map(|field| field.name());
        let arms = fields.zip(rows.columns()).filter_map(|(name, column)| {
            ArmParameter::of(name)?;
            let values = column_of::<Float64Type>(column)?;
            #[expect(clippy::cast_possible_truncation, reason = "f32 is enough to show it")]
            let values: Vec<f32> = values.iter().flatten().map(|value| value as f32).collect();
            Some((name, Moments::of(&values)))
        });
        merge(&mut self.arms, arms);
    }

    pub fn finish(self) -> ShardSummary {
        let [torques, positions] = [("u", self.torques), ("q", self.positions)]
            .map(|(signal, power)| power.finish(signal, self.rate_hz));
        let mut spectra = vec![torques.mean, positions.mean];
        if self.of_joints {
            spectra.extend(torques.joints.into_iter().chain(positions.joints));
        }
        let named = |(name, moments): (String, Moments)| moments.channel(name);
        ShardSummary {
            trajectories: self.rows / (self.samples as u64).max(1),
            samples: self.rows,
            rejected: self.rejected,
            channels: self.channels.into_iter().map(named).collect(),
            spectra,
            // A column without a value is of a quantity that these arms do not have.
            arms: self.arms.into_iter().filter(|(_, arm)| arm.count > 0).map(named).collect(),
        }
    }
}

fn column_of<T: ArrowPrimitiveType>(column: &ArrayRef) -> Option<&PrimitiveArray<T>> {
    column.as_any().downcast_ref()
}

/// Adds moments of the same columns as before.
fn merge<'a>(all: &mut Vec<(String, Moments)>, new: impl Iterator<Item = (&'a String, Moments)>) {
    let is_first = all.is_empty();
    for (k, (name, moments)) in new.enumerate() {
        if is_first {
            all.push((name.clone(), Moments::default()));
        }
        all[k].1.merge(&moments);
    }
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

/// Power of each joint, summed over trajectories.
struct PowerSpectrum {
    samples: usize,
    /// A Hann window.
    window: Vec<f64>,
    trajectories: usize,
    /// The power at each frequency, by joint.
    power: Vec<Vec<f64>>,
}

/// The spectra of a signal.
struct Spectra {
    /// Over all joints.
    mean: Spectrum,
    joints: Vec<Spectrum>,
}

impl PowerSpectrum {
    fn new(samples: usize) -> Self {
        let turn = std::f64::consts::TAU / samples as f64;
        let window = (0..samples).map(|k| 0.5 - 0.5 * (turn * k as f64).cos()).collect();
        Self { samples, window, trajectories: 0, power: Vec::new() }
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
        self.power.resize(joints.len(), vec![0.0; self.samples / 2 + 1]);
        for (values, power) in joints.iter().zip(&mut self.power) {
            for trajectory in values.values().chunks_exact(self.samples).take(count) {
                let mean = trajectory.iter().copied().map(f64::from).sum::<f64>();
                let mean = mean / self.samples as f64;
                for ((input, value), window) in input.iter_mut().zip(trajectory).zip(&self.window) {
                    *input = (f64::from(*value) - mean) * window;
                }
                if transform.process(&mut input, &mut output).is_ok() {
                    for (power, value) in power.iter_mut().zip(&output) {
                        *power += value.norm_sqr();
                    }
                }
            }
        }
        self.trajectories += count;
    }

    fn finish(self, signal: &str, rate_hz: f64) -> Spectra {
        let joints = self.power.len();
        let mut sum = vec![0.0; self.samples / 2 + 1];
        for power in &self.power {
            sum.iter_mut().zip(power).for_each(|(sum, power)| *sum += power);
        }
        let mean = self.density(&sum, joints, signal, rate_hz);
        let of_joint = |(joint, power): (u32, &Vec<f64>)| Spectrum {
            joint: Some(joint),
            ..self.density(power, 1, signal, rate_hz)
        };
        Spectra { mean, joints: (1..).zip(&self.power).map(of_joint).collect() }
    }

    /// The one-sided density of the power of so many joints together, in bands of equal width.
    fn density(&self, power: &[f64], joints: usize, signal: &str, rate_hz: f64) -> Spectrum {
        let taken = (self.trajectories * joints).max(1) as f64;
        let energy: f64 = self.window.iter().map(|window| window * window).sum();
        let last = power.len() - 1;
        let density = |(k, power): (usize, &f64)| {
            let alone = k == 0 || (k == last && self.samples.is_multiple_of(2));
            let sides = if alone { 1.0 } else { 2.0 };
            sides * power / (taken * energy * rate_hz)
        };
        let density: Vec<f64> = power.iter().enumerate().map(density).collect();
        let width = density.len().div_ceil(BANDS);
        #[expect(clippy::cast_possible_truncation, reason = "f32 is enough to draw it")]
        let mean = |band: &[f64]| (band.iter().sum::<f64>() / band.len() as f64) as f32;
        Spectrum {
            signal: signal.to_owned(),
            joint: None,
            trajectories: self.trajectories as u64,
            step_hz: width as f64 * rate_hz / self.samples as f64,
            density: density.chunks(width).map(mean).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::Float64Array;

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
    fn the_first_shard_has_a_spectrum_of_each_joint_and_their_mean_is_that_of_all() {
        let mut rows = waves(1.0, 5.0, 2);
        let louder = waves(3.0, 8.0, 2);
        let mut columns = rows.columns().to_vec();
        columns[2] = Arc::clone(louder.column(2));
        rows = RecordBatch::try_new(rows.schema(), columns).unwrap();
        let summary = |first: u64| {
            let mut builder = SummaryBuilder::new(200, 50.0).beginning_at(first);
            builder.add(&rows);
            builder.finish()
        };
        assert_eq!(summary(2048).spectra.len(), 2);
        let spectra = summary(0).spectra;
        let of = |signal: &str, joint: Option<u32>| {
            let is_it = |it: &&Spectrum| it.signal == signal && it.joint == joint;
            spectra.iter().find(is_it).unwrap_or_else(|| panic!("{signal} {joint:?}"))
        };
        assert_eq!(spectra.len(), 2 + 2 * 7);
        // The amplitude of joint 3 is three times that of the others, at 8 Hz.
        let (third, fourth) = (of("u", Some(3)), of("u", Some(4)));
        assert!((third.density[32] / fourth.density[20] - 9.0).abs() < 1e-3);
        let mean: f32 = (1..=7).map(|joint| of("u", Some(joint)).density[32]).sum::<f32>() / 7.0;
        assert!((of("u", None).density[32] / mean - 1.0).abs() < 1e-5);
    }

    #[test]
    fn arms_have_the_parameters_that_tables_show_and_no_quantity_that_they_lack() {
        let column =
            |values: &[Option<f64>]| -> ArrayRef { Arc::new(Float64Array::from(values.to_vec())) };
        let rows = |mass: f64| {
            RecordBatch::try_from_iter([
                ("mass_2", column(&[Some(mass), Some(mass + 2.0)])),
                ("ixx_2", column(&[Some(0.1), Some(0.1)])),
                ("payload_mass", column(&[None, Some(3.0)])),
                ("friction_phi1_2", column(&[None, None])),
            ])
        };
        let mut builder = SummaryBuilder::new(200, 50.0);
        builder.add_arms(&rows(1.0).unwrap());
        builder.add_arms(&rows(5.0).unwrap());
        let arms = builder.finish().arms;
        let told: Vec<_> =
            arms.iter().map(|it| (it.name.as_str(), it.min, it.max, it.mean)).collect();
        assert_eq!(told, [("mass_2", 1.0, 7.0, 4.0), ("payload_mass", 3.0, 3.0, 3.0)]);
    }

    #[test]
    fn long_trajectories_have_no_more_bands_than_short_ones() {
        let spectrum = PowerSpectrum::new(10_000).finish("q", 100.0).mean;
        assert!(spectrum.density.len() <= BANDS);
        let reach = spectrum.step_hz * spectrum.density.len() as f64;
        assert!((50.0..51.0).contains(&reach), "{reach}");
    }
}
