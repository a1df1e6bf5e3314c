//! Random numbers keyed by purpose. The order of the calls does not matter.
//!
//! A generator's key is the ChaCha key itself (Bernstein 2008), so that sequences of different keys
//! are independent without seeding one generator from another (Salmon et al. 2011, *Parallel random
//! numbers: as easy as 1, 2, 3*). Datasets, trainings and intervals consist of these numbers, so
//! none of their bits may change.

#![warn(missing_docs)]

use std::sync::LazyLock;

pub use rand_chacha::{ChaCha8Rng, ChaCha12Rng};
pub use rand_core::{Rng, SeedableRng};

/// A separate generator for every key of four numbers.
pub fn keyed<G: SeedableRng<Seed = [u8; 32]>>(key: [u64; 4]) -> G {
    let mut seed = [0; 32];
    for (bytes, number) in seed.chunks_exact_mut(8).zip(key) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    G::from_seed(seed)
}

/// Uniform in [0, 1), a multiple of 2⁻⁵³.
pub fn unit(generator: &mut impl Rng) -> f64 {
    const STEP: f64 = 1.0 / (1u64 << 53) as f64;
    (generator.next_u64() >> 11) as f64 * STEP
}

/// Uniform in [0, 1), a multiple of 2⁻²⁴. An `f32` represents each exactly.
pub fn unit_f32(generator: &mut impl Rng) -> f32 {
    const STEP: f32 = 1.0 / (1u32 << 24) as f32;
    (generator.next_u32() >> 8) as f32 * STEP
}

/// Uniform index below `count`, by the high half of a 64-bit product.
#[expect(clippy::cast_possible_truncation, reason = "the result is below `count`, a usize")]
pub fn below(generator: &mut impl Rng, count: usize) -> usize {
    ((u128::from(generator.next_u64()) * count as u128) >> 64) as usize
}

/// Shuffles items. All orders are equally likely (Fisher and Yates).
pub fn shuffle<T>(items: &mut [T], generator: &mut impl Rng) {
    for last in (1..items.len()).rev() {
        items.swap(last, below(generator, last + 1));
    }
}

/// Normal with mean 0 and variance 1 (Box and Muller 1958, the cosine branch), never infinite.
pub fn normal(generator: &mut impl Rng) -> f64 {
    const HALF_STEP: f64 = 0.5 / (1u64 << 53) as f64;
    let mut inner = || unit(generator) + HALF_STEP;
    (-2.0 * inner().ln()).sqrt() * (std::f64::consts::TAU * inner()).cos()
}

/// Fills `values` with normal numbers of mean 0 and variance 1 (both branches of Box and Muller).
pub fn fill_normal(values: &mut [f32], generator: &mut impl Rng) {
    for pair in values.chunks_mut(2) {
        let radius = (-2.0 * (1.0 - unit_f32(generator)).ln()).sqrt();
        let (sine, cosine) = (std::f32::consts::TAU * unit_f32(generator)).sin_cos();
        for (value, direction) in pair.iter_mut().zip([cosine, sine]) {
            *value = radius * direction;
        }
    }
}

/// Fills `values` with normal numbers of mean 0 and variance 1. Their bits are the same on every
/// machine: the polar method of Marsaglia and Bray (1964), with a logarithm computed in software.
/// The first numbers of a generator are the same for every length.
pub fn fill_normal_portably(values: &mut [f64], generator: &mut impl Rng) {
    for pair in values.chunks_mut(2) {
        let (x, y, square) = loop {
            let [x, y] = [(); 2].map(|()| 2.0 * unit(generator) - 1.0);
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                break (x, y, square);
            }
        };
        let scale = (-2.0 * libm::log(square) / square).sqrt();
        for (value, direction) in pair.iter_mut().zip([x, y]) {
            *value = scale * direction;
        }
    }
}

