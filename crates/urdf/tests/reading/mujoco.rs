//! Models for MuJoCo, read back: frames and energies are the description's.

use std::collections::BTreeMap;

use nalgebra::{IsometryMatrix3, Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;
use quick_xml::XmlVersion;
use quick_xml::events::Event;
use quick_xml::reader::Reader;
use spec::{RobotDescription, RobotModel};
use urdf::{Options, mjcf, read};

use crate::agreement::{distance, energies, frame, motion};
use crate::robots::{Draws, Energies, Moving, Robot};

/// Names and attributes of the elements of a text.
fn elements(text: &str) -> Vec<(String, BTreeMap<String, String>)> {
    let mut reader = Reader::from_str(text);
    let mut elements = Vec::new();
    loop {
        let start = match reader.read_event().unwrap() {
            Event::Start(start) | Event::Empty(start) => start,
            Event::End(_) | Event::Text(_) => continue,
            Event::Eof => return elements,
            other => panic!("{other:?}"),
        };
        let attributes = start.attributes().map(|attribute| {
            let attribute = attribute.unwrap();
            let value = attribute.normalized_value(XmlVersion::default()).unwrap().into_owned();
            (String::from_utf8_lossy(attribute.key.as_ref()).into_owned(), value)
        });
        let name = String::from_utf8_lossy(start.name().as_ref()).into_owned();
        elements.push((name, attributes.collect()));
    }
}

fn numbers<const N: usize>(attributes: &BTreeMap<String, String>, name: &str) -> [f64; N] {
    let numbers = attributes[name].split(' ').map(|number| number.parse().unwrap());
    numbers.collect::<Vec<f64>>().try_into().unwrap()
}

fn pose(attributes: &BTreeMap<String, String>) -> IsometryMatrix3<f64> {
    let [w, x, y, z] = numbers(attributes, "quat");
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let position = Vector3::from(numbers::<3>(attributes, "pos"));
    IsometryMatrix3::from_parts(position.into(), turn.to_rotation_matrix())
}

/// The bodies of a model in motion, by name, the site, and all energies.
fn moved(text: &str, q: &[f64], qd: &[f64]) -> (BTreeMap<String, Moving>, Moving, Energies) {
    let mut at = Moving::standing(IsometryMatrix3::identity());
    let mut bodies = BTreeMap::new();
    let mut site = None;
    let mut body = String::new();
    let mut held = Vec::new();
    for (name, attributes) in elements(text) {
        match name.as_str() {
            "body" => {
                at = at.fixed(&pose(&attributes));
                body.clone_from(&attributes["name"]);
                bodies.insert(body.clone(), at);
            }
            "inertial" => held.push((body.clone(), attributes)),
            "joint" => {
                let index = bodies.len() - 2;
                let axis = Unit::new_unchecked(Vector3::from(numbers::<3>(&attributes, "axis")));
                at = at.turned(&axis, q[index], qd[index]);
                bodies.insert(body.clone(), at);
            }
            "site" => site = Some(at.fixed(&pose(&attributes))),
            _ => {}
        }
    }
    let energies = held.iter().map(|(body, attributes)| {
        let [xx, yy, zz, xy, xz, yz] = numbers(attributes, "fullinertia");
        let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let [mass] = numbers(attributes, "mass");
        let center = Vector3::from(numbers::<3>(attributes, "pos"));
        bodies[body].energies(mass, center, inertia)
    });
    let sum = energies.sum();
    (bodies, site.unwrap(), sum)
}

proptest! {
    #[test]
    fn a_model_moves_as_the_description(seed in any::<u64>()) {
        let (robot, mut options) = Robot::locked(seed);
        let mut draws = Draws::new(seed, 7);
        options.mount.position_m = draws.vector(1.0);
        options.mount.rpy_deg = draws.vector(180.0);
        let arm = read(&robot.urdf(seed), &options).unwrap();
        let joints = robot.moving.len();
        let [q, qd] =
            [3.0, 2.0].map(|range| (0..joints).map(|_| draws.within(range)).collect::<Vec<f64>>());
        let frames = motion(&arm.description, &q, &qd);

        let (bodies, site, sum) = moved(&mjcf(&arm.description, Some(&arm)).unwrap(), &q, &qd);
        for (body, ours) in arm.bodies.iter().zip(&frames) {
            prop_assert!(distance(&bodies[&body.link].fixed(&frame(body)), ours) < 1e-12);
        }
        prop_assert!(distance(&site, &frames[joints]) < 1e-12);
        sum.assert_close(&energies(&arm, &frames), 1e-12);

        let (bodies, site, sum) = moved(&mjcf(&arm.description, None).unwrap(), &q, &qd);
        for (index, ours) in frames[..joints].iter().enumerate() {
            let body = &bodies[&format!("link{}", index + 1)];
            prop_assert!(distance(body, ours) < 1e-12);
        }
        prop_assert!(distance(&site, &frames[joints]) < 1e-12);
        sum.assert_close(&energies(&arm, &frames), 1e-12);
    }
}

/// The attributes of all elements of this name.
fn named(text: &str, name: &str) -> Vec<BTreeMap<String, String>> {
    let found = elements(text).into_iter().filter(|(found, _)| found == name);
    found.map(|(_, attributes)| attributes).collect()
}

#[test]
fn joints_and_motors_have_the_description_s_numbers() {
    let mut description: RobotDescription = RobotModel::panda().description().clone();
    description.name = "a \"b\" <c>\n&".to_owned();
    let text = mjcf(&description, None).unwrap();
    assert_eq!(named(&text, "mujoco")[0]["model"], description.name);
    let [joints, motors] = ["joint", "motor"].map(|name| named(&text, name));
    assert_eq!((joints.len(), motors.len()), (7, 7));
    for ((joint, motor), ours) in joints.iter().zip(&motors).zip(&description.joints) {
        assert_eq!((&joint["name"], joint["type"].as_str()), (&ours.name, "hinge"));
        assert_eq!(numbers(joint, "axis"), [0.0, 0.0, 1.0]);
        assert_eq!(numbers(joint, "range"), [ours.position_rad.min, ours.position_rad.max]);
        assert_eq!(numbers(joint, "damping"), [ours.damping_nm_s_rad]);
        assert_eq!(numbers(joint, "armature"), [ours.armature_kg_m2]);
        let friction = ours.friction.unwrap().phi1_nm / 2.0;
        assert_eq!(numbers(joint, "frictionloss"), [friction]);
        let torques = [-ours.torque_nm, ours.torque_nm];
        assert_eq!(numbers(joint, "actuatorfrcrange"), torques);
        assert_eq!(numbers(motor, "ctrlrange"), torques);
        assert_eq!([&motor["name"], &motor["joint"]], [&ours.name; 2]);
    }
    assert_eq!(numbers(&named(&text, "option")[0], "gravity"), [0.0, 0.0, -9.81]);
    // The hand, which the description has as bodies of its own, is part of the last link.
    let masses: f64 =
        named(&text, "inertial").iter().map(|inertial| numbers::<1>(inertial, "mass")[0]).sum();
    let parts = description.joints.iter().map(|joint| joint.link.mass_kg);
    let parts = parts.chain(description.hand.bodies.iter().map(|part| part.body.mass_kg));
    assert!((masses - parts.sum::<f64>()).abs() < 1e-14);
}

#[test]
fn a_link_called_world_has_no_name() {
    let text = "<robot name='arm'><link name='world'/><link name='arm'><inertial><mass value='1'/><inertia \
                ixx='1e-2' ixy='0' ixz='0' iyy='1e-2' iyz='0' izz='1e-2'/></inertial></link><joint name='world' \
                type='continuous'><parent link='world'/><child link='arm'/></joint></robot>";
    let arm = read(text, &Options::default()).unwrap();
    let text = mjcf(&arm.description, Some(&arm)).unwrap();
    let bodies = named(&text, "body");
    assert_eq!([bodies[0].get("name"), bodies[1].get("name")], [None, Some(&"arm".to_owned())]);
    assert_eq!(named(&text, "joint")[0]["name"], "world");
}
