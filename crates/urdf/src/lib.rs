//! Arms from URDFs: the text of a URDF in, the description of an arm out, and back.
//!
//! [`read`] takes the chain from a base link to a tip link. Its revolute and continuous joints
//! become the joints of a [`RobotDescription`]. All else is welded: fixed joints, joints that the
//! options lock, joints that mimic others, and branches, each at its position. Meshes, visuals,
//! collisions, transmissions and elements of simulators are passed over.
//!
//! The description is the URDF's arm and not an approximation: poses, mass matrix and forces are
//! the URDF's within rounding. Angles within 1e-12 rad of a multiple of 45° become that multiple,
//! and lengths below 1e-13 m become 0. `table` says how frames are chosen.
//! `tests/peers/public_arms.py` compares public arms with Pinocchio.
//!
//! # What is assumed
//!
//! Whatever the URDF leaves open, or what looks like a mistake but is allowed, is a [`Doubt`] of the
//! arm, with the value that was assumed. `limits` and `initial` have these values. A URDF's Coulomb
//! friction f becomes f tanh(20 q̇), which is smooth. The attribute `phi2_s_rad` of `<dynamics>` makes
//! it f tanh(φ2 q̇ / 2).
//!
//! An inertia that no body can have is an error if its link moves, unless
//! [`Options::nearest_physical`] asks for the nearest possible. The links are repaired one by one,
//! before they are welded.
//!
//! # The way back
//!
//! [`write()`] puts the bodies, damping and friction of a description, perhaps an identified one, into
//! the text of its URDF and leaves all else as it is. [`mjcf`] makes a model for MuJoCo.
//! `tests/peers/mujoco_models.py` compares both with Pinocchio and MuJoCo.
//!
//! [`zero_pose`] and [`links`] show an arm to people.
//!
//! # A stranger's text
//!
//! Reading takes time and memory in proportion to the text, which has at most 4 MiB; it cannot
//! overflow the stack, and no entity is expanded. The crate reads XML with quick-xml's events and
//! not with `urdf-rs` (0.10): that one overflows the stack on nested elements, takes `xyz="1 oops 2
//! 3"` for 1, 2, 3, and does not tell a link without `<inertial>` from one with zeros.

#![warn(missing_docs)]

mod bodies;
mod chain;
mod document;
mod error;
mod frames;
mod initial;
mod limits;
mod looks;
mod masses;
mod mujoco;
mod numbers;
mod options;
mod part;
mod reading;
mod spans;
mod table;
mod tree;
mod writing;

use std::collections::BTreeMap;

use nalgebra::{IsometryMatrix3, Vector3};
use serde::Serialize;
use sha2::{Digest, Sha256};
use spec::{
    BaseDescription, HandDescription, JointDescription, Randomization, RobotDescription, SpecError,
};

pub use error::UrdfError;
pub use looks::{links, zero_pose};
pub use mujoco::mjcf;
pub use options::{Options, read_lock, read_mount};
pub use part::{Doubt, Part};
pub use reading::MAX_BYTES;
pub use writing::write;

use bodies::{Welder, axis, places};
use chain::Chain;
use document::Joint;
use limits::Limits;
use part::Doubts;
use table::{Axis, Row, Table};
use tree::Tree;

/// An arm from a URDF.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Arm {
    /// The arm.
    pub description: RobotDescription,
    /// The arm's user should know these.
    pub doubts: Vec<Doubt>,
    /// Name of the link that stands.
    pub base: String,
    /// Name of the link with the hand's frame.
    pub tip: String,
    /// The URDF's links behind each joint of the description.
    pub bodies: Vec<ArmBody>,
}

/// The URDF's links that became one link of a description, and where its frame is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ArmBody {
    /// Name of the joint that moves the body.
    pub joint: String,
    /// Name of the joint's child, in whose frame `rotation` and `translation_m` are.
    pub link: String,
    /// Names of all links of the body, the joint's child first.
    pub links: Vec<String>,
    /// Rows of the matrix that turns vectors of the description's frame into the child's.
    pub rotation: [[f64; 3]; 3],
    /// Origin of the description's frame, m.
    pub translation_m: [f64; 3],
}

