//! The prior of identification: an arm for every vector of standard normal numbers.

use dynamics::{Joints, Payload, RigidBody, Robot};
use spec::{Range, RobotSpec};

/// Numbers of a link: its mass, the coordinates of its centre, its stretch along three axes.
const PER_LINK: usize = 7;
/// Numbers of a payload: its mass, the coordinates of its centre, its radius.
const PER_PAYLOAD: usize = 5;
/// Spread of the velocity around the estimate from the first three samples, rad/s. A light joint
/// forgets its velocity within a sample or two, so that these samples do not determine it.
const VELOCITY_SPREAD: f64 = 1.0;

/// The fitted numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    Nothing,
    /// Dampings, and velocities at the first sample.
    Dampings,
    Everything,
}

/// The distribution of arms that a [`RobotSpec`] draws, as a function of numbers that are standard
/// normal a priori. With zeros it is the nominal arm.
///
/// A link's mass and stretch, dampings, armatures and friction are the nominal ones times the
/// exponential of a number times the spread. Centres and lengths are in proportion to the nominal
/// ones. A payload's values are uniform over their ranges. Hand and fingers count as part of the
/// last link, and so does a payload that is the same for all robots.
#[derive(Clone, Debug)]
pub(super) struct Prior {
    /// Without the payload, if the payload is fitted.
    spec: RobotSpec,
    /// The payload, if it is fitted.
    payload: Option<spec::Payload>,
    freedom: Freedom,
    nominal: Robot,
    spread: Spread,
    sizes: Sizes,
}

/// A candidate robot.
pub(super) struct Arm {
    pub robot: Robot,
    /// Velocity at the first sample, in addition to the estimated one, rad/s.
    pub extra_velocity: Joints<f64>,
}

/// Standard deviation of each number a priori. For a uniform law it is its half-width / √3.
#[derive(Clone, Copy, Debug)]
struct Spread {
    mass: f64,
    com: f64,
    stretch: f64,
    damping: f64,
    armature: f64,
    friction: f64,
    length: f64,
}

/// How many numbers each part of an arm has, in their order. Parts that a spec does not draw have
/// none, except for links and dampings.
#[derive(Clone, Copy, Debug, Default)]
struct Sizes {
    links: usize,
    damping: usize,
    velocity: usize,
    armature: usize,
    friction: usize,
    lengths: usize,
    payload: usize,
}

impl Prior {
    pub fn new(spec: &RobotSpec, freedom: Freedom) -> Self {
        let sizes = Sizes::of(spec, freedom);
        let mut spec = spec.clone();
        let payload = if sizes.payload > 0 { spec.payload.take() } else { None };
        Self {
            payload,
            freedom,
            nominal: Robot::nominal(&spec),
            spread: Spread::of(&spec),
            sizes,
            spec,
        }
    }

    pub fn freedom(&self) -> Freedom {
        self.freedom
    }

    pub fn joints(&self) -> usize {
        self.nominal.joints()
    }

    pub fn nominal(&self) -> &Robot {
        &self.nominal
    }

    /// The length of the vectors. With seven joints of a default spec, the arm and its neighbours in
    /// each number make 64 robots, a whole number of vectors.
    pub fn parameters(&self) -> usize {
        let Sizes { links, damping, velocity, armature, friction, lengths, payload } = self.sizes;
        links + damping + velocity + armature + friction + lengths + payload
    }

    /// The arm of `parameters`.
    pub fn arm_at(&self, parameters: &[f64]) -> Arm {
        let Self { spread, sizes, .. } = self;
        let (of_links, rest) = parameters.split_at(sizes.links);
        let (of_damping, rest) = rest.split_at(sizes.damping);
        let (of_velocity, rest) = rest.split_at(sizes.velocity);
        let (of_armature, rest) = rest.split_at(sizes.armature);
        let (of_friction, rest) = rest.split_at(sizes.friction);
        let (of_lengths, of_payload) = rest.split_at(sizes.lengths);

        let mut robot = self.nominal.clone();
        if !of_lengths.is_empty() {
            let mut kinematics = robot.kinematics;
            let mut numbers = of_lengths.iter();
            kinematics.for_each_length(|length| {
                *length *= numbers.next().map_or(1.0, |number| 1.0 + spread.length * number);
            });
            robot = Robot::with_kinematics(&self.spec, kinematics);
        }
        for (link, of_link) in robot.links.iter_mut().zip(of_links.chunks_exact(PER_LINK)) {
            let stretch = [4, 5, 6].map(|k| (spread.stretch * of_link[k]).exp());
            *link = RigidBody {
                mass: link.mass * (spread.mass * of_link[0]).exp(),
                com: std::array::from_fn(|k| link.com[k] * (1.0 + spread.com * of_link[1 + k])),
                ..link.stretched(stretch)
            };
        }
        scale(&mut robot.damping, spread.damping, of_damping);
        scale(&mut robot.armature, spread.armature, of_armature);
        if let Some(friction) = &mut robot.friction {
            scale(&mut friction.phi1_nm, spread.friction, of_friction);
        }
        if let (Some(law), [mass, x, y, z, radius]) = (&self.payload, of_payload) {
            let [at_x, at_y, at_z] = law.center_m;
            robot = robot.holding(Payload {
                mass_kg: uniform(law.mass_kg, *mass),
                center_m: [uniform(at_x, *x), uniform(at_y, *y), uniform(at_z, *z)],
                radius_m: uniform(law.radius_m, *radius),
            });
        }
        let mut extra_velocity = Joints::splat(self.joints(), 0.0);
        for (extra, velocity) in extra_velocity.iter_mut().zip(of_velocity) {
            *extra = VELOCITY_SPREAD * velocity;
        }
        Arm { robot, extra_velocity }
    }
}

