//! A description as a model for MuJoCo.

use nalgebra::{IsometryMatrix3, UnitQuaternion, Vector3};
use quick_xml::escape::escape;
use spec::{BodyDescription, RobotDescription};

use crate::masses::{bodies, hand_pose, joint_pose, same_joints, seen_from_child};
use crate::numbers::{shortest, spaced};
use crate::{Arm, UrdfError, frames};

/// The arm of `description` as a MuJoCo model (MJCF) that can be loaded as it is.
///
/// With the arm of a URDF, its bodies have the names and frames of the URDF's links. Without one,
/// they have the description's frames and the names `link1`, `link2` and so on. The body at the base
/// always has the description's frame, so it can be turned and shifted along z from the URDF's
/// base link. A site has the hand's frame. Each joint has a motor of gear 1 with its name.
///
/// Damping, Coulomb friction (φ1 / 2, as `frictionloss`), rotor inertia, and limits of position and
/// torque are the description's. MJCF has no limit of the speed, and there are no shapes.
///
/// # Errors
/// `description` has other joints or lengths than `arm`.
pub fn mjcf(description: &RobotDescription, arm: Option<&Arm>) -> Result<String, UrdfError> {
    let links = match arm {
        Some(arm) => {
            same_joints(arm, description)?;
            arm.bodies.iter().map(|body| (body.link.clone(), body.frame())).collect()
        }
        None => (1..=description.joints.len())
            .map(|number| (format!("link{number}"), IsometryMatrix3::identity()))
            .collect::<Vec<(String, IsometryMatrix3<f64>)>>(),
    };
    let [base, tip] = arm.map_or(["base", "hand"], |arm| [&arm.base, &arm.tip]);
    let mut model = Model::default();
    model.open(&format!("mujoco{}", attribute("model", &description.name)));
    model.add("compiler angle=\"radian\"");
    model.add("option gravity=\"0 0 -9.81\"");
    model.open("worldbody");
    model.open(&format!("body{}{}", named(base), pose(&frames::base_pose(&description.base))));
    // Pose of the description's frame in the body that is open.
    let mut before = IsometryMatrix3::identity();
    let described = description.joints.iter().zip(bodies(description));
    for ((link, frame), (joint, body)) in links.iter().zip(described) {
        let place = before * joint_pose(joint) * frame.inverse();
        model.open(&format!("body{}{}", named(link), pose(&place)));
        model.add(&inertial(&seen_from_child(&body, frame)));
        // The axis goes through the origin of the joint's child.
        let axis = frame.rotation * Vector3::z();
        let friction_nm = joint.friction.map_or(0.0, |friction| 0.5 * friction.phi1_nm);
        let torques = spaced([-joint.torque_nm, joint.torque_nm]);
        model.add(&format!(
            "joint{} type=\"hinge\" axis=\"{}\" range=\"{}\" damping=\"{}\" frictionloss=\"{}\" \
             armature=\"{}\" actuatorfrcrange=\"{torques}\"",
            attribute("name", &joint.name),
            spaced(axis.iter().copied().map(component)),
            spaced([joint.position_rad.min, joint.position_rad.max]),
            shortest(joint.damping_nm_s_rad),
            shortest(friction_nm),
            shortest(joint.armature_kg_m2),
        ));
        before = *frame;
    }
    let hand = before * hand_pose(&description.hand);
    model.add(&format!("site{}{}", attribute("name", tip), pose(&hand)));
    while model.open.len() > 1 {
        model.close();
    }
    model.open("actuator");
    for joint in &description.joints {
        let name = attribute("name", &joint.name);
        let joint_name = attribute("joint", &joint.name);
        let torques = spaced([-joint.torque_nm, joint.torque_nm]);
        model.add(&format!("motor{name}{joint_name} ctrlrange=\"{torques}\""));
    }
    model.close();
    model.close();
    Ok(model.text)
}

/// The text of a model, element by element.
#[derive(Default)]
struct Model {
    text: String,
    /// Names of the elements that are open.
    open: Vec<String>,
}

impl Model {
    /// Adds an element with nothing inside.
    fn add(&mut self, element: &str) {
        self.line(&format!("<{element}/>"));
    }

    fn open(&mut self, element: &str) {
        self.line(&format!("<{element}>"));
        let name = element.split(' ').next().unwrap_or(element);
        self.open.push(name.to_owned());
    }

    fn close(&mut self) {
        if let Some(name) = self.open.pop() {
            self.line(&format!("</{name}>"));
        }
    }

    fn line(&mut self, line: &str) {
        let indentation = 2 * self.open.len();
        self.text.push_str(&" ".repeat(indentation));
        self.text.push_str(line);
        self.text.push('\n');
    }
}

fn attribute(name: &str, value: &str) -> String {
    // A line break in an attribute is read as a space.
    let value = escape(value).replace('\n', "&#10;").replace('\r', "&#13;").replace('\t', "&#9;");
    format!(" {name}=\"{value}\"")
}

/// The name of a body, unless it is that of MuJoCo's own body.
fn named(name: &str) -> String {
    if name == "world" { String::new() } else { attribute("name", name) }
}

fn pose(pose: &IsometryMatrix3<f64>) -> String {
    let origin = spaced(pose.translation.vector.iter().copied().map(frames::to_length));
    let turn = UnitQuaternion::from_rotation_matrix(&pose.rotation);
    let turn = spaced([turn.w, turn.i, turn.j, turn.k].map(component));
    format!(" pos=\"{origin}\" quat=\"{turn}\"")
}

/// A component of a direction or a turn, or 0 if it is rounding.
fn component(component: f64) -> f64 {
    const ROUNDING: f64 = 1e-15;

    if component.abs() < ROUNDING { 0.0 } else { component }
}

fn inertial(body: &BodyDescription) -> String {
    let [xx, xy, xz, yy, yz, zz] = body.inertia_kg_m2;
    let (center, mass) = (spaced(body.center_m), shortest(body.mass_kg));
    let inertia = spaced([xx, yy, zz, xy, xz, yz]);
    format!("inertial pos=\"{center}\" mass=\"{mass}\" fullinertia=\"{inertia}\"")
}
