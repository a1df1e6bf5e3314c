use std::ops::Range;

/// The numbers that are fitted to one robot, in order: the weight of each particle, the strength of each force,
/// the damping of each joint in N·m·s/rad, and its friction in N·m.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Numbers {
    pub particles: usize,
    pub forces: usize,
    pub joints: usize,
}

impl Numbers {
    pub fn count(self) -> usize {
        self.frictions().end
    }

    pub fn weights(self) -> Range<usize> {
        0..self.particles
    }

    pub fn strengths(self) -> Range<usize> {
        self.particles..self.particles + self.forces
    }

    /// Weights and strengths, which occur in the equations of every joint.
    pub fn shared(self) -> Range<usize> {
        0..self.particles + self.forces
    }

    pub fn dampings(self) -> Range<usize> {
        let first = self.shared().end;
        first..first + self.joints
    }

    pub fn frictions(self) -> Range<usize> {
        let first = self.dampings().end;
        first..first + self.joints
    }

    /// Whether a number must be at least 0. Forces have both signs.
    pub fn is_bounded(self, number: usize, bounds: Bounds) -> bool {
        match bounds {
            Bounds::Own => !self.shared().contains(&number),
            Bounds::Masses => !self.strengths().contains(&number),
        }
    }

    /// Raises numbers below their bound to it.
    pub fn keep_bounds<T: PartialOrd + Default>(self, values: &mut [T], bounds: Bounds) {
        for (number, value) in values.iter_mut().enumerate() {
            if *value < T::default() && self.is_bounded(number, bounds) {
                *value = T::default();
            }
        }
    }
}

/// The numbers of a robot that must be at least 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bounds {
    /// Dampings and frictions. A particle is not a body of its own, so its mass may be negative and
    /// correct that of the others.
    Own,
    /// Masses, too.
    Masses,
}
