//! The contents of a dataset as tables: its channels, and the parameters of its arms.

use std::collections::BTreeMap;

use wire::{ARM_PARAMETERS, ArmParameter, ChannelSummary, Interval, Summary, Unit};

use crate::table::Align;
use crate::{Cell, Table, TableOf};

/// The range, the mean and the deviation of every channel, in the unit that its row names.
pub fn table(summary: &Summary) -> Table {
    let number = |value: f64| Cell::Number(value, Unit::Other);
    TableOf::new(&summary.channels)
        .text("channel", |channel| channel.name.as_str())
        .text("meaning", |channel| channel.about.clone())
        .text("unit", |channel| channel.unit.clone())
        .number("minimum", |channel| number(channel.min))
        .number("maximum", |channel| number(channel.max))
        .number("mean", |channel| number(channel.mean))
        .number("deviation", |channel| number(channel.std))
        .titled("Channels", "")
        .without_empty_columns()
}

/// The parameters of simulated arms: mean and range, a row for each, with a column for each joint. `None` for recordings
/// and for datasets of earlier versions.
pub fn arms(summary: &Summary) -> Option<Table> {
    let mut rows: BTreeMap<usize, Row<'_>> = BTreeMap::new();
    for arm in &summary.arms {
        let Some((ArmParameter { column, title }, joint)) = ArmParameter::of(&arm.name) else {
            continue;
        };
        let place = ARM_PARAMETERS.iter().position(|parameter| parameter.column == column);
        let row = rows.entry(place.unwrap_or_default()).or_default();
        (row.title, row.unit) = (title, arm.unit.as_deref());
        row.cells.insert(joint, arm);
    }
    let joints = rows.values().filter_map(|row| row.cells.keys().copied().flatten().max()).max();
    let columns = [None].into_iter().chain((1..=joints.unwrap_or(0)).map(Some));
    let first = TableOf::new(rows.into_values())
        .text("parameter", |row| row.title)
        .text("unit", |row| row.unit.map(str::to_owned));
    let table = columns.fold(first, |table, joint| {
        let heading = joint.map_or("arm".to_owned(), |joint| format!("joint {joint}"));
        table.column(&heading, Align::Right, "", move |row| {
            row.cells.get(&joint).map_or(Cell::Missing, |arm| {
                let ChannelSummary { mean, min: low, max: high, .. } = **arm;
                match low < high {
                    true => Cell::Interval(Interval { mean, low, high }, Unit::Other),
                    false => Cell::Number(mean, Unit::Other),
                }
            })
        })
    });
    let note =
        format!("Means and ranges over {} arms.", crate::numbers::count(summary.trajectories));
    Some(table.titled("Arms", note).without_empty_columns()).filter(|table| !table.rows.is_empty())
}

/// A parameter: its values by joint, and the one that is of no joint.
#[derive(Default)]
struct Row<'a> {
    title: &'static str,
    unit: Option<&'a str>,
    cells: BTreeMap<Option<usize>, &'a ChannelSummary>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parameters_of_arms_have_a_row_each_and_a_column_for_each_joint() {
        let arm = |name: &str, unit: &str, min: f64, max: f64| ChannelSummary {
            name: name.to_owned(),
            unit: Some(unit.to_owned()),
            about: None,
            min,
            max,
            mean: 0.5 * (min + max),
            std: 0.0,
        };
        let arms = vec![
            arm("gravity_m_s2", "m/s²", 9.81, 9.81),
            arm("damping_1", "N·m·s/rad", 0.0, 1.0),
            arm("damping_2", "N·m·s/rad", 0.5, 2.5),
            arm("mass_2", "kg", 1.0, 3.0),
        ];
        let nothing = Summary {
            dataset: 1,
            trajectories: 12,
            first: 0,
            samples: 0,
            rejected: 0,
            summarized: 12,
            channels: Vec::new(),
            spectra: Vec::new(),
            arms: Vec::new(),
        };
        let table = super::arms(&Summary { arms, ..nothing.clone() }).unwrap();
        let expected = "\
parameter         unit        arm     joint 1         joint 2
link mass         kg            -           -        2 [1, 3]
viscous friction  N·m·s/rad     -  0.5 [0, 1]  1.5 [0.5, 2.5]
gravity           m/s²       9.81           -               -
";
        assert_eq!(table.render(), expected);
        assert_eq!(table.note, "Means and ranges over 12 arms.");
        assert!(super::arms(&nothing).is_none());
    }
}
