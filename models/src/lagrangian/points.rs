use burn::tensor::{Device, Tensor, TensorData};
use spec::MAX_JOINTS;

use super::fit::{Prior, Sums};
use super::motion::{Motion, Recorded, products};

/// Samples of a batch that a step of training looks at: so many of each robot.
pub(super) struct Points {
    robots: usize,
    joints: usize,
    /// Sines and then cosines of each sample's angles.
    pose: Vec<f32>,
    /// rad/s².
    acceleration: Vec<f32>,
    /// rad²/s².
    products: Vec<f32>,
    motions: Vec<Motion>,
}

impl Points {
    /// Of arms of `joints`, with room for `count` points of each of `robots`.
    pub fn new([robots, joints, count]: [usize; 3]) -> Self {
        let points = robots * count;
        Self {
            robots,
            joints,
            pose: Vec::with_capacity(points * 2 * joints),
            acceleration: Vec::with_capacity(points * joints),
            products: Vec::with_capacity(points * products(joints)),
            motions: Vec::with_capacity(points * joints),
        }
    }

    /// Appends a sample of the robot that is next. The pose is that of the joints from `first` on.
    pub fn push(&mut self, recorded: &Recorded<'_>, sample: usize, first: usize) {
        let angles = &recorded.y[sample * self.joints..][first..self.joints];
        self.pose.extend(angles.iter().map(|angle| angle.sin()));
        self.pose.extend(angles.iter().map(|angle| angle.cos()));
        let mut velocities = [0.0; MAX_JOINTS];
        for (joint, velocity) in velocities.iter_mut().enumerate().take(self.joints) {
            let motion = recorded.motion(sample, joint);
            *velocity = 0.5_f32.mul_add(motion.change, motion.velocity);
            self.acceleration.push(motion.change * recorded.rate_hz);
            self.motions.push(motion);
        }
        for (first, velocity) in velocities.iter().enumerate().take(self.joints) {
            let others = &velocities[first..self.joints];
            self.products.extend(others.iter().map(|other| velocity * other));
        }
    }

    /// Points of each robot.
    fn count(&self) -> usize {
        self.motions.len() / (self.robots * self.joints).max(1)
    }

    /// `[robot, point, 2 · input]`.
    pub fn pose(&self, device: &Device) -> Tensor<3> {
        let width = self.pose.len() / (self.robots * self.count()).max(1);
        tensor(self.pose.clone(), [self.robots, self.count(), width], device)
    }

    /// `[robot · point, joint, 1]`.
    pub fn acceleration(&self, device: &Device) -> Tensor<3> {
        let shape = [self.robots * self.count(), self.joints, 1];
        tensor(self.acceleration.clone(), shape, device)
    }

    /// `[robot · point, 1, product]`.
    pub fn products(&self, device: &Device) -> Tensor<3> {
        let shape = [self.robots * self.count(), 1, products(self.joints)];
        tensor(self.products.clone(), shape, device)
    }

    /// Fits the damping of each joint of each robot, given the torques that inertia takes
    /// `[robot, point, joint]`.
    pub fn fit(&self, inertial: &[f32], priors: &[Prior]) -> Fitted {
        let (robots, joints, count) = (self.robots, self.joints, self.count());
        let mut fitted = Fitted::default();
        for robot in 0..robots {
            let here = robot * count * joints..(robot + 1) * count * joints;
            let (motions, inertial) = (&self.motions[here.clone()], &inertial[here]);
            for (joint, prior) in priors.iter().enumerate() {
                let mut sums = Sums::default();
                for (&motion, &inertial) in motions.iter().zip(inertial).skip(joint).step_by(joints)
                {
                    sums.add(prior.share, motion, inertial);
                }
                fitted.damping.push(prior.damping(&sums));
                fitted.squares.push(sums.squares);
            }
        }
        fitted
    }

    /// The torque that is missing at the older value and by how much more at the newer one, N·m, each
    /// `[robot, point, joint]`: damping times velocity less torque.
    pub fn missing(&self, fitted: &Fitted, device: &Device) -> [Tensor<3>; 2] {
        let per_robot = self.count() * self.joints;
        let mut older = Vec::with_capacity(self.motions.len());
        let mut more = Vec::with_capacity(self.motions.len());
        for (index, motion) in self.motions.iter().enumerate() {
            let of = index / per_robot * self.joints + index % self.joints;
            let damping = fitted.damping[of];
            older.push(damping.mul_add(motion.velocity, -motion.torque));
            more.push(damping.mul_add(motion.change, -motion.step));
        }
        let shape = [self.robots, self.count(), self.joints];
        [older, more].map(|values| tensor(values, shape, device))
    }
}

/// The dampings of each robot, `[robot, joint]`.
#[derive(Default)]
pub(super) struct Fitted {
    /// N·m·s/rad.
    damping: Vec<f32>,
    /// Sums of squared velocities that tell it, rad²/s².
    squares: Vec<f64>,
}

impl Fitted {
    /// `[robot, 1, joint]`, N·m·s/rad.
    pub fn damping(&self, joints: usize, device: &Device) -> Tensor<3> {
        let robots = self.damping.len() / joints;
        tensor(self.damping.clone(), [robots, 1, joints], device)
    }

    /// `[robot, 1, joint]`, rad²/s².
    #[expect(clippy::cast_possible_truncation, reason = "losses are computed in f32")]
    pub fn squares(&self, joints: usize, device: &Device) -> Tensor<3> {
        let values: Vec<f32> = self.squares.iter().map(|&squares| squares as f32).collect();
        let robots = values.len() / joints;
        tensor(values, [robots, 1, joints], device)
    }
}

fn tensor(values: Vec<f32>, shape: [usize; 3], device: &Device) -> Tensor<3> {
    Tensor::from_data(TensorData::new(values, shape), device)
}
