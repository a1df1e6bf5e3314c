//! The description of a URDF moves as the URDF's tree.

use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Vector3};
use proptest::prelude::*;
use spec::{BaseDescription, RobotDescription};
use urdf::{Arm, ArmBody, Options, read};

use crate::robots::{Draws, Energies, Moving, Robot};

/// Frames of the joints and the hand by the description, in motion.
pub fn motion(description: &RobotDescription, q: &[f64], qd: &[f64]) -> Vec<Moving> {
    let mut at = Moving::standing(base(&description.base));
    let mut frames = Vec::new();
    for (index, joint) in description.joints.iter().enumerate() {
        let step = step(joint.shift_m, joint.a_m, joint.alpha_deg, joint.d_m, joint.offset_deg);
        at = at.fixed(&step).turned(&Vector3::z_axis(), q[index], qd[index]);
        frames.push(at);
    }
    let hand = &description.hand;
    let step = step(hand.shift_m, hand.a_m, hand.alpha_deg, hand.flange_m, hand.yaw_deg);
    frames.push(at.fixed(&step));
    frames
}

fn step(shift_m: [f64; 3], a: f64, alpha_deg: f64, d: f64, yaw_deg: f64) -> IsometryMatrix3<f64> {
    let alpha = Rotation3::from_axis_angle(&Vector3::x_axis(), alpha_deg.to_radians());
    let yaw = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_deg.to_radians());
    let place =
        Vector3::from(shift_m) + Vector3::new(a, 0.0, 0.0) + alpha * Vector3::new(0.0, 0.0, d);
    IsometryMatrix3::from_parts(place.into(), alpha * yaw)
}

pub fn base(base: &BaseDescription) -> IsometryMatrix3<f64> {
    let [roll, pitch, yaw] = base.rpy_deg.map(f64::to_radians);
    let turn = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let rotation = turn(Vector3::z_axis(), yaw)
        * turn(Vector3::y_axis(), pitch)
        * turn(Vector3::x_axis(), roll);
    IsometryMatrix3::from_parts(Vector3::from(base.position_m).into(), rotation)
}

/// The frame of a body in the URDF's link.
pub fn frame(body: &ArmBody) -> IsometryMatrix3<f64> {
    let rotation = Matrix3::from_fn(|row, column| body.rotation[row][column]);
    let rotation = Rotation3::from_matrix_unchecked(rotation);
    IsometryMatrix3::from_parts(Vector3::from(body.translation_m).into(), rotation)
}

pub fn energies(arm: &Arm, frames: &[Moving]) -> Energies {
    let bodies = arm.description.joints.iter().zip(frames);
    let energies = bodies.map(|(joint, frame)| {
        let [xx, xy, xz, yy, yz, zz] = joint.link.inertia_kg_m2;
        let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        frame.energies(joint.link.mass_kg, joint.link.center_m.into(), inertia)
    });
    energies.sum()
}

pub fn distance(one: &Moving, other: &Moving) -> f64 {
    let parts = [
        (one.pose.rotation.matrix() - other.pose.rotation.matrix()).amax(),
        (one.pose.translation.vector - other.pose.translation.vector).amax(),
        (one.angular - other.angular).amax(),
        (one.linear - other.linear).amax(),
    ];
    parts.into_iter().fold(0.0, f64::max)
}

#[track_caller]
pub fn check(robot: &Robot, arm: &Arm, mount: &BaseDescription, draws: &mut Draws, most: f64) {
    let joints = robot.moving.len();
    assert_eq!(arm.description.per_joint(|joint| joint.name.clone()), robot.moving);
    let named: Vec<&String> = arm.bodies.iter().flat_map(|body| &body.links).collect();
    assert_eq!(named.len(), robot.moved().len());
    for _ in 0..5 {
        let [q, qd] =
            [3.0, 2.0].map(|range| (0..joints).map(|_| draws.within(range)).collect::<Vec<f64>>());
        let links = robot.motion(base(mount), &q, &qd);
        let frames = motion(&arm.description, &q, &qd);
        let link = |name: &str| {
            let index = robot.links.iter().position(|link| link.name == name).unwrap();
            links[index]
        };
        for (body, ours) in arm.bodies.iter().zip(&frames) {
            let error = distance(&link(&body.link).fixed(&frame(body)), ours);
            assert!(error < most, "{}: {error:e}", body.joint);
        }
        let error = distance(&link(&arm.tip), &frames[joints]);
        assert!(error < most, "the tip: {error:e}");

        let theirs: Energies =
            robot.moved().into_iter().map(|index| robot.links[index].energies(&links[index])).sum();
        energies(arm, &frames).assert_close(&theirs, most);
    }
}

