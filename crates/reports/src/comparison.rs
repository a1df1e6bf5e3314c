//! Runs beside each other: what was set differently, and what came out.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use spec::Digest;
use wire::{Run, Unit};

use crate::cell::shortened;
use crate::{Align, Cell, Table};

/// The most fields that a sweep varies.
const SWEPT: usize = 3;

/// A run beside others, of torqued or of a client that logged it.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// Its name in tables and figures. No two runs have the same.
    pub label: String,
    /// The spec or the parameters, as an object.
    pub parameters: Value,
    /// The last value of each metric; `None` for NaN.
    pub metrics: BTreeMap<String, Option<f64>>,
}

impl From<&Run> for Compared {
    fn from(run: &Run) -> Self {
        let metrics = run.metrics.iter();
        Self {
            label: format!("{} {}", run.id, run.name),
            parameters: run.spec.clone(),
            metrics: metrics.map(|(key, latest)| (key.clone(), latest.value)).collect(),
        }
    }
}

impl Compared {
    /// A run of a client of MLflow. Parameters that are written as numbers are numbers.
    pub fn logged<'a>(
        name: &str,
        identifier: &str,
        parameters: impl IntoIterator<Item = (&'a str, &'a str)>,
        metrics: impl IntoIterator<Item = (&'a str, f64)>,
    ) -> Self {
        let read = |text: &str| match text.parse::<f64>() {
            Ok(number) if number.is_finite() => serde_json::from_str(text).unwrap_or(number.into()),
            _ => Value::from(text),
        };
        let parameters = parameters.into_iter().map(|(name, text)| (name.to_owned(), read(text)));
        let known = |value: f64| Some(value).filter(|value| !value.is_nan());
        let metrics = metrics.into_iter().map(|(key, value)| (key.to_owned(), known(value)));
        Self {
            label: format!("{} {name}", identifier.get(..8).unwrap_or(identifier)),
            parameters: Value::Object(parameters.collect()),
            metrics: metrics.collect(),
        }
    }
}

/// The last values of every metric, a row per metric and a column per run.
pub fn metrics(runs: &[Compared]) -> Table {
    let mut keys: Vec<&String> = runs.iter().flat_map(|run| run.metrics.keys()).collect();
    keys.sort_unstable();
    keys.dedup();
    let mut table = beside("metric", Align::Right, runs);
    for key in keys {
        let value = |run: &Compared| {
            let latest = run.metrics.get(key).copied().flatten();
            latest.map_or(Cell::Missing, |value| Cell::Number(value, unit(key)))
        };
        table.push([vec![Cell::from(key.as_str())], runs.iter().map(value).collect()].concat());
    }
    table.title = "Metrics".to_owned();
    table.note = "The last value of each.".to_owned();
    table
}

/// The fields of the runs' specs, a row per field and a column per run. Without `all`, only those
/// that differ.
pub fn parameters(runs: &[Compared], all: bool) -> Table {
    let specs: Vec<BTreeMap<String, &Value>> =
        runs.iter().map(|run| fields(&run.parameters)).collect();
    let mut names: Vec<&String> = specs.iter().flat_map(BTreeMap::keys).collect();
    names.sort_unstable();
    names.dedup();
    let mut table = beside("parameter", Align::Left, runs);
    for name in names {
        let values: Vec<Option<&Value>> =
            specs.iter().map(|spec| spec.get(name).copied()).collect();
        if all || differ(runs, &values) {
            let cells = values.into_iter().map(|value| value.map_or(Cell::Missing, shown));
            table.push([vec![Cell::from(name.as_str())], cells.collect()].concat());
        }
    }
    table.title = if all { "Parameters" } else { "Parameters that differ" }.to_owned();
    table
}

