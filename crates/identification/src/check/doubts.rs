//! Sentences about probable mistakes in a recording.

use wire::Measurement;

use super::channel::Channel;
use super::layout::Layout;

/// A description is rarely further off. A scale that is off more than this is doubtful.
const USUAL_SCALE: f64 = 1.5;

/// How far a scale must be from 1 or from a unit's, in standard deviations.
const CLEAR: f64 = 3.0;

/// A channel that the arm explains less is doubtful.
const LEAST_EXPLAINED: f64 = 0.5;

/// Units that torques are often in, and how many make one N·m.
const UNITS: [(&str, f64); 3] = [("mN·m", 1e3), ("N·cm", 1e2), ("kN·m", 1e-3)];

/// `period_s` is that of the recordings.
pub fn of(layout: &Layout, channels: &[Channel], period_s: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    of_layout(layout, &mut doubts);
    of_signs(layout, channels, &mut doubts);
    of_scales(channels, &mut doubts);
    of_gravity(channels, &mut doubts);
    of_delays(channels, period_s, &mut doubts);
    let constant = joints(channels.iter().filter(|channel| channel.is_constant));
    if let Some(joints) = constant {
        doubts.push(format!("u of {joints} is constant"));
    }
    for channel in channels {
        if let Some(explained) = channel.explained.filter(|share| *share < LEAST_EXPLAINED) {
            let (joint, percent) = (channel.column + 1, 100.0 * explained);
            doubts.push(format!(
                "the arm explains {percent:.0} % of the variance of u of joint {joint}: are the columns, the units of \
                 angles and the zero positions those of the robot?"
            ));
        }
    }
    doubts
}

fn of_layout(layout: &Layout, doubts: &mut Vec<String>) {
    let positions: Vec<usize> = layout.positions.iter().map(|(column, _)| *column).collect();
    if positions == layout.torques {
        doubts.extend(
            moved(&positions).map(|order| format!("joints look exchanged: {order} of q and u")),
        );
    } else {
        for (name, columns) in [("q", &positions), ("u", &layout.torques)] {
            let order = moved(columns);
            doubts.extend(
                order.map(|order| format!("columns of {name} look exchanged: {order} of {name}")),
            );
        }
    }
}

