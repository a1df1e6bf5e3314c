//! The columns of a dataset's two tables: names, units and frames.
//!
//! The name of a joint's or link's column ends in its number, from 1. The tables are written from
//! these lists, so the lists match the files.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::excitation_columns::{chirps, multisines, pulses, steps, tracking};
use super::spec::SimulateSpec;
use crate::{JointDescription, RobotDescription};

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Column {
    /// The name in the file.
    pub name: String,
    /// The type of its values.
    pub data_type: ColumnType,
    /// Whether a row may have no value.
    pub nullable: bool,
    /// The unit of a number, e.g. `N·m`. `None` for counts and names.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The frame in whose axes a component is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<String>,
    /// Its meaning, in a few words.
    pub about: String,
}

/// The type of a column's values, as Arrow names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "the names are those of Arrow")]
pub enum ColumnType {
    Boolean,
    Int32,
    Int64,
    Float32,
    Float64,
    /// Text in UTF-8.
    Text,
}

/// The frame of poses.
fn world(robot: &RobotDescription) -> &'static str {
    if robot.base.is_upright() {
        "base: origin at the foot of the arm, z up"
    } else {
        "world: z up; the description says where the arm's base is"
    }
}

const AXES: [&str; 3] = ["x", "y", "z"];
const LINK_BEFORE: &str = "modified DH frame of the link before, or of the base";
const LINK: &str = "modified DH frame of the link, which moves with it";

impl Column {
    /// A column without unit and frame, in which every row has a value.
    pub fn new(name: impl Into<String>, data_type: ColumnType, about: impl Into<String>) -> Self {
        let (name, about) = (name.into(), about.into());
        Self { name, data_type, nullable: false, unit: None, frame: None, about }
    }

    /// The column with a unit.
    #[must_use]
    pub fn unit(mut self, unit: &str) -> Self {
        self.unit = Some(unit.to_owned());
        self
    }

    #[must_use]
    fn frame(mut self, frame: &str) -> Self {
        self.frame = Some(frame.to_owned());
        self
    }

    #[must_use]
    pub(super) fn nullable(mut self) -> Self {
        self.nullable = true;
        self
    }

    /// The index of the trajectory in its dataset; in both tables.
    pub fn trajectory() -> Self {
        Self::new("trajectory", ColumnType::Int32, "index of the trajectory in the dataset")
    }

    /// The index of the sample in its trajectory.
    pub fn step() -> Self {
        Self::new("step", ColumnType::Int32, "index of the sample, which is at step / rate_hz")
    }

    /// Torques `u1`, `u2`, ...
    pub fn torques(joints: usize) -> impl Iterator<Item = Self> {
        numbered(joints, "u", ColumnType::Float32, "N·m", |joint| {
            format!("torque of joint {joint}, held from this sample to the next")
        })
    }

    /// Positions `q1`, `q2`, ...
    pub fn positions(joints: usize) -> impl Iterator<Item = Self> {
        numbered(joints, "q", ColumnType::Float32, "rad", |joint| {
            format!("position of joint {joint}, before the torque of this sample acts")
        })
    }

    /// Torques with their noise, `u_measured1`, `u_measured2`, ...
    pub fn measured_torques(joints: usize) -> impl Iterator<Item = Self> {
        numbered(joints, "u_measured", ColumnType::Float32, "N·m", |joint| {
            format!("torque of joint {joint} as it is measured, with noise")
        })
    }

    /// Positions with their noise, `q_measured1`, `q_measured2`, ...
    pub fn measured_positions(joints: usize) -> impl Iterator<Item = Self> {
        numbered(joints, "q_measured", ColumnType::Float32, "rad", |joint| {
            format!("position of joint {joint} as it is measured, with noise and rounded")
        })
    }

    /// References `r1`, `r2`, ...
    pub fn references(joints: usize) -> impl Iterator<Item = Self> {
        numbered(joints, "r", ColumnType::Float32, "rad", |joint| {
            format!("position that the controller should give joint {joint} at this sample")
        })
    }

    /// Torques of a controller, `u1`, `u2`, ...
    fn mean_torques(joints: usize) -> impl Iterator<Item = Self> {
        numbered(joints, "u", ColumnType::Float32, "N·m", |joint| {
            format!("torque of joint {joint}, its mean from this sample to the next")
        })
    }