/// Fills `values` with normal numbers of mean 0 and variance 1, several times as fast as
/// [`fill_normal_portably`], and with the same bits on every machine as well. Their resolution is
/// 2⁻²⁴ of the largest number of their layer.
///
/// Source: Doornik 2005, "An improved ziggurat method to generate normal random samples", with 128
/// layers and one word of 32 bits for most numbers.
pub fn fill_normal_by_ziggurat(values: &mut [f32], generator: &mut impl Rng) {
    #[expect(clippy::cast_possible_truncation, reason = "numbers are asked for in f32")]
    values.fill_with(|| ZIGGURAT.draw(generator) as f32);
}

/// Layers of equal area under the bell curve.
struct Ziggurat {
    /// Half-widths of the layers, the lowest first. The lowest one stands for the tail as well.
    width: [f64; LAYERS + 1],
    /// The part of each layer that lies under the curve wherever it is hit.
    inner: [f64; LAYERS],
}

const LAYERS: usize = 128;

/// The beginning of the tail, and the area of a layer (Doornik 2005, table 1).
const TAIL: f64 = 3.442_619_855_899;
const AREA: f64 = 9.912_563_035_262_17e-3;

static ZIGGURAT: LazyLock<Ziggurat> = LazyLock::new(Ziggurat::new);

impl Ziggurat {
    fn new() -> Self {
        let curve = |x: f64| libm::exp(-0.5 * x * x);
        let mut width = [0.0; LAYERS + 1];
        (width[0], width[1]) = (AREA / curve(TAIL), TAIL);
        for layer in 2..LAYERS {
            let below = width[layer - 1];
            width[layer] = (-2.0 * libm::log(AREA / below + curve(below))).sqrt();
        }
        let inner = std::array::from_fn(|layer| width[layer + 1] / width[layer]);
        Self { width, inner }
    }

    fn draw(&self, generator: &mut impl Rng) -> f64 {
        loop {
            let word = generator.next_u32();
            let layer = (word % 128) as usize;
            // The other 25 bits are a number from -1 to 1.
            let share = f64::from(word >> 7) / f64::from(1 << 24) - 1.0;
            let x = share * self.width[layer];
            if share.abs() < self.inner[layer] {
                return x;
            }
            if layer == 0 {
                return Self::tail(generator).copysign(share);
            }
            let fall = |width: f64| libm::exp(-0.5 * (width * width - x * x));
            let [outer, inner] = [fall(self.width[layer]), fall(self.width[layer + 1])];
            if inner + unit(generator) * (outer - inner) < 1.0 {
                return x;
            }
        }
    }

