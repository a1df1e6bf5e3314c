//! Sentences about probable mistakes in a recording.

use wire::Measurement;

use super::beyond;
use super::channel::Channel;
use super::comparison::Comparison;
use super::cuts;
use super::purpose::{CLEAR, Purpose};
use super::told::{Doubt, Kind};
use crate::wording::{digits, joints, range};

/// A description is rarely further off. A scale that is off more than this is doubtful.
const USUAL_SCALE: f64 = 1.5;

/// A channel that the arm explains less is doubtful, if more than noise is left: a hundredth of the
/// largest channel. Real arms explain 95 % and more.
const USUALLY_EXPLAINED: f64 = 0.8;
const NOISE: f64 = 0.01;

/// A channel that the arm explains less is doubtful, noise or not.
const LEAST_EXPLAINED: f64 = 0.5;

/// Units that torques are often in, and how many make one N·m.
const UNITS: [(&str, f64); 3] = [("mN·m", 1e3), ("N·cm", 1e2), ("kN·m", 1e-3)];

/// The doubts about a comparison, in the order of their kinds.
pub fn of(found: &Comparison, purpose: Purpose) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    let (positions, channels): (Vec<Channel>, Vec<Channel>) =
        found.channels.iter().cloned().partition(|channel| channel.is_position);
    let channels = channels.as_slice();
    of_positions(&positions, &mut doubts);
    // Positions say nothing about columns, signs and units of torques.
    if positions.is_empty() {
        of_layout(found, &mut doubts);
        of_signs(found, &mut doubts);
    }
    let other_rates = of_rates(channels, &mut doubts);
    let before = doubts.len();
    of_scales(channels, &other_rates, purpose, &mut doubts);
    let has_other_scale = doubts.len() > before || !other_rates.is_empty();
    of_gravity(channels, &other_rates, purpose, &mut doubts);
    of_delays(channels, found.period_s, purpose, &mut doubts);
    let constant: Vec<&Channel> = channels.iter().filter(|channel| channel.is_constant).collect();
    if let Some(joints) = named(constant.iter().copied()) {
        let text = format!("u of {joints} is constant");
        doubts.push(Doubt { kind: Kind::Constant, joints: columns(&constant), size: 1.0, text });
    }
    cuts::of_cuts(found, purpose, &mut doubts);
    of_unexplained(channels, purpose, &mut doubts);
    beyond::of_motion(found, &mut doubts);
    // Another unit or rate is rarely that of one column.
    if !has_other_scale && positions.is_empty() {
        beyond::of_torques(found, purpose, &mut doubts);
    }
    doubts
}

/// Positions in the columns of torques.
fn of_positions(channels: &[Channel], doubts: &mut Vec<Doubt>) {
    let Some(joints) = named(channels.iter()) else { return };
    let follows = if channels.len() == 1 { "its position" } else { "their positions" };
    let text = format!(
        "u of {joints} follows {follows}: these are positions (LeRobot's `action` is the commanded position), not \
         torques"
    );
    let joints = channels.iter().map(|channel| channel.column).collect();
    doubts.push(Doubt { kind: Kind::PositionForTorque, joints, size: 1.0, text });
}

fn of_unexplained(channels: &[Channel], purpose: Purpose, doubts: &mut Vec<Doubt>) {
    let largest = channels.iter().map(|channel| channel.deviation_nm).fold(0.0, f64::max);
    for channel in channels {
        let Some(explained) = channel.explained else { continue };
        let left_nm = channel.deviation_nm * (1.0 - explained).sqrt();
        // A load explains more.
        let is_settled = left_nm < NOISE * largest || purpose.has_load();
        if explained < LEAST_EXPLAINED || (explained < USUALLY_EXPLAINED && !is_settled) {
            let (joint, percent) = (channel.column + 1, 100.0 * explained);
            let text = format!(
                "the arm explains {percent:.0} % of the variance of u of joint {joint}: are the columns, the units of \
                 angles and the zero positions those of the robot?"
            );
            let joints = vec![channel.column];
            doubts.push(Doubt { kind: Kind::Unexplained, joints, size: 1.0 - explained, text });
        }
    }
}

