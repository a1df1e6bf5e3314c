//! Random robots, their URDFs, and their motion by a direct evaluation of their trees.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::iter::Sum;

use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Unit, Vector3};
use random::{ChaCha8Rng, below, keyed, shuffle, unit};
use urdf::Options;

pub struct Robot {
    pub links: Vec<Link>,
    /// Each joint's parent is the child of an earlier one, or link 0.
    pub joints: Vec<Joint>,
    /// Names of the moving joints, from the base outwards.
    pub moving: Vec<String>,
    /// Name of the link at the end of the chain.
    pub tip: String,
}

pub struct Link {
    pub name: String,
    pub inertial: Option<Inertial>,
}

pub struct Inertial {
    pub origin: Origin,
    pub mass: f64,
    pub inertia: Matrix3<f64>,
}

pub struct Origin {
    pub xyz: [f64; 3],
    pub rpy: [f64; 3],
}

pub struct Joint {
    pub name: String,
    pub kind: &'static str,
    pub parent: usize,
    pub child: usize,
    pub origin: Origin,
    pub axis: [f64; 3],
    /// The joint that it mimics, the multiplier and the offset.
    pub mimic: Option<(String, f64, f64)>,
    /// Where the joint stands if it does not move.
    pub position: f64,
}

impl Origin {
    fn pose(&self) -> IsometryMatrix3<f64> {
        let [roll, pitch, yaw] = self.rpy;
        let turn = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
        let rotation = turn(Vector3::z_axis(), yaw)
            * turn(Vector3::y_axis(), pitch)
            * turn(Vector3::x_axis(), roll);
        IsometryMatrix3::from_parts(Translation3::from(Vector3::from(self.xyz)), rotation)
    }
}

/// A frame in motion, seen from the world.
#[derive(Clone, Copy)]
pub struct Moving {
    pub pose: IsometryMatrix3<f64>,
    pub angular: Vector3<f64>,
    /// Of the frame's origin.
    pub linear: Vector3<f64>,
}

impl Moving {
    /// The world.
    pub fn standing(pose: IsometryMatrix3<f64>) -> Self {
        Self { pose, angular: Vector3::zeros(), linear: Vector3::zeros() }
    }

    /// A frame that moves with this one.
    pub fn fixed(&self, step: &IsometryMatrix3<f64>) -> Self {
        let arm = self.pose.rotation * step.translation.vector;
        let linear = self.linear + self.angular.cross(&arm);
        Self { pose: self.pose * step, linear, ..*self }
    }

    /// The frame turned about its own `axis`.
    pub fn turned(&self, axis: &Unit<Vector3<f64>>, position: f64, speed: f64) -> Self {
        let angular = self.angular + self.pose.rotation * axis.into_inner() * speed;
        let turn = Rotation3::from_axis_angle(axis, position);
        let turn = IsometryMatrix3::from_parts(Translation3::identity(), turn);
        Self { pose: self.pose * turn, angular, ..*self }
    }

    /// Potential and kinetic energy of a body with this centre and inertia in the frame.
    pub fn energies(&self, mass: f64, center: Vector3<f64>, inertia: Matrix3<f64>) -> Energies {
        let arm = self.pose.rotation * center;
        let height = self.pose.translation.z + arm.z;
        let velocity = self.linear + self.angular.cross(&arm);
        let inner = self.pose.rotation.inverse() * self.angular;
        let turning = 0.5 * inner.dot(&(inertia * inner));
        let farthest = self.pose.translation.z.abs() + arm.z.abs();
        let fastest = self.linear.norm() + self.angular.norm() * arm.norm();
        Energies {
            joules: [mass * 9.81 * height, 0.5 * mass * velocity.norm_squared() + turning],
            terms: [mass * 9.81 * farthest, 0.5 * mass * fastest.powi(2) + turning.abs()],
        }
    }
}

