//! The kinematics of an arm that the law is told: particles at known places of its links.
//!
//! The inertia of a rigid body is linear in the masses of ten particles whose places on it are fixed
//! and in general position: they have its mass, its three first moments and its six second moments.
//! So ten particles per link, and ten more in the hand for a load, describe every arm with these
//! lengths and axes. With weights of 1 those of the links are the arm of the description.
//!
//! A robot's numbers are not the weights of single particles, which depend on each other over robots,
//! but ten *moments* of a body ([`MOMENTS`]): how many times its mass it has with the same shape, how
//! far its centre is off along each principal axis, and how it is stretched and turned.
//!
//! The arm comes from a description, or from the motions of many arms ([`super::chain`]).

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector3};
use simd::Lanes;
use spec::{BodyDescription, Gravity, KnownRobot, MAX_JOINTS, RobotDescription};

/// Acceleration of gravity, m/s².
const GRAVITY: f64 = 9.81;
/// Directions from a body's centre to its particles, in units of the body's extent along its
/// principal axes: along the axes, and to four corners of a cube.
const DIRECTIONS: [[f64; 3]; PER_BODY] = [
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.0, 0.0, -1.0],
    [1.0, 1.0, 1.0],
    [1.0, -1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
];
/// The weight of each particle at a moment of 1: of the body as it is; of a centre that is off along
/// the first, the second and the third axis; of a body that is stretched along the first and along the
/// second axis, and made larger; of one that is turned about each axis. All but the first leave the
/// mass as it is, and the last six leave the centre.
const MOMENTS: [[f32; PER_BODY]; PER_BODY] = [
    [1.0; PER_BODY],
    [1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 1.0, -0.5, -0.5, -0.5, -0.5, 0.0, 0.0, 0.0, 0.0],
    [-0.5, -0.5, 1.0, 1.0, -0.5, -0.5, 0.0, 0.0, 0.0, 0.0],
    [-0.5, -0.5, -0.5, -0.5, -0.5, -0.5, 0.75, 0.75, 0.75, 0.75],
    [-1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, -0.5, -0.5],
    [0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.5, -0.5, 0.5, -0.5],
    [0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.5, -0.5, -0.5, 0.5],
];
/// Particles of a body.
const PER_BODY: usize = 10;
/// The sum over [`DIRECTIONS`] of the square of one coordinate.
const SQUARES: f64 = 6.0;
/// The least extent of a body, m, so that its particles have different places.
const LEAST_EXTENT_M: f64 = 0.03;
/// The least mass of a body, kg, so that its particles can have more.
const LEAST_MASS_KG: f64 = 0.1;
/// Mass of the load whose particles have weights of 1, kg.
const LOAD_KG: f64 = 2.0;
/// Extent of the particles of the load, and how far its centre is along the hand's z, m.
const LOAD_EXTENT_M: f64 = 0.1;

/// Mass and extent of each body of an arm whose bodies are not known.
const UNKNOWN_KG: f64 = 1.0;
const UNKNOWN_EXTENT_M: f64 = 0.3;

/// The lengths and axes of an arm, and the places of its particles.
#[derive(Clone, Debug)]
pub(super) struct Kinematics {
    joints: Vec<Frame>,
    particles: Vec<Particle>,
    /// Particles of the load, which are last.
    load: usize,
    mixing: Mixing,
    /// Acceleration of a body that falls, along the third axis and negated, m/s².
    gravity: f64,
}

/// The frame of a joint at position 0, in the frame of the link before, or in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub turn: Matrix3<f64>,
    pub origin: Vector3<f64>,
}

/// How the weights of particles follow from a robot's numbers: for blocks of as many particles as
/// numbers, which are alike.
#[derive(Clone, Debug)]
struct Mixing {
    block: usize,
    /// The weight of each particle of a block at a number of 1, `[particle, number]`.
    weights: Vec<f32>,
}

#[derive(Clone, Copy, Debug)]
struct Particle {
    /// The joint that moves its link.
    link: usize,
    /// In the frame of the link, m.
    place: Vector3<f64>,
    /// The root of its mass at a weight of 1, √kg.
    root: f64,
}