/// The numbers in the runs' specs that differ, by their paths, with a value of each run that has one. Seeds are left out.
pub fn numbers(runs: &[Compared]) -> BTreeMap<String, Vec<Option<f64>>> {
    let specs: Vec<BTreeMap<String, &Value>> =
        runs.iter().map(|run| fields(&run.parameters)).collect();
    let names: BTreeSet<&String> = specs.iter().flat_map(BTreeMap::keys).collect();
    let differing = names.into_iter().filter(|name| !is_seed(name)).filter_map(|name| {
        let values: Vec<Option<f64>> =
            specs.iter().map(|spec| spec.get(name).and_then(|value| value.as_f64())).collect();
        let mut known = values.iter().flatten();
        let first = known.next()?;
        known.any(|value| value != first).then(|| (name.clone(), values.clone()))
    });
    differing.collect()
}

/// The places of runs that repeat each other, whose specs differ in no field but seeds. Each run
/// is in one group, and groups are in the order of their first runs.
pub fn repetitions(runs: &[Compared]) -> Vec<Vec<usize>> {
    let without_seeds = |run: &Compared| {
        let is_other =
            |(name, _): &(String, &Value)| !is_seed(name) && !name.starts_with("execution.");
        let fields = fields(&run.parameters).into_iter().filter(is_other);
        fields.map(|(name, value)| (name, value.clone())).collect::<BTreeMap<String, Value>>()
    };
    let specs: Vec<BTreeMap<String, Value>> = runs.iter().map(without_seeds).collect();
    equal(&specs)
}

/// The number of different seeds among runs. A run with several seeds counts as one.
pub fn seeds(runs: &[Compared]) -> usize {
    let of_run = |run: &Compared| {
        let seeds = fields(&run.parameters).into_iter().filter(|(name, _)| is_seed(name));
        seeds.map(|(name, value)| (name, value.clone())).collect::<BTreeMap<String, Value>>()
    };
    equal(&runs.iter().map(of_run).collect::<Vec<_>>()).len()
}

/// The digests in the specs of runs, which stand for results of other jobs.
pub fn digests(runs: &[Compared]) -> BTreeSet<Digest> {
    fn collect(value: &Value, found: &mut BTreeSet<Digest>) {
        match value {
            Value::String(text) => found.extend(text.parse::<Digest>()),
            Value::Array(values) => values.iter().for_each(|value| collect(value, found)),
            Value::Object(fields) => fields.values().for_each(|value| collect(value, found)),
            _ => {}
        }
    }
    let mut found = BTreeSet::new();
    runs.iter().for_each(|run| collect(&run.parameters, &mut found));
    found
}

/// The runs with a name before each digest that has one: `train-set (98f7…)`.
#[must_use]
pub fn with_names(runs: &[Compared], names: &BTreeMap<Digest, String>) -> Vec<Compared> {
    fn name(value: &mut Value, names: &BTreeMap<Digest, String>) {
        match value {
            Value::String(text) => {
                let digest = text.parse::<Digest>().ok();
                if let Some((digest, named)) = digest.and_then(|it| Some((it, names.get(&it)?))) {
                    *text = format!("{named} ({})", digest.short());
                }
            }
            Value::Array(values) => values.iter_mut().for_each(|value| name(value, names)),
            Value::Object(fields) => fields.values_mut().for_each(|value| name(value, names)),
            _ => {}
        }
    }
    let mut named = runs.to_vec();
    named.iter_mut().for_each(|run| name(&mut run.parameters, names));
    named
}

/// The places of runs that have the same value of a field, in the order of their first runs. Runs
/// without the field are a group.
pub fn sharing(runs: &[Compared], field: &str) -> Vec<Vec<usize>> {
    let value = |run: &Compared| fields(&run.parameters).get(field).map(|it| (*it).clone());
    equal(&runs.iter().map(value).collect::<Vec<Option<Value>>>())
}

/// The value of a field of a run's spec, in words.
pub fn value(run: &Compared, field: &str) -> Option<String> {
    fields(&run.parameters).get(field).map(|value| words(value))
}

