//! From text to a [`Document`], with quick-xml's events.
//!
//! Only the elements that a description needs are looked at. Others are passed over, in time in
//! proportion to their length, whatever their depth.

use std::str::FromStr;

use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;

use crate::document::{Document, Inertial, Joint, JointDynamics, Kind, Limit, Link, Mimic, Origin};
use crate::part::shown;
use crate::{Part, UrdfError};

/// Bytes of the longest text that is read.
pub const MAX_BYTES: usize = 4 << 20;
const MAX_ELEMENTS: usize = 200_000;
const MAX_DEPTH: usize = 100;
/// Links and joints, together.
const MAX_PARTS: usize = 20_000;

/// Bounds of numbers, beyond which no robot is. Products of numbers within them stay finite.
const LENGTH_M: f64 = 1e4;
const ANGLE_RAD: f64 = 1e4;
const MASS_KG: f64 = 1e6;
const INERTIA_KG_M2: f64 = 1e9;
const OTHERS: f64 = 1e9;

pub(crate) fn read(text: &str) -> Result<Document, UrdfError> {
    if text.len() > MAX_BYTES {
        return Err(UrdfError::TooLarge { bytes: text.len(), most: MAX_BYTES });
    }
    let mut elements = Elements::new(text.strip_prefix('\u{feff}').unwrap_or(text));
    let Some(root) = elements.next_child()? else {
        return Err(elements.not_xml("there is no element"));
    };
    let name = name_of(&root);
    if name != "robot" {
        return Err(UrdfError::NotRobot { root: shown(&name) });
    }
    let document = robot(&mut elements, &root)?;
    if elements.next_child()?.is_some() {
        return Err(elements.not_xml("there is a second root element"));
    }
    Ok(document)
}

/// The elements of a text, one after the other.
struct Elements<'text> {
    text: &'text str,
    reader: Reader<&'text [u8]>,
    /// Number of elements so far.
    count: usize,
    /// Number of elements that are open.
    depth: usize,
}

impl<'text> Elements<'text> {
    fn new(text: &'text str) -> Self {
        let mut reader = Reader::from_str(text);
        // Then every element has a start and an end.
        reader.config_mut().expand_empty_elements = true;
        Self { text, reader, count: 0, depth: 0 }
    }

    /// The next child of the open element, or the end of that element. The child is open then.
    fn next_child(&mut self) -> Result<Option<BytesStart<'text>>, UrdfError> {
        loop {
            match self.reader.read_event().map_err(|error| self.not_xml(&error))? {
                Event::Start(start) => {
                    self.count += 1;
                    self.depth += 1;
                    if self.count > MAX_ELEMENTS {
                        return Err(UrdfError::TooMany { what: "elements", most: MAX_ELEMENTS });
                    }
                    if self.depth > MAX_DEPTH {
                        let what = "elements inside each other";
                        return Err(UrdfError::TooMany { what, most: MAX_DEPTH });
                    }
                    return Ok(Some(start));
                }
                Event::End(_) => {
                    self.depth -= 1;
                    return Ok(None);
                }
                Event::Eof if self.depth > 0 => {
                    return Err(self.not_xml("the text ends inside an element"));
                }
                Event::Eof => return Ok(None),
                Event::DocType(_) => {
                    return Err(self.not_xml("a document type (<!DOCTYPE>) is not allowed"));
                }
                Event::Text(text)
                    if self.depth == 0 && !text.iter().all(u8::is_ascii_whitespace) =>
                {
                    return Err(self.not_xml("there is text outside of the root element"));
                }
                _ => {}
            }
        }
    }

    /// Passes over what is left of the open element.
    fn skip(&mut self) -> Result<(), UrdfError> {
        let outside = self.depth - 1;
        while self.depth > outside {
            self.next_child()?;
        }
        Ok(())
    }

    fn not_xml(&self, reason: &(impl ToString + ?Sized)) -> UrdfError {
        let at = usize::try_from(self.reader.error_position().max(self.reader.buffer_position()));
        let before = self.text.as_bytes().iter().take(at.unwrap_or(usize::MAX));
        let line = 1 + before.filter(|byte| **byte == b'\n').count();
        UrdfError::NotXml { line, reason: shown(&reason.to_string()) }
    }

    /// The values of these attributes of an element of `part`, as far as they are there.
    fn attributes<const N: usize>(
        &self,
        part: &Part,
        element: &BytesStart<'_>,
        names: [&str; N],
    ) -> Result<[Option<String>; N], UrdfError> {
        let mut values = [const { None }; N];
        let mut attributes = element.attributes();
        // This check would compare each attribute with every other.
        for attribute in attributes.with_checks(false) {
            let attribute = attribute.map_err(|error| self.not_xml(&error))?;
            let key = attribute.key.as_ref();
            let Some(place) = names.iter().position(|name| name.as_bytes() == key) else {
                continue;
            };
            let value = attribute
                .normalized_value(XmlVersion::default())
                .map_err(|error| self.not_xml(&error))?;
            if value.contains("${") || value.contains("$(") {
                let found = format!("{}=\"{}\"", names[place], shown(&value));
                return Err(UrdfError::Xacro { part: part.clone(), found });
            }
            if values[place].replace(value.into_owned()).is_some() {
                let found = format!("attributes `{}` in <{}>", names[place], name_of(element));
                return Err(UrdfError::Twice { part: part.clone(), found });
            }
        }
        Ok(values)
    }
}

