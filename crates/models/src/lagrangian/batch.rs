//! A batch in a training step: its trajectories in the memory of the processor, where regressions
//! run, the samples that the step uses, and the fit of each robot to them.

use burn::tensor::{Device, Tensor, TensorData};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use series::MeasurementNoise;
use spec::MAX_JOINTS;

use super::features::Samples;
use super::filtering::smoother;
use super::law::JointLaw;
use super::recorded::{Motion, Recorded};
use super::regression::{Equation, Numbers, OwnFactors, Posterior, Prior, Regression};
use super::values;
use crate::architecture::ModelInput;

/// Torques and positions of a batch in the memory of the processor.
pub(super) struct HostBatch {
    u: Vec<f32>,
    y: Vec<f32>,
    samples: usize,
    context: usize,
    joints: usize,
    rate_hz: f32,
}

impl HostBatch {
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn new(input: &ModelInput) -> Self {
        let [_, samples, joints] = input.u.dims();
        let [_, context, _] = input.y_context.dims();
        Self {
            u: values(input.u.clone()),
            y: values(input.y_context.clone()),
            samples,
            context,
            joints,
            rate_hz: input.rate_hz as f32,
        }
    }

    /// Smooths noisy positions, because the regression uses their differences.
    pub fn smooth(&mut self, noise: MeasurementNoise) {
        if noise.position_rad <= 0.0 || self.y.is_empty() {
            return;
        }
        let smoother = smoother(&self.robot(0), noise);
        let (joints, row) = (self.joints, self.context * self.joints);
        self.y.par_chunks_exact_mut(row).for_each(|y| {
            let smoothed = smoother.smooth_robot(y, joints);
            y.copy_from_slice(&smoothed);
        });
    }

    pub fn robot(&self, robot: usize) -> Recorded<'_> {
        let &Self { samples, context, joints, rate_hz, .. } = self;
        Recorded {
            u: &self.u[robot * samples * joints..][..samples * joints],
            y: &self.y[robot * context * joints..][..context * joints],
            joints,
            rate_hz,
        }
    }
}

/// The samples of a batch in a training step, as many for each robot.
pub(super) struct Points {
    robots: usize,
    joints: usize,
    /// The first joint whose angle the network sees.
    first: usize,
    /// rad.
    angles: Vec<f32>,
    /// Sines and then cosines of each sample's angles.
    pose: Vec<f32>,
    /// 1/s.
    pose_rate: Vec<f32>,
    /// rad/s.
    velocity: Vec<f32>,
    /// rad/s².
    acceleration: Vec<f32>,
    motions: Vec<Motion>,
}

impl Points {
    /// Makes room for `count` points of each of `robots` robots with `joints` joints. The network
    /// sees the joints from `first` on.
    pub fn new([robots, joints, count]: [usize; 3], first: usize) -> Self {
        let points = robots * count;
        let room = || Vec::with_capacity(points * joints);
        Self {
            robots,
            joints,
            first,
            angles: room(),
            pose: Vec::with_capacity(points * 2 * joints),
            pose_rate: Vec::with_capacity(points * 2 * joints),
            velocity: room(),
            acceleration: room(),
            motions: Vec::with_capacity(points * joints),
        }
    }

    /// Appends a sample of the next robot.
    pub fn push(&mut self, recorded: &Recorded<'_>, sample: usize) {
        let mut velocities = [0.0; MAX_JOINTS];
        for (joint, velocity) in velocities.iter_mut().enumerate().take(self.joints) {
            let motion = recorded.motion(sample, joint);
            *velocity = motion.middle();
            self.acceleration.push(motion.change * recorded.rate_hz);
            self.motions.push(motion);
        }
        self.velocity.extend(&velocities[..self.joints]);
        self.angles.extend(&recorded.y[sample * self.joints..][..self.joints]);
        let angles = &recorded.y[sample * self.joints..][self.first..self.joints];
        let seen = &velocities[self.first..self.joints];
        self.pose.extend(angles.iter().map(|angle| angle.sin()));
        self.pose.extend(angles.iter().map(|angle| angle.cos()));
        let each = || angles.iter().zip(seen);
        self.pose_rate.extend(each().map(|(angle, velocity)| angle.cos() * velocity));
        self.pose_rate.extend(each().map(|(angle, velocity)| -angle.sin() * velocity));
    }

    /// Points of each robot.
    fn count(&self) -> usize {
        self.motions.len() / (self.robots * self.joints).max(1)
    }

    fn rows(&self) -> usize {
        self.robots * self.count()
    }

