//! The normal distribution, for tests of scores.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use random::{ChaCha8Rng, SeedableRng};

pub fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / TAU.sqrt()
}

/// The distribution function by Simpson's rule, with an error of about 1e-9.
pub fn distribution(z: f64) -> f64 {
    let steps = 2000;
    let h = z / f64::from(steps);
    let weighted = (0..=steps).map(|k| {
        let weight = match k {
            0 => 1.0,
            k if k == steps => 1.0,
            k if k % 2 == 1 => 4.0,
            _ => 2.0,
        };
        weight * density(f64::from(k) * h)
    });
    0.5 + weighted.sum::<f64>() * h / 3.0
}

/// Independent standard normal numbers.
pub fn samples(seed: u64, count: usize) -> Vec<f64> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| random::normal(&mut generator)).collect()
}

#[test]
fn the_distribution_is_the_normal_one() {
    for (z, expected) in [(0.0, 0.5), (FRAC_1_SQRT_2, 0.760_249_938_9), (-1.96, 0.024_997_895_1)] {
        assert!((distribution(z) - expected).abs() < 1e-8, "{z}");
    }
}