/// Reads a URDF.
///
/// # Errors
/// The text is no URDF of an arm that can be described, with the part, its value, what is allowed
/// and the option that helps.
pub fn read(text: &str, options: &Options) -> Result<Arm, UrdfError> {
    if let Some(at) = text.find('\0') {
        let line = text[..at].matches('\n').count() + 1;
        let reason = "it has a NUL character, which XML does not allow".to_owned();
        return Err(UrdfError::NotXml { line, reason });
    }
    let tree = Tree::new(reading::read(text)?)?;
    let mut doubts = Doubts::default();
    let chain = Chain::new(&tree, options, &mut doubts)?;
    let joints: Vec<&Joint> = chain.moving.iter().map(|joint| &tree.joints[*joint]).collect();
    let placed = places(&tree, &chain)?;
    let table = Table::new(&axes(&tree, &chain, &placed)?);
    let limits = joints
        .iter()
        .map(|joint| Limits::of(joint, &mut doubts))
        .collect::<Result<Vec<Limits>, UrdfError>>()?;
    let has_friction = limits.iter().any(|limits| limits.friction_nm > 0.0);
    let is_assumed = |limits: &Limits| limits.friction_nm > 0.0 && limits.phi2_s_rad.is_none();
    let rubbing: Vec<&str> = joints
        .iter()
        .zip(&limits)
        .filter(|(_, limits)| is_assumed(limits))
        .map(|(joint, _)| joint.name.as_str())
        .collect();
    if !rubbing.is_empty() {
        doubts.robot(format!(
            "the friction f of the joints {} is taken over as f tanh(20 q̇), for specs that ask for friction",
            part::listed(rubbing)
        ));
    }

    let welder = Welder { tree: &tree, options, placed: &placed };
    let mut described = Vec::with_capacity(joints.len());
    let mut bodies = Vec::with_capacity(joints.len());
    for (index, joint) in joints.iter().enumerate() {
        let frame = &table.frames[index];
        let (link, links) = welder.body(index, joint, frame, &mut doubts)?;
        let Row { a_m, alpha_deg, d_m, offset_deg, shift_m } = table.rows[index];
        let limits = &limits[index];
        described.push(JointDescription {
            name: joint.name.clone(),
            a_m,
            alpha_deg,
            d_m,
            offset_deg,
            shift_m,
            position_rad: limits.position_rad,
            velocity_rad_s: limits.velocity_rad_s,
            torque_nm: limits.torque_nm,
            damping_nm_s_rad: limits.damping_nm_s_rad,
            armature_kg_m2: limits.armature_kg_m2,
            friction: has_friction
                .then(|| limits::described(limits.friction_nm, limits.phi2_s_rad)),
            multisine_divisor: 1.0,
            least_inertia_kg_m2: None,
            link,
        });
        let rotation = frame.rotation.matrix();
        bodies.push(ArmBody {
            joint: joint.name.clone(),
            link: joint.child.clone(),
            links,
            rotation: [0, 1, 2].map(|row| [0, 1, 2].map(|column| rotation[(row, column)])),
            translation_m: frame.translation.vector.into(),
        });
    }
    let Row { a_m, alpha_deg, d_m, offset_deg, shift_m } = table.rows[joints.len()];
    let hand = HandDescription {
        a_m,
        alpha_deg,
        shift_m,
        flange_m: d_m,
        yaw_deg: offset_deg,
        ..HandDescription::default()
    };
    let [base, tip] = [chain.base, chain.tip].map(|link| tree.links[link].name.clone());
    let description = RobotDescription {
        name: tree.name.clone(),
        sources: sources(text, &tree.name, options, [&base, &tip]),
        base: mounted(&options.mount, &table),
        joints: described,
        hand,
        randomization: Randomization::default(),
        initial_state: initial::initial_state(&joints, &limits, &mut doubts),
    };
    description.checked().map_err(|error| named(error, &joints))?;
    Ok(Arm { description, doubts: doubts.into_vec(), base, tip, bodies })
}

/// The violations of a description, with the names of joints for their numbers.
fn named(mut error: SpecError, joints: &[&Joint]) -> UrdfError {
    for violation in &mut error.violations {
        for (index, joint) in joints.iter().enumerate() {
            let name = Part::Joint(joint.name.clone()).to_string();
            violation.field = violation.field.replace(&format!("joints[{index}]"), &name);
        }
    }
    UrdfError::Description(error)
}

/// The joints' axes and the tip's z, each seen from the one before.
fn axes(
    tree: &Tree,
    chain: &Chain,
    placed: &[(usize, bodies::Place)],
) -> Result<Vec<Axis>, UrdfError> {
    let place = |wanted: usize| {
        let found = placed.iter().find(|(link, _)| *link == wanted);
        found.map_or(IsometryMatrix3::identity(), |(_, place)| place.pose)
    };
    let mut axes = Vec::with_capacity(chain.moving.len() + 1);
    for joint in &chain.moving {
        let before = place(tree.ends[*joint].parent);
        let joint = &tree.joints[*joint];
        axes.push(Axis { pose: before * joint.origin.pose(), direction: axis(joint)? });
    }
    axes.push(Axis { pose: place(chain.tip), direction: Vector3::z_axis() });
    Ok(axes)
}

/// The base of the table in the world.
fn mounted(mount: &BaseDescription, table: &Table) -> BaseDescription {
    let Table { base_shift_m, base_yaw_deg, .. } = *table;
    let pose = frames::base_pose(mount);
    let shift = pose.rotation * Vector3::new(0.0, 0.0, base_shift_m);
    let position_m = [0, 1, 2].map(|axis| mount.position_m[axis] + frames::to_length(shift[axis]));
    let [roll, pitch, yaw] = mount.rpy_deg;
    let rpy_deg = if base_yaw_deg == 0.0 {
        mount.rpy_deg
    } else if [roll, pitch] == [0.0; 2] {
        [0.0, 0.0, frames::to_degrees((yaw + base_yaw_deg).to_radians())]
    } else {
        let turned = pose.rotation * frames::about_z(frames::sin_cos_deg(base_yaw_deg));
        frames::roll_pitch_yaw(&turned).map(frames::to_degrees)
    };
    BaseDescription { position_m, rpy_deg }
}

/// Where the numbers come from.
fn sources(
    text: &str,
    name: &str,
    options: &Options,
    [base, tip]: [&str; 2],
) -> BTreeMap<String, String> {
    let digest = hex::encode(Sha256::digest(text));
    let mut urdf = format!(
        "the URDF of `{}` (SHA-256 {digest}), from link `{}` to link `{}`",
        part::shown(name),
        part::shown(base),
        part::shown(tip)
    );
    for (joint, position) in &options.locks {
        urdf.push_str(&format!(", {} locked at {position}", part::shown(joint)));
    }
    if options.nearest_physical {
        urdf.push_str(", impossible inertias replaced by the nearest possible");
    }
    BTreeMap::from([
        ("kinematics, limits, links, damping, friction".to_owned(), urdf),
        (
            "initial_state, randomization".to_owned(),
            "torqued's defaults within the limits".to_owned(),
        ),
    ])
}
