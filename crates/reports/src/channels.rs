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

/// The parameters of simulated arms, with mean and range: those of whole arms have a row each, and those of joints a
/// column each. There are none for recordings and for datasets of earlier versions.
pub fn arms(summary: &Summary) -> Vec<Table> {
    let mut whole = BTreeMap::new();
    let mut of_joints = BTreeMap::new();
    let mut joints: BTreeMap<usize, BTreeMap<usize, Cell>> = BTreeMap::new();
    for arm in &summary.arms {
        let Some((ArmParameter { column, title }, joint)) = ArmParameter::of(&arm.name) else {
            continue;
        };
        let found = ARM_PARAMETERS.iter().position(|parameter| parameter.column == column);
        let place = found.unwrap_or_default();
        let unit = arm.unit.as_deref();
        match joint {
            None => drop(whole.insert(place, (title, unit, cell(arm)))),
            Some(joint) => {
                of_joints.insert(
                    place,
                    unit.map_or(title.to_owned(), |unit| format!("{title}, {unit}")),
                );
                joints.entry(joint).or_default().insert(place, cell(arm));
            }
        }
    }
    let whole = TableOf::new(whole.into_values())
        .text("parameter", |(title, ..)| *title)
        .text("unit", |(_, unit, _)| unit.map(str::to_owned))
        .column("arm", Align::Right, "", |(.., cell)| cell.clone());
    let first = TableOf::new(joints).text("joint", |(joint, _)| joint.to_string());
    let joints = of_joints.into_iter().fold(first, |table, (place, heading)| {
        table.column(&heading, Align::Right, "", move |(_, cells)| {
            cells.get(&place).cloned().unwrap_or(Cell::Missing)
        })
    });
    let count = crate::numbers::count(summary.trajectories);
    let note = format!("Means and ranges over {count} arms.");
    let tables = [joints.titled("Arms by joint", note.clone()), whole.titled("Arms", note)];
    tables.into_iter().filter(|table| !table.rows.is_empty()).collect()
}

/// The mean of a parameter, and its range unless all arms have the same.
fn cell(&ChannelSummary { mean, min: low, max: high, .. }: &ChannelSummary) -> Cell {
    match low < high {
        true => Cell::Interval(Interval { mean, low, high }, Unit::Other),
        false => Cell::Number(mean, Unit::Other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parameters_of_joints_have_a_column_each_and_those_of_arms_a_row_each() {
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
        let tables = super::arms(&Summary { arms, ..nothing.clone() });
        let [joints, whole] = tables.as_slice() else { panic!("{tables:?}") };
        let expected = "\
joint  link mass, kg  viscous friction, N·m·s/rad
1                  -                   0.5 [0, 1]
2           2 [1, 3]               1.5 [0.5, 2.5]
";
        assert_eq!(joints.render(), expected);
        assert_eq!(whole.render(), "parameter  unit   arm\ngravity    m/s²  9.81\n");
        assert_eq!(joints.note, "Means and ranges over 12 arms.");
        assert!(super::arms(&nothing).is_empty());
    }
}