    /// A number beyond [`TAIL`] (Marsaglia 1964).
    fn tail(generator: &mut impl Rng) -> f64 {
        loop {
            let [x, y] = [(); 2].map(|()| libm::log(1.0 - unit(generator)));
            let beyond = -x / TAIL;
            if -2.0 * y >= beyond * beyond {
                return TAIL + beyond;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ziggurat_has_the_distribution_of_a_normal_number() {
        const COUNT: u32 = 4_000_000;
        let mut values = vec![0.0; COUNT as usize];
        fill_normal_by_ziggurat(&mut values, &mut generator());
        let values: Vec<f64> = values.into_iter().map(f64::from).collect();
        let (mean, variance) = moments(&values);
        assert!(mean.abs() < 2e-3 && (variance - 1.0).abs() < 3e-3, "{mean} {variance}");
        // Shares on one side of these, from 0.5 erfc(x / √2), with five standard deviations.
        for x in [-3.6, -3.0, -2.0, -1.0, -0.1, 0.0, 0.5, 1.5, 2.5, 3.442_619_855_899, 4.0] {
            let expected = 0.5 * libm::erfc(x / std::f64::consts::SQRT_2);
            let above = values.iter().filter(|value| **value > x).count() as f64;
            let count = f64::from(COUNT);
            let deviation = (count * expected * (1.0 - expected)).sqrt();
            assert!((above - count * expected).abs() < 5.0 * deviation, "{x}: {above}");
        }
    }

    /// Fails if the numbers of a key change, on this machine or since they were written here.
    #[test]
    fn the_ziggurat_s_numbers_are_pinned() {
        let mut values = [0.0; 4];
        fill_normal_by_ziggurat(&mut values, &mut generator());
        assert_eq!(values.map(f32::to_bits), [1064281621, 3215192448, 1067752191, 3198485656]);
        let mut longer = [0.0; 7];
        fill_normal_by_ziggurat(&mut longer, &mut generator());
        assert_eq!(longer[..4], values);
    }

    fn generator() -> ChaCha8Rng {
        keyed([7, 1, 2, 3])
    }

    /// Mean and variance.
    fn moments(values: &[f64]) -> (f64, f64) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        (mean, squares / values.len() as f64)
    }

    /// Fails if a new version of a dependency draws other numbers for the same key.
    #[test]
    fn the_numbers_of_a_key_are_pinned() {
        assert_eq!(keyed::<ChaCha8Rng>([0; 4]).next_u32(), 0x2fef_003e);
        assert_eq!(keyed::<ChaCha12Rng>([0; 4]).next_u32(), 0x6a9a_f49b);
    }

    #[test]
    fn every_part_of_the_key_changes_the_sequence() {
        let base = unit(&mut generator());
        for part in 0..4 {
            let mut key = [7, 1, 2, 3];
            key[part] += 1;
            assert_ne!(unit(&mut keyed::<ChaCha8Rng>(key)), base);
        }
        assert_eq!(unit(&mut generator()), base);
    }

    #[test]
    fn units_have_the_mean_and_variance_of_a_uniform_distribution() {
        let mut generator = generator();
        let units: Vec<f64> = (0..100_000).map(|_| unit(&mut generator)).collect();
        let short: Vec<f64> = (0..100_000).map(|_| unit_f32(&mut generator).into()).collect();
        for values in [units, short] {
            let (mean, variance) = moments(&values);
            assert!(values.iter().all(|value| (0.0..1.0).contains(value)));
            assert!((mean - 0.5).abs() < 0.005, "{mean}");
            assert!((variance - 1.0 / 12.0).abs() < 0.002, "{variance}");
        }
    }

    #[test]
    fn normal_numbers_have_mean_0_variance_1_and_kurtosis_3() {
        let mut generator = generator();
        let alone: Vec<f64> = (0..400_000).map(|_| normal(&mut generator)).collect();
        let mut filled = vec![0.0; 400_001];
        fill_normal(&mut filled, &mut generator);
        let filled: Vec<f64> = filled.into_iter().map(f64::from).collect();
        let mut portable = vec![0.0; 400_001];
        fill_normal_portably(&mut portable, &mut generator);
        for values in [alone, filled, portable] {
            let (mean, variance) = moments(&values);
            let fourth =
                values.iter().map(|value| value.powi(4)).sum::<f64>() / values.len() as f64;
            // Five standard errors.
            assert!(mean.abs() < 0.008, "{mean}");
            assert!((variance - 1.0).abs() < 0.012, "{variance}");
            assert!((fourth - 3.0).abs() < 0.08, "{fourth}");
        }
    }

    /// Datasets contain these numbers.
    #[test]
    fn portable_normal_numbers_are_pinned_and_begin_alike_at_every_length() {
        let mut short = [0.0; 3];
        fill_normal_portably(&mut short, &mut generator());
        let mut long = [0.0; 8];
        fill_normal_portably(&mut long, &mut generator());
        assert_eq!(short, long[..3]);
        assert_eq!(
            short.map(f64::to_bits),
            [13_824_775_214_309_844_588, 13_824_087_296_958_530_819, 13_822_646_093_797_407_635]
        );
    }

    #[test]
    fn indices_reach_every_place_evenly_and_shuffles_keep_every_item() {
        let mut generator = generator();
        let mut counts = [0_u32; 7];
        for _ in 0..7000 {
            counts[below(&mut generator, 7)] += 1;
        }
        assert!(counts.iter().all(|count| (850..1150).contains(count)), "{counts:?}");
        let mut items: Vec<u32> = (0..100).collect();
        shuffle(&mut items, &mut generator);
        assert_ne!(items, (0..100).collect::<Vec<_>>());
        items.sort_unstable();
        assert_eq!(items, (0..100).collect::<Vec<_>>());
    }
}