/// Potential and kinetic energy.
#[derive(Clone, Copy, Debug, Default)]
pub struct Energies {
    pub joules: [f64; 2],
    /// The sums of the magnitudes of their terms, which rounding errors are relative to.
    terms: [f64; 2],
}

impl Energies {
    /// `most`: the largest difference as a share of the terms.
    #[track_caller]
    pub fn assert_close(&self, theirs: &Self, most: f64) {
        for kind in 0..2 {
            let [ours, theirs_j] = [self, theirs].map(|energies| energies.joules[kind]);
            assert!(
                (ours - theirs_j).abs() < most * (1.0 + theirs.terms[kind]),
                "{ours} J, not {theirs_j} J"
            );
        }
    }
}

impl Sum for Energies {
    fn sum<I: Iterator<Item = Self>>(bodies: I) -> Self {
        bodies.fold(Self::default(), |sum, body| Self {
            joules: [0, 1].map(|kind| sum.joules[kind] + body.joules[kind]),
            terms: [0, 1].map(|kind| sum.terms[kind] + body.terms[kind]),
        })
    }
}

impl Robot {
    /// A robot with up to eight moving joints, fixed joints between them, and branches. Some of
    /// its axes are nearly parallel, by up to `finest` decimals.
    pub fn random(seed: u64, finest: f64) -> Self {
        let mut draws = Draws { generator: keyed([seed, 0, 0, 0]), finest };
        let mut robot = Self {
            links: vec![Link { name: "base_link".to_owned(), inertial: draws.inertial() }],
            joints: Vec::new(),
            moving: Vec::new(),
            tip: String::new(),
        };
        let mut at = 0;
        for number in 0..1 + draws.below(8) {
            for _ in 0..draws.below(3) {
                at = robot.add(at, "fixed", &mut draws);
            }
            let name = format!("joint_{number}");
            let kind = if draws.chance(0.2) { "continuous" } else { "revolute" };
            at = robot.add(at, kind, &mut draws);
            robot.links[at].inertial = Some(draws.some_inertial());
            if let Some(joint) = robot.joints.last_mut() {
                joint.name.clone_from(&name);
            }
            robot.moving.push(name);
            robot.add_branch(at, &mut draws);
        }
        for _ in 0..draws.below(3) {
            at = robot.add(at, "fixed", &mut draws);
        }
        robot.tip.clone_from(&robot.links[at].name);
        robot.add_branch(at, &mut draws);
        robot
    }

    /// A random robot, some of whose joints the options lock.
    pub fn locked(seed: u64) -> (Self, Options) {
        let mut robot = Self::random(seed, 9.0);
        let mut draws = Draws::new(seed, 3);
        let tip = Some(robot.tip.clone());
        let mut locks = BTreeMap::new();
        let moving = std::mem::take(&mut robot.moving);
        let stays = draws.below(moving.len());
        for (index, name) in moving.into_iter().enumerate() {
            if index == stays || draws.below(2) == 0 {
                robot.moving.push(name);
            } else {
                locks.insert(name, draws.within(3.0));
            }
        }
        for joint in &mut robot.joints {
            if let Some(position) = locks.get(&joint.name) {
                joint.position = *position;
            }
            if let Some((mimicked, multiplier, offset)) = &joint.mimic {
                joint.position = multiplier * locks.get(mimicked).unwrap_or(&0.0) + offset;
            }
        }
        (robot, Options { tip, locks, ..Options::default() })
    }

    /// Adds a link and the joint that holds it. Returns the link.
    fn add(&mut self, parent: usize, kind: &'static str, draws: &mut Draws) -> usize {
        let child = self.links.len();
        self.links.push(Link { name: format!("link {child} <&\">"), inertial: draws.inertial() });
        let before = self.joints.last().map(|joint| joint.axis);
        let (origin, axis) = draws.place(before);
        self.joints.push(Joint {
            name: format!("held_{child}"),
            kind,
            parent,
            child,
            origin,
            axis,
            mimic: None,
            position: 0.0,
        });
        child
    }