#[track_caller]
fn check_random(seed: u64, finest: f64, most: f64) {
    let robot = Robot::random(seed, finest);
    let mut draws = Draws::new(seed, 2);
    let mount = BaseDescription { position_m: draws.vector(1.0), rpy_deg: draws.vector(180.0) };
    let tip = Some(robot.tip.clone());
    let options = Options { tip, mount, ..Options::default() };
    let arm = read(&robot.urdf(seed), &options).unwrap();
    check(&robot, &arm, &mount, &mut draws, most);
}

#[track_caller]
fn check_locked(seed: u64) {
    let (robot, options) = Robot::locked(seed);
    let arm = read(&robot.urdf(seed), &options).unwrap();
    let mut draws = Draws::new(seed, 8);
    check(&robot, &arm, &options.mount, &mut draws, 1e-12);
}

proptest! {
    #[test]
    fn a_random_robot_moves_as_its_tree(seed in any::<u64>()) {
        // Below 1e-9 rad the next angle might become a multiple of 45°.
        check_random(seed, 9.0, 1e-12);
    }

    #[test]
    fn angles_that_become_multiples_of_45_degrees_hardly_change_it(seed in any::<u64>()) {
        check_random(seed, 16.0, 3e-11);
    }

    #[test]
    fn a_robot_with_locked_joints_moves_as_its_tree(seed in any::<u64>()) {
        check_locked(seed);
    }
}

/// Its heights cancel to a tenth of their terms.
#[test]
fn energies_are_compared_by_their_terms() {
    check_locked(7_081_024_476_816_747_541);
}

/// Lengths of the Panda's URDF, with a link of its own for each joint.
fn panda() -> String {
    let rows = [
        ("0 0 0", "0 0 0.333"),
        ("-1.57079632679489661923 0 0", "0 0 0"),
        ("1.57079632679489661923 0 0", "0 -0.316 0"),
        ("1.57079632679489661923 0 0", "0.0825 0 0"),
        ("-1.57079632679489661923 0 0", "-0.0825 0.384 0"),
        ("1.57079632679489661923 0 0", "0 0 0"),
        ("1.57079632679489661923 0 0", "0.088 0 0"),
    ];
    let mut text = "<robot name='panda'><link name='link0'/>".to_owned();
    for (index, (rpy, xyz)) in rows.iter().enumerate() {
        let child = index + 1;
        text += &format!(
            "<link name='link{child}'><inertial><mass value='1'/><inertia ixx='0.01' ixy='0' ixz='0' \
             iyy='0.01' iyz='0' izz='0.015'/></inertial></link>\
             <joint name='joint{child}' type='revolute'><origin rpy='{rpy}' xyz='{xyz}'/>\
             <parent link='link{index}'/><child link='link{child}'/><axis xyz='0 0 1'/>\
             <limit lower='-2.9' upper='2.9' effort='87' velocity='2.175'/></joint>"
        );
    }
    text + "<link name='hand'/><joint name='fixed' type='fixed'>\
            <origin rpy='0 0 -0.785398163397448309616' xyz='0 0 0.107'/>\
            <parent link='link7'/><child link='hand'/></joint></robot>"
}

#[test]
fn the_panda_s_urdf_gives_its_published_table() {
    let arm = read(&panda(), &Options::default()).unwrap();
    let model = spec::RobotModel::panda();
    let published = model.description();
    for (ours, theirs) in arm.description.joints.iter().zip(&published.joints) {
        let row = |joint: &spec::JointDescription| {
            (joint.a_m, joint.alpha_deg, joint.d_m, joint.offset_deg, joint.shift_m)
        };
        assert_eq!(row(ours), row(theirs), "{}", theirs.name);
    }
    let hand = &arm.description.hand;
    assert_eq!((hand.a_m, hand.alpha_deg), (0.0, 0.0));
    assert_eq!((hand.flange_m, hand.yaw_deg), (published.hand.flange_m, published.hand.yaw_deg));
    assert!(arm.description.base.is_upright());
    assert_eq!(arm.doubts, []);
}

#[test]
fn a_mount_that_is_exact_stays_exact() {
    let mount = BaseDescription { position_m: [0.0, 0.5, 2.0], rpy_deg: [180.0, 0.0, 0.0] };
    let arm = read(&panda(), &Options { mount, ..Options::default() }).unwrap();
    assert_eq!(arm.description.base, mount);
}
