//! The weights with which the training of a law begins.

use spec::{Gravity, LagrangianSpec, MAX_JOINTS};

use super::chain::FoundChain;
use super::kinematics::Kinematics;
use super::law::{DIRECTIONS, Limits};
use super::nominal::{self, NominalJoint};
use super::regression::Numbers;
use super::{CALIBRATION_PACE, Lagrangian, PACE};
use crate::ModelError;
use crate::architecture::{Architecture, Extents};
use crate::initialization::InitialWeights;
use crate::layers::Linear;
use crate::sizes::{LARGEST_WIDTH, MOST_LAYERS, MOST_SAMPLES, within};

/// The largest number of particles, and of forces.
const MOST_PARTS: u32 = 64;

/// Initial Jacobians are uniform on ± this over the root of their number of columns, √(kg m²).
const INITIAL_JACOBIAN: f32 = 0.9;
/// Largest initial weight of the heads, times √width.
const INITIAL_HEAD: f32 = 0.35;
/// Initial standard deviation of the residual torque, N·m.
const INITIAL_NOISE: f32 = 0.3;
/// Initial spread of weights and strengths over robots.
const INITIAL_SHARED_SPREAD: f32 = 0.1;
/// Initial spread of the moments of a load.
const INITIAL_LOAD_SPREAD: f32 = 1.0;
/// Initial inertia that all robots have in common, as a share of their rotors', where these are
/// fitted.
const LEAST_SHARE_OF_ROTOR: f32 = 0.05;
/// Initial deviation of the logarithm of a draw's scale.
const INITIAL_SCALE_SPREAD: f32 = 0.3;
/// The shortest context in samples: one sample with one before it and one after it.
const LEAST_CONTEXT: u32 = 3;
/// The shortest context that shows a chain. It has more samples than a joint and its link have numbers.
const LEAST_CONTEXT_OF_CHAIN: u32 = 30;

impl Architecture for LagrangianSpec {
    type Model = Lagrangian;

    fn init(
        &self,
        Extents { context, joints, .. }: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Lagrangian, ModelError> {
        within("width", self.width, 1, LARGEST_WIDTH)?;
        within("layers", self.layers, 1, MOST_LAYERS)?;
        within("points", self.points, 1, MOST_SAMPLES)?;
        within("particles", self.particles, 1, MOST_PARTS)?;
        within("forces", self.forces, 0, MOST_PARTS)?;
        let least = if self.chain.is_some() { LEAST_CONTEXT_OF_CHAIN } else { LEAST_CONTEXT };
        within("context", context, least, MOST_SAMPLES)?;
        let joints_of = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let expected = self.robot.as_ref().map(|robot| robot.model.description().joints.len());
        let free = usize::from(self.turns_freely && self.chain.is_none());
        let fewest = expected.unwrap_or(free + 1);
        let most = expected.unwrap_or(MAX_JOINTS);
        within("joints", joints_of(joints), joints_of(fewest), joints_of(most))?;
        let nominal = match &self.robot {
            Some(robot) => nominal::of(robot.model.description()),
            None => nominal::unknown(joints),
        };
        let limits: Vec<Limits> = nominal.iter().map(|joint| joint.limits).collect();
        let gravity = self.chain.map_or(Gravity::On, |chain| chain.gravity);
        let chain = self.chain.map(|_| FoundChain::unknown(&limits, gravity, weights));
        let told = self.robot.as_ref().map(Kinematics::new);
        let found = chain.as_ref().map(|chain| chain.kinematics(gravity));
        let known = told.clone().or(found);
        let first = usize::from(self.turns_freely && known.is_none());
        let width = self.width as usize;
        let [particles, forces] = match &known {
            Some(kinematics) => [kinematics.particles(), 0],
            None => [self.particles, self.forces].map(|count| count as usize),
        };
        let Self { rotor_inertia: rotors, torque_offset: offsets, .. } = *self;
        let moments = known.is_some();
        let numbers = Numbers { particles, forces, joints, moments, rotors, offsets };
        let inputs = |layer: u32| if layer == 0 { 2 * (joints - first) } else { width };
        let bound = INITIAL_HEAD / (width as f32).sqrt();
        let paced = |value: f32| value.ln() / PACE;
        let load = known.as_ref().map_or(particles, Kinematics::load)..particles;
        let spreads = (0..numbers.count()).map(|number| {
            let joint = number.saturating_sub(particles + forces) % joints;
            paced(if load.contains(&number) {
                INITIAL_LOAD_SPREAD
            } else if numbers.shared().contains(&number) {
                INITIAL_SHARED_SPREAD
            } else if numbers.dampings().contains(&number) {
                nominal[joint].damping_spread
            } else if numbers.rotors().contains(&number) {
                nominal[joint].rotor
            } else {
                nominal[joint].friction_spread
            })
        });
        let each = |value: fn(&NominalJoint) -> f32| nominal.iter().map(value).map(paced);
        let layers = if known.is_none() { self.layers } else { 0 };
        let hidden = (0..layers).map(|layer| {
            let bound = (6.0 / (inputs(layer) + width) as f32).sqrt();
            Linear::near(&vec![0.0; width], inputs(layer), bound, weights)
        });
        let hidden = hidden.collect();
        let learned = known.is_none().then(|| {
            let jacobians = DIRECTIONS * particles * joints;
            let columns = (DIRECTIONS * particles) as f32;
            let biases = weights.draws(jacobians, INITIAL_JACOBIAN / columns.sqrt());
            Linear::near(&biases, width, bound, weights)
        });
        let armature = |joint: &NominalJoint| joint.rotor;
        let least = |joint: &NominalJoint| joint.rotor * LEAST_SHARE_OF_ROTOR;
        Ok(Lagrangian {
            hidden,
            particles: learned,
            forces: (forces > 0)
                .then(|| Linear::near(&vec![0.0; (1 + forces) * joints], width, bound, weights)),
            share: weights.constant([joints], 0.0),
            armature: weights.given([joints], each(if rotors { least } else { armature })),
            chain,
            masses: known
                .as_ref()
                .map(|kinematics| weights.given([particles], kinematics.described())),
            rotor: rotors.then(|| weights.given([joints], each(|joint| joint.rotor))),
            damping: weights.given([joints], each(|joint| joint.damping)),
            friction: weights.given([joints], nominal.iter().map(|joint| joint.friction / PACE)),
            friction_slope: weights.given([joints], each(|joint| joint.slope)),
            friction_shift: weights.constant([joints], 0.0),
            spread: weights.given([numbers.count()], spreads),
            noise: weights.constant([joints], paced(INITIAL_NOISE)),
            doubt: weights.given([3], [0.0, INITIAL_SCALE_SPREAD / CALIBRATION_PACE, 0.0]),
            first,
            numbers,
            friction_units: nominal.iter().map(|joint| joint.friction_unit).collect(),
            limits,
            disturbance: self.disturbance,
            told,
            gravity,
            points: self.points.min(context - 2) as usize,
        })
    }
}
