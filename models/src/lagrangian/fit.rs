//! The fit of a robot's dampings to its context: Bayesian linear regression, in closed form.

use super::motion::Motion;

/// Knowledge of a joint before its robot is seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    /// How far torque and velocity lie towards the newer of two values, 0 to 1.
    pub share: f32,
    /// Mean of the damping over robots, N·m·s/rad.
    pub mean: f32,
    /// Its standard deviation over robots.
    pub spread: f32,
    /// Standard deviation of the torque that the law leaves over at a sample, N·m.
    pub noise: f32,
}

/// Sums over the samples of a joint, for the regression of the torque that inertia does not take on the
/// velocity.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// Σ v².
    pub squares: f64,
    /// Σ v (u - inertial torque).
    pub products: f64,
}

impl Sums {
    pub fn add(&mut self, share: f32, motion: Motion, inertial: f32) {
        let velocity = f64::from(share.mul_add(motion.change, motion.velocity));
        let torque = share.mul_add(motion.step, motion.torque);
        self.squares += velocity * velocity;
        self.products += velocity * f64::from(torque - inertial);
    }
}

impl Prior {
    /// The most likely damping of a robot; the mean over robots where nothing has moved. None drives its
    /// arm: it is 0 at least.
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn damping(&self, sums: &Sums) -> f32 {
        let weight = (f64::from(self.noise) / f64::from(self.spread)).powi(2);
        let damping = (weight * f64::from(self.mean) + sums.products) / (weight + sums.squares);
        damping.max(0.0) as f32
    }
}