impl Kinematics {
    pub fn new(robot: &KnownRobot) -> Self {
        let description = robot.model.description();
        let links = description.joints.iter().map(|joint| joint.link);
        let mut particles: Vec<Particle> = links
            .enumerate()
            .flat_map(|(link, body)| of_body(link, &body, &Frame::identity()))
            .collect();
        let last = description.joints.len().saturating_sub(1);
        let hand = hand_frame(description);
        for attached in &description.hand.bodies {
            let mut at = hand;
            at.origin += hand.turn * Vector3::from(attached.position_m);
            particles.extend(of_body(last, &attached.body, &at));
        }
        particles.extend(DIRECTIONS.map(|direction| {
            let place = LOAD_EXTENT_M * (Vector3::from(direction) + Vector3::z());
            let place = hand.turn * place + hand.origin;
            Particle { link: last, place, root: (LOAD_KG / PER_BODY as f64).sqrt() }
        }));
        Self {
            joints: frames(description),
            particles,
            load: PER_BODY,
            mixing: Mixing::of_bodies(),
            gravity: acceleration_of(robot.gravity),
        }
    }

    /// An arm whose joints have these frames in the world at position 0. Each link has the body of
    /// [`UNKNOWN_KG`] at its joint, and there is no load apart from the last link.
    pub fn of_chain(frames: &[Frame], gravity: Gravity) -> Self {
        let mut before = Frame::identity();
        let joints = frames.iter().map(|frame| {
            let turn = before.turn.transpose();
            let origin = turn * (frame.origin - before.origin);
            before = *frame;
            Frame { turn: turn * frame.turn, origin }
        });
        let root = (UNKNOWN_KG / PER_BODY as f64).sqrt();
        let bodies = (0..frames.len()).flat_map(|link| {
            DIRECTIONS.map(|direction| {
                let place = UNKNOWN_EXTENT_M * Vector3::from(direction);
                Particle { link, place, root }
            })
        });
        Self {
            joints: joints.collect(),
            particles: bodies.collect(),
            load: 0,
            mixing: Mixing::of_bodies(),
            gravity: acceleration_of(gravity),
        }
    }

    pub fn joints(&self) -> usize {
        self.joints.len()
    }

    /// Particles of the arm, with those of the load.
    pub fn particles(&self) -> usize {
        self.particles.len()
    }

    /// The first particle, and the first moment, of the load.
    pub fn load(&self) -> usize {
        self.particles.len() - self.load
    }

    /// The moments of the arm of the description, without a load.
    pub fn described(&self) -> impl Iterator<Item = f32> {
        let load = self.load();
        (0..self.particles.len())
            .map(move |moment| f32::from(u8::from(moment < load && moment % PER_BODY == 0)))
    }

    /// The arm whose moments are combinations of a robot's numbers: `[moment, number]`.
    pub fn in_basis(mut self, basis: &[f32]) -> Self {
        self.mixing = self.mixing.in_basis(basis, self.particles.len());
        self
    }

    /// Turns a robot's numbers into the weights of particles.
    pub fn weigh(&self, numbers: &mut [f32]) {
        let Mixing { block, weights } = &self.mixing;
        for numbers in numbers.chunks_exact_mut(*block) {
            let weighed = weights.chunks_exact(*block).map(|of_particle| {
                of_particle.iter().zip(&*numbers).map(|(weight, number)| weight * number).sum()
            });
            let weighed: Vec<f32> = weighed.collect();
            numbers.copy_from_slice(&weighed);
        }
    }

    /// The torques of numbers of 1, `[number]`, from those of particles of weight 1, `[particle]`.
    #[inline(always)]
    pub fn gather<L: Lanes>(&self, torques: &[[L; MAX_JOINTS]], gathered: &mut [[L; MAX_JOINTS]]) {
        let (joints, Mixing { block, weights }) = (self.joints.len(), &self.mixing);
        for first in (0..torques.len()).step_by(*block) {
            for number in 0..*block {
                let mut sum = [L::splat(0.0); MAX_JOINTS];
                for particle in 0..*block {
                    let weight = weights[particle * block + number];
                    if weight != 0.0 {
                        let (weight, torque) =
                            (L::splat(f64::from(weight)), &torques[first + particle]);
                        for joint in 0..joints {
                            sum[joint] = weight.mul_add(torque[joint], sum[joint]);
                        }
                    }
                }
                gathered[first + number] = sum;
            }
        }
    }