    /// Velocities `qd1`, `qd2`, ...
    pub fn velocities(joints: usize) -> impl Iterator<Item = Self> {
        numbered(joints, "qd", ColumnType::Float32, "rad/s", |joint| {
            format!("velocity of joint {joint}, before the torque of this sample acts")
        })
    }
}

fn numbered(
    joints: usize,
    prefix: &str,
    data_type: ColumnType,
    unit: &str,
    about: impl Fn(usize) -> String,
) -> impl Iterator<Item = Column> {
    (1..=joints).map(move |joint| {
        Column::new(format!("{prefix}{joint}"), data_type, about(joint)).unit(unit)
    })
}

impl SimulateSpec {
    /// Columns of the table with one row per time step.
    pub fn trajectory_columns(&self) -> Vec<Column> {
        let joints = self.joints();
        let mut columns = vec![Column::trajectory(), Column::step()];
        match self.controller {
            None => columns.extend(Column::torques(joints)),
            Some(_) => columns.extend(Column::mean_torques(joints)),
        }
        columns.extend(Column::positions(joints));
        if self.observations.joint_velocities {
            columns.extend(Column::velocities(joints));
        }
        if self.observations.end_effector_pose {
            columns.extend(end_effector_pose(world(self.robot.description())));
        }
        if self.observations.measures_torques() {
            columns.extend(Column::measured_torques(joints));
        }
        if self.observations.measures_positions() {
            columns.extend(Column::measured_positions(joints));
        }
        if self.controller.is_some() {
            columns.extend(Column::references(joints));
        }
        columns
    }

    /// Columns of the table with one row per trajectory. They have everything that another
    /// simulator needs to make it again.
    pub fn robot_columns(&self) -> Vec<Column> {
        let robot = self.robot.description();
        let joints = robot.joints.len();
        let mut columns = design(robot, self);
        let start = match self.controller {
            None => "at t = 0",
            Some(_) => "at the start, settle_s of the controller before t = 0",
        };
        columns.extend(initial_state(joints, start));
        columns.extend(kinematics(robot));
        (1..=joints).for_each(|link| columns.extend(body(robot, link)));
        columns.extend(friction(joints));
        columns.extend(payload(robot));
        if self.controller.is_some() {
            columns.extend(tracking());
            return columns;
        }
        columns.extend(chirps(joints));
        columns.extend(multisines(joints));
        // Only if there are steps, so that the columns of other tables do not change.
        if self.excitation.steps.is_some() {
            columns.extend(steps(joints));
        }
        if self.excitation.pulses.is_some() {
            columns.extend(pulses(joints));
        }
        columns
    }
}

fn end_effector_pose(world: &str) -> impl Iterator<Item = Column> {
    let position = AXES.map(|axis| {
        let about = format!("{axis} of the hand's origin at the positions of this sample");
        Column::new(format!("ee_{axis}"), ColumnType::Float32, about).unit("m").frame(world)
    });
    let rotation = ["qx", "qy", "qz", "qw"].map(|part| {
        let about = "part of the unit quaternion that turns the hand's axes into the base's; its \
                     sign is continuous in time and begins with qw >= 0";
        Column::new(format!("ee_{part}"), ColumnType::Float32, about).frame(world)
    });
    position.into_iter().chain(rotation)
}

pub(super) fn number(name: impl Into<String>, unit: &str, about: impl Into<String>) -> Column {
    Column::new(name, ColumnType::Float64, about).unit(unit)
}

/// Columns of the design, which many trajectories share.
fn design(robot: &RobotDescription, simulation: &SimulateSpec) -> Vec<Column> {
    let SimulateSpec { excitation, controller, .. } = simulation;
    // Files contain these words, so the words of the other families stay as they were.
    let family = match (controller, &excitation.steps) {
        (None, _) if excitation.pulses.is_some() => {
            "of the excitation: chirp, multisine, steps or pulses"
        }
        (None, None) => "of the excitation: chirp or multisine",
        (None, Some(_)) => "of the excitation: chirp, multisine or steps",
        (Some(_), _) if excitation.hand_paths.is_some() => {
            "of the reference: fourier, point-to-point, via-points or hand-paths"
        }
        (Some(_), _) => "of the reference: fourier, point-to-point or via-points",
    };
    let rate = match controller {
        None => "rate of the samples; torques are held in between",
        Some(_) => "rate of the samples; the controller has a rate of its own",
    };
    let down = if robot.base.is_upright() {
        "acceleration along -z of the base; 0 when off"
    } else {
        "acceleration along -z of the world; 0 when off"
    };
    vec![
        Column::trajectory(),
        Column::new("draws", ColumnType::Int32, "draws until one stayed clear of the limits"),
        Column::new("seed", ColumnType::Int64, "of the dataset; with the index, key of all draws"),
        Column::new("family", ColumnType::Text, family),
        number("frequency_hz", "Hz", "master frequency of the excitation"),
        number("rate_hz", "Hz", rate),
        number("gravity_m_s2", "m/s²", down),
        Column::new(
            "gravity_compensated",
            ColumnType::Boolean,
            "whether u is the excitation plus the gravity torque g(q) at each sample",
        ),
    ]
}

