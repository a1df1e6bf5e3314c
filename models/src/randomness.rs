//! Random numbers by what they are for: whoever asks, in whatever order, gets the same.

use burn::tensor::{Device, Tensor, TensorData};
use rand_chacha::ChaCha12Rng;
use rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

use kernels::DropoutKeys;

/// What random numbers are drawn for. Part of the key: a number is never used twice.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    /// Noise and its level in a training step, by (step, trajectory of the batch).
    Training = 1,
    /// The same in a validation, by (0, trajectory of the batch).
    Validation = 2,
    /// A sample of a prediction, by (scenario, sample).
    Sample = 3,
    /// The key of what is left out in a training step, by (step, trajectory of the batch).
    Dropout = 4,
}

/// A generator of its own for every key (ChaCha, Bernstein 2008).
pub(crate) fn generator(seed: u64, purpose: Purpose, first: u64, second: u64) -> ChaCha12Rng {
    let mut key = [0; 32];
    for (bytes, part) in key.chunks_exact_mut(8).zip([seed, purpose as u64, first, second]) {
        bytes.copy_from_slice(&part.to_le_bytes());
    }
    ChaCha12Rng::from_seed(key)
}

/// Uniform on `[0, 1)`, in steps of 2⁻²⁴, each of which an `f32` holds exactly.
pub(crate) fn unit(generator: &mut ChaCha12Rng) -> f32 {
    const STEP: f32 = 1.0 / 16_777_216.0;
    (generator.next_u32() >> 8) as f32 * STEP
}

/// A generator for each row of a batch.
#[derive(Debug)]
pub(crate) struct Noise {
    rows: Vec<ChaCha12Rng>,
    /// For what is left out of each row, where anything is.
    dropout: Option<DropoutKeys>,
    /// Numbers that others drew, taken instead of drawn ones; backwards.
    #[cfg(test)]
    given: Vec<Vec<f32>>,
}

impl Noise {
    pub fn new(rows: impl IntoIterator<Item = ChaCha12Rng>) -> Self {
        Self {
            rows: rows.into_iter().collect(),
            dropout: None,
            #[cfg(test)]
            given: Vec::new(),
        }
    }

    /// With a generator for what is left out of each row.
    pub fn with_dropout(self, rows: impl IntoIterator<Item = ChaCha12Rng>) -> Self {
        let key = |mut generator: ChaCha12Rng| [(); 4].map(|()| generator.next_u32());
        Self { dropout: Some(rows.into_iter().map(key).collect()), ..self }
    }

    pub fn dropout_keys(&self) -> Option<DropoutKeys> {
        self.dropout.clone()
    }

    /// Noise drawn elsewhere, `[row, sample, channel]` for each time that it is asked for.
    #[cfg(test)]
    pub fn given(series: impl IntoIterator<Item = Vec<f32>>) -> Self {
        let mut given: Vec<Vec<f32>> = series.into_iter().collect();
        given.reverse();
        Self { rows: Vec::new(), dropout: None, given }
    }

    /// A whole number below `end` for each row, each as likely but for one in 2³².
    pub fn below(&mut self, end: usize) -> Vec<usize> {
        let scaled = |generator: &mut ChaCha12Rng| {
            let number = (u64::from(generator.next_u32()) * end as u64) >> 32;
            usize::try_from(number).unwrap_or(0)
        };
        self.rows.iter_mut().map(scaled).collect()
    }

    /// Independent standard normal numbers `[row, sample, channel]`.
    pub fn normal(&mut self, [samples, channels]: [usize; 2], device: &Device) -> Tensor<3> {
        let width = samples * channels;
        #[cfg(test)]
        if let Some(values) = self.given.pop() {
            let rows = values.len() / width;
            return Tensor::from_data(TensorData::new(values, [rows, samples, channels]), device);
        }
        let rows = self.rows.len();
        let mut values = vec![0.0; rows * width];
        values
            .par_chunks_mut(width.max(1))
            .zip(&mut self.rows)
            .for_each(|(values, generator)| fill_normal(values, generator));
        Tensor::from_data(TensorData::new(values, [rows, samples, channels]), device)
    }
}

/// Both branches of Box and Muller (1958).
fn fill_normal(values: &mut [f32], generator: &mut ChaCha12Rng) {
    for pair in values.chunks_mut(2) {
        let radius = (-2.0 * (1.0 - unit(generator)).ln()).sqrt();
        let (sine, cosine) = (std::f32::consts::TAU * unit(generator)).sin_cos();
        for (value, direction) in pair.iter_mut().zip([cosine, sine]) {
            *value = radius * direction;
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::{Noise, Purpose, generator};
    use crate::parameters::host_values;

    fn row(purpose: Purpose, first: u64, second: u64) -> Vec<f32> {
        let mut noise = Noise::new([generator(9, purpose, first, second)]);
        host_values(noise.normal([100, 7], &Device::flex())).unwrap()
    }

    #[test]
    fn a_row_of_noise_is_the_same_alone_and_among_others() {
        let mut noise = Noise::new((0..5).map(|row| generator(9, Purpose::Sample, 3, row)));
        let together = host_values(noise.normal([100, 7], &Device::flex())).unwrap();
        for (index, values) in together.chunks(700).enumerate() {
            assert_eq!(values, row(Purpose::Sample, 3, index as u64));
        }
    }

    #[test]
    fn every_part_of_the_key_changes_the_noise() {
        let reference = row(Purpose::Sample, 3, 4);
        assert_ne!(reference, row(Purpose::Training, 3, 4));
        assert_ne!(reference, row(Purpose::Sample, 4, 4));
        assert_ne!(reference, row(Purpose::Sample, 3, 5));
        let mut other = Noise::new([generator(10, Purpose::Sample, 3, 4)]);
        assert_ne!(reference, host_values(other.normal([100, 7], &Device::flex())).unwrap());
    }

    #[test]
    fn noise_has_mean_0_variance_1_and_kurtosis_3() {
        let mut noise = Noise::new((0..16).map(|row| generator(1, Purpose::Training, 0, row)));
        let values = host_values(noise.normal([4000, 7], &Device::flex())).unwrap();
        let moment = |power: i32| {
            values.iter().map(|&value| f64::from(value).powi(power)).sum::<f64>()
                / values.len() as f64
        };
        // Five standard errors of 448 000 values.
        assert!(moment(1).abs() < 0.0075, "{}", moment(1));
        assert!((moment(2) - 1.0).abs() < 0.011, "{}", moment(2));
        assert!((moment(4) - 3.0).abs() < 0.075, "{}", moment(4));
    }

    #[test]
    fn whole_numbers_reach_every_value_below_the_end_evenly() {
        let mut noise = Noise::new((0..7000).map(|row| generator(1, Purpose::Training, 0, row)));
        let mut counts = [0_u32; 7];
        for number in noise.below(7) {
            counts[number] += 1;
        }
        assert!(counts.iter().all(|count| (850..1150).contains(count)), "{counts:?}");
    }
}