    /// Perhaps adds joints that do not move the chain.
    fn add_branch(&mut self, mut at: usize, draws: &mut Draws) {
        for _ in 0..draws.below(3) {
            let kinds = ["fixed", "revolute", "prismatic", "floating", "planar", "continuous"];
            at = self.add(at, kinds[draws.below(kinds.len())], draws);
            let mimicked = self.moving[draws.below(self.moving.len())].clone();
            let Some(joint) = self.joints.last_mut() else { continue };
            if ["revolute", "prismatic"].contains(&joint.kind) && draws.chance(0.5) {
                let offset = draws.within(1.0);
                joint.mimic = Some((mimicked, draws.within(2.0), offset));
                joint.position = offset;
            }
        }
    }

    /// The text, with the elements in any order.
    pub fn urdf(&self, seed: u64) -> String {
        let mut elements: Vec<String> = self.links.iter().map(Link::element).collect();
        let joint = |joint| Joint::element(joint, &self.links);
        elements.extend(self.joints.iter().map(joint));
        elements.push("<gazebo reference='x'><plugin><joint name='y'/></plugin></gazebo>".into());
        elements.push("<!-- a comment --><material name='grey'/>".into());
        elements.push("<transmission name='t'><joint name='joint_0'/></transmission>".into());
        shuffle(&mut elements, &mut keyed::<ChaCha8Rng>([seed, 1, 0, 0]));
        format!(
            "<?xml version=\"1.0\" ?>\n<robot name=\"random\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n{}\n</robot>\n",
            elements.join("\n")
        )
    }

    /// Every link in motion, with the base at `base`.
    pub fn motion(&self, base: IsometryMatrix3<f64>, q: &[f64], qd: &[f64]) -> Vec<Moving> {
        let mut links = vec![Moving::standing(base); self.links.len()];
        for joint in &self.joints {
            let held = links[joint.parent].fixed(&joint.origin.pose());
            let axis = Unit::new_normalize(Vector3::from(joint.axis));
            let moving = self.moving.iter().position(|name| *name == joint.name);
            links[joint.child] = match (moving, joint.kind) {
                (Some(moving), _) => held.turned(&axis, q[moving], qd[moving]),
                (None, "revolute" | "continuous") => held.turned(&axis, joint.position, 0.0),
                (None, "prismatic") => {
                    let shift = axis.into_inner() * joint.position;
                    held.fixed(&IsometryMatrix3::from_parts(shift.into(), Rotation3::identity()))
                }
                (None, _) => held,
            };
        }
        links
    }

    /// The links that move.
    pub fn moved(&self) -> Vec<usize> {
        let mut moves = vec![false; self.links.len()];
        for joint in &self.joints {
            moves[joint.child] = moves[joint.parent] || self.moving.contains(&joint.name);
        }
        (0..self.links.len()).filter(|link| moves[*link]).collect()
    }
}

impl Link {
    /// Potential and kinetic energy of the link in motion.
    pub fn energies(&self, moving: &Moving) -> Energies {
        let Some(Inertial { origin, mass, inertia }) = &self.inertial else {
            return Energies::default();
        };
        moving.fixed(&origin.pose()).energies(*mass, Vector3::zeros(), *inertia)
    }

    fn element(&self) -> String {
        let name = escaped(&self.name);
        let Some(Inertial { origin, mass, inertia: i }) = &self.inertial else {
            return format!("<link name=\"{name}\"/>");
        };
        format!(
            "<link name=\"{name}\"><visual><geometry><mesh filename='a.stl'/></geometry></visual>\
             <inertial>{}<mass value=\"{mass}\"/><inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" \
             iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/></inertial></link>",
            origin.element(),
            i.m11,
            i.m12,
            i.m13,
            i.m22,
            i.m23,
            i.m33
        )
    }
}