fn initial_state(joints: usize, start: &str) -> impl Iterator<Item = Column> {
    let joint = |prefix: &str, unit: &str, what: &str| {
        let (prefix, unit) = (prefix.to_owned(), unit.to_owned());
        let (what, start) = (what.to_owned(), start.to_owned());
        (1..=joints).map(move |joint| {
            let about = format!("{what} of joint {joint} {start}");
            number(format!("{prefix}_{joint}"), &unit, about)
        })
    };
    joint("q0", "rad", "position").chain(joint("qd0", "rad/s", "velocity"))
}

/// An angle in words. Multiples of 45° are fractions of π, and others are in rad.
fn angle(degrees: f64) -> String {
    let sign = if degrees < 0.0 { "-" } else { "" };
    match degrees.abs() {
        0.0 => "0".to_owned(),
        45.0 => format!("{sign}π/4"),
        90.0 => format!("{sign}π/2"),
        180.0 => format!("{sign}π"),
        _ => format!("{}", degrees.to_radians()),
    }
}

fn kinematics(robot: &RobotDescription) -> Vec<Column> {
    // The angles of the modified DH table are never randomized.
    let angles = |angle_deg: fn(&JointDescription) -> f64| -> String {
        robot.per_joint(|joint| angle(angle_deg(joint))).join(", ")
    };
    let mut constants = format!("α = {}", angles(|joint| joint.alpha_deg));
    if robot.joints.iter().any(|joint| joint.offset_deg != 0.0) {
        constants += &format!("; θ at position 0 = {}", angles(|joint| joint.offset_deg));
    }
    let joints = robot.joints.len();
    let a = (1..=joints).map(|joint| {
        let about = format!("modified DH: length a before joint {joint}; {constants}");
        number(format!("a_{joint}"), "m", about)
    });
    let d = (1..=joints).map(|joint| {
        number(format!("d_{joint}"), "m", format!("modified DH: offset d of joint {joint}"))
    });
    let hand = &robot.hand;
    let mut about = format!("from the origin of link {joints} along its z to the hand's");
    if hand.alpha_deg != 0.0 {
        about = format!(
            "from the origin of link {joints} along the hand's z to the hand's, which is turned by {} about x",
            angle(hand.alpha_deg)
        );
    }
    let mut columns: Vec<Column> = a.chain(d).chain([number("flange", "m", about)]).collect();
    // Proper tables have none of these, so the columns of their tables do not change.
    if hand.a_m != 0.0 {
        let about = format!("from the origin of link {joints} along its x to the hand's");
        columns.push(number("hand_a", "m", about));
    }
    for (joint, described) in (1..).zip(&robot.joints) {
        if described.is_shifted() {
            columns.extend(AXES.map(|axis| {
                let about = format!("further shift of joint {joint} along {axis}");
                number(format!("shift_{axis}_{joint}"), "m", about).frame(LINK_BEFORE)
            }));
        }
    }
    if hand.is_shifted() {
        columns.extend(AXES.map(|axis| {
            let about = format!("further shift of the hand along {axis}");
            number(format!("hand_shift_{axis}"), "m", about).frame(LINK_BEFORE)
        }));
    }
    columns
}

fn body(robot: &RobotDescription, link: usize) -> Vec<Column> {
    let welded = match robot.hand.contents.as_str() {
        _ if link < robot.joints.len() => String::new(),
        "" => ", payload included".to_owned(),
        contents => format!(", {contents} and payload included"),
    };
    let mut columns = vec![number(format!("mass_{link}"), "kg", format!("of link {link}{welded}"))];
    for axis in AXES {
        let about = format!("{axis} of the centre of mass of link {link}{welded}");
        columns.push(number(format!("com_{axis}_{link}"), "m", about).frame(LINK));
    }
    for entry in ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"] {
        let about = format!("entry of the inertia of link {link} about its centre of mass{welded}");
        columns.push(number(format!("{entry}_{link}"), "kg·m²", about).frame(LINK));
    }
    let damping = format!("viscous friction of joint {link}");
    columns.push(number(format!("damping_{link}"), "N·m·s/rad", damping));
    let armature = format!("reflected rotor inertia of joint {link}");
    columns.push(number(format!("armature_{link}"), "kg·m²", armature));
    columns
}

