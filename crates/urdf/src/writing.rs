//! A description written into the text of the URDF that it came from.
//!
//! The new text is the old one with some of its bytes replaced. It is never printed from a tree of
//! elements, so whatever is not replaced stays as it is.

use std::collections::BTreeSet;
use std::ops::Range;

use spec::{BodyDescription, JointDescription, RobotDescription};

use crate::masses::{bodies, same_joints, seen_from_child};
use crate::numbers::{says, shortest, spaced};
use crate::spans::{self, Element};
use crate::tree::Tree;
use crate::{Arm, UrdfError, limits, reading};

/// Begins the comments of this module. Those inside a joint are replaced.
const MARK: &str = "<!-- torqued: ";
const WELDED: &str = "<!-- torqued: the mass of this link and of others without an inertial is in \
                      the child link of the joint that moves them -->";

/// Writes the bodies, damping and friction of `description` into `text`, the URDF that `arm` was
/// read from.
///
/// - The child link of each moving joint gets the body that the joint moves, in its own frame. An
///   `<inertial>` that is there gets other numbers and keeps its place and comments.
/// - The other links of that body lose their `<inertial>`. A comment at the first one says so.
/// - The `<dynamics>` of each moving joint gets damping, Coulomb friction, φ1 / 2, rotor inertia, as
///   the attribute `armature`, and φ2, as the attribute `phi2_s_rad`, unless it is that of
///   [`read`](crate::read) without one. If the description does not know the friction, the text's
///   stays. A joint without any of them needs no `<dynamics>`.
/// - A comment beside it has the friction if φ3 is not 0. Writing again replaces the comment.
///
/// All else stays byte for byte: comments, spaces, line ends, the order of elements and
/// attributes, meshes, other links and joints, limits and poses. Numbers that do not change keep
/// their text, new ones have the fewest digits that are read back as the same number. Read with the
/// same options, the new text has the bodies of the description within rounding, and its damping,
/// friction and rotor inertia exactly. Bodies of the hand are part of the last body then.
///
/// # Errors
/// `text` is not the URDF of `arm`, or `description` has other joints or lengths.
pub fn write(text: &str, arm: &Arm, description: &RobotDescription) -> Result<String, UrdfError> {
    same_joints(arm, description)?;
    let tree = Tree::new(reading::read(text)?)?;
    let root = spans::root(text)?;
    let links: Vec<&Element> = root.children("link").collect();
    let joints: Vec<&Element> = root.children("joint").collect();
    let mut edits = Edits { text, list: Vec::new() };
    let mut welded = BTreeSet::new();
    let described = description.joints.iter().zip(bodies(description));
    for (body, (joint, mass)) in arm.bodies.iter().zip(described) {
        let user = || "the arm".to_owned();
        let index = tree.joint(&body.joint, user)?;
        let child = tree.ends[index].child;
        if tree.links[child].name != body.link {
            let found = tree.links[child].name.clone();
            let [joint, link] = [&body.joint, &body.link].map(String::clone);
            return Err(UrdfError::OtherChild { joint, link, found });
        }
        for link in &body.links {
            welded.insert(tree.link(link, user)?);
        }
        welded.remove(&child);
        edits.put_inertial(links[child], &seen_from_child(&mass, &body.frame()));
        edits.put_dynamics(joints[index], joint);
    }
    let mut is_said = text.contains(WELDED);
    // In the order of the text.
    for inertial in welded.into_iter().filter_map(|link| links[link].child("inertial")) {
        if is_said {
            edits.remove(&inertial.whole);
        } else {
            edits.list.push((inertial.whole.clone(), WELDED.to_owned()));
        }
        is_said = true;
    }
    Ok(edits.made())
}

/// Changes of a text.
struct Edits<'text> {
    text: &'text str,
    /// Places, which do not overlap, and what they get.
    list: Vec<(Range<usize>, String)>,
}