fn scale(values: &mut Joints<f64>, spread: f64, numbers: &[f64]) {
    for (value, number) in values.iter_mut().zip(numbers) {
        *value *= (spread * number).exp();
    }
}

/// A value that is uniform over `range` if `number` is standard normal. The logistic function
/// stands for the normal distribution's, from which it differs by less than 0.01 (Bowling et al.
/// 2009, "A logistic approximation to the cumulative normal distribution").
fn uniform(range: Range, number: f64) -> f64 {
    const STEEPNESS: f64 = 1.702;
    range.at((1.0 + (-STEEPNESS * number).exp()).recip())
}

impl Spread {
    fn of(spec: &RobotSpec) -> Self {
        let deviation = |half_width: f64| half_width / 3.0_f64.sqrt();
        Self {
            mass: deviation(spec.mass_fraction),
            com: deviation(spec.com_fraction),
            stretch: deviation(spec.inertia_fraction),
            damping: deviation(spec.damping_fraction),
            armature: deviation(spec.armature_fraction),
            friction: deviation(spec.friction.as_ref().map_or(0.0, |law| law.phi1_fraction)),
            length: deviation(spec.geometry_fraction),
        }
    }
}

impl Sizes {
    fn of(spec: &RobotSpec, freedom: Freedom) -> Self {
        let joints = spec.joints();
        let dampings = Self { damping: joints, velocity: joints, ..Self::default() };
        let if_drawn = |fraction: f64, count: usize| if fraction > 0.0 { count } else { 0 };
        let friction = spec.friction.as_ref().map_or(0.0, |law| law.phi1_fraction);
        let mut lengths = 0;
        Robot::nominal(spec).kinematics.for_each_length(|_| lengths += 1);
        match freedom {
            Freedom::Nothing => Self::default(),
            Freedom::Dampings => dampings,
            Freedom::Everything => Self {
                links: PER_LINK * joints,
                armature: if_drawn(spec.armature_fraction, joints),
                friction: if_drawn(friction, joints),
                lengths: if_drawn(spec.geometry_fraction, lengths),
                payload: if is_drawn(spec.payload.as_ref()) { PER_PAYLOAD } else { 0 },
                ..dampings
            },
        }
    }
}

/// Whether robots differ in their payload.
fn is_drawn(payload: Option<&spec::Payload>) -> bool {
    let is_wide = |range: &Range| range.min < range.max;
    payload.is_some_and(|law| {
        is_wide(&law.mass_kg) || is_wide(&law.radius_m) || law.center_m.iter().any(is_wide)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn everything() -> RobotSpec {
        RobotSpec {
            armature_fraction: 0.2,
            geometry_fraction: 0.05,
            friction: Some(spec::Friction::default()),
            payload: Some(spec::Payload {
                mass_kg: Range::new(0.0, 3.0),
                center_m: [Range::new(-0.05, 0.05), Range::new(0.0, 0.0), Range::new(0.1, 0.2)],
                radius_m: Range::new(0.04, 0.04),
            }),
            ..RobotSpec::default()
        }
    }

    #[test]
    fn zeros_are_the_nominal_arm() {
        for spec in [RobotSpec::default(), everything()] {
            let prior = Prior::new(&spec, Freedom::Everything);
            let arm = prior.arm_at(&vec![0.0; prior.parameters()]);
            let nominal = Robot::nominal(&spec);
            assert_eq!(
                (arm.robot.kinematics, &arm.robot.payload),
                (nominal.kinematics, &nominal.payload)
            );
            assert_eq!(
                (&arm.robot.armature, &arm.robot.friction),
                (&nominal.armature, &nominal.friction)
            );
            for (link, expected) in arm.robot.links.iter().zip(&nominal.links) {
                assert!((link.mass - expected.mass).abs() < 1e-12);
                assert!((link.inertia[0][0] - expected.inertia[0][0]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn only_what_is_drawn_has_numbers() {
        let numbers = |spec: &RobotSpec| Prior::new(spec, Freedom::Everything).parameters();
        assert_eq!(numbers(&RobotSpec::default()), 63);
        // Armatures, frictions, the lengths that are not zero, and a payload.
        assert_eq!(numbers(&everything()), 63 + 7 + 7 + 7 + 5);
        let fixed = spec::Payload {
            mass_kg: Range::new(1.0, 1.0),
            center_m: [Range::new(0.0, 0.0); 3],
            radius_m: Range::new(0.04, 0.04),
        };
        let holding = RobotSpec { payload: Some(fixed), ..RobotSpec::default() };
        assert_eq!(numbers(&holding), 63);
        assert_eq!(Prior::new(&everything(), Freedom::Dampings).parameters(), 14);
    }

    #[test]
    fn a_payload_stays_within_its_ranges_and_has_the_spread_of_its_law() {
        let range = Range::new(0.0, 3.0);
        for number in [-40.0, -3.0, 0.0, 3.0, 40.0] {
            assert!(range.contains(uniform(range, number)), "{number}");
        }
        // The quartiles of the normal distribution are at ±0.6745.
        assert!((uniform(range, 0.6745) - 2.25).abs() < 0.03);
        assert!((uniform(range, 0.0) - 1.5).abs() < 1e-12);
    }
}
