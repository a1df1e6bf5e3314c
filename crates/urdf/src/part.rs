use std::fmt;

use serde::Serialize;

/// A part of a URDF, by its name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// The robot as a whole.
    Robot,
    /// A link.
    Link(String),
    /// A joint.
    Joint(String),
}

/// Bytes of the longest name in a message. Names are a stranger's.
const NAME_BYTES: usize = 100;

/// A name for a message.
pub(crate) fn shown(name: &str) -> String {
    spec::cut(name.to_owned(), NAME_BYTES)
}

/// At most 20 names for a message, and the number of those left out.
pub(crate) fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const MOST: usize = 20;

    let mut names = names.into_iter();
    let mut text: Vec<String> =
        names.by_ref().take(MOST).map(|name| format!("`{}`", shown(name))).collect();
    let more = names.count();
    if more > 0 {
        text.push(format!("{more} more"));
    }
    text.join(", ")
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Robot => f.write_str("the robot"),
            Self::Link(name) => write!(f, "link `{}`", shown(name)),
            Self::Joint(name) => write!(f, "joint `{}`", shown(name)),
        }
    }
}

/// A fact about an arm that is allowed, but that its user should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Doubt {
    /// The part that the doubt is about.
    pub part: Part,
    /// The reason, with numbers, and how it was resolved.
    pub text: String,
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.part, self.text)
    }
}

/// The doubts so far.
#[derive(Default)]
pub(crate) struct Doubts(Vec<Doubt>);

impl Doubts {
    pub(crate) fn robot(&mut self, text: impl Into<String>) {
        self.0.push(Doubt { part: Part::Robot, text: text.into() });
    }

    pub(crate) fn link(&mut self, name: &str, text: impl Into<String>) {
        self.0.push(Doubt { part: Part::Link(name.to_owned()), text: text.into() });
    }

    pub(crate) fn joint(&mut self, name: &str, text: impl Into<String>) {
        self.0.push(Doubt { part: Part::Joint(name.to_owned()), text: text.into() });
    }

    pub(crate) fn into_vec(self) -> Vec<Doubt> {
        self.0
    }
}
