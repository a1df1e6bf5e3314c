//! A robot as tables: its joints and its links.

use spec::{JointDescription, RobotDescription};
use wire::{RobotLink, Unit};

use crate::numbers::value;
use crate::{Cell, Table, TableOf};

/// A row of the table of frames: a joint, or the hand.
struct Row<'a> {
    name: &'a str,
    a_m: f64,
    alpha_deg: f64,
    d_m: f64,
    offset_deg: f64,
    shift_m: [f64; 3],
    joint: Option<&'a JointDescription>,
}

/// The joints with their rows of the modified Denavit-Hartenberg table, limits and losses, and the
/// row of the hand.
pub fn joints(robot: &RobotDescription) -> Table {
    let hand = &robot.hand;
    let hand = Row {
        name: "hand",
        a_m: hand.a_m,
        alpha_deg: hand.alpha_deg,
        d_m: hand.flange_m,
        offset_deg: hand.yaw_deg,
        shift_m: hand.shift_m,
        joint: None,
    };
    let rows = robot.joints.iter().map(|joint| Row {
        name: &joint.name,
        a_m: joint.a_m,
        alpha_deg: joint.alpha_deg,
        d_m: joint.d_m,
        offset_deg: joint.offset_deg,
        shift_m: joint.shift_m,
        joint: Some(joint),
    });
    TableOf::new(rows.chain([hand]))
        .text("joint", |row| row.name)
        .number("length a, m", |row| in_place(row.a_m))
        .number("twist α, °", |row| in_place(row.alpha_deg))
        .number("distance d, m", |row| in_place(row.d_m))
        .number("offset, °", |row| {
            Some(row.offset_deg).filter(|offset| *offset != 0.0).map(in_place)
        })
        .number("shift, m", |row| {
            Some(row.shift_m).filter(|shift| *shift != [0.0; 3]).map(|shift| point(&shift))
        })
        .number("from, °", of_joint(|joint| Some(joint.position_rad.min.to_degrees())))
        .number("to, °", of_joint(|joint| Some(joint.position_rad.max.to_degrees())))
        .number("speed, rad/s", of_joint(|joint| Some(joint.velocity_rad_s)))
        .number("torque, N·m", of_joint(|joint| Some(joint.torque_nm)))
        .number("damping, N·m·s/rad", of_joint(|joint| Some(joint.damping_nm_s_rad)))
        .number("armature, kg·m²", of_joint(|joint| Some(joint.armature_kg_m2)))
        .number("φ1, N·m", of_joint(|joint| Some(joint.friction?.phi1_nm)))
        .number("φ2, s/rad", of_joint(|joint| Some(joint.friction?.phi2_s_rad)))
        .number("φ3, rad/s", of_joint(|joint| Some(joint.friction?.phi3_rad_s)))
        .titled("Joints", "")
        .without_empty_columns()
}

/// A cell with a number of the joint; missing in the row of the hand.
fn of_joint(get: impl Fn(&JointDescription) -> Option<f64>) -> impl Fn(&Row<'_>) -> Option<Cell> {
    move |row| row.joint.and_then(&get).map(number)
}

/// The links with their masses, centres and inertias.
pub fn links(links: &[RobotLink]) -> Table {
    TableOf::new(links)
        .text("moved by", |link| link.joint.as_str())
        .number("mass, kg", |link| number(link.mass_kg))
        .number("centre, m", |link| point(&link.center_m))
        .number("principal moments, kg·m²", |link| vector(&link.principal_kg_m2))
        .text("made of", |link| Some(link.parts.join(", ")).filter(|parts| !parts.is_empty()))
        .titled("Links", "")
        .without_empty_columns()
}

fn number(value: f64) -> Cell {
    Cell::Number(value, Unit::Other)
}

fn in_place(coordinate: f64) -> Cell {
    number(tidy(coordinate))
}

/// A length in m or an angle in degrees as text.
pub fn place(coordinate: f64) -> String {
    value(tidy(coordinate))
}

/// The vector of a place, m.
fn point(coordinates: &[f64; 3]) -> Cell {
    vector(&coordinates.map(tidy))
}

fn vector(coordinates: &[f64; 3]) -> Cell {
    let [x, y, z] = coordinates.map(value);
    Cell::Text(format!("{x} {y} {z}"))
}

/// A length in m or an angle in degrees in millionths. Less is rounding, which a reader would stumble over.
fn tidy(value: f64) -> f64 {
    // Adding 0 takes the sign from -0.
    (value * 1e6).round() / 1e6 + 0.0
}

#[cfg(test)]
mod tests {
    use spec::RobotModel;

    use super::*;

    #[test]
    fn every_joint_and_the_hand_has_a_row_and_columns_without_values_are_left_out() {
        let panda = RobotModel::panda();
        let table = joints(panda.description());
        assert_eq!(table.rows.len(), 8);
        let headings: Vec<&str> =
            table.columns.iter().map(|column| column.heading.as_str()).collect();
        assert!(headings.contains(&"φ1, N·m") && !headings.contains(&"shift, m"), "{headings:?}");
        let text = table.render();
        let first: Vec<&str> = text.lines().nth(1).unwrap_or_default().split_whitespace().collect();
        assert_eq!(first[1..4], ["0", "0", "0.333"], "{text}");

        let mut shifted = panda.description().clone();
        shifted.joints[1].shift_m = [0.0, -0.25, 0.0];
        shifted.joints[2].friction = None;
        let text = joints(&shifted).render();
        assert!(text.contains("shift, m") && text.contains("0 -0.25 0"), "{text}");
    }

    #[test]
    fn a_link_has_its_parts_if_they_are_known() {
        let link = |parts: &[&str]| RobotLink {
            joint: "hip".to_owned(),
            mass_kg: 1.5,
            center_m: [0.0, -0.0, 0.1],
            principal_kg_m2: [0.01, 0.02, 0.025],
            parts: parts.iter().map(|part| (*part).to_owned()).collect(),
        };
        let text = links(&[link(&["lever", "shade"])]).render();
        assert!(text.contains("lever, shade") && text.contains("0 0 0.1"), "{text}");
        assert!(!links(&[link(&[])]).render().contains("made of"));
    }
}
