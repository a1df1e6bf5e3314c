//! The numbers of an arm that are identified, and the robot with these numbers.

use dynamics::{Friction, Joints, LINK_PARAMETERS, RigidBody, Robot};
use nalgebra::{DMatrix, DVector, Vector3};
use spec::{
    BodyDescription, Gravity, HandDescription, JointDescription, JointFriction, RobotDescription,
    RobotModel, RobotSpec,
};

use crate::IdentificationError;
use crate::body::{self, LogCholesky};

/// Numbers of a joint besides those of its link.
pub(crate) const JOINT_NUMBERS: usize = 6;
/// Where a joint's own numbers begin among those of joint and link: Coulomb and viscous friction,
/// offset, rotor inertia, gain, bend.
pub(crate) const OWN: usize = LINK_PARAMETERS;
/// All numbers of a joint and its link.
pub(crate) const NUMBERS: usize = LINK_PARAMETERS + JOINT_NUMBERS;

/// A number of a joint that is identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointParameter {
    /// Coulomb friction, N·m.
    Coulomb,
    /// Viscous friction, N·m·s/rad.
    Viscous,
    /// A constant torque that the sensor adds, before its gain, N·m.
    Offset,
    /// Reflected rotor inertia, kg·m².
    Rotor,
    /// Measured torque per torque. Motor currents times a nominal constant are often off by 10 %.
    Gain,
    /// The speed of the bend at which Coulomb friction is 76 % of its final value, rad/s:
    /// τ = τ_c tanh(q̇ / speed).
    Bend,
}

/// A number of an arm that is identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Mass of a link, kg.
    Mass,
    /// Centre of mass along an axis (0 to 2) of the link's frame, m.
    Center(usize),
    /// Entry xx, xy, xz, yy, yz or zz (0 to 5) of the inertia about the centre of mass, kg·m².
    Inertia(usize),
    /// A number of the joint.
    Joint(JointParameter),
}

impl Parameter {
    /// All parameters of a link and its joint.
    pub const ALL: [Self; NUMBERS] = [
        Self::Mass,
        Self::Center(0),
        Self::Center(1),
        Self::Center(2),
        Self::Inertia(0),
        Self::Inertia(1),
        Self::Inertia(2),
        Self::Inertia(3),
        Self::Inertia(4),
        Self::Inertia(5),
        Self::Joint(JointParameter::Coulomb),
        Self::Joint(JointParameter::Viscous),
        Self::Joint(JointParameter::Offset),
        Self::Joint(JointParameter::Rotor),
        Self::Joint(JointParameter::Gain),
        Self::Joint(JointParameter::Bend),
    ];
}

/// The numbers of an arm. Every link and joint has [`NUMBERS`] of them, without bounds: those of
/// [`body`], then the logarithms of Coulomb and viscous friction, the offset, and the logarithms of
/// the rotor's inertia, of the gain and of the bend's speed. The numbers of a load in the hand may
/// follow.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    nominal: Robot,
    /// Rated torques of the joints, N·m.
    rated_nm: Vec<f64>,
    /// How late torques are recorded against positions, s. Without it, simulations hold the torque of
    /// a sample until the next; with it, the torque of half a sample later.
    pub(crate) delay_s: Option<f64>,
    pub(crate) numbers: DVector<f64>,
}

/// The slowest bend that a description may have, rad/s. Friction that is steeper at rest needs shorter
/// steps of the integrator than anybody takes.
pub(crate) const LEAST_BEND_RAD_S: f64 = 0.002;

/// The description's arm and how far from it an identified arm may be.
#[derive(Clone)]
pub(crate) struct Prior {
    /// The arm's name in reports.
    pub(crate) name: &'static str,
    pub(crate) arm: Arm,
    /// One standard deviation per number; 0 where the number is known.
    pub(crate) deviations: DVector<f64>,
}

/// The described arm's name in reports.
pub(crate) const DESCRIBED: &str = "description";

/// The speeds of the bends that a description has, rad/s, if it has one for every joint.
pub(crate) fn described_bends(description: &RobotDescription) -> Option<Vec<f64>> {
    let speed = |joint: &JointDescription| {
        let friction = joint.friction?;
        let is_odd = friction.phi3_rad_s == 0.0 && friction.phi2_s_rad > 0.0;
        is_odd.then_some(2.0 / friction.phi2_s_rad)
    };
    description.joints.iter().map(speed).collect()
}