    /// Computes the Jacobians of all particles and their rates of change, `[direction, particle,
    /// joint]`, √kg m, and the accelerations of particles at constant joint velocities, as felt by a
    /// body that does not fall, `[direction, particle]`. Entries of joints beyond a particle's link
    /// stay as they are.
    #[inline(always)]
    pub fn update<L: Lanes>(
        &self,
        q: &[L; MAX_JOINTS],
        velocity: &[L; MAX_JOINTS],
        jacobians: &mut [L],
        rates: &mut [L],
        bias_accelerations: &mut [L],
    ) {
        let joints = self.joints.len();
        let zero = [L::splat(0.0); 3];
        let mut turns = [[zero; 3]; MAX_JOINTS];
        // Origins, axes, their velocities, and angular velocities.
        let [mut origins, mut axes, mut moving, mut turning] = [[zero; MAX_JOINTS]; 4];
        for joint in 0..joints {
            let Frame { turn, origin } = &self.joints[joint];
            let mut rotated = [zero; 3];
            if joint == 0 {
                for row in 0..3 {
                    origins[0][row] = L::splat(origin[row]);
                    for column in 0..3 {
                        rotated[row][column] = L::splat(turn[(row, column)]);
                    }
                }
            } else {
                let before = &turns[joint - 1];
                let mut shift = zero;
                for row in 0..3 {
                    for inner in 0..3 {
                        let along = before[row][inner];
                        shift[row] = along.mul_add(L::splat(origin[inner]), shift[row]);
                        for column in 0..3 {
                            let entry = L::splat(turn[(inner, column)]);
                            rotated[row][column] = along.mul_add(entry, rotated[row][column]);
                        }
                    }
                }
                let carried = cross(&turning[joint - 1], &shift);
                for row in 0..3 {
                    origins[joint][row] = origins[joint - 1][row] + shift[row];
                    moving[joint][row] = moving[joint - 1][row] + carried[row];
                }
            }
            let (sin, cos) = q[joint].sin_cos();
            for row in 0..3 {
                let [x, y, z] = rotated[row];
                turns[joint][row] = [cos * x + sin * y, cos * y - sin * x, z];
                axes[joint][row] = z;
                let carried = if joint == 0 { L::splat(0.0) } else { turning[joint - 1][row] };
                turning[joint][row] = velocity[joint].mul_add(z, carried);
            }
        }
        let mut axis_rates = [zero; MAX_JOINTS];
        for joint in 0..joints {
            axis_rates[joint] = cross(&turning[joint], &axes[joint]);
        }
        let count = self.particles.len();
        for index in 0..count {
            let Particle { link, place, root } = &self.particles[index];
            let mut arm = zero;
            for row in 0..3 {
                for column in 0..3 {
                    let along = L::splat(place[column]);
                    arm[row] = turns[*link][row][column].mul_add(along, arm[row]);
                }
            }
            let carried = cross(&turning[*link], &arm);
            let root = L::splat(*root);
            let mut bias = [L::splat(0.0), L::splat(0.0), root * L::splat(self.gravity)];
            for joint in 0..=*link {
                let mut lever = zero;
                let mut lever_rate = zero;
                for row in 0..3 {
                    lever[row] = (origins[*link][row] + arm[row]) - origins[joint][row];
                    lever_rate[row] = (moving[*link][row] + carried[row]) - moving[joint][row];
                }
                let column = cross(&axes[joint], &lever);
                let [one, other] =
                    [cross(&axis_rates[joint], &lever), cross(&axes[joint], &lever_rate)];
                for row in 0..3 {
                    let at = (row * count + index) * joints + joint;
                    let rate = root * (one[row] + other[row]);
                    jacobians[at] = root * column[row];
                    rates[at] = rate;
                    bias[row] = rate.mul_add(velocity[joint], bias[row]);
                }
            }
            for row in 0..3 {
                bias_accelerations[row * count + index] = bias[row];
            }
        }
    }
}

