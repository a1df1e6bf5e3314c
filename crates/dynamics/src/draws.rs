//! Random numbers keyed by purpose. The order of the draws does not matter.

use random::ChaCha8Rng;
use spec::Range;

/// The purpose of a sequence of draws. Each purpose has its own sequence, so another excitation
/// does not change the masses.
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
    PositionNoise = 8,
    TorqueNoise = 9,
    /// Noise that is added to positions after they were recorded.
    AddedPositionNoise = 10,
    /// Levels of torques in steps, and their durations.
    Steps = 11,
    /// References of controllers.
    Reference = 12,
    /// Gains and delays of controllers.
    Controller = 13,
    /// Levels of pulses, and their durations.
    Pulses = 14,
}

/// A sequence of random numbers keyed by (seed, trajectory, purpose, draw).
pub(crate) struct Draws(ChaCha8Rng);

impl Draws {
    pub(crate) fn new(seed: u64, trajectory: u64, purpose: Purpose, draw: u32) -> Self {
        Self(random::keyed([seed, trajectory, purpose as u64, u64::from(draw)]))
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³.
    pub(crate) fn unit(&mut self) -> f64 {
        random::unit(&mut self.0)
    }

    pub(crate) fn uniform(&mut self, range: Range) -> f64 {
        range.at(self.unit())
    }

    /// A factor from 1 − `fraction` to 1 + `fraction`.
    pub(crate) fn factor(&mut self, fraction: f64) -> f64 {
        self.uniform(Range::new(1.0 - fraction, 1.0 + fraction))
    }

    /// Normal numbers of mean 0 and variance 1.
    pub(crate) fn fill_normal(&mut self, values: &mut [f64]) {
        random::fill_normal_portably(values, &mut self.0);
    }

    /// Normal numbers of mean 0 and variance 1, other ones than those of [`Draws::fill_normal`] and
    /// several times as fast.
    pub(crate) fn fill_normal_fast(&mut self, values: &mut [f32]) {
        random::fill_normal_by_ziggurat(values, &mut self.0);
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
}