    pub fn samples(&self, device: &Device) -> Samples {
        let width = self.pose.len() / self.rows().max(1);
        let pose = [self.robots, self.count(), width];
        let row = [self.rows(), 1, self.joints];
        let turning: Vec<f32> = match self.first {
            0 => vec![0.0; self.rows()],
            _ => self.velocity.iter().copied().step_by(self.joints).collect(),
        };
        Samples {
            pose: tensor(self.pose.clone(), pose, device),
            rate: tensor(self.pose_rate.clone(), pose, device),
            velocity: tensor(self.velocity.clone(), row, device),
            acceleration: tensor(self.acceleration.clone(), row, device),
            turning: tensor(turning, [self.rows(), 1, 1], device),
        }
    }

    /// A value of each joint at each point, `[robot, point, joint]`.
    pub fn of_joints(&self, number: impl Fn(&Motion) -> f32, device: &Device) -> Tensor<3> {
        let values = self.motions.iter().map(number).collect();
        tensor(values, [self.robots, self.count(), self.joints], device)
    }

    /// rad/s², `[robot, point, joint]`.
    pub fn acceleration(&self, device: &Device) -> Tensor<3> {
        let shape = [self.robots, self.count(), self.joints];
        tensor(self.acceleration.clone(), shape, device)
    }

    /// The angles, velocities and accelerations of all points, `[point, joint]`: rad, rad/s, rad/s².
    pub fn states(&self) -> [&[f32]; 3] {
        [&self.angles, &self.velocity, &self.acceleration]
    }

    /// Fits the numbers of each robot. `equations` has the factor of each number and that of the
    /// force that acts on every robot, `[robot, point · joint, number + 1]`. `torques` has the
    /// right-hand sides, N·m.
    pub fn fit(
        &self,
        equations: &[f32],
        torques: &[f32],
        joints: &[JointLaw],
        prior: &Prior,
        numbers: Numbers,
    ) -> Posteriors {
        let noise: Vec<f64> = joints.iter().map(|joint| f64::from(joint.noise)).collect();
        let rows = self.count() * self.joints;
        let width = numbers.count() + 1;
        let posteriors: Vec<Option<Posterior>> = equations
            .par_chunks_exact(rows * width)
            .zip(torques.par_chunks_exact(rows))
            .map(|(equations, torques)| {
                let mut regression = Regression::new(numbers);
                for (row, (factors, torque)) in
                    equations.chunks_exact(width).zip(torques).enumerate()
                {
                    let joint = row % self.joints;
                    let mut own = OwnFactors::default();
                    for (kind, factor) in own.iter_mut().enumerate().take(numbers.own()) {
                        *factor = factors[numbers.shared().end + kind * self.joints + joint];
                    }
                    regression.add(&Equation {
                        joint,
                        shared: &factors[numbers.shared()],
                        own,
                        torque: torque - factors[width - 1],
                    });
                }
                regression.posterior(prior, &noise)
            })
            .collect();
        let mut fitted = Posteriors { count: numbers.count(), ..Posteriors::default() };
        for posterior in posteriors {
            fitted.push(posterior, prior);
        }
        fitted
    }
}

/// The distribution of each robot's numbers.
#[derive(Default)]
pub(super) struct Posteriors {
    /// Numbers of a robot.
    count: usize,
    /// `[robot, number]`.
    pub mean: Vec<f32>,
    /// `[robot, number]`.
    variance: Vec<f32>,
    /// `[robot, number + 1, 1 + number]`: the means in the first column, with a 1 for the force
    /// that acts on every robot, and a root of the covariance in the others.
    combinations: Vec<f32>,
    /// The information that the points add for each robot: [`Posterior::information_gain`].
    information_gain: Vec<f32>,
}

impl Posteriors {
    /// Appends the next robot. Without a posterior it gets the prior.
    #[expect(clippy::cast_possible_truncation, reason = "losses are computed in f32")]
    fn push(&mut self, posterior: Option<Posterior>, prior: &Prior) {
        let count = self.count;
        let (mean, root, information_gain) = match posterior {
            Some(posterior) => {
                (posterior.mean.clone(), posterior.root(), posterior.information_gain())
            }
            None => {
                let spread = DVector::from_column_slice(&prior.spread);
                (prior.mean.clone(), DMatrix::from_diagonal(&spread), 0.0)
            }
        };
        for (number, &mean) in mean.iter().enumerate() {
            let row = root.row(number);
            self.mean.push(mean as f32);
            self.variance.push(row.norm_squared() as f32);
            self.combinations.push(mean as f32);
            self.combinations.extend(row.iter().map(|&entry| entry as f32));
        }
        self.combinations.push(1.0);
        self.combinations.extend(std::iter::repeat_n(0.0, count));
        self.information_gain.push(information_gain as f32);
    }