fn friction(joints: usize) -> impl Iterator<Item = Column> {
    [("phi1", "N·m"), ("phi2", "s/rad"), ("phi3", "rad/s")].into_iter().flat_map(
        move |(name, unit)| {
            (1..=joints).map(move |joint| {
            let about = format!(
                "of joint {joint}: φ1 / (1 + exp(-φ2 (q̇ + φ3))) - φ1 / (1 + exp(-φ2 φ3)) opposes \
                 the motion; null without friction"
            );
            number(format!("friction_{name}_{joint}"), unit, about).nullable()
        })
        },
    )
}

fn payload(robot: &RobotDescription) -> impl Iterator<Item = Column> {
    let hand = format!(
        "hand: origin at the flange, z towards the fingers, turned by {} about it",
        angle(robot.hand.yaw_deg)
    );
    let mass = number("payload_mass", "kg", "of the solid sphere in the hand; null without one");
    let center = AXES.map(|axis| {
        let about = format!("{axis} of the sphere's centre; null without one");
        number(format!("payload_{axis}"), "m", about).frame(&hand).nullable()
    });
    let radius = number("payload_radius", "m", "of the sphere; null without one").nullable();
    [mass.nullable()].into_iter().chain(center).chain([radius])
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use serde_json::json;

    use super::*;
    use crate::simulate::STEP_LEVELS;
    use crate::{JobSpec, parse};

    fn spec(fields: &serde_json::Value) -> SimulateSpec {
        let mut spec = json!({"preset": "D1-chirp"});
        spec.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        match parse(spec.to_string().as_bytes()).unwrap() {
            JobSpec::Simulate(spec) => spec,
            other => panic!("{other:?}"),
        }
    }

    fn names(columns: &[Column]) -> Vec<&str> {
        columns.iter().map(|column| column.name.as_str()).collect()
    }

    #[test]
    fn trajectories_have_torques_and_positions_and_what_else_was_asked_for() {
        let plain = spec(&json!({})).trajectory_columns();
        assert_eq!(names(&plain)[..4], ["trajectory", "step", "u1", "u2"]);
        assert_eq!((plain.len(), names(&plain)[15]), (16, "q7"));
        let observations = json!({"joint_velocities": true, "end_effector_pose": true});
        let all = spec(&json!({"observations": observations})).trajectory_columns();
        assert_eq!(names(&all)[16..18], ["qd1", "qd2"]);
        let pose = ["ee_x", "ee_y", "ee_z", "ee_qx", "ee_qy", "ee_qz", "ee_qw"];
        assert_eq!(names(&all)[23..], pose);
    }

    #[test]
    fn the_size_of_a_dataset_follows_its_columns() {
        let bytes = |fields: serde_json::Value| spec(&fields).estimated_bytes();
        let plain = json!({"trajectories": 1000, "samples": 400});
        assert_eq!(bytes(plain), 1000 * 400 * 43);
        let velocities = json!({
            "trajectories": 1000, "samples": 400, "observations": {"joint_velocities": true},
        });
        assert_eq!(bytes(velocities), 1000 * 400 * 43 * 3 / 2);
    }

    #[test]
    fn no_column_comes_twice_and_every_number_has_a_unit() {
        let spec = spec(&json!({"observations": {"end_effector_pose": true}}));
        let mut jumping = spec.clone();
        jumping.excitation.steps =
            serde_json::from_value(json!({"frequency_hz": {"fixed": 1}})).unwrap();
        let tables = [spec.trajectory_columns(), spec.robot_columns(), jumping.robot_columns()];
        assert_eq!(tables[2].len() - tables[1].len(), 2 * STEP_LEVELS * 7);
        for columns in tables {
            let different: HashSet<_> = names(&columns).into_iter().collect();
            assert_eq!(different.len(), columns.len());
            for column in columns {
                let measured = column.data_type == ColumnType::Float64;
                assert!(!measured || column.unit.is_some(), "{column:?}");
            }
        }
    }
}