fn of_layout(found: &Comparison, doubts: &mut Vec<Doubt>) {
    let layout = &found.layout;
    let positions: Vec<usize> = layout.positions.iter().map(|(column, _)| *column).collect();
    if positions == layout.torques {
        doubts.extend(exchange(Kind::Exchange, &positions, |order| {
            format!("joints look exchanged: {order} of q and u")
        }));
        return;
    }
    for (kind, name, other, columns) in [
        (Kind::ExchangeOfPositions, "q", "u", &positions),
        (Kind::ExchangeOfTorques, "u", "q", &layout.torques),
    ] {
        doubts.extend(exchange(kind, columns, |order| match found.ties.is_exchange_tied {
            true => format!(
                "columns of {name} or of {other} look exchanged: {order}. The torques do not tell of which"
            ),
            false => format!("columns of {name} look exchanged: {order} of {name}"),
        }));
    }
}

/// The doubt about columns that fit other joints than declared, if there are any.
fn exchange(kind: Kind, columns: &[usize], sentence: impl Fn(&str) -> String) -> Option<Doubt> {
    let moved = columns.iter().enumerate().filter(|(joint, column)| *joint != **column);
    let (joints, order): (Vec<usize>, Vec<String>) = moved
        .map(|(joint, column)| (joint, format!("joint {} fits column {}", joint + 1, column + 1)))
        .unzip();
    let (size, text) = (joints.len() as f64, sentence(&order.join(", ")));
    (!joints.is_empty()).then_some(Doubt { kind, joints, size, text })
}

fn of_signs(found: &Comparison, doubts: &mut Vec<Doubt>) {
    let Comparison { layout, channels, ties, .. } = found;
    for (joint, torque) in layout.torques.iter().enumerate() {
        let sign = channels.iter().find(|channel| channel.column == *torque);
        let is_turned = sign.and_then(|channel| channel.sign) == Some(-1);
        let is_tied = ties.signs.contains(&joint);
        let number = joint + 1;
        let text = match (layout.has_declared_sign(joint), is_turned) {
            (false, true) => format!(
                "joint {number} seems to turn the other way than in the robot's description: q and u have the other sign"
            ),
            (false, false) => format!("q of joint {number} seems to have the other sign"),
            (true, true) if is_tied => format!(
                "u or q of joint {number} seems to have the other sign. The torques do not tell which"
            ),
            (true, true) => format!("u of joint {number} seems to have the other sign"),
            (true, false) => continue,
        };
        doubts.push(Doubt { kind: Kind::Sign, joints: vec![joint], size: 1.0, text });
    }
}

/// Whether a scale is that of a usual description times `unit`.
fn is_near(size: f64, unit: f64) -> bool {
    (size / unit).ln().abs() < USUAL_SCALE.ln()
}

/// Whether a channel has too much torque of accelerations, beside weight that fits, or too little.
fn too_much(channel: &Channel) -> Option<bool> {
    let (weight, rest) = (channel.of_weight?, channel.of_rest?);
    if weight.value < CLEAR * weight.deviation || !is_near(weight.value, 1.0) {
        return None;
    }
    let margin = CLEAR * rest.deviation;
    if rest.value - margin > USUAL_SCALE {
        Some(true)
    } else if rest.value > 0.0 && rest.value + margin < 1.0 / USUAL_SCALE {
        Some(false)
    } else {
        None
    }
}