fn name_of(element: &BytesStart<'_>) -> String {
    String::from_utf8_lossy(element.name().as_ref()).into_owned()
}

/// Refuses an element of xacro among the children of `part`.
fn not_xacro(part: &Part, name: &str) -> Result<(), UrdfError> {
    if name.starts_with("xacro:") {
        return Err(UrdfError::Xacro { part: part.clone(), found: format!("<{}>", shown(name)) });
    }
    Ok(())
}

/// Puts the only element of its kind into its place.
fn put<T>(place: &mut Option<T>, value: T, part: &Part, element: &str) -> Result<(), UrdfError> {
    if place.replace(value).is_some() {
        return Err(UrdfError::Twice { part: part.clone(), found: format!("<{element}>") });
    }
    Ok(())
}

fn required<T>(value: Option<T>, part: &Part, missing: &str) -> Result<T, UrdfError> {
    value.ok_or_else(|| UrdfError::Missing { part: part.clone(), missing: missing.to_owned() })
}

fn robot(elements: &mut Elements<'_>, root: &BytesStart<'_>) -> Result<Document, UrdfError> {
    let [name] = elements.attributes(&Part::Robot, root, ["name"])?;
    let name = required(name, &Part::Robot, "attribute `name`")?;
    let mut document = Document { name, links: Vec::new(), joints: Vec::new() };
    while let Some(child) = elements.next_child()? {
        let element = name_of(&child);
        not_xacro(&Part::Robot, &element)?;
        match element.as_str() {
            "link" => document.links.push(link(elements, &child)?),
            "joint" => document.joints.push(joint(elements, &child)?),
            _ => elements.skip()?,
        }
        if document.links.len() + document.joints.len() > MAX_PARTS {
            return Err(UrdfError::TooMany { what: "links and joints", most: MAX_PARTS });
        }
    }
    Ok(document)
}

fn link(elements: &mut Elements<'_>, start: &BytesStart<'_>) -> Result<Link, UrdfError> {
    let [name] = elements.attributes(&Part::Robot, start, ["name"])?;
    let name = required(name, &Part::Robot, "attribute `name` in a <link>")?;
    let part = Part::Link(name.clone());
    let mut inertial = None;
    let mut has_shape = false;
    while let Some(child) = elements.next_child()? {
        let element = name_of(&child);
        not_xacro(&part, &element)?;
        match element.as_str() {
            "inertial" => put(&mut inertial, read_inertial(elements, &part)?, &part, &element)?,
            "visual" | "collision" => {
                has_shape = true;
                elements.skip()?;
            }
            _ => elements.skip()?,
        }
    }
    Ok(Link { name, inertial, has_shape })
}

