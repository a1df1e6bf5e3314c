//! The columns of an MCAP file: what a row takes from a message.

use spec::{ImportSpec, TimeUnit};

use super::DecodeError;
use super::joint_state::JointState;
use crate::error::{Place, RowError};

/// The most names of joints in an error.
const MAX_NAMED_JOINTS: usize = 32;

/// The parts of a message that a row takes.
pub(super) struct Columns {
    pub time: Option<Time>,
    /// Fields for u, q and, if there is one, qd.
    pub quantities: Vec<Quantity>,
    pub joints: Vec<String>,
    /// Whether the spec names no topic.
    pub is_any_topic: bool,
    /// The names of the last message, and the place of each joint among them.
    pub places: Option<(Vec<String>, Option<Vec<usize>>)>,
    /// The names in messages that have none of the joints, for an error.
    others: Vec<String>,
}

#[derive(Clone, Copy)]
pub(super) enum Time {
    Stamp,
    Log,
    Publish,
}

#[derive(Clone, Copy)]
pub(super) enum Quantity {
    Position,
    Velocity,
    Effort,
}

const TIMES: [(&str, Time); 3] =
    [("stamp", Time::Stamp), ("log_time", Time::Log), ("publish_time", Time::Publish)];

const QUANTITIES: [(&str, Quantity); 3] = [
    ("position", Quantity::Position),
    ("velocity", Quantity::Velocity),
    ("effort", Quantity::Effort),
];

impl Quantity {
    pub fn of(self, message: &JointState) -> &[f64] {
        match self {
            Self::Position => &message.positions,
            Self::Velocity => &message.velocities,
            Self::Effort => &message.efforts,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Effort => "effort",
        }
    }
}

impl Columns {
    pub fn of(spec: &ImportSpec) -> Result<Self, DecodeError> {
        let refused = |field: &str, name: &str, allowed: &str| {
            DecodeError::File(format!(
                "columns.{field} is {name:?}, allowed in an MCAP file: {allowed}"
            ))
        };
        let time = spec.columns.time.as_deref().map(|name| {
            let known = TIMES.iter().find(|(known, _)| *known == name.trim());
            let allowed = "\"stamp\", \"log_time\" or \"publish_time\"";
            known.map(|(_, time)| *time).ok_or_else(|| refused("time", name, allowed))
        });
        if ![TimeUnit::S, TimeUnit::Ns].contains(&spec.units.time) {
            let found = spec.units.time.as_str();
            return Err(DecodeError::File(format!(
                "units.time is {found:?}, allowed in an MCAP file: none, as its times are in ns"
            )));
        }
        if let Some(name) = &spec.columns.recording {
            return Err(refused("recording", name, "none; a file is one recording"));
        }
        let columns = &spec.columns;
        let all = [("u", Some(&columns.u)), ("q", Some(&columns.q)), ("qd", columns.qd.as_ref())];
        let of_joints = all.into_iter().filter_map(|(field, names)| Some((field, names?)));
        let quantities = of_joints.map(|(field, names)| {
            let allowed = "one of [\"position\"], [\"velocity\"] and [\"effort\"]";
            let name = names.first().map_or("", |name| name.trim());
            let known = QUANTITIES.iter().find(|(known, _)| *known == name && names.len() == 1);
            known.map(|(_, quantity)| *quantity).ok_or_else(|| refused(field, name, allowed))
        });
        let joints = match &spec.mcap.joints {
            Some(joints) => joints.clone(),
            None => spec.robot().description().per_joint(|joint| joint.name.clone()),
        };
        Ok(Self {
            time: time.transpose()?,
            quantities: quantities.collect::<Result<_, _>>()?,
            joints,
            places: None,
            others: Vec::new(),
            is_any_topic: spec.mcap.topic.is_none(),
        })
    }

    /// The error where no message has one of the joints; `None` without messages.
    pub fn no_joint(&self) -> Option<DecodeError> {
        let error = format!(
            "no message has the joints {}; its messages have {}; name yours in mcap.joints",
            shortened(&self.joints),
            shortened(&self.others)
        );
        (!self.others.is_empty()).then_some(DecodeError::File(error))
    }

    /// Finds the place of each joint among the names of a message; none in a message of other
    /// joints.
    pub fn find_joints(&mut self, message: &JointState, place: Place) -> Result<(), DecodeError> {
        if self.places.as_ref().is_some_and(|(names, _)| *names == message.names) {
            return Ok(());
        }
        let place_of = |joint: &String| message.names.iter().position(|name| name == joint);
        let found: Vec<Option<usize>> = self.joints.iter().map(place_of).collect();
        let is_other = found.iter().all(Option::is_none);
        let missing = self.joints.iter().zip(&found).find(|(_, place)| place.is_none());
        if let Some((joint, _)) = missing.filter(|_| !is_other) {
            let found = format!("no joint {joint:?} among {}", message.names.join(", "));
            let allowed = "all joints in each message, or none of them";
            return Err(RowError::value(place, "name", found, allowed).into());
        }
        if is_other {
            for name in &message.names {
                if self.others.len() < MAX_NAMED_JOINTS && !self.others.contains(name) {
                    self.others.push(name.clone());
                }
            }
        }
        self.places = Some((message.names.clone(), found.into_iter().collect()));
        Ok(())
    }
}

/// Names for an error, each cut if it is long.
fn shortened(names: &[String]) -> String {
    const MAX_CHARS: usize = 60;

    let short = |name: &String| name.chars().take(MAX_CHARS).collect::<String>();
    names.iter().take(MAX_NAMED_JOINTS).map(short).collect::<Vec<_>>().join(", ")
}