impl Prior {
    /// `bends_rad_s` has the speed of each joint's bend, near which it is expected.
    ///
    /// # Errors
    /// When a link of the description cannot exist.
    pub(crate) fn of(
        description: &RobotDescription,
        bends_rad_s: &[f64],
        gain_deviation: f64,
    ) -> Result<Self, IdentificationError> {
        /// Standard deviation of the logarithms of friction and rotor inertia.
        const LOGARITHM: f64 = 1.5;
        /// Standard deviation of the logarithm of a bend's speed.
        const OF_BEND: f64 = 1.0;

        let spec = RobotSpec {
            gravity: Gravity::On,
            ..RobotSpec::of(RobotModel::Described(Box::new(description.clone())))
        };
        let nominal = Robot::nominal(&spec);
        let joints = nominal.joints();
        let mut numbers = DVector::zeros(joints * NUMBERS);
        let mut deviations = DVector::zeros(joints * NUMBERS);
        for (joint, bend_rad_s) in bends_rad_s.iter().enumerate() {
            let described = &description.joints[joint];
            let rated_nm = described.torque_nm;
            let link = body::log_cholesky(&nominal.links[joint])
                .ok_or(IdentificationError::Link { link: joint + 1 })?;
            let described_coulomb =
                described.friction.map_or(0.0, |friction| 0.5 * friction.phi1_nm);
            // A number that the description does not have begins at a usual fraction of the rated
            // torque.
            let or_usual =
                |value: f64, share: f64| if value > 0.0 { value } else { share * rated_nm };
            let coulomb = or_usual(described_coulomb, 0.01);
            let viscous = or_usual(described.damping_nm_s_rad, 0.005);
            let rotor = or_usual(described.armature_kg_m2, 0.001);
            let at = joint * NUMBERS;
            let own = [coulomb.ln(), viscous.ln(), 0.0, rotor.ln(), 0.0, bend_rad_s.ln()];
            for (k, value) in link.into_iter().chain(own).enumerate() {
                numbers[at + k] = value;
            }
            let of_offset = offset_deviation_nm(rated_nm);
            let own = [LOGARITHM, LOGARITHM, of_offset, LOGARITHM, gain_deviation, OF_BEND];
            for (k, value) in body::prior_deviations(&link).into_iter().chain(own).enumerate() {
                deviations[at + k] = value;
            }
        }
        let rated_nm = description.per_joint(|joint| joint.torque_nm);
        let arm = Arm { nominal, rated_nm, delay_s: None, numbers };
        Ok(Self { name: DESCRIBED, arm, deviations })
    }

    /// The same arm, whose torques are recorded this much later than its positions, s.
    pub(crate) fn late_by(&self, delay_s: f64) -> Self {
        let arm = Arm { delay_s: Some(delay_s), ..self.arm.clone() };
        Self { arm, deviations: self.deviations.clone(), ..*self }
    }

    /// The same arm, whose bends are known.
    pub(crate) fn with_known_bends(&self) -> Self {
        let mut deviations = self.deviations.clone();
        for joint in 0..self.arm.joints() {
            deviations[joint * NUMBERS + OWN + BEND] = 0.0;
        }
        Self { arm: self.arm.clone(), deviations, ..*self }
    }

    /// ½ Σ ((numbers − the prior's) / deviations)².
    pub(crate) fn distance(&self, numbers: &DVector<f64>) -> f64 {
        let distances =
            (numbers - &self.arm.numbers).zip_map(&self.deviations, |distance, deviation| {
                if deviation == 0.0 { 0.0 } else { distance / deviation }
            });
        0.5 * distances.norm_squared()
    }

    /// An arm that is known but for its offsets, with a load in the hand. Friction depends a little
    /// on the load and on the gears' temperature.
    pub(crate) fn loaded(arm: &Arm) -> Self {
        const FRICTION: f64 = 0.1;

        let known = arm.joints() * NUMBERS;
        let (load, spread) = body::load(arm.nominal.kinematics.hand.origin());
        let both = arm.numbers.iter().take(known).copied().chain(load);
        let numbers = DVector::from_iterator(known + LINK_PARAMETERS, both);
        let mut deviations = DVector::zeros(known + LINK_PARAMETERS);
        for (joint, rated_nm) in arm.rated_nm.iter().enumerate() {
            let own = joint * NUMBERS + LINK_PARAMETERS;
            deviations[own + OFFSET] = offset_deviation_nm(*rated_nm);
            deviations[own + COULOMB] = FRICTION;
            deviations[own + VISCOUS] = FRICTION;
        }
        for (k, deviation) in spread.into_iter().enumerate() {
            deviations[known + k] = deviation;
        }
        Self { name: "load of 1 kg", arm: arm.with_numbers(numbers), deviations }
    }
}

fn offset_deviation_nm(rated_nm: f64) -> f64 {
    0.05 * rated_nm
}

/// The indices of numbers of a joint.
const COULOMB: usize = 0;
const VISCOUS: usize = 1;
const OFFSET: usize = 2;
const ROTOR: usize = 3;
const GAIN: usize = 4;
const BEND: usize = 5;

