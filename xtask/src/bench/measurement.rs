use std::fmt::Write;

use serde::Serialize;

/// One number, with what it is compared to.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    pub name: String,
    pub ours: f64,
    /// The same, by the program we compare ourselves with.
    pub peer: Option<f64>,
    pub peer_version: Option<String>,
    pub unit: String,
    /// `ours / peer`.
    pub ratio: Option<f64>,
    /// What the ratio, or without a peer our own number, shall not exceed.
    pub goal: Option<f64>,
    pub met: Option<bool>,
}

impl Measurement {
    /// A number without a peer.
    pub fn alone(name: impl Into<String>, ours: f64, unit: &str, at_most: Option<f64>) -> Self {
        Self {
            name: name.into(),
            ours,
            peer: None,
            peer_version: None,
            unit: unit.to_owned(),
            ratio: None,
            goal: at_most,
            met: at_most.map(|goal| ours <= goal),
        }
    }
}

/// The measurements as a table for people.
pub fn table(measurements: &[Measurement]) -> String {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |it| format!("{it:.2}"));
    let widest = measurements.iter().map(|it| it.name.chars().count()).max().unwrap_or(0).max(4);
    let mut text = String::new();
    let header = ["ours", "peer", "ratio", "goal"].map(|name| format!("{name:>10}")).concat();
    let _ = writeln!(text, "{:widest$}{header}  unit  met", "name");
    for it in measurements {
        let numbers = [Some(it.ours), it.peer, it.ratio, it.goal]
            .map(|value| format!("{:>10}", number(value)))
            .concat();
        let met = match it.met {
            Some(true) => "yes",
            Some(false) => "NO",
            None => "-",
        };
        let _ = writeln!(text, "{:widest$}{numbers}  {:4}  {met}", it.name, it.unit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_goal_without_a_peer_is_a_bound_on_our_own_number() {
        assert_eq!(Measurement::alone("a", 299.0, "s", Some(300.0)).met, Some(true));
        assert_eq!(Measurement::alone("a", 301.0, "s", Some(300.0)).met, Some(false));
        assert_eq!(Measurement::alone("a", 301.0, "s", None).met, None);
    }

    #[test]
    fn the_json_has_every_key_even_where_there_is_no_peer() {
        let json = serde_json::to_value(Measurement::alone("a", 1.0, "s", None)).unwrap();
        let mut keys: Vec<&String> = json.as_object().unwrap().keys().collect();
        keys.sort();
        let expected = ["goal", "met", "name", "ours", "peer", "peer_version", "ratio", "unit"];
        assert_eq!(keys, expected);
    }
}
