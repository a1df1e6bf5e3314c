//! What people look at: the zero pose of an arm as a figure, and its links as they are simulated.

use dynamics::{Joints, Kinematics, Pose};
use figures::{ArmFigure, ArmJoint};
use spec::{RobotDescription, RobotModel, RobotSpec};
use wire::RobotLink;

use crate::{Arm, ArmBody};

/// The arm with all joints at 0. With the arm of a URDF, joints are where the URDF has them, which
/// may be elsewhere on their axes.
pub fn zero_pose(description: &RobotDescription, arm: Option<&Arm>) -> ArmFigure {
    let kinematics = nominal(description).kinematics;
    let joints = description.joints.iter().enumerate().map(|(index, joint)| {
        let frame = joint_frame(&kinematics, index);
        let [_, _, axis] = axes(&frame);
        let body = arm.and_then(|arm| arm.bodies.get(index));
        let origin_m = body.map_or(frame.position_m, |body| origin(body, &frame));
        ArmJoint { name: joint.name.clone(), origin_m, axis }
    });
    let joints = joints.collect();
    let hand = kinematics.end_effector_pose(Joints::splat(kinematics.joints.len(), 0.0));
    ArmFigure {
        title: format!("{}, all joints at 0", description.name),
        base_m: kinematics.base.position_m,
        joints,
        hand_m: hand.position_m,
        hand_axes: axes(&hand),
    }
}

/// The links as they are simulated. The last one carries the hand. With the arm of a URDF, they have
/// the names of its links.
pub fn links(description: &RobotDescription, arm: Option<&Arm>) -> Vec<RobotLink> {
    let nominal = nominal(description);
    let mut links: Vec<RobotLink> = nominal
        .links
        .iter()
        .zip(&description.joints)
        .map(|(link, joint)| RobotLink {
            joint: joint.name.clone(),
            mass_kg: link.mass,
            center_m: link.com,
            principal_kg_m2: link.principal_moments(),
            parts: Vec::new(),
        })
        .collect();
    for (link, body) in links.iter_mut().zip(arm.into_iter().flat_map(|arm| &arm.bodies)) {
        link.parts = body.links.clone();
    }
    if let Some(last) = links.last_mut()
        && !description.hand.bodies.is_empty()
    {
        let hand = description.hand.bodies.iter().map(|body| body.name.clone());
        last.parts = ["the link".to_owned()].into_iter().chain(hand).collect();
    }
    links
}

fn nominal(description: &RobotDescription) -> dynamics::Robot {
    let model = RobotModel::Described(Box::new(description.clone()));
    dynamics::Robot::nominal(&RobotSpec::of(model))
}

/// The frame of a joint in the world: that of the hand of the arm that ends there.
fn joint_frame(kinematics: &Kinematics, joint: usize) -> Pose {
    let before = Kinematics {
        joints: kinematics.joints.iter().take(joint).copied().collect(),
        hand: kinematics.joints[joint],
        ..*kinematics
    };
    before.end_effector_pose(Joints::splat(joint, 0.0))
}

/// The origin of the joint in its URDF.
fn origin(body: &ArmBody, frame: &Pose) -> [f64; 3] {
    let columns = axes(frame);
    let mut origin = frame.position_m;
    for (axis, column) in columns.iter().enumerate() {
        // The origin of the child's frame in the frame of the table: -Rᵀ t.
        let along: f64 =
            (0..3).map(|row| -body.rotation[row][axis] * body.translation_m[row]).sum();
        for (coordinate, direction) in origin.iter_mut().zip(column) {
            *coordinate += along * direction;
        }
    }
    origin
}

/// Unit vectors along x, y and z of a frame.
fn axes(pose: &Pose) -> [[f64; 3]; 3] {
    let [x, y, z, w] = pose.quaternion_xyzw;
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
        [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn a_panda_at_zero_stands_upright_with_its_hand_pointing_down() {
        let figure = zero_pose(RobotModel::panda().description(), None);
        assert_eq!(figure.joints.len(), 7);
        assert!(close(figure.joints[0].axis, [0.0, 0.0, 1.0]));
        assert!(close(figure.joints[1].axis, [0.0, 1.0, 0.0]), "{:?}", figure.joints[1]);
        assert!(close(figure.joints[3].origin_m, [0.0825, 0.0, 0.649]), "{:?}", figure.joints[3]);
        assert!(close(figure.hand_axes[2], [0.0, 0.0, -1.0]), "{:?}", figure.hand_axes);
    }

    #[test]
    fn the_joints_of_a_urdf_are_where_it_has_them() {
        let text = r#"<robot name="a"><link name="a"/><link name="b"><inertial><mass value="1"/>
            <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <link name="c"><inertial><mass value="1"/>
            <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="j1" type="continuous"><parent link="a"/><child link="b"/>
            <origin xyz="0.1 0.2 0.3" rpy="0.3 0.2 0.1"/><axis xyz="0 0 1"/></joint>
            <joint name="j2" type="continuous"><parent link="b"/><child link="c"/>
            <origin xyz="0.4 0 0.1"/><axis xyz="0 1 0"/></joint></robot>"#;
        let arm = crate::read(text, &crate::Options::default()).unwrap();
        let figure = zero_pose(&arm.description, Some(&arm));
        assert!(close(figure.joints[0].origin_m, [0.1, 0.2, 0.3]), "{:?}", figure.joints[0]);
        // rpy (0.3, 0.2, 0.1) applied to (0.4, 0, 0.1).
        let turn = dynamics::Base::new([0.0; 3], [0.3_f64, 0.2, 0.1].map(f64::to_degrees)).rotation;
        let second = [0, 1, 2]
            .map(|row| figure.joints[0].origin_m[row] + 0.4 * turn[row][0] + 0.1 * turn[row][2]);
        assert!(close(figure.joints[1].origin_m, second), "{:?}", figure.joints[1]);
        assert!(close(figure.joints[1].axis, [0, 1, 2].map(|row| turn[row][1])));
    }

    #[test]
    fn the_last_link_carries_the_hand_and_the_others_have_the_names_of_the_urdf() {
        let panda = RobotModel::panda();
        let of_panda = links(panda.description(), None);
        assert_eq!(of_panda.len(), 7);
        assert!(of_panda[0].parts.is_empty() && of_panda[6].parts[0] == "the link");
        let heavier = of_panda[6].mass_kg - panda.description().joints[6].link.mass_kg;
        let hand: f64 = panda.description().hand.bodies.iter().map(|body| body.body.mass_kg).sum();
        assert!((heavier - hand).abs() < 1e-12, "{heavier} and {hand}");
        let text = r#"<robot name="a"><link name="a"/><link name="b"><inertial><mass value="1"/>
            <inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="j1" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"#;
        let arm = crate::read(text, &crate::Options::default()).unwrap();
        let of_urdf = links(&arm.description, Some(&arm));
        assert_eq!(
            (of_urdf[0].joint.as_str(), &of_urdf[0].parts[..]),
            ("j1", &["b".to_owned()][..])
        );
        assert_eq!(of_urdf[0].mass_kg, 1.0);
    }
}
