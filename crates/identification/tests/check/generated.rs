//! Logs of arms whose mistakes are known.

use std::f64::consts::{FRAC_PI_2, TAU};

use dynamics::{Joints, LINK_PARAMETERS, RigidBody, Robot, torque_regressor};
use identification::Recording;
use random::{keyed, normal, unit};
use spec::{Gravity, JointFriction, RobotDescription, RobotModel, RobotSpec};

/// The first joints of a Panda, with the friction and rotors of a real arm.
pub fn arm(joints: usize) -> RobotDescription {
    let mut description = RobotModel::panda().description().clone();
    description.joints.truncate(joints);
    description.initial_state.center_rad.truncate(joints);
    for (joint, described) in (0..).zip(&mut description.joints) {
        let size = 0.6_f64.powi(joint);
        described.damping_nm_s_rad = 3.0 * size;
        described.armature_kg_m2 = 0.7 * size;
        described.friction =
            Some(JointFriction { phi1_nm: 3.0 * size, phi2_s_rad: 40.0, phi3_rad_s: 0.0 });
    }
    description
}

/// An arm that differs from the description: 10 % in masses, 30 % in moments of inertia and
/// friction, 2 cm in centres of mass.
pub fn drawn(described: &RobotDescription, seed: u64) -> RobotDescription {
    let mut generator = keyed::<rand_chacha::ChaCha8Rng>([seed, 0, 0, 0]);
    let mut drawn = described.clone();
    for joint in &mut drawn.joints {
        let mut factor = |deviation: f64| (deviation * normal(&mut generator)).exp();
        joint.link.mass_kg *= factor(0.1);
        let stretch = factor(0.3);
        joint.link.inertia_kg_m2 = joint.link.inertia_kg_m2.map(|entry| entry * stretch);
        joint.damping_nm_s_rad *= factor(0.3);
        joint.armature_kg_m2 *= factor(0.3);
        if let Some(friction) = &mut joint.friction {
            friction.phi1_nm *= factor(0.3);
        }
        for coordinate in &mut joint.link.center_m {
            *coordinate += 0.02 * normal(&mut generator);
        }
    }
    drawn
}

/// A log of an arm: its motion, and what is wrong with it.
pub struct Log {
    arm: RobotDescription,
    seed: u64,
    pub seconds: f64,
    pub rate_hz: f64,
    /// The lowest of six frequencies.
    pub base_hz: f64,
    /// Of each joint, times a usual one.
    pub amplitudes: Vec<f64>,
    pub delay_s: f64,
    /// The share of the arm's weight in the torques.
    pub gravity: f64,
    pub q_factors: Vec<f64>,
    pub u_factors: Vec<f64>,
    /// The joint in each column.
    pub q_columns: Vec<usize>,
    pub u_columns: Vec<usize>,
}

impl Log {
    pub fn of(arm: &RobotDescription, seed: u64) -> Self {
        let joints = arm.joints.len();
        Self {
            arm: arm.clone(),
            seed,
            seconds: 30.0,
            rate_hz: 125.0,
            base_hz: 0.1,
            amplitudes: vec![1.0; joints],
            delay_s: 0.0,
            gravity: 1.0,
            q_factors: vec![1.0; joints],
            u_factors: vec![1.0; joints],
            q_columns: (0..joints).collect(),
            u_columns: (0..joints).collect(),
        }
    }

    /// Encoders have 2e-5 rad of noise, and torques 0.03 N·m.
    pub fn recording(&self) -> Recording {
        const HARMONICS: i32 = 6;

        let model = RobotModel::Described(Box::new(self.arm.clone()));
        let robot = Robot::nominal(&RobotSpec { gravity: Gravity::On, ..RobotSpec::of(model) });
        let joints = robot.joints();
        let mut generator = keyed::<rand_chacha::ChaCha8Rng>([self.seed, 1, 0, 0]);
        let center = &self.arm.initial_state.center_rad;
        let waves: Vec<Vec<(f64, f64)>> = (0..joints)
            .map(|joint| {
                let wave = |n: i32| {
                    let amplitude = 0.5 / f64::from(n) * (0.5 + unit(&mut generator));
                    (self.amplitudes[joint] * amplitude, TAU * unit(&mut generator))
                };
                (1..=HARMONICS).map(wave).collect()
            })
            .collect();
        let motion = |t: f64| {
            [0, 1, 2].map(|order: i32| {
                Joints::from_fn(joints, |joint| {
                    let still = if order == 0 { center[joint] } else { 0.0 };
                    (1..).zip(&waves[joint]).fold(still, |sum, (n, (amplitude, phase))| {
                        let w = TAU * self.base_hz * f64::from(n);
                        let turned = w * t + phase + f64::from(order) * FRAC_PI_2;
                        sum + amplitude * w.powi(order) * turned.sin()
                    })
                })
            })
        };
        let torques = |t: f64| {
            let [q, qd, qdd] = motion(t);
            let still = Joints::splat(joints, 0.0);
            let of_links = |qd: &Joints<f64>, qdd: &Joints<f64>| {
                let mut regressor = vec![0.0; joints * joints * LINK_PARAMETERS];
                torque_regressor(&robot.kinematics, robot.gravity, &q, qd, qdd, &mut regressor);
                let parameters: Vec<f64> =
                    robot.links.iter().flat_map(RigidBody::parameters).collect();
                let rows = regressor.chunks(parameters.len());
                let torque = |row: &[f64]| row.iter().zip(&parameters).map(|(y, p)| y * p).sum();
                rows.map(torque).collect::<Vec<f64>>()
            };
            let (all, weight) = (of_links(&qd, &qdd), of_links(&still, &still));
            let torque = |joint: usize| {
                let friction = self.arm.joints[joint].friction.unwrap();
                let coulomb =
                    0.5 * friction.phi1_nm * (0.5 * friction.phi2_s_rad * qd[joint]).tanh();
                all[joint]
                    + (self.gravity - 1.0) * weight[joint]
                    + robot.armature[joint] * qdd[joint]
                    + robot.damping[joint] * qd[joint]
                    + coulomb
            };
            (0..joints).map(torque).collect::<Vec<f64>>()
        };
        let mut recording = Recording {
            name: format!("{}", self.seed),
            rate_hz: self.rate_hz,
            q: Vec::new(),
            u: Vec::new(),
        };
        let times = (0_u32..).map(|sample| f64::from(sample) / self.rate_hz);
        for t in times.take_while(|t| *t < self.seconds) {
            let [q, ..] = motion(t);
            let u = torques(t - self.delay_s);
            let mut noise = |size: f64| size * normal(&mut generator);
            let q: Vec<f64> = (0..joints).map(|k| self.q_factors[k] * q[k] + noise(2e-5)).collect();
            let u: Vec<f64> = (0..joints)
                .map(|k| {
                    let unit = if self.u_factors[k] == 0.0 { 1.0 } else { self.u_factors[k] };
                    self.u_factors[k] * u[k] + unit * noise(0.03)
                })
                .collect();
            recording.q.push(self.q_columns.iter().map(|column| q[*column]).collect());
            recording.u.push(self.u_columns.iter().map(|column| u[*column]).collect());
        }
        recording
    }
}