/// The fields of the runs' specs that differ, by their paths, seeds left out.
pub fn differing(runs: &[Compared]) -> Vec<String> {
    let specs: Vec<BTreeMap<String, &Value>> =
        runs.iter().map(|run| fields(&run.parameters)).collect();
    let names: BTreeSet<&String> = specs.iter().flat_map(BTreeMap::keys).collect();
    let differs = |name: &&String| {
        let values: Vec<_> = specs.iter().map(|spec| spec.get(*name).copied()).collect();
        !is_seed(name) && differ(runs, &values)
    };
    names.into_iter().filter(differs).cloned().collect()
}

/// For each of the specs of a sweep, its values of the swept fields in words, such as `learning_rate
/// 0.001`. Empty if the specs make no sweep: with several kinds, or with more than a few fields that
/// differ.
pub fn swept(specs: &[&Value]) -> Vec<String> {
    let all: Vec<BTreeMap<String, &Value>> = specs.iter().map(|spec| fields(spec)).collect();
    let names: BTreeSet<&String> = all.iter().flat_map(BTreeMap::keys).collect();
    let differs = |name: &&String| {
        let first = all[0].get(*name);
        !name.starts_with("execution.") && all.iter().any(|spec| spec.get(*name) != first)
    };
    let names: Vec<&String> = names.into_iter().filter(differs).collect();
    if !(1..=SWEPT).contains(&names.len()) || names.iter().any(|name| *name == "kind") {
        return Vec::new();
    }
    let value = |spec: &BTreeMap<String, &Value>, name: &str| {
        let last = name.rsplit('.').next().unwrap_or(name);
        let value = spec.get(name).map_or("-".to_owned(), |value| words(value));
        format!("{last} {value}")
    };
    let values = |spec: &BTreeMap<String, &Value>| {
        names.iter().map(|name| value(spec, name)).collect::<Vec<_>>().join(", ")
    };
    all.iter().map(values).collect()
}

/// Whether the runs' values of a field differ. A job of another kind that has no such field makes no
/// difference between runs that agree.
fn differ(runs: &[Compared], values: &[Option<&Value>]) -> bool {
    let kind = |run: &Compared| run.parameters.get("kind").cloned();
    let having: Vec<(Option<Value>, &Value)> =
        runs.iter().zip(values).filter_map(|(run, value)| Some((kind(run), (*value)?))).collect();
    if having.windows(2).any(|pair| pair[0].1 != pair[1].1) {
        return true;
    }
    let lacking = runs.iter().zip(values).filter(|(_, value)| value.is_none());
    let mut lacking = lacking.map(|(run, _)| kind(run));
    match having.len() {
        0 => false,
        1 => lacking.next().is_some(),
        _ => lacking.any(|kind| having.iter().any(|(other, _)| *other == kind)),
    }
}

fn is_seed(name: &str) -> bool {
    name == "seed" || name.ends_with(".seed")
}

/// The places of equal values, in the order of the first of each.
fn equal<T: PartialEq>(values: &[T]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (place, value) in values.iter().enumerate() {
        match groups.iter_mut().find(|group| values[group[0]] == *value) {
            Some(group) => group.push(place),
            None => groups.push(vec![place]),
        }
    }
    groups
}

fn beside(first: &str, align: Align, runs: &[Compared]) -> Table {
    let columns = runs.iter().map(|run| (run.label.clone(), align));
    Table::new([(first.to_owned(), Align::Left)].into_iter().chain(columns))
}

fn unit(key: &str) -> Unit {
    if key.ends_with("_deg") { Unit::Degrees } else { Unit::Other }
}

/// The values of a spec by their paths, such as `optimizer.learning_rate`. A list is one value.
fn fields(spec: &Value) -> BTreeMap<String, &Value> {
    fn collect<'a>(path: &str, value: &'a Value, found: &mut BTreeMap<String, &'a Value>) {
        let Value::Object(fields) = value else {
            found.insert(path.to_owned(), value);
            return;
        };
        for (name, value) in fields {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            collect(&path, value, found);
        }
    }
    let mut found = BTreeMap::new();
    collect("", spec, &mut found);
    found
}

fn shown(value: &Value) -> Cell {
    Cell::Long(whole(value))
}

fn words(value: &Value) -> String {
    shortened(&whole(value))
}

