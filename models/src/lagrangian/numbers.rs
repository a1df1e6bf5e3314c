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

    /// Weights and strengths, which every joint feels.
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

    /// Whether a number is 0 at least, as damping and friction are. A force points both ways, and a particle takes
    /// away what others have too much of: those of one robot are no bodies of their own.
    pub fn is_bounded(self, number: usize) -> bool {
        !self.shared().contains(&number)
    }

    /// Raises numbers below their bound to it.
    pub fn keep_bounds<T: PartialOrd + Default>(self, values: &mut [T]) {
        for (number, value) in values.iter_mut().enumerate() {
            if *value < T::default() && self.is_bounded(number) {
                *value = T::default();
            }
        }
    }
}
