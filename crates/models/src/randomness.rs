//! Random numbers keyed by purpose. The order of the calls does not matter.

use burn::tensor::{Device, Tensor, TensorData};
use random::{ChaCha12Rng, Rng};
use rayon::prelude::*;

use kernels::DropoutKeys;

/// The purpose of random numbers. It is part of the key, so that no number is used twice.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    /// Noise and its level in a training step, by (step, trajectory of the batch).
    Training = 1,
    /// The same in a validation, by (0, trajectory of the batch).
    Validation = 2,
    /// A sample of a prediction, by (scenario, sample).
    Sample = 3,
    /// The key of dropout in a training step, by (step, trajectory of the batch).
    Dropout = 4,
    /// The ends of the contexts of a training step, by (step, 0).
    Cut = 5,
}

/// A generator of its own for every key.
pub(crate) fn generator(seed: u64, purpose: Purpose, first: u64, second: u64) -> ChaCha12Rng {
    random::keyed([seed, purpose as u64, first, second])
}

/// A generator for each row of a batch.
#[derive(Debug)]
pub(crate) struct Noise {
    rows: Vec<ChaCha12Rng>,
    /// The keys of each row's dropout, if there is any.
    dropout: Option<DropoutKeys>,
    /// Noise that was drawn elsewhere and replaces own draws, in reverse order.
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

    /// Adds a generator for the dropout of each row.
    pub fn with_dropout(self, rows: impl IntoIterator<Item = ChaCha12Rng>) -> Self {
        let key = |mut generator: ChaCha12Rng| [(); 4].map(|()| generator.next_u32());
        Self { dropout: Some(rows.into_iter().map(key).collect()), ..self }
    }

    pub fn dropout_keys(&self) -> Option<DropoutKeys> {
        self.dropout.clone()
    }

    /// Noise that was drawn elsewhere, `[row, sample, channel]` for each call of [`Noise::normal`].
    #[cfg(test)]
    pub fn given(series: impl IntoIterator<Item = Vec<f32>>) -> Self {
        let mut given: Vec<Vec<f32>> = series.into_iter().collect();
        given.reverse();
        Self { rows: Vec::new(), dropout: None, given }
    }

    /// A whole number below `end` for each row, uniform up to one in 2³².
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
            .for_each(|(values, generator)| random::fill_normal(values, generator));
        Tensor::from_data(TensorData::new(values, [rows, samples, channels]), device)
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::{Noise, Purpose, generator};
    use crate::device::host_values;

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
    fn whole_numbers_reach_every_value_below_the_end_evenly() {
        let mut noise = Noise::new((0..7000).map(|row| generator(1, Purpose::Training, 0, row)));
        let mut counts = [0_u32; 7];
        for number in noise.below(7) {
            counts[number] += 1;
        }
        assert!(counts.iter().all(|count| (850..1150).contains(count)), "{counts:?}");
    }
}
