//! The channels of a dataset as a table.

use wire::{Summary, Unit};

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
