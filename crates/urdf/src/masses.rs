//! The frames and bodies of a description, as the way back to other formats needs them.

use dynamics::RigidBody;
use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Vector3};
use spec::{BodyDescription, HandDescription, JointDescription, RobotDescription};

use crate::frames::{about_x, about_z, sin_cos_deg, to_length};
use crate::part::shown;
use crate::{Arm, ArmBody, UrdfError};

impl ArmBody {
    /// Pose of the description's frame in the joint's child.
    pub(crate) fn frame(&self) -> IsometryMatrix3<f64> {
        let rotation = Matrix3::from_fn(|row, column| self.rotation[row][column]);
        let rotation = Rotation3::from_matrix_unchecked(rotation);
        IsometryMatrix3::from_parts(Vector3::from(self.translation_m).into(), rotation)
    }
}

/// The body of each joint, in the joint's frame. The last one includes the hand.
pub(crate) fn bodies(description: &RobotDescription) -> Vec<RigidBody> {
    let mut bodies: Vec<RigidBody> =
        description.joints.iter().map(|joint| body(&joint.link)).collect();
    let hand = hand_pose(&description.hand);
    for part in &description.hand.bodies {
        let origin = hand.translation.vector + hand.rotation * Vector3::from(part.position_m);
        let part = body(&part.body).seen_from(&hand.rotation, &origin);
        if let Some(last) = bodies.last_mut() {
            *last = last.welded_to(&part);
        }
    }
    bodies
}

fn body(description: &BodyDescription) -> RigidBody {
    let BodyDescription { mass_kg, center_m, inertia_kg_m2, nearest_physical } = *description;
    let body = RigidBody::new(mass_kg, center_m, inertia_kg_m2);
    if nearest_physical { body.projected() } else { body }
}

/// A body seen from the child of its joint, without the rounding of turns by right angles.
pub(crate) fn seen_from_child(body: &RigidBody, frame: &IsometryMatrix3<f64>) -> BodyDescription {
    /// Relative to the trace. Turned zeros are below it.
    const ROUNDING: f64 = 1e-16;

    let body = body.seen_from(&frame.rotation, &frame.translation.vector);
    let [[xx, xy, xz], [_, yy, yz], [.., zz]] = body.inertia;
    let least = ROUNDING * (xx + yy + zz);
    let inertia_kg_m2 = [xx, xy, xz, yy, yz, zz];
    BodyDescription {
        mass_kg: body.mass,
        center_m: body.com.map(to_length),
        inertia_kg_m2: inertia_kg_m2.map(|entry| if entry.abs() < least { 0.0 } else { entry }),
        nearest_physical: false,
    }
}

/// Pose of a joint's frame at position 0, in the frame before.
pub(crate) fn joint_pose(joint: &JointDescription) -> IsometryMatrix3<f64> {
    let JointDescription { shift_m, a_m, alpha_deg, d_m, offset_deg, .. } = *joint;
    step(shift_m, a_m, alpha_deg, d_m, offset_deg)
}

/// Pose of the hand's frame in the last joint's.
pub(crate) fn hand_pose(hand: &HandDescription) -> IsometryMatrix3<f64> {
    step(hand.shift_m, hand.a_m, hand.alpha_deg, hand.flange_m, hand.yaw_deg)
}

/// A row of the modified Denavit-Hartenberg table.
fn step(
    shift_m: [f64; 3],
    a_m: f64,
    alpha_deg: f64,
    d_m: f64,
    offset_deg: f64,
) -> IsometryMatrix3<f64> {
    let twist = about_x(sin_cos_deg(alpha_deg));
    let along = Vector3::new(a_m, 0.0, 0.0) + twist * Vector3::new(0.0, 0.0, d_m);
    let origin = Vector3::from(shift_m) + along;
    IsometryMatrix3::from_parts(origin.into(), twist * about_z(sin_cos_deg(offset_deg)))
}

/// Refuses a description whose joints are not those of the arm.
pub(crate) fn same_joints(arm: &Arm, description: &RobotDescription) -> Result<(), UrdfError> {
    /// Of lengths in m and angles in degrees. Texts between the two may round.
    const ROUNDING: f64 = 1e-9;

    let joints = [&arm.description, description].map(|one| one.joints.len());
    if joints[0] != joints[1] || joints[0] != arm.bodies.len() {
        let reason = format!("{} joints, the arm has {}", joints[1], joints[0]);
        return Err(UrdfError::OtherArm { reason });
    }
    for (ours, theirs) in arm.description.joints.iter().zip(&description.joints) {
        if ours.name != theirs.name {
            let [theirs, ours] = [theirs, ours].map(|joint| shown(&joint.name));
            let reason = format!("joint `{theirs}` in the place of `{ours}`");
            return Err(UrdfError::OtherArm { reason });
        }
        let row = |joint: &JointDescription| {
            let JointDescription { a_m, alpha_deg, d_m, offset_deg, shift_m, .. } = *joint;
            let [x, y, z] = shift_m;
            [a_m, alpha_deg, d_m, offset_deg, x, y, z]
        };
        let is_same = |(ours, theirs): (f64, f64)| (ours - theirs).abs() <= ROUNDING;
        if !row(ours).into_iter().zip(row(theirs)).all(is_same) {
            let name = shown(&ours.name);
            let reason = format!("joint `{name}` with other lengths or angles");
            return Err(UrdfError::OtherArm { reason });
        }
    }
    Ok(())
}