/// The columns whose weight fits and whose other torques do not, as those of a recording whose rows
/// follow at another rate: at half of it, accelerations are a quarter.
fn of_rates(channels: &[Channel], doubts: &mut Vec<Doubt>) -> Vec<usize> {
    let Some(more) = channels.iter().find_map(too_much) else {
        return Vec::new();
    };
    // Joints that carry no weight have the same scale.
    let has_it = |channel: &&Channel| {
        let of_scale = channel.scale.is_some_and(|scale| {
            let distance =
                if more { scale.value - USUAL_SCALE } else { 1.0 / USUAL_SCALE - scale.value };
            distance > CLEAR * scale.deviation
        });
        too_much(channel) == Some(more) || of_scale
    };
    let found: Vec<&Channel> = channels.iter().filter(has_it).collect();
    // Accelerations must show how far they are off.
    let factors = found.iter().filter_map(|channel| channel.clear_rest()).map(f64::sqrt);
    let (Some(joints), Some(_)) = (named(found.iter().copied()), factors.clone().next()) else {
        return Vec::new();
    };
    let size = farthest_from_one(factors.clone());
    let rate = range(factors);
    let text = format!(
        "u of {joints} fits the arm's weight but not its accelerations: with {rate} times the rate of the rows it \
         would. Look at columns.time, units.time and rate_hz"
    );
    let columns = columns(&found);
    doubts.push(Doubt { kind: Kind::Rate, joints: columns.clone(), size, text });
    columns
}

/// `other_rates` are columns whose scale is that of another rate.
fn of_scales(
    channels: &[Channel],
    other_rates: &[usize],
    purpose: Purpose,
    doubts: &mut Vec<Doubt>,
) {
    // The unit that fits each channel; none for a scale without a name.
    let mut odd: Vec<(Option<&str>, &Channel, f64)> = Vec::new();
    for channel in channels.iter().filter(|channel| !other_rates.contains(&channel.column)) {
        let Some(scale) = channel.scale else { continue };
        let size = scale.value.abs();
        if is_near(size, 1.0)
            || (size - 1.0).abs() < CLEAR * scale.deviation
            || purpose.finds_scale(size)
        {
            continue;
        }
        let unit = UNITS.into_iter().find(|(_, per_nm)| is_near(size, *per_nm));
        odd.push((unit.map(|(name, _)| name), channel, size));
    }
    let of_unit = |name: Option<&str>| -> (Vec<&Channel>, Vec<f64>) {
        let found = odd.iter().filter(|(unit, ..)| *unit == name);
        found.map(|(_, channel, size)| (*channel, *size)).unzip()
    };
    for (name, _) in UNITS {
        let (found, sizes) = of_unit(Some(name));
        if let Some(joints) = named(found.iter().copied()) {
            let range = range(sizes.iter().copied());
            let text = format!("u of {joints} is {range} times the arm's torque: is it in {name}?");
            doubts.push(of_scale(&found, &sizes, text));
        }
    }
    // A load may be as heavy as the arm.
    if purpose.has_load() {
        return;
    }
    let (found, sizes) = of_unit(None);
    if let Some(joints) = named(found.iter().copied()) {
        let times = range(sizes.iter().copied());
        let gains: Vec<String> = sizes.iter().map(|size| digits(1.0 / size)).collect();
        let (field, gains) = (purpose.gains(), gains.join(", "));
        let text = if looks_like_a_load(channels) {
            format!(
                "u of {joints} is {times} times the arm's torque, and more so towards the hand: does it carry a load \
                 that the robot's description lacks? Otherwise {field} of {gains} would fit"
            )
        } else {
            format!(
                "u of {joints} is {times} times the arm's torque: a motor's current, another unit, a load, or a wrong \
                 rate of the rows? If it is a current, {field} of {gains} would fit"
            )
        };
        doubts.push(of_scale(&found, &sizes, text));
    }
}

fn of_scale(channels: &[&Channel], sizes: &[f64], text: String) -> Doubt {
    let size = farthest_from_one(sizes.iter().copied());
    Doubt { kind: Kind::Scale, joints: columns(channels), size, text }
}

/// The largest logarithm of a factor.
fn farthest_from_one(factors: impl Iterator<Item = f64>) -> f64 {
    factors.map(|factor| factor.ln().abs()).fold(0.0, f64::max)
}