impl Origin {
    fn element(&self) -> String {
        let [x, y, z] = self.xyz;
        let [roll, pitch, yaw] = self.rpy;
        format!("<origin rpy=\"{roll} {pitch} {yaw}\" xyz=\" {x}\t{y} {z}\n\"/>")
    }
}

impl Joint {
    fn element(&self, links: &[Link]) -> String {
        let [x, y, z] = self.axis;
        let mut text = format!(
            "<joint name=\"{}\" type=\"{}\">{}<parent link=\"{}\"/><child link=\"{}\"/>\
             <axis xyz=\"{x} {y} {z}\"/><limit lower=\"-2\" upper=\"2.5\" effort=\"30\" velocity=\"2\"/>",
            self.name,
            self.kind,
            self.origin.element(),
            escaped(&links[self.parent].name),
            escaped(&links[self.child].name)
        );
        if let Some((joint, multiplier, offset)) = &self.mimic {
            write!(
                text,
                "<mimic joint=\"{joint}\" multiplier=\"{multiplier}\" offset=\"{offset}\"/>"
            )
            .unwrap();
        }
        text + "</joint>"
    }
}

fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

pub struct Draws {
    generator: ChaCha8Rng,
    /// Decimals of the least angle.
    finest: f64,
}

impl Draws {
    pub fn new(seed: u64, purpose: u64) -> Self {
        Self { generator: keyed([seed, purpose, 0, 0]), finest: 0.0 }
    }

    pub fn below(&mut self, count: usize) -> usize {
        below(&mut self.generator, count)
    }

    fn chance(&mut self, share: f64) -> bool {
        unit(&mut self.generator) < share
    }

    pub fn within(&mut self, most: f64) -> f64 {
        most * (2.0 * unit(&mut self.generator) - 1.0)
    }

    pub fn vector(&mut self, most: f64) -> [f64; 3] {
        [0; 3].map(|_| self.within(most))
    }

    fn inertial(&mut self) -> Option<Inertial> {
        self.chance(0.6).then(|| self.some_inertial())
    }

    fn some_inertial(&mut self) -> Inertial {
        let moments = Vector3::from(self.vector(0.05)).abs() + Vector3::repeat(1e-4);
        let axes = Rotation3::from_scaled_axis(Vector3::from(self.vector(3.0)));
        let moments = axes.matrix() * Matrix3::from_diagonal(&moments) * axes.matrix().transpose();
        let moments = 0.5 * (moments + moments.transpose());
        Inertial {
            origin: Origin { xyz: self.vector(0.2), rpy: self.vector(3.0) },
            mass: 0.05 + 4.0 * unit(&mut self.generator),
            inertia: Matrix3::identity() * moments.trace() - moments,
        }
    }

    /// An origin and an axis. Robots have right angles and parallel axes more often than others.
    fn place(&mut self, before: Option<[f64; 3]>) -> (Origin, [f64; 3]) {
        const SIGNED: [f64; 2] = [1.0, -1.0];

        let mut along = [0.0; 3];
        along[self.below(3)] = SIGNED[self.below(2)];
        let xyz = match self.below(4) {
            0 => [0.0; 3],
            1 => [0.0, 0.0, self.within(0.4)],
            _ => self.vector(0.4),
        };
        let rpy = match self.below(4) {
            0 => [0.0; 3],
            1 => [0; 3].map(|_| std::f64::consts::FRAC_PI_2 * [0.0, 1.0, -1.0, 2.0][self.below(4)]),
            2 => {
                let nearly = 10_f64.powf(-self.finest * unit(&mut self.generator));
                self.vector(1.0).map(|angle| nearly * (angle + 0.5_f64.copysign(angle)))
            }
            _ => self.vector(3.2),
        };
        let axis = match (self.below(3), before) {
            (0, _) => along,
            (1, Some(axis)) => axis,
            _ => self.vector(2.0),
        };
        (Origin { xyz, rpy }, axis)
    }
}