fn read_inertial(elements: &mut Elements<'_>, part: &Part) -> Result<Inertial, UrdfError> {
    const ENTRIES: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

    let (mut origin, mut mass, mut inertia) = (None, None, None);
    while let Some(child) = elements.next_child()? {
        let element = name_of(&child);
        match element.as_str() {
            "origin" => {
                let value = read_origin(elements, part, &child, "inertial origin")?;
                put(&mut origin, value, part, "origin> in its <inertial")?;
            }
            "mass" => {
                let [value] = elements.attributes(part, &child, ["value"])?;
                let value = required(value, part, "`value` in its <mass>")?;
                let value = number(part, "mass value", &value, MASS_KG)?;
                put(&mut mass, value, part, &element)?;
            }
            "inertia" => {
                let entries = elements.attributes(part, &child, ENTRIES)?;
                let mut value = [0.0; 6];
                for ((entry, name), value) in entries.into_iter().zip(ENTRIES).zip(&mut value) {
                    let entry = required(entry, part, &format!("`{name}` in its <inertia>"))?;
                    *value = number(part, &format!("inertia {name}"), &entry, INERTIA_KG_M2)?;
                }
                put(&mut inertia, value, part, &element)?;
            }
            _ => {}
        }
        elements.skip()?;
    }
    Ok(Inertial {
        origin: origin.unwrap_or_default(),
        mass_kg: required(mass, part, "<mass> in its <inertial>")?,
        inertia_kg_m2: required(inertia, part, "<inertia> in its <inertial>")?,
    })
}

fn joint(elements: &mut Elements<'_>, start: &BytesStart<'_>) -> Result<Joint, UrdfError> {
    let [name, kind] = elements.attributes(&Part::Robot, start, ["name", "type"])?;
    let name = required(name, &Part::Robot, "attribute `name` in a <joint>")?;
    let part = Part::Joint(name.clone());
    let kind = read_kind(&part, &required(kind, &part, "attribute `type`")?)?;
    let (mut origin, mut axis, mut limit) = (None, None, None);
    let (mut parent, mut child) = (None, None);
    let (mut friction, mut mimic) = (None, None);
    while let Some(inner) = elements.next_child()? {
        let element = name_of(&inner);
        not_xacro(&part, &element)?;
        match element.as_str() {
            "origin" => {
                let value = read_origin(elements, &part, &inner, "origin")?;
                put(&mut origin, value, &part, &element)?;
            }
            "axis" => {
                let [xyz] = elements.attributes(&part, &inner, ["xyz"])?;
                let xyz = required(xyz, &part, "`xyz` in its <axis>")?;
                put(&mut axis, numbers(&part, "axis xyz", &xyz, OTHERS)?, &part, &element)?;
            }
            "parent" | "child" => {
                let [link] = elements.attributes(&part, &inner, ["link"])?;
                let link = required(link, &part, &format!("`link` in its <{element}>"))?;
                let place = if element == "parent" { &mut parent } else { &mut child };
                put(place, link, &part, &element)?;
            }
            "limit" => put(&mut limit, read_limit(elements, &part, &inner)?, &part, &element)?,
            "dynamics" => {
                let value = read_dynamics(elements, &part, &inner)?;
                put(&mut friction, value, &part, &element)?;
            }
            "mimic" => put(&mut mimic, read_mimic(elements, &part, &inner)?, &part, &element)?,
            _ => {}
        }
        elements.skip()?;
    }
    Ok(Joint {
        kind,
        origin: origin.unwrap_or_default(),
        parent: required(parent, &part, "<parent>")?,
        child: required(child, &part, "<child>")?,
        // URDF's default.
        axis: axis.unwrap_or([1.0, 0.0, 0.0]),
        limit,
        friction,
        mimic,
        name,
    })
}

fn read_kind(part: &Part, text: &str) -> Result<Kind, UrdfError> {
    Kind::ALL.into_iter().find(|kind| kind.name() == text).ok_or_else(|| UrdfError::Value {
        part: part.clone(),
        field: "type".to_owned(),
        value: format!("`{}`", shown(text)),
        allowed: Kind::ALL.map(Kind::name).join(", "),
    })
}