fn whole(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn run(id: i64, spec: &Value, rmse_deg: Option<f64>) -> Compared {
        let mut metrics = json!({"train/loss": {"step": 10, "value": 0.25}});
        if let Some(rmse_deg) = rmse_deg {
            metrics["validation/rmse_deg"] = json!({"step": 10, "value": rmse_deg});
        }
        let run = json!({
            "id": id, "job": id, "kind": "train", "name": "train", "digest": "0".repeat(64),
            "state": "succeeded", "error": null, "spec": spec, "metrics": metrics, "artifacts": [],
            "created_at": "2026-11-28T12:00:00Z",
        });
        Compared::from(&serde_json::from_value::<Run>(run).unwrap())
    }

    #[test]
    fn numbers_that_differ_are_those_of_no_seed() {
        let found = numbers(&three());
        let expected = vec![Some(0.01), Some(0.02), Some(0.01)];
        assert_eq!(found, BTreeMap::from([("optimizer.learning_rate".to_owned(), expected)]));
        let mut without = three();
        without[1].parameters["optimizer"] = json!({});
        without[2].parameters["optimizer"]["learning_rate"] = json!(0.5);
        assert_eq!(numbers(&without)["optimizer.learning_rate"], [Some(0.01), None, Some(0.5)]);
    }

    fn three() -> Vec<Compared> {
        let spec = |seed: u32, rate: f64| json!({"seed": seed, "steps": 100, "optimizer": {"learning_rate": rate}});
        vec![
            run(4, &spec(0, 0.01), Some(1.5)),
            run(7, &spec(0, 0.02), None),
            run(9, &spec(1, 0.01), Some(0.123_456)),
        ]
    }

    #[test]
    fn only_what_differs_is_shown_unless_all_is_asked_for() {
        let lines = |table: &Table| -> Vec<String> {
            table
                .render()
                .lines()
                .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "))
                .collect()
        };
        assert_eq!(
            lines(&parameters(&three(), false)),
            [
                "parameter 4 train 7 train 9 train",
                "optimizer.learning_rate 0.01 0.02 0.01",
                "seed 0 0 1",
            ]
        );
        assert_eq!(parameters(&three(), true).rows.len(), 3);
        assert_eq!(
            lines(&metrics(&three())),
            [
                "metric 4 train 7 train 9 train",
                "train/loss 0.25 0.25 0.25",
                "validation/rmse_deg 1.50 - 0.12",
            ]
        );
    }

    #[test]
    fn a_field_that_one_run_lacks_and_a_long_list_have_their_rows() {
        let list: Vec<u32> = (0..100).collect();
        let runs = [run(1, &json!({"a": list}), None), run(2, &json!({"b": null}), None)];
        let table = parameters(&runs, false);
        assert_eq!(table.rows.len(), 2);
        assert_eq!(table.rows[0][2], Cell::Missing);
        assert!(table.rows[0][1].to_string().ends_with('…'));
    }

    #[test]
    fn a_digest_is_short_in_a_table_and_whole_in_a_file() {
        let digest = |digit: &str| json!({"kind": "train", "data": {"digest": digit.repeat(64)}});
        let runs = [run(1, &digest("a"), None), run(2, &digest("b"), None)];
        let table = parameters(&runs, false);
        assert!(
            table.render().contains("data.digest  aaaaaaaaaaaa…  bbbbbbbbbbbb…"),
            "{}",
            table.render()
        );
        assert!(table.to_csv().unwrap().contains(&"b".repeat(64)));
        assert_eq!(value(&runs[0], "data.digest").as_deref(), Some("aaaaaaaaaaaa…"));
    }

    #[test]
    fn a_run_of_another_kind_makes_no_difference_between_equal_ones() {
        let training = |id, steps: u32| {
            run(id, &json!({"kind": "train", "batch_size": 8, "steps": steps}), None)
        };
        let evaluation = run(3, &json!({"kind": "evaluate", "context": 320}), None);
        let names = |runs: &[Compared]| -> Vec<String> {
            parameters(runs, false).rows.iter().map(|row| row[0].value()).collect()
        };
        let three = [training(1, 10), training(2, 20), evaluation.clone()];
        assert_eq!(names(&three), ["context", "kind", "steps"]);
        assert_eq!(
            names(&[training(1, 10), evaluation]),
            ["batch_size", "context", "kind", "steps"]
        );
        let lacking = run(2, &json!({"kind": "train", "steps": 10}), None);
        assert_eq!(names(&[training(1, 10), lacking]), ["batch_size"]);
    }

    #[test]
    fn runs_that_differ_in_their_seeds_repeat_each_other() {
        assert_eq!(repetitions(&three()), [vec![0, 2], vec![1]]);
        assert_eq!([seeds(&three()), seeds(&three()[..2])], [2, 1]);
    }

    #[test]
    fn a_digest_that_has_a_name_is_shown_by_it() {
        let spec =
            |digit: &str| json!({"data": {"digest": digit.repeat(64)}, "of": [digit.repeat(64)]});
        let runs = [run(1, &spec("a"), None), run(2, &spec("b"), None)];
        let [a, b] = ["a", "b"].map(|digit| digit.repeat(64).parse::<Digest>().unwrap());
        assert_eq!(digests(&runs), BTreeSet::from([a, b]));
        let named = with_names(&runs, &BTreeMap::from([(a, "train-set".to_owned())]));
        let table = parameters(&named, false).render();
        let words = table.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words.contains("train-set (aaaaaaaaaaaa) bbbbbbbbbbbb…"), "{table}");
        assert!(table.contains("[\"train-set (aaaaaaaaaaaa)\"]"), "{table}");
    }

    #[test]
    fn runs_are_grouped_by_the_value_of_a_field() {
        let mut runs = three();
        runs[2].parameters["model"] = json!("robomorph");
        assert_eq!(differing(&runs), ["model", "optimizer.learning_rate"]);
        assert_eq!(sharing(&runs, "model"), [vec![0, 1], vec![2]]);
        assert_eq!(sharing(&runs, "optimizer.learning_rate"), [vec![0, 2], vec![1]]);
        assert_eq!(value(&runs[2], "model").as_deref(), Some("robomorph"));
        assert_eq!(value(&runs[0], "model"), None);
    }

    #[test]
    fn a_sweep_is_told_by_the_few_fields_that_differ() {
        let spec = |rate: f64, steps: u32| {
            json!({"kind": "train", "steps": steps, "optimizer": {"learning_rate": rate},
                "execution": {"priority": steps}})
        };
        let (first, second) = (spec(0.01, 10), spec(0.02, 10));
        assert_eq!(swept(&[&first, &second]), ["learning_rate 0.01", "learning_rate 0.02"]);
        let third = spec(0.01, 20);
        assert_eq!(
            swept(&[&first, &second, &third])[2],
            "learning_rate 0.01, steps 20",
            "every field that differs is there"
        );
        let lacking = json!({"kind": "train", "steps": 10, "optimizer": {}});
        assert_eq!(swept(&[&first, &lacking])[1], "learning_rate -");
        let evaluation = json!({"kind": "evaluate", "steps": 10});
        for specs in [&[&first, &evaluation][..], &[&first, &first], &[&first], &[]] {
            assert!(swept(specs).is_empty(), "{specs:?}");
        }
    }

    #[test]
    fn a_logged_run_stands_beside_a_run_of_torqued() {
        let params = [("optimizer.learning_rate", "0.03"), ("seed", "7"), ("note", "1e400")];
        let logged = Compared::logged("mine", "0123456789abcdef", params, [("train/loss", 0.5)]);
        assert_eq!(logged.label, "01234567 mine");
        let all = [three().remove(0), logged];
        assert_eq!(numbers(&all)["optimizer.learning_rate"], [Some(0.01), Some(0.03)]);
        assert_eq!(all[1].parameters["seed"], json!(7));
        assert_eq!(all[1].parameters["note"], json!("1e400"));
        assert_eq!(metrics(&all).rows[0][2], Cell::Number(0.5, Unit::Other));
    }
}