/// Whether torques exceed the arm's, and the more the nearer to the hand, as those of a load do.
fn looks_like_a_load(channels: &[Channel]) -> bool {
    /// Scales are this uncertain.
    const ALIKE: f64 = 1.2;

    let scales: Vec<f64> =
        channels.iter().filter_map(|channel| channel.scale).map(|scale| scale.value).collect();
    let (Some(first), Some(last)) = (scales.first(), scales.last()) else { return false };
    let is_rising = scales.windows(2).all(|pair| pair[1] * ALIKE > pair[0]);
    let carries_weight = channels.iter().any(|channel| channel.carries_weight == Some(true));
    carries_weight
        && is_rising
        && *last > ALIKE * first
        && scales.iter().all(|scale| *scale > 1.0 / ALIKE)
}

/// `other_rates` are columns whose accelerations are those of another rate.
fn of_gravity(
    channels: &[Channel],
    other_rates: &[usize],
    purpose: Purpose,
    doubts: &mut Vec<Doubt>,
) {
    let known = || channels.iter().filter(|channel| !other_rates.contains(&channel.column));
    let of = |carries: bool| -> Vec<&Channel> {
        known().filter(|channel| channel.carries_weight == Some(carries)).collect()
    };
    let (with, without) = (of(true), of(false));
    let text = match (named(with.iter().copied()), named(without.iter().copied())) {
        (Some(with), Some(without)) => {
            Some(format!("u of {with} carries the arm's weight, and u of {without} does not"))
        }
        (None, Some(joints)) if !matches!(purpose, Purpose::Import) => Some(format!(
            "u of {joints} comes without the arm's weight: an identification needs torques that carry it"
        )),
        _ => None,
    };
    let size = without.len() as f64;
    doubts.extend(text.map(|text| Doubt {
        kind: Kind::Weight,
        joints: columns(&without),
        size,
        text,
    }));
    if purpose.has_load() {
        return;
    }
    for channel in known() {
        let is_part = |share: &Measurement| {
            let distance = share.value.abs().min((share.value - 1.0).abs());
            distance > 0.3 && distance > CLEAR * share.deviation
        };
        if let Some(share) = channel.gravity.filter(is_part) {
            let (joint, percent) = (channel.column + 1, 100.0 * share.value);
            let deviation = 100.0 * share.deviation;
            let text = format!(
                "u of joint {joint} carries {percent:.0} ± {deviation:.0} % of the arm's weight: is there a load, or is \
                 a part of it compensated?"
            );
            let (kind, joints) = (Kind::ShareOfWeight, vec![channel.column]);
            doubts.push(Doubt { kind, joints, size: (share.value - 1.0).abs(), text });
        }
    }
}

/// A torque that is held until the next sample acts half a sample later than its own time.
fn of_delays(channels: &[Channel], period_s: f64, purpose: Purpose, doubts: &mut Vec<Doubt>) {
    let is_doubtful = |delay: &Measurement| {
        let allowed = 0.6 * period_s + CLEAR * delay.deviation;
        delay.value.abs() > allowed && !purpose.finds_delay(delay)
    };
    let late = || {
        let delayed = |channel: &Channel| channel.delay_s.filter(is_doubtful);
        channels.iter().filter_map(move |channel| Some((channel, delayed(channel)?)))
    };
    for (word, sign) in [("later", 1.0), ("earlier", -1.0)] {
        let found = late().filter(|(_, delay)| delay.value * sign > 0.0);
        let (found, delays): (Vec<&Channel>, Vec<f64>) =
            found.map(|(channel, delay)| (channel, delay.value.abs())).unzip();
        if let Some(joints) = named(found.iter().copied()) {
            let range = range(delays.iter().map(|delay| 1e3 * delay));
            let text = format!("u of {joints} seems to be recorded {range} ms {word} than q");
            let size = delays.iter().copied().fold(0.0, f64::max);
            doubts.push(Doubt { kind: Kind::Delay, joints: columns(&found), size, text });
        }
    }
}

fn columns(channels: &[&Channel]) -> Vec<usize> {
    channels.iter().map(|channel| channel.column).collect()
}

/// `joints 1, 2 and 5`. `None` without any.
fn named<'a>(channels: impl Iterator<Item = &'a Channel>) -> Option<String> {
    joints(channels.map(|channel| channel.column + 1))
}
