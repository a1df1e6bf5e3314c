//! Built-in descriptions of robots, from the folder `robots`.

use std::fmt;
use std::sync::LazyLock;

use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use utoipa::ToSchema;

use super::description::RobotDescription;

/// Name and text of each file. A test compares the list with the folder.
const FILES: [(&str, &str); 2] = [
    ("panda", include_str!("../../robots/panda.json")),
    ("ur10e", include_str!("../../robots/ur10e.json")),
];

static BUILT_IN: LazyLock<Vec<BuiltInRobot>> = LazyLock::new(|| {
    let read = |(name, text): (&'static str, &str)| BuiltInRobot {
        name,
        description: serde_json::from_str(text)
            .unwrap_or_else(|error| panic!("the description of {name} is broken: {error}")),
    };
    FILES.map(read).into()
});

/// A built-in description.
#[derive(Debug, PartialEq)]
pub struct BuiltInRobot {
    /// The name in specs, which is also that of its file.
    pub name: &'static str,
    /// The content of the file.
    pub description: RobotDescription,
}

/// The name of a built-in robot, or the description of another one. What is submitted to a server may
/// also name a robot that the server keeps: `{"robot": ID}` or `{"digest": HEX}`.
#[derive(Clone, Debug, PartialEq, ToSchema)]
#[schema(rename_all = "kebab-case")]
#[serde(untagged)]
pub enum RobotModel {
    /// The name of a built-in robot.
    #[schema(value_type = String)]
    BuiltIn(&'static BuiltInRobot),
    /// A robot that the spec describes itself.
    Described(Box<RobotDescription>),
}

impl RobotModel {
    /// All built-in robots.
    pub fn built_in() -> impl Iterator<Item = Self> {
        BUILT_IN.iter().map(Self::BuiltIn)
    }

    /// The Franka Emika Panda, the default robot of specs.
    pub fn panda() -> Self {
        Self::BuiltIn(&BUILT_IN[0])
    }

    /// The names of the built-in robots.
    pub(super) fn names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|robot| robot.name)
    }

    pub(super) fn named(name: &str) -> Option<Self> {
        BUILT_IN.iter().find(|robot| robot.name == name).map(Self::BuiltIn)
    }

    /// The description, built-in or not.
    pub fn description(&self) -> &RobotDescription {
        match self {
            Self::BuiltIn(robot) => &robot.description,
            Self::Described(description) => description,
        }
    }
}

impl Serialize for RobotModel {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::BuiltIn(robot) => serializer.serialize_str(robot.name),
            Self::Described(description) => description.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for RobotModel {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Model;

        impl<'de> Visitor<'de> for Model {
            type Value = RobotModel;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let names: Vec<&str> = RobotModel::names().collect();
                write!(f, "{}, or a description as an object", names.join(", "))
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<RobotModel, E> {
                RobotModel::named(name)
                    .ok_or_else(|| E::invalid_value(serde::de::Unexpected::Str(name), &self))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RobotModel, A::Error> {
                let description = Deserialize::deserialize(MapAccessDeserializer::new(map))?;
                Ok(RobotModel::Described(description))
            }
        }

        deserializer.deserialize_any(Model)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{Check, Violations};
    use crate::{InitialState, Randomization};

    #[test]
    fn every_file_of_the_folder_is_a_valid_description() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/robots");
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .expect("the folder of robots")
            .map(|entry| entry.expect("a file").path())
            .map(|path| path.file_stem().expect("a name").to_string_lossy().into_owned())
            .collect();
        names.sort();
        let known: Vec<&str> = BUILT_IN.iter().map(|robot| robot.name).collect();
        assert_eq!(names, known);
        for robot in BUILT_IN.iter() {
            let mut violations = Violations::default();
            robot.description.check(&mut violations);
            assert_eq!(violations.finish().err(), None, "{}", robot.name);
        }
    }

    #[test]
    fn the_defaults_of_specs_are_the_panda_s() {
        let RobotModel::BuiltIn(panda) = RobotModel::panda() else { panic!("not built in") };
        assert_eq!(panda.name, "panda");
        assert_eq!(panda.description.initial_state, InitialState::default());
        assert_eq!(panda.description.randomization, Randomization::default());
    }
}
