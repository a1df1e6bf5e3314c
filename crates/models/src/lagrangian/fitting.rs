//! The regression of a robot's context. Samples lie in lanes.

#![expect(
    clippy::needless_range_loop,
    reason = "closures do not inline into functions compiled for other instructions; loops over indices do"
)]

use simd::{Lanes, MAX_LANES};
use spec::MAX_JOINTS;

use super::dense::tanh;
use super::factored::Factored;
use super::law::{JointLaw, Law};
use super::motion::Recorded;
use super::pose::Pose;
use super::regression::{Equation, Equations, Regression};

/// The stride in samples where only poses matter: an eighth of a second at 60 Hz.
const EVERY: usize = 8;

/// Values of up to [`MAX_LANES`] samples, `[joint, lane]`.
type Gathered = [[f32; MAX_LANES]; MAX_JOINTS];

impl Law {
    #[inline(always)]
    pub(super) fn regression<L: Lanes>(&self, recorded: &Recorded<'_>) -> Regression {
        let mut regression = Regression::new(self.numbers);
        self.equations::<L>(recorded, |equation| regression.add(equation));
        regression
    }

    /// The equations of a context.
    #[inline(always)]
    pub(super) fn kept_equations<L: Lanes>(&self, recorded: &Recorded<'_>) -> Equations {
        let mut equations = Equations::new(self.numbers);
        self.equations::<L>(recorded, |equation| equations.push(equation));
        equations
    }

    /// Calls `each` with the equation of each joint, in order, at every sample with a sample on
    /// both sides.
    #[inline(always)]
    fn equations<L: Lanes>(&self, recorded: &Recorded<'_>, mut each: impl FnMut(&Equation<'_>)) {
        let joints = self.numbers.joints;
        let shared = self.numbers.shared().len();
        let mut pose = Pose::<L>::new(self);
        // `[particle or force]` of each joint in every lane.
        let mut features: Vec<Gathered> = vec![[[0.0; MAX_LANES]; MAX_JOINTS]; 1 + shared];
        let mut equation = vec![0.0; shared];
        let mut sample = 1;
        while sample + 1 < recorded.samples() {
            let lanes = L::LANES.min(recorded.samples() - 1 - sample);
            let mut gathered: [Gathered; 4] = [[[0.0; MAX_LANES]; MAX_JOINTS]; 4];
            for lane in 0..lanes {
                for joint in 0..joints {
                    let motion = recorded.motion(sample + lane, joint);
                    gathered[0][joint][lane] = recorded.y[(sample + lane) * joints + joint];
                    gathered[1][joint][lane] = motion.change * recorded.rate_hz;
                    gathered[2][joint][lane] = motion.middle();
                    gathered[3][joint][lane] = motion.velocity_at(self.joints[joint].share);
                }
            }
            let [mut q, mut acceleration, mut velocity] = [[L::splat(0.0); MAX_JOINTS]; 3];
            let mut friction: Gathered = [[0.0; MAX_LANES]; MAX_JOINTS];
            for joint in 0..joints {
                q[joint] = L::load(&gathered[0][joint]);
                acceleration[joint] = L::load(&gathered[1][joint]);
                velocity[joint] = L::load(&gathered[2][joint]);
                let [shape, _] = self.joints[joint].friction(L::load(&gathered[3][joint]));
                shape.store(&mut friction[joint]);
            }
            pose.look(self, &q, &velocity);
            for particle in 0..self.numbers.particles {
                let torques = pose.particle(self, particle, &acceleration);
                for joint in 0..joints {
                    torques[joint].store(&mut features[particle][joint]);
                }
            }
            // The force that acts on every robot comes last.
            for force in 0..=self.numbers.forces {
                let torques = pose.force(self, force);
                let place = if force == 0 { shared } else { self.numbers.particles + force - 1 };
                for joint in 0..joints {
                    torques[joint].store(&mut features[place][joint]);
                }
            }
            for lane in 0..lanes {
                for joint in 0..joints {
                    let law = self.joints[joint];
                    for (number, place) in equation.iter_mut().zip(&features) {
                        *number = place[joint][lane];
                    }
                    let motion = recorded.motion(sample + lane, joint);
                    let inertia = law.armature * gathered[1][joint][lane];
                    each(&Equation {
                        joint,
                        shared: &equation,
                        velocity: gathered[3][joint][lane],
                        friction: friction[joint][lane],
                        torque: motion.torque_at(law.share)
                            - inertia
                            - features[shared][joint][lane],
                    });
                }
            }
            sample += lanes;
        }
    }

    /// The least pivot of the mass matrix at the poses of the context, as a ratio to the inertia of
    /// the joint alone. It is at least 1 where no mass is negative.
    #[inline(always)]
    pub(super) fn least_pivot<L: Lanes>(&self, recorded: &Recorded<'_>, numbers: &[f32]) -> f32 {
        let joints = self.numbers.joints;
        let mut pose = Pose::<L>::new(self);
        let numbers: Vec<L> = numbers.iter().map(|&number| L::splat(f64::from(number))).collect();
        let mut armatures = [L::splat(0.0); MAX_JOINTS];
        for joint in 0..joints {
            armatures[joint] = L::splat(f64::from(self.joints[joint].armature));
        }
        let standing = [L::splat(0.0); MAX_JOINTS];
        let mut least = f32::INFINITY;
        // The samples are the same whatever the number of lanes.
        let last = recorded.samples().saturating_sub(1) / EVERY * EVERY;
        for first in (0..=last).step_by(EVERY * L::LANES) {
            let mut gathered: Gathered = [[0.0; MAX_LANES]; MAX_JOINTS];
            for lane in 0..L::LANES {
                let sample = (first + EVERY * lane).min(last);
                for joint in 0..joints {
                    gathered[joint][lane] = recorded.y[sample * joints + joint];
                }
            }
            let mut q = [L::splat(0.0); MAX_JOINTS];
            for joint in 0..joints {
                q[joint] = L::load(&gathered[joint]);
            }
            pose.look(self, &q, &standing);
            let factored = Factored::new(joints, pose.inertia(self, &numbers), &armatures);
            let mut ratios = [0.0; MAX_LANES];
            factored.least.store(&mut ratios);
            for lane in 0..L::LANES {
                // A NaN also becomes the least.
                least = if ratios[lane] >= least { least } else { ratios[lane] };
            }
        }
        least
    }
}

impl JointLaw {
    /// Friction of strength 1 at a velocity in rad/s, and its slope, in lanes.
    #[inline(always)]
    pub fn friction<L: Lanes>(&self, velocity: L) -> [L; 2] {
        let slope = L::splat(f64::from(self.friction_slope));
        let shift = L::splat(f64::from(self.friction_shift));
        let value = tanh((velocity + shift) * slope);
        let shape = value - tanh(shift * slope);
        [shape, slope * value.neg_mul_add(value, L::splat(1.0))]
    }
}
