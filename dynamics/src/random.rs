//! Random numbers that depend on what they are for, never on when they are drawn.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use spec::Range;

/// What a sequence of draws decides; each purpose has a sequence of its own, so that a change of
/// one (another excitation, say) leaves the others as they were.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    /// Excitation family and master frequency.
    Design = 0,
    Robot = 1,
    InitialState = 2,
    Excitation = 3,
    Armature = 4,
    Geometry = 5,
    Friction = 6,
    Payload = 7,
}

/// A sequence of random numbers keyed by (seed, trajectory, purpose, draw).
///
/// The key is the ChaCha key itself, so that sequences are independent without any seeding of
/// one generator from another (Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3").
pub(crate) struct Draws(ChaCha8Rng);

impl Draws {
    pub(crate) fn new(seed: u64, trajectory: u64, purpose: Purpose, draw: u32) -> Self {
        let mut key = [0; 32];
        let words = [seed, trajectory, purpose as u64, u64::from(draw)];
        for (bytes, word) in key.chunks_exact_mut(8).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        Self(ChaCha8Rng::from_seed(key))
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³.
    pub(crate) fn unit(&mut self) -> f64 {
        const TWO_POW_MINUS_53: f64 = 1.0 / (1u64 << 53) as f64;
        let mantissa = self.0.next_u64() >> 11;
        mantissa as f64 * TWO_POW_MINUS_53
    }

    pub(crate) fn uniform(&mut self, range: Range) -> f64 {
        range.at(self.unit())
    }

    /// A factor from 1 − `fraction` to 1 + `fraction`.
    pub(crate) fn factor(&mut self, fraction: f64) -> f64 {
        self.uniform(Range::new(1.0 - fraction, 1.0 + fraction))
    }

    /// −1 or 1.
    pub(crate) fn sign(&mut self) -> f64 {
        if self.unit() < 0.5 { -1.0 } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_the_key_changes_the_sequence() {
        let base = Draws::new(1, 2, Purpose::Robot, 3).unit();
        let others = [
            Draws::new(2, 2, Purpose::Robot, 3).unit(),
            Draws::new(1, 3, Purpose::Robot, 3).unit(),
            Draws::new(1, 2, Purpose::Excitation, 3).unit(),
            Draws::new(1, 2, Purpose::Robot, 4).unit(),
        ];
        assert!(others.iter().all(|&other| other != base));
        assert_eq!(Draws::new(1, 2, Purpose::Robot, 3).unit(), base);
    }

    #[test]
    fn units_have_the_mean_and_variance_of_a_uniform_distribution() {
        let mut draws = Draws::new(0, 0, Purpose::Robot, 1);
        let units: Vec<f64> = (0..100_000).map(|_| draws.unit()).collect();
        let mean = units.iter().sum::<f64>() / 1e5;
        let variance = units.iter().map(|unit| (unit - mean).powi(2)).sum::<f64>() / 1e5;
        assert!(units.iter().all(|unit| (0.0..1.0).contains(unit)));
        assert!((mean - 0.5).abs() < 0.005, "{mean}");
        assert!((variance - 1.0 / 12.0).abs() < 0.002, "{variance}");
    }
}