/// The columns that fit other joints than declared, if there are any.
fn moved(columns: &[usize]) -> Option<String> {
    let moved = columns.iter().enumerate().filter(|(joint, column)| *joint != **column);
    let parts: Vec<String> = moved
        .map(|(joint, column)| format!("joint {} fits column {}", joint + 1, column + 1))
        .collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

fn of_signs(layout: &Layout, channels: &[Channel], doubts: &mut Vec<String>) {
    for (joint, (position, torque)) in layout.positions.iter().zip(&layout.torques).enumerate() {
        let sign = channels.iter().find(|channel| channel.column == *torque);
        let is_turned = sign.and_then(|channel| channel.sign) == Some(-1);
        let joint = joint + 1;
        match (position.1 < 0.0, is_turned) {
            (true, true) => doubts.push(format!(
                "joint {joint} seems to turn the other way than in the robot's description: q and u have the other sign"
            )),
            (true, false) => {
                doubts.push(format!("q of joint {joint} seems to have the other sign"));
            }
            (false, true) => {
                doubts.push(format!("u of joint {joint} seems to have the other sign"));
            }
            (false, false) => {}
        }
    }
}

fn of_scales(channels: &[Channel], doubts: &mut Vec<String>) {
    // The unit that fits each channel; none for a scale without a name.
    let mut odd: Vec<(Option<&str>, &Channel, f64)> = Vec::new();
    for channel in channels {
        let Some(scale) = channel.scale else { continue };
        let size = scale.value.abs();
        let is_near = |unit: f64| (size / unit).ln().abs() < USUAL_SCALE.ln();
        if is_near(1.0) || (size - 1.0).abs() < CLEAR * scale.deviation {
            continue;
        }
        let unit = UNITS.into_iter().find(|(_, per_nm)| is_near(*per_nm));
        odd.push((unit.map(|(name, _)| name), channel, size));
    }
    for (name, _) in UNITS {
        let found = || odd.iter().filter(|(unit, ..)| *unit == Some(name));
        if let Some(joints) = joints(found().map(|(_, channel, _)| *channel)) {
            let sizes = found().map(|(.., size)| *size);
            let range = range(sizes);
            doubts
                .push(format!("u of {joints} is {range} times the arm's torque: is it in {name}?"));
        }
    }
    let unnamed = || odd.iter().filter(|(unit, ..)| unit.is_none());
    if let Some(joints) = joints(unnamed().map(|(_, channel, _)| *channel)) {
        let (times, gains) = (range(unnamed().map(|(.., size)| *size)), unnamed());
        let gains: Vec<String> = gains.map(|(.., size)| digits(1.0 / size)).collect();
        doubts.push(format!(
            "u of {joints} is {times} times the arm's torque: a motor's current or another unit? columns.gains of {} would fit",
            gains.join(", ")
        ));
    }
}

fn of_gravity(channels: &[Channel], doubts: &mut Vec<String>) {
    let of = |carries: bool| {
        joints(channels.iter().filter(|channel| channel.carries_weight == Some(carries)))
    };
    if let (Some(with), Some(without)) = (of(true), of(false)) {
        doubts.push(format!("u of {with} carries the arm's weight, and u of {without} does not"));
    }
    for channel in channels {
        let is_part = |share: &Measurement| {
            let distance = share.value.abs().min((share.value - 1.0).abs());
            distance > 0.3 && distance > CLEAR * share.deviation
        };
        if let Some(share) = channel.gravity.filter(is_part) {
            let (joint, percent) = (channel.column + 1, 100.0 * share.value);
            let deviation = 100.0 * share.deviation;
            doubts.push(format!(
                "u of joint {joint} carries {percent:.0} ± {deviation:.0} % of the arm's weight: is there a load, or is \
                 a part of it compensated?"
            ));
        }
    }
}

/// A torque that is held until the next sample acts half a sample later than its own time.
fn of_delays(channels: &[Channel], period_s: f64, doubts: &mut Vec<String>) {
    let is_doubtful = |delay: &Measurement| {
        let allowed = 0.6 * period_s + CLEAR * delay.deviation;
        delay.value.abs() > allowed
    };
    let late = || {
        let delayed = |channel: &Channel| channel.delay_s.filter(is_doubtful);
        channels.iter().filter_map(move |channel| Some((channel, delayed(channel)?)))
    };
    for (word, sign) in [("later", 1.0), ("earlier", -1.0)] {
        let found = || late().filter(|(_, delay)| delay.value * sign > 0.0);
        if let Some(joints) = joints(found().map(|(channel, _)| channel)) {
            let range = range(found().map(|(_, delay)| 1e3 * delay.value.abs()));
            doubts.push(format!("u of {joints} seems to be recorded {range} ms {word} than q"));
        }
    }
}

/// `joints 1, 2 and 5`. `None` without any.
fn joints<'a>(channels: impl Iterator<Item = &'a Channel>) -> Option<String> {
    let mut names: Vec<String> = channels.map(|channel| (channel.column + 1).to_string()).collect();
    let last = names.pop()?;
    Some(if names.is_empty() {
        format!("joint {last}")
    } else {
        format!("joints {} and {last}", names.join(", "))
    })
}

/// The least and the largest number, or one if they look the same.
fn range(numbers: impl Iterator<Item = f64> + Clone) -> String {
    let least = digits(numbers.clone().fold(f64::INFINITY, f64::min));
    let largest = digits(numbers.fold(f64::NEG_INFINITY, f64::max));
    if least == largest { least } else { format!("{least} to {largest}") }
}

/// The number with three significant digits.
fn digits(number: f64) -> String {
    let rounded: f64 = format!("{number:.2e}").parse().unwrap_or(number);
    rounded.to_string()
}