fn read_origin(
    elements: &Elements<'_>,
    part: &Part,
    start: &BytesStart<'_>,
    field: &str,
) -> Result<Origin, UrdfError> {
    let [xyz, rpy] = elements.attributes(part, start, ["xyz", "rpy"])?;
    let triple = |text: Option<String>, name: &str, most: f64| match text {
        Some(text) => numbers(part, &format!("{field} {name}"), &text, most),
        None => Ok([0.0; 3]),
    };
    Ok(Origin { xyz: triple(xyz, "xyz", LENGTH_M)?, rpy: triple(rpy, "rpy", ANGLE_RAD)? })
}

fn read_limit(
    elements: &Elements<'_>,
    part: &Part,
    start: &BytesStart<'_>,
) -> Result<Limit, UrdfError> {
    const NAMES: [&str; 4] = ["lower", "upper", "effort", "velocity"];

    let mut values = [None; 4];
    let texts = elements.attributes(part, start, NAMES)?;
    for ((text, name), value) in texts.into_iter().zip(NAMES).zip(&mut values) {
        if let Some(text) = text {
            let field = format!("limit {name}");
            // Some write an infinite or a huge limit for none.
            *value = Some(parsed(part, &field, &text, |limit| !limit.is_nan(), "a number")?);
        }
    }
    let [lower, upper, effort, velocity] = values;
    Ok(Limit { lower, upper, effort, velocity })
}

fn read_dynamics(
    elements: &Elements<'_>,
    part: &Part,
    start: &BytesStart<'_>,
) -> Result<JointDynamics, UrdfError> {
    let names = ["damping", "friction", "armature", "phi2_s_rad"];
    let [damping, friction, armature, phi2] = elements.attributes(part, start, names)?;
    let value = |text: Option<String>, field: &str| match text {
        Some(text) => number(part, field, &text, OTHERS),
        None => Ok(0.0),
    };
    Ok(JointDynamics {
        damping: value(damping, "dynamics damping")?,
        friction: value(friction, "dynamics friction")?,
        armature: value(armature, "dynamics armature")?,
        phi2: phi2.map(|text| number(part, "dynamics phi2_s_rad", &text, OTHERS)).transpose()?,
    })
}

fn read_mimic(
    elements: &Elements<'_>,
    part: &Part,
    start: &BytesStart<'_>,
) -> Result<Mimic, UrdfError> {
    let names = ["joint", "multiplier", "offset"];
    let [joint, multiplier, offset] = elements.attributes(part, start, names)?;
    let value = |text: Option<String>, field: &str, default: f64| match text {
        Some(text) => number(part, field, &text, OTHERS),
        None => Ok(default),
    };
    Ok(Mimic {
        joint: required(joint, part, "`joint` in its <mimic>")?,
        multiplier: value(multiplier, "mimic multiplier", 1.0)?,
        offset: value(offset, "mimic offset", 0.0)?,
    })
}

/// A number of at most this magnitude.
fn number(part: &Part, field: &str, text: &str, most: f64) -> Result<f64, UrdfError> {
    let allowed = format!("a number within ±{most}");
    parsed(part, field, text, |number| number.abs() <= most, &allowed)
}

/// Three numbers of at most this magnitude, separated by white space.
fn numbers(part: &Part, field: &str, text: &str, most: f64) -> Result<[f64; 3], UrdfError> {
    let words: Vec<&str> = text.split_ascii_whitespace().take(4).collect();
    let [x, y, z] = words[..] else {
        return Err(UrdfError::Value {
            part: part.clone(),
            field: field.to_owned(),
            value: format!("`{}`", shown(text)),
            allowed: "three numbers, separated by spaces".to_owned(),
        });
    };
    let number = |text| number(part, field, text, most);
    Ok([number(x)?, number(y)?, number(z)?])
}

fn parsed(
    part: &Part,
    field: &str,
    text: &str,
    is_allowed: impl Fn(f64) -> bool,
    allowed: &str,
) -> Result<f64, UrdfError> {
    match f64::from_str(text.trim_ascii()) {
        Ok(number) if is_allowed(number) => Ok(number),
        _ => Err(UrdfError::Value {
            part: part.clone(),
            field: field.to_owned(),
            value: format!("`{}`", shown(text)),
            allowed: allowed.to_owned(),
        }),
    }
}