    /// The mean and the spread of each number over robots.
    pub fn over_robots(&self) -> Prior {
        let (count, robots) = (self.count, self.robots().max(1) as f64);
        let over = |value: &dyn Fn(usize) -> f64| -> f64 {
            (0..self.robots()).map(|robot| value(robot * count)).sum::<f64>() / robots
        };
        let numbers = (0..count).map(|number| {
            let mean = over(&|first| f64::from(self.mean[first + number]));
            let variance = over(&|first| {
                let off = f64::from(self.mean[first + number]) - mean;
                off.mul_add(off, f64::from(self.variance[first + number]))
            });
            (mean, variance.sqrt())
        });
        let (mean, spread) = numbers.unzip();
        Prior { mean, spread }
    }

    /// The covariance over robots of combinations of their first numbers, `[combination, number]`. A
    /// few robots do not tell the correlations of many numbers, so these shrink as Schäfer and
    /// Strimmer (2005) do it: the more they differ from robot to robot, the more.
    pub fn covariance_over_robots(&self, combinations: &DMatrix<f64>) -> DMatrix<f64> {
        let (size, count) = (self.count + 1, combinations.ncols());
        let mean = DVector::from_iterator(count, self.over_robots().mean.into_iter().take(count));
        let of_robot = |of_robot: &[f32]| {
            // The first column has the means, the others a root of the robot's own covariance.
            let rows = DMatrix::from_row_slice(count, size, &of_robot[..count * size]);
            let mut root = rows.map(f64::from);
            let off = root.column(0) - &mean;
            root.set_column(0, &off);
            let root = combinations * root;
            &root * root.transpose()
        };
        let each: Vec<DMatrix<f64>> =
            self.combinations.chunks_exact(size * size).map(of_robot).collect();
        let robots = each.len().max(1) as f64;
        let mut covariance = each
            .iter()
            .fold(DMatrix::zeros(combinations.nrows(), combinations.nrows()), |sum, one| sum + one)
            / robots;
        let (mut varying, mut squares) = (0.0, 0.0);
        for row in 0..covariance.nrows() {
            for column in 0..row {
                let unit = covariance[(row, row)] * covariance[(column, column)];
                let expected = covariance[(row, column)];
                let off = each.iter().map(|one| (one[(row, column)] - expected).powi(2));
                varying += off.sum::<f64>() / (robots * (robots - 1.0).max(1.0) * unit);
                squares += expected.powi(2) / unit;
            }
        }
        let kept = if varying < squares { 1.0 - varying / squares } else { 0.0 };
        let diagonal = covariance.diagonal();
        covariance *= kept;
        covariance.set_diagonal(&diagonal);
        covariance
    }

    /// The root mean square of each joint's residual torque, N·m, for the equations of
    /// [`Points::fit`].
    pub fn residual_torques(&self, factors: &[f32], torques: &[f32], joints: usize) -> Vec<f64> {
        let width = self.count + 1;
        let rows = torques.len() / self.robots().max(1);
        let mut squares = vec![0.0; joints];
        for (row, (factors, torque)) in factors.chunks_exact(width).zip(torques).enumerate() {
            let mean = &self.mean[row / rows * self.count..][..self.count];
            let explained = factors[self.count]
                + factors.iter().zip(mean).map(|(factor, number)| factor * number).sum::<f32>();
            squares[row % joints] += f64::from(explained - torque).powi(2);
        }
        let each = (torques.len() / joints.max(1)).max(1) as f64;
        squares.into_iter().map(|square| (square / each).sqrt()).collect()
    }

    fn robots(&self) -> usize {
        self.information_gain.len()
    }

    /// `[robot, number + 1, 1 + number]`, which the equations are multiplied with.
    pub fn combinations(&self, device: &Device) -> Tensor<3> {
        let size = self.count + 1;
        tensor(self.combinations.clone(), [self.robots(), size, size], device)
    }

    /// `[robot, 1, number]`.
    pub fn mean(&self, device: &Device) -> Tensor<3> {
        tensor(self.mean.clone(), [self.robots(), 1, self.count], device)
    }

    /// `[robot, 1, number]`.
    pub fn variance(&self, device: &Device) -> Tensor<3> {
        tensor(self.variance.clone(), [self.robots(), 1, self.count], device)
    }

    /// `[robot, 1, 1]`.
    pub fn information_gain(&self, device: &Device) -> Tensor<3> {
        tensor(self.information_gain.clone(), [self.robots(), 1, 1], device)
    }
}

fn tensor(values: Vec<f32>, shape: [usize; 3], device: &Device) -> Tensor<3> {
    Tensor::from_data(TensorData::new(values, shape), device)
}
