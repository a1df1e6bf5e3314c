//! An arm in its zero pose as a figure.

use dynamics::{Joints, Kinematics, Pose};
use figures::{ArmFigure, ArmJoint};

use crate::robots::Robot;

/// The arm with all joints at 0.
pub fn zero_pose(robot: &Robot, kinematics: &Kinematics) -> ArmFigure {
    let names = robot.description().per_joint(|joint| joint.name.clone());
    let joints = names.into_iter().enumerate().map(|(joint, name)| {
        let frame = joint_frame(kinematics, joint);
        let [_, _, axis] = axes(&frame);
        ArmJoint { name, origin_m: origin(robot, joint, &frame), axis }
    });
    let hand = kinematics.end_effector_pose(Joints::splat(kinematics.joints.len(), 0.0));
    ArmFigure {
        title: format!("{}, all joints at 0", robot.description().name),
        base_m: kinematics.base.position_m,
        joints: joints.collect(),
        hand_m: hand.position_m,
        hand_axes: axes(&hand),
    }
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

/// Where the joint is: for a URDF the origin of the joint there, which its table has elsewhere on the axis.
fn origin(robot: &Robot, joint: usize, frame: &Pose) -> [f64; 3] {
    let Some(urdf) = &robot.urdf else { return frame.position_m };
    let body = &urdf.arm.bodies[joint];
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
    use spec::{RobotModel, RobotSpec};

    use super::*;
    use crate::robots::Urdf;

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn a_panda_at_zero_stands_upright_with_its_hand_pointing_down() {
        let robot = Robot { model: RobotModel::panda(), urdf: None };
        let figure = zero_pose(&robot, &dynamics::Robot::panda().kinematics);
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
        let arm = urdf::read(text, &urdf::Options::default()).unwrap();
        let model = RobotModel::Described(Box::new(arm.description.clone()));
        let nominal = dynamics::Robot::nominal(&RobotSpec::of(model.clone()));
        let robot = Robot { model, urdf: Some(Urdf { text: text.to_owned(), arm }) };
        let figure = zero_pose(&robot, &nominal.kinematics);
        assert!(close(figure.joints[0].origin_m, [0.1, 0.2, 0.3]), "{:?}", figure.joints[0]);
        // rpy (0.3, 0.2, 0.1) applied to (0.4, 0, 0.1).
        let turn = dynamics::Base::new([0.0; 3], [0.3_f64, 0.2, 0.1].map(f64::to_degrees)).rotation;
        let second = [0, 1, 2]
            .map(|row| figure.joints[0].origin_m[row] + 0.4 * turn[row][0] + 0.1 * turn[row][2]);
        assert!(close(figure.joints[1].origin_m, second), "{:?}", figure.joints[1]);
        assert!(close(figure.joints[1].axis, [0, 1, 2].map(|row| turn[row][1])));
    }
}