/// The places of a joint's Coulomb friction and of its bend in its own equations.
pub(crate) const FRICTION: [usize; 2] = [OWN + COULOMB, OWN + BEND];

impl Arm {
    /// The number of joints.
    pub fn joints(&self) -> usize {
        self.nominal.joints()
    }

    /// The description's robot. Only what is identified differs from it.
    pub(crate) const fn nominal(&self) -> &Robot {
        &self.nominal
    }

    pub(crate) fn with_numbers(&self, numbers: DVector<f64>) -> Self {
        Self { numbers, ..self.clone() }
    }

    /// The same arm with bends at these speeds, rad/s.
    pub(crate) fn bent_at(&self, bends_rad_s: &[f64]) -> Self {
        let mut arm = self.clone();
        for (joint, speed) in bends_rad_s.iter().enumerate() {
            arm.numbers[joint * NUMBERS + OWN + BEND] = speed.ln();
        }
        arm
    }

    /// The speed of each joint's bend, rad/s.
    pub(crate) fn bends_rad_s(&self) -> Vec<f64> {
        (0..self.joints()).map(|joint| self.joint(joint)[BEND].exp()).collect()
    }

    fn link(&self, joint: usize) -> LogCholesky {
        std::array::from_fn(|k| self.numbers[joint * NUMBERS + k])
    }

    fn joint(&self, joint: usize) -> [f64; JOINT_NUMBERS] {
        std::array::from_fn(|k| self.numbers[joint * NUMBERS + LINK_PARAMETERS + k])
    }

    /// The load in the hand, in the last link's frame.
    fn load(&self) -> Option<LogCholesky> {
        let begin = self.joints() * NUMBERS;
        (self.numbers.len() > begin).then(|| std::array::from_fn(|k| self.numbers[begin + k]))
    }

    /// The load in the hand, in the hand's frame.
    pub(crate) fn load_in_hand(&self) -> Option<RigidBody> {
        let load = RigidBody::from_parameters(&body::parameters(&self.load()?));
        let hand = self.nominal.kinematics.hand;
        let turn = hand.turn(0.0).inverse();
        Some(load.seen_from(&turn, &-(turn * Vector3::from(hand.origin()))))
    }

    /// The parameters of a link in which torques are linear, a load included.
    fn link_parameters(&self, joint: usize) -> [f64; LINK_PARAMETERS] {
        let mut parameters = body::parameters(&self.link(joint));
        if let Some(load) = self.load()
            && joint + 1 == self.joints()
        {
            for (parameter, of_load) in parameters.iter_mut().zip(body::parameters(&load)) {
                *parameter += of_load;
            }
        }
        parameters
    }

    /// Torque offsets of the joints, N·m.
    pub fn offsets_nm(&self) -> Vec<f64> {
        (0..self.joints()).map(|joint| self.joint(joint)[OFFSET]).collect()
    }

    /// Measured torque per torque of each joint.
    pub fn gains(&self) -> Vec<f64> {
        (0..self.joints()).map(|joint| self.joint(joint)[GAIN].exp()).collect()
    }

    /// Coulomb friction of a joint, N·m.
    pub(crate) fn coulomb_nm(&self, joint: usize) -> f64 {
        self.joint(joint)[COULOMB].exp()
    }

    /// The index of a joint's gain among the numbers.
    pub(crate) const fn gain_number(joint: usize) -> usize {
        joint * NUMBERS + LINK_PARAMETERS + GAIN
    }

    /// The robot with these numbers. Its torques are the measured ones divided by the gains, less the
    /// offsets.
    pub fn robot(&self) -> Robot {
        let joints = self.joints();
        let exp = |number: usize| Joints::from_fn(joints, |joint| self.joint(joint)[number].exp());
        let coulomb = exp(COULOMB);
        Robot {
            links: Joints::from_fn(joints, |joint| {
                RigidBody::from_parameters(&self.link_parameters(joint))
            }),
            damping: exp(VISCOUS),
            armature: exp(ROTOR),
            // τ_c tanh(x) = 2 τ_c / (1 + exp(−2x)) − τ_c.
            friction: Some(Friction {
                phi1_nm: coulomb.map(|coulomb| 2.0 * coulomb),
                phi2_s_rad: exp(BEND).map(|speed| 2.0 / speed),
                phi3_rad_s: Joints::splat(joints, 0.0),
            }),
            ..self.nominal.clone()
        }
    }

    /// [`Arm::linear_about`] with the arm's own bends.
    pub(crate) fn linear(&self) -> DVector<f64> {
        self.linear_about(&self.bends_rad_s())
    }