impl Edits<'_> {
    fn made(mut self) -> String {
        // Stable: what is inserted at the same place stays in order.
        self.list.sort_by_key(|(place, _)| (place.start, place.end));
        let mut made = String::with_capacity(self.text.len() + 1024);
        let mut at = 0;
        for (place, new) in &self.list {
            made.push_str(&self.text[at..place.start]);
            made.push_str(new);
            at = place.end;
        }
        made.push_str(&self.text[at..]);
        made
    }

    fn put_inertial(&mut self, link: &Element, body: &BodyDescription) {
        const ENTRIES: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

        let BodyDescription { mass_kg, center_m, inertia_kg_m2, .. } = *body;
        let inertia = || ENTRIES.into_iter().zip(inertia_kg_m2);
        let new_origin = format!("<origin xyz=\"{}\" rpy=\"0 0 0\"/>", spaced(center_m));
        let Some(inertial) = link.child("inertial") else {
            let Lines { line, step } = self.lines(link);
            let mass = shortest(mass_kg);
            let inertia = attributes(inertia());
            let new = format!(
                "<inertial>{line}{step}{new_origin}{line}{step}<mass value=\"{mass}\"/>\
                 {line}{step}<inertia{inertia}/>{line}</inertial>"
            );
            self.append(link, &new);
            return;
        };
        if let Some(origin) = inertial.child("origin") {
            self.set(origin, "xyz", &center_m, &[0.0; 3]);
            self.set(origin, "rpy", &[0.0; 3], &[0.0; 3]);
        } else if center_m != [0.0; 3] {
            self.append(inertial, &new_origin);
        }
        // A text that has been read has these two.
        if let Some(mass) = inertial.child("mass") {
            self.set(mass, "value", &[mass_kg], &[]);
        }
        if let Some(element) = inertial.child("inertia") {
            for (name, entry) in inertia() {
                self.set(element, name, &[entry], &[]);
            }
        }
    }

    fn put_dynamics(&mut self, joint: &Element, description: &JointDescription) {
        for comment in &joint.comments {
            if self.text[comment.clone()].starts_with(MARK) {
                self.remove(comment);
            }
        }
        let friction = description.friction;
        let bent = friction.filter(|friction| friction.phi1_nm != 0.0);
        let values = [
            ("damping", Some(description.damping_nm_s_rad), None),
            ("friction", friction.map(|friction| 0.5 * friction.phi1_nm), None),
            ("armature", Some(description.armature_kg_m2), Some(0.0)),
            ("phi2_s_rad", bent.map(|friction| friction.phi2_s_rad), Some(limits::PHI2_S_RAD)),
        ];
        let known = || {
            values.into_iter().filter_map(|(name, value, default)| Some((name, value?, default)))
        };
        let comment = remark(description);
        if let Some(dynamics) = joint.child("dynamics") {
            for (name, value, default) in known() {
                self.set(dynamics, name, &[value], &[default.unwrap_or(0.0)]);
            }
            if let Some(comment) = comment {
                let end = dynamics.whole.end;
                self.list.push((end..end, comment));
            }
        } else if comment.is_some()
            || known().any(|(_, value, default)| value != default.unwrap_or(0.0))
        {
            let named = known().filter(|(_, value, default)| *default != Some(*value));
            let named = named.map(|(name, value, _)| (name, value));
            let new = format!("<dynamics{}/>{}", attributes(named), comment.unwrap_or_default());
            self.append(joint, &new);
        }
    }

    /// Sets an attribute, unless it says these numbers already. One that is missing says `default`.
    fn set(&mut self, element: &Element, attribute: &str, numbers: &[f64], default: &[f64]) {
        let new = spaced(numbers.iter().copied());
        match element.value(self.text, attribute) {
            Some(place) if says(&self.text[place.clone()], numbers) => {}
            Some(place) => self.list.push((place, new)),
            None if numbers == default => {}
            None => {
                let end = element.attributes_end(self.text);
                self.list.push((end..end, format!(" {attribute}=\"{new}\"")));
            }
        }
    }

    /// Adds an element behind the others in `parent`, on a line of its own if they have one.
    fn append(&mut self, parent: &Element, new: &str) {
        let Lines { line, .. } = self.lines(parent);
        if parent.closes_itself() {
            let end = parent.whole.end;
            let before = self.line_of(parent);
            let new = format!(">{line}{new}{before}</{}>", parent.name);
            self.list.push((parent.attributes_end(self.text)..end, new));
        } else {
            let inside = &self.text[parent.tag.end..parent.whole.end];
            let inside = &inside[..inside.rfind("</").unwrap_or(0)];
            let end = parent.tag.end + inside.trim_ascii_end().len();
            self.list.push((end..end, format!("{line}{new}")));
        }
    }

    /// Removes an element or a comment, with the white space before it.
    fn remove(&mut self, place: &Range<usize>) {
        let start = self.text[..place.start].trim_ascii_end().len();
        self.list.push((start..place.end, String::new()));
    }

    /// The line break before an element and its indentation. Empty if it does not begin a line.
    fn line_of(&self, element: &Element) -> &str {
        let before = &self.text[..element.whole.start];
        let spaces = &before[before.trim_ascii_end().len()..];
        match spaces.rfind('\n') {
            Some(at) if spaces[..at].ends_with('\r') => &spaces[at - 1..],
            Some(at) => &spaces[at..],
            None => "",
        }
    }

    /// How the elements in `parent` are indented.
    fn lines(&self, parent: &Element) -> Lines {
        const LINE_ENDS: [char; 2] = ['\r', '\n'];

        let outer = self.line_of(parent);
        let indentation = outer.trim_start_matches(LINE_ENDS);
        match parent.children.first().map(|child| self.line_of(child)) {
            // In a single line there is nothing to indent.
            Some("") => Lines::default(),
            None if outer.is_empty() => Lines::default(),
            Some(line) => {
                let step = line.trim_start_matches(LINE_ENDS).strip_prefix(indentation);
                let step = step.filter(|step| !step.is_empty()).unwrap_or("  ");
                Lines { line: line.to_owned(), step: step.to_owned() }
            }
            None => {
                // A link or a joint is one step inside the robot.
                let step = if indentation.is_empty() { "  " } else { indentation };
                Lines { line: format!("{outer}{step}"), step: step.to_owned() }
            }
        }
    }
}

/// The text of attributes, with a space before each.
fn attributes<'a>(values: impl Iterator<Item = (&'a str, f64)>) -> String {
    values.map(|(name, value)| format!(" {name}=\"{}\"", shortest(value))).collect()
}

/// How the elements in another one are indented.
#[derive(Default)]
struct Lines {
    /// The line break before each, with its indentation.
    line: String,
    /// One more level of indentation.
    step: String,
}

/// A comment with friction that a URDF cannot say.
fn remark(joint: &JointDescription) -> Option<String> {
    let friction = joint.friction.filter(|friction| !limits::is_coulomb(friction))?;
    let [phi1, phi2, phi3] =
        [friction.phi1_nm, friction.phi2_s_rad, friction.phi3_rad_s].map(shortest);
    Some(format!(" {MARK}phi1_nm {phi1}, phi2_s_rad {phi2}, phi3_rad_s {phi3} -->"))
}
