//! The torques of recordings beside those of the robot that was recorded.

use wire::{ChannelCheck, LogCheck, Measurement, Unit};

use crate::{Cell, Table, TableOf};

/// What each torque column says of itself. No rows if nothing could be compared.
pub fn table(check: &LogCheck) -> Table {
    let channels = if check.seconds > 0.0 { check.channels.as_slice() } else { &[] };
    let number = |value: Option<f64>| value.map(|value| Cell::Number(value, Unit::Other));
    let table = TableOf::new(channels)
        .number("joint", |channel| Cell::Count(channel.joint.into()))
        .number("u is late by, ms", move |channel| number(of(channel.delay_s).map(|s| 1e3 * s)))
        .number("±", move |channel| number(channel.delay_s.map(|delay| 1e3 * delay.deviation)))
        .text("sign", |channel| channel.sign.map(|sign| if sign < 0 { "other" } else { "same" }))
        .number("times the robot's", move |channel| number(of(channel.scale)))
        .number("±", move |channel| number(channel.scale.map(|scale| scale.deviation)))
        .text("weight", |channel: &&ChannelCheck| {
            channel.carries_weight.map(|carries| if carries { "carried" } else { "not carried" })
        })
        .number("explained", |channel| channel.explained.map(|it| Cell::Number(it, Unit::Share)))
        .text("not told because", |channel| channel.unseen.clone());
    table
        .titled(
            "Torques beside the robot's",
            "All recordings are compared together. ±: standard deviation. Explained: the share of u's variance that the \
             robot explains, with friction, rotors and offsets that fit.",
        )
        .without_empty_columns()
}

fn of(number: Option<Measurement>) -> Option<f64> {
    number.map(|number| number.value)
}
