use std::fmt::{self, Write};

use serde::{Serialize, Serializer};

/// One measured number, with its comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    pub name: String,
    pub ours: f64,
    /// The same measurement of the other program.
    pub peer: Option<f64>,
    pub peer_version: Option<String>,
    pub unit: String,
    /// `ours / peer`.
    pub ratio: Option<f64>,
    /// The goal of the ratio, or of the number if there is no peer.
    pub goal: Option<Goal>,
    pub met: Option<bool>,
}

/// A bound. In JSON it is only the number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    AtMost(f64),
    AtLeast(f64),
}

/// The number of another program.
#[derive(Clone, Debug)]
pub struct Peer {
    pub value: f64,
    /// The program's name and version.
    pub version: String,
}

impl Goal {
    fn is_met(self, value: f64) -> bool {
        match self {
            Self::AtMost(bound) => value <= bound,
            Self::AtLeast(bound) => value >= bound,
        }
    }
}

impl Serialize for Goal {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::AtMost(bound) | Self::AtLeast(bound) => serializer.serialize_f64(*bound),
        }
    }
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtMost(bound) => write!(f, "<= {bound}"),
            Self::AtLeast(bound) => write!(f, ">= {bound}"),
        }
    }
}

impl Measurement {
    /// A number without a peer.
    pub fn alone(
        name: impl Into<String>,
        ours: f64,
        unit: impl Into<String>,
        goal: Option<Goal>,
    ) -> Self {
        Self {
            name: name.into(),
            ours,
            peer: None,
            peer_version: None,
            unit: unit.into(),
            ratio: None,
            goal,
            met: goal.map(|goal| goal.is_met(ours)),
        }
    }

    /// A number with a peer's number, and a goal for their ratio. Without the peer there is no
    /// goal.
    pub fn compared(
        name: impl Into<String>,
        ours: f64,
        peer: Option<Peer>,
        unit: impl Into<String>,
        goal: Option<Goal>,
    ) -> Self {
        let ratio = peer.as_ref().map(|peer| ours / peer.value);
        Self {
            peer: peer.as_ref().map(|peer| peer.value),
            peer_version: peer.map(|peer| peer.version),
            ratio,
            goal,
            met: goal.and_then(|goal| ratio.map(|ratio| goal.is_met(ratio))),
            ..Self::alone(name, ours, unit, None)
        }
    }
}

/// The measurements as a table for people.
pub fn table(measurements: &[Measurement]) -> String {
    let number =
        |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
    let widest = |text: fn(&Measurement) -> &str, header: &str| {
        let widths = measurements.iter().map(|measurement| text(measurement).chars().count());
        widths.chain([header.len()]).max().unwrap_or(0)
    };
    let name_width = widest(|measurement| &measurement.name, "name");
    let unit_width = widest(|measurement| &measurement.unit, "unit");
    let peer_width =
        widest(|measurement| measurement.peer_version.as_deref().unwrap_or("-"), "compared with");
    let mut text = String::new();
    let header = ["ours", "peer", "ratio", "goal"].map(|name| format!("{name:>11}")).concat();
    let _ = writeln!(
        text,
        "{:name_width$}{header}  {:unit_width$}  {:peer_width$}  met",
        "name", "unit", "compared with"
    );
    for measurement in measurements {
        let numbers = [Some(measurement.ours), measurement.peer, measurement.ratio].map(number);
        let goal = measurement.goal.map_or_else(|| "-".to_owned(), |goal| goal.to_string());
        let [ours, peer, ratio] = &numbers;
        let numbers = [ours, peer, ratio, &goal].map(|text| format!("{text:>11}")).concat();
        let compared_with = measurement.peer_version.as_deref().unwrap_or("-");
        let met = match measurement.met {
            Some(true) => "yes",
            Some(false) => "NO",
            None => "-",
        };
        let _ = writeln!(
            text,
            "{:name_width$}{numbers}  {:unit_width$}  {compared_with:peer_width$}  {met}",
            measurement.name, measurement.unit
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peer(value: f64) -> Option<Peer> {
        Some(Peer { value, version: "Other 1.2".to_owned() })
    }

    #[test]
    fn a_goal_without_a_peer_is_a_bound_on_our_own_number() {
        let met = |ours, goal| Measurement::alone("a", ours, "s", goal).met;
        assert_eq!(met(299.0, Some(Goal::AtMost(300.0))), Some(true));
        assert_eq!(met(301.0, Some(Goal::AtMost(300.0))), Some(false));
        assert_eq!(met(301.0, Some(Goal::AtLeast(300.0))), Some(true));
        assert_eq!(met(299.0, Some(Goal::AtLeast(300.0))), Some(false));
        assert_eq!(met(301.0, None), None);
    }

    #[test]
    fn a_goal_with_a_peer_is_a_bound_on_the_ratio() {
        let met = |ours, goal| Measurement::compared("a", ours, peer(2.0), "M/s", Some(goal)).met;
        assert_eq!(met(160.0, Goal::AtLeast(80.0)), Some(true));
        assert_eq!(met(159.0, Goal::AtLeast(80.0)), Some(false));
        assert_eq!(met(1.0, Goal::AtMost(0.5)), Some(true));
        assert_eq!(met(1.1, Goal::AtMost(0.5)), Some(false));
    }

    #[test]
    fn a_goal_for_a_ratio_is_neither_met_nor_missed_without_the_peer() {
        let goal = Some(Goal::AtLeast(80.0));
        assert_eq!(Measurement::compared("a", 1.0, None, "M/s", goal).met, None);
    }

    #[test]
    fn what_is_not_a_number_meets_no_goal() {
        for goal in [Goal::AtMost(1.0), Goal::AtLeast(1.0)] {
            assert_eq!(Measurement::alone("a", f64::NAN, "s", Some(goal)).met, Some(false));
        }
    }

    #[test]
    fn the_json_has_every_key_even_where_there_is_no_peer() {
        let json = serde_json::to_value(Measurement::alone("a", 1.0, "s", None)).unwrap();
        let mut keys: Vec<&String> = json.as_object().unwrap().keys().collect();
        keys.sort();
        let expected = ["goal", "met", "name", "ours", "peer", "peer_version", "ratio", "unit"];
        assert_eq!(keys, expected);
    }

    #[test]
    fn the_json_has_plain_numbers() {
        let measurement = Measurement::compared("a", 9.0, peer(3.0), "s", Some(Goal::AtLeast(2.5)));
        let json = serde_json::to_value(measurement).unwrap();
        assert_eq!((&json["goal"], &json["ratio"]), (&2.5.into(), &3.0.into()));
        assert_eq!(json["peer_version"], "Other 1.2");
    }

    #[test]
    fn the_table_has_its_columns_under_each_other() {
        let measurements = [
            Measurement::compared(
                "evaluations",
                160.0,
                peer(2.0),
                "M/s",
                Some(Goal::AtLeast(90.0)),
            ),
            Measurement::alone("peak memory", 0.5, "GiB", Some(Goal::AtMost(1.0))),
        ];
        let expected = "\
name              ours       peer      ratio       goal  unit  compared with  met
evaluations     160.00       2.00      80.00      >= 90  M/s   Other 1.2      NO
peak memory       0.50          -          -       <= 1  GiB   -              yes
";
        assert_eq!(table(&measurements), expected);
    }
}