impl Mixing {
    /// Numbers that are the moments of each body.
    fn of_bodies() -> Self {
        let weights = (0..PER_BODY).flat_map(|particle| MOMENTS.map(|weights| weights[particle]));
        Self { block: PER_BODY, weights: weights.collect() }
    }

    /// Numbers of a whole arm of `count` particles, whose combinations are the ones before.
    fn in_basis(&self, basis: &[f32], count: usize) -> Self {
        let mut weights = vec![0.0; count * count];
        for (particle, weights) in weights.chunks_exact_mut(count).enumerate() {
            let (body, own) = (particle / self.block, particle % self.block);
            for (moment, factor) in
                self.weights[own * self.block..][..self.block].iter().enumerate()
            {
                let combined = &basis[(body * self.block + moment) * count..][..count];
                for (weight, number) in weights.iter_mut().zip(combined) {
                    *weight += factor * number;
                }
            }
        }
        Self { block: count, weights }
    }
}

#[inline(always)]
fn cross<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> [L; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Frame {
    fn identity() -> Self {
        Self { turn: Matrix3::identity(), origin: Vector3::zeros() }
    }

    /// A row of a modified Denavit-Hartenberg table with angles in degrees, and a further shift.
    fn of_row(a_m: f64, alpha_deg: f64, d_m: f64, offset_deg: f64, shift_m: [f64; 3]) -> Self {
        let twist = Rotation3::from_axis_angle(&Vector3::x_axis(), alpha_deg.to_radians());
        let about = Rotation3::from_axis_angle(&Vector3::z_axis(), offset_deg.to_radians());
        let origin = Vector3::new(a_m, 0.0, 0.0) + twist * Vector3::new(0.0, 0.0, d_m);
        Self { turn: (twist * about).into_inner(), origin: origin + Vector3::from(shift_m) }
    }
}

fn acceleration_of(gravity: Gravity) -> f64 {
    if gravity == Gravity::Off { 0.0 } else { GRAVITY }
}

/// The frames of all joints. That of the first is in the world.
fn frames(description: &RobotDescription) -> Vec<Frame> {
    let rows = description.joints.iter().map(|joint| {
        Frame::of_row(joint.a_m, joint.alpha_deg, joint.d_m, joint.offset_deg, joint.shift_m)
    });
    let mut frames: Vec<Frame> = rows.collect();
    if let Some(first) = frames.first_mut() {
        let [roll, pitch, yaw] = description.base.rpy_deg.map(f64::to_radians);
        let base = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
        let position = Vector3::from(description.base.position_m);
        *first = Frame { turn: base * first.turn, origin: base * first.origin + position };
    }
    frames
}

/// The hand's frame in that of the last link.
fn hand_frame(description: &RobotDescription) -> Frame {
    let hand = &description.hand;
    Frame::of_row(hand.a_m, hand.alpha_deg, hand.flange_m, hand.yaw_deg, hand.shift_m)
}

/// The particles of a body whose frame is at `at` in that of its link. They have the body's mass,
/// centre and inertia where these are not below the least ones.
fn of_body(link: usize, body: &BodyDescription, at: &Frame) -> [Particle; PER_BODY] {
    let [xx, xy, xz, yy, yz, zz] = body.inertia_kg_m2;
    let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    // Second moments of the mass about its centre.
    let moments = Matrix3::identity() * (0.5 * inertia.trace()) - inertia;
    let mass = body.mass_kg.max(LEAST_MASS_KG);
    let axes = SymmetricEigen::new(moments);
    // The mass is the same for all particles.
    let extents = axes.eigenvalues.map(|moment| {
        let squared = PER_BODY as f64 * moment / (SQUARES * mass);
        squared.max(0.0).sqrt().max(LEAST_EXTENT_M)
    });
    let center = Vector3::from(body.center_m);
    DIRECTIONS.map(|direction| {
        let off = axes.eigenvectors * extents.component_mul(&Vector3::from(direction));
        let place = at.turn * (center + off) + at.origin;
        Particle { link, place, root: (mass / PER_BODY as f64).sqrt() }
    })
}
