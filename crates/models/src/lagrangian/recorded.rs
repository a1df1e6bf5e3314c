//! Velocities, accelerations and torques around one sample of a trajectory.
//!
//! Positions are sampled, and everything else is a difference. The mean velocity from sample k - 1
//! to sample k is (q_k - q_{k-1}) / h, with the sampling time h. From there to the next sampling
//! time it changes by h times the acceleration at sample k.

/// The velocity and torque of one joint around one sample, as the law takes them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    /// Mean velocity over the sampling time before the sample, rad/s.
    pub velocity: f32,
    /// Increase of the mean velocity over the sampling time after the sample, rad/s.
    pub change: f32,
    /// Torque over the sampling time before the sample, N·m.
    pub torque: f32,
    /// Increase of the torque over the sampling time after the sample, N·m.
    pub step: f32,
}

impl Motion {
    /// The mean of the velocities over both sampling times, rad/s.
    pub fn middle(&self) -> f32 {
        0.5_f32.mul_add(self.change, self.velocity)
    }

    /// The velocity at a share of the way from the older to the newer one, rad/s.
    pub fn velocity_at(&self, share: f32) -> f32 {
        share.mul_add(self.change, self.velocity)
    }

    /// The torque at a share of the way from the older to the newer one, N·m.
    pub fn torque_at(&self, share: f32) -> f32 {
        share.mul_add(self.step, self.torque)
    }
}

/// Torques of a trajectory, and positions of its context, `[sample, joint]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recorded<'a> {
    pub u: &'a [f32],
    pub y: &'a [f32],
    pub joints: usize,
    pub rate_hz: f32,
}

impl Recorded<'_> {
    /// Samples that have a position.
    pub fn samples(&self) -> usize {
        self.y.len() / self.joints
    }

    /// The index of the values of the last sample but one, or 0 if there is a single sample.
    pub fn before(&self) -> usize {
        self.samples().saturating_sub(2) * self.joints
    }

    /// Whether `other` has the same past, so that it is the same robot. The torque at the last
    /// position does not belong to the past, because it acts only later.
    pub fn has_the_past_of(&self, other: &Self) -> bool {
        let past = self.y.len() - self.joints;
        self.y == other.y && self.u[..past] == other.u[..past]
    }

    pub fn motion(&self, sample: usize, joint: usize) -> Motion {
        let at = sample * self.joints + joint;
        let [before, here, after] = [at - self.joints, at, at + self.joints];
        let velocity = self.rate_hz * (self.y[here] - self.y[before]);
        Motion {
            velocity,
            change: self.rate_hz * (self.y[after] - self.y[here]) - velocity,
            torque: self.u[before],
            step: self.u[here] - self.u[before],
        }
    }

    /// The last mean velocity in the positions, rad/s; 0 for a single position.
    pub fn last_velocity(&self, joint: usize) -> f32 {
        let last = self.y.len() - self.joints + joint;
        match last.checked_sub(self.joints) {
            Some(before) => self.rate_hz * (self.y[last] - self.y[before]),
            None => 0.0,
        }
    }
}