    /// The values in which torques are linear, `[joint][NUMBERS]`: the link's parameters, Coulomb
    /// and viscous friction, offset, rotor inertia, 0, and Coulomb friction times the logarithm of the
    /// ratio of the bend to that of the regression. Torques are linear in it for small changes.
    pub(crate) fn linear_about(&self, bends_rad_s: &[f64]) -> DVector<f64> {
        let values = (0..self.joints()).flat_map(|joint| {
            let [coulomb, viscous, offset, rotor, _, bend] = self.joint(joint);
            let coulomb = coulomb.exp();
            let of_bend = coulomb * (bend - bends_rad_s[joint].ln());
            let own = [coulomb, viscous.exp(), offset, rotor.exp(), 0.0, of_bend];
            self.link_parameters(joint).into_iter().chain(own)
        });
        DVector::from_iterator(self.joints() * NUMBERS, values)
    }

    /// The derivatives of [`Arm::linear`], `[value, number]`.
    pub(crate) fn derivatives(&self) -> DMatrix<f64> {
        self.derivatives_about(&self.bends_rad_s())
    }

    /// The derivatives of [`Arm::linear_about`], `[value, number]`.
    pub(crate) fn derivatives_about(&self, bends_rad_s: &[f64]) -> DMatrix<f64> {
        let values = self.joints() * NUMBERS;
        let mut derivatives = DMatrix::zeros(values, self.numbers.len());
        if let Some(load) = self.load() {
            let last = values - NUMBERS;
            derivatives
                .view_mut((last, values), (LINK_PARAMETERS, LINK_PARAMETERS))
                .copy_from(&body::derivatives(&load));
        }
        for (joint, bend_rad_s) in bends_rad_s.iter().enumerate() {
            let at = joint * NUMBERS;
            derivatives
                .view_mut((at, at), (LINK_PARAMETERS, LINK_PARAMETERS))
                .copy_from(&body::derivatives(&self.link(joint)));
            let own = at + OWN;
            let numbers = self.joint(joint);
            let coulomb = numbers[COULOMB].exp();
            for (k, number) in numbers.into_iter().enumerate() {
                derivatives[(own + k, own + k)] = match k {
                    OFFSET => 1.0,
                    GAIN => 0.0,
                    BEND => coulomb,
                    _ => number.exp(),
                };
            }
            derivatives[(own + BEND, own + COULOMB)] = coulomb * (numbers[BEND] - bend_rad_s.ln());
        }
        derivatives
    }

    /// The derivatives of [`Arm::linear`] as the joint's sensor measures it, its gain included,
    /// `[value, number]`.
    pub(crate) fn measured_derivatives(&self, joint: usize) -> DMatrix<f64> {
        let mut derivatives = self.derivatives() * self.gains()[joint];
        derivatives.set_column(Self::gain_number(joint), &(self.linear() * self.gains()[joint]));
        derivatives
    }

    /// The parameters of a link and its joint in the order of [`Parameter::ALL`].
    pub fn parameters(&self, joint: usize) -> [f64; NUMBERS] {
        let RigidBody { mass, com, inertia: i } =
            RigidBody::from_parameters(&body::parameters(&self.link(joint)));
        let [coulomb, viscous, offset, rotor, gain, bend] = self.joint(joint);
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = i;
        [
            mass,
            com[0],
            com[1],
            com[2],
            xx,
            xy,
            xz,
            yy,
            yz,
            zz,
            coulomb.exp(),
            viscous.exp(),
            offset,
            rotor.exp(),
            gain.exp(),
            bend.exp(),
        ]
    }

    /// `described` with the identified links, friction and rotors. The hand's bodies, and a load,
    /// are part of the last link. Offsets belong to the sensors and are left out.
    pub fn description(&self, described: &RobotDescription) -> RobotDescription {
        let robot = self.robot();
        let joint = |(at, joint): (usize, &JointDescription)| {
            let RigidBody { mass, com, inertia: [[xx, xy, xz], [_, yy, yz], [_, _, zz]] } =
                robot.links[at];
            let [coulomb, _, _, _, _, bend] = self.joint(at);
            JointDescription {
                damping_nm_s_rad: robot.damping[at],
                armature_kg_m2: robot.armature[at],
                friction: Some(JointFriction {
                    phi1_nm: 2.0 * coulomb.exp(),
                    phi2_s_rad: 2.0 / bend.exp().max(LEAST_BEND_RAD_S),
                    phi3_rad_s: 0.0,
                }),
                least_inertia_kg_m2: None,
                link: BodyDescription {
                    mass_kg: mass,
                    center_m: com,
                    inertia_kg_m2: [xx, xy, xz, yy, yz, zz],
                    nearest_physical: false,
                },
                ..joint.clone()
            }
        };
        RobotDescription {
            joints: described.joints.iter().enumerate().map(joint).collect(),
            hand: HandDescription { bodies: Vec::new(), ..described.hand.clone() },
            ..described.clone()
        }
    }
}
