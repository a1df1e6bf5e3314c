//! Sentences about probable mistakes in a recording.

use wire::Measurement;

use super::Comparison;
use super::channel::Channel;
use super::limits::Reached;
use crate::wording::{digits, joints, range};

/// A description is rarely further off. A scale that is off more than this is doubtful.
const USUAL_SCALE: f64 = 1.5;

/// How far a scale must be from 1 or from a unit's, in standard deviations.
const CLEAR: f64 = 3.0;

/// A channel that the arm explains less is doubtful, if more than noise is left: a hundredth of the
/// largest channel. Real arms explain 95 % and more.
const USUALLY_EXPLAINED: f64 = 0.8;
const NOISE: f64 = 0.01;

/// A channel that the arm explains less is doubtful, noise or not.
const LEAST_EXPLAINED: f64 = 0.5;

/// How far a position may be beyond its limit, rad, and a speed or a torque as a share of its limit.
const BEYOND_RAD: f64 = 0.05;
const BEYOND: f64 = 1.1;

/// Units that torques are often in, and how many make one N·m.
const UNITS: [(&str, f64); 3] = [("mN·m", 1e3), ("N·cm", 1e2), ("kN·m", 1e-3)];

/// The use of a recording.
#[derive(Clone, Copy)]
pub enum Purpose {
    Import,
    /// Gains have this standard deviation around 1, and a delay of the torques is found up to this, s.
    Identification {
        gain_deviation: f64,
        most_delay_s: f64,
    },
}

impl Purpose {
    /// Whether a scale of the torques is found later.
    fn finds_scale(self, size: f64) -> bool {
        match self {
            Self::Import => false,
            Self::Identification { gain_deviation, .. } => size.ln().abs() < CLEAR * gain_deviation,
        }
    }

    /// The share of a limit from which a torque is doubtful. A gain may be off.
    fn doubtful_torque(self) -> f64 {
        match self {
            Self::Import => BEYOND,
            Self::Identification { gain_deviation, .. } => BEYOND * (CLEAR * gain_deviation).exp(),
        }
    }

    /// Whether a delay is found later.
    fn finds_delay(self, delay: &Measurement) -> bool {
        match self {
            Self::Import => false,
            Self::Identification { most_delay_s, .. } => delay.value.abs() < most_delay_s,
        }
    }

    /// The name of the field with gains.
    const fn gains(self) -> &'static str {
        match self {
            Self::Import => "columns.gains",
            Self::Identification { .. } => "gains",
        }
    }
}

pub fn of(found: &Comparison, purpose: Purpose) -> Vec<String> {
    let channels = found.channels.as_slice();
    let mut doubts = Vec::new();
    of_layout(found, &mut doubts);
    of_signs(found, &mut doubts);
    let other_rates = of_rates(channels, &mut doubts);
    let before = doubts.len();
    of_scales(channels, &other_rates, purpose, &mut doubts);
    let has_other_scale = doubts.len() > before || !other_rates.is_empty();
    of_gravity(channels, &other_rates, purpose, &mut doubts);
    of_delays(channels, found.period_s, purpose, &mut doubts);
    let constant = named(channels.iter().filter(|channel| channel.is_constant));
    if let Some(joints) = constant {
        doubts.push(format!("u of {joints} is constant"));
    }
    of_unexplained(channels, &mut doubts);
    of_motion_limits(found, &mut doubts);
    // Another unit or rate is rarely that of one column.
    if !has_other_scale {
        of_torque_limits(found, purpose, &mut doubts);
    }
    doubts
}

/// Positions and speeds that the description does not allow, in columns that look like those of their
/// joints.
fn of_motion_limits(found: &Comparison, doubts: &mut Vec<String>) {
    let Comparison { layout, ties, .. } = found;
    let is_as_declared = |joint: usize| {
        layout.positions[joint].0 == joint
            && layout.has_declared_sign(joint)
            && !ties.signs.contains(&joint)
    };
    let joints = || found.farthest.iter().enumerate().filter(|(joint, _)| is_as_declared(*joint));
    let positions = joints().filter(|(_, farthest)| farthest.beyond_rad > BEYOND_RAD);
    if let Some(list) = beyond(positions.map(|(joint, farthest)| (joint, farthest.position)), "rad")
    {
        doubts.push(format!(
            "q goes beyond the limits of the robot: {list}. Are the unit of angles, the zero positions and the order of \
             the joints those of the robot?"
        ));
    }
    let speeds = joints().filter(|(_, farthest)| farthest.speed.share() > BEYOND);
    if let Some(list) = beyond(speeds.map(|(joint, farthest)| (joint, farthest.speed)), "rad/s") {
        doubts.push(format!(
            "the speed goes beyond the limits of the robot: {list}. Are the unit of angles and the rate of the rows right?"
        ));
    }
}

/// Torques that the description does not allow, in columns that look like those of their joints.
fn of_torque_limits(found: &Comparison, purpose: Purpose, doubts: &mut Vec<String>) {
    let is_doubtful = |joint: usize, torque: Reached| {
        found.layout.torques[joint] == joint && torque.share() > purpose.doubtful_torque()
    };
    let torques = found.farthest.iter().map(|farthest| farthest.torque).enumerate();
    let torques = torques.filter(|(joint, torque)| is_doubtful(*joint, *torque));
    if let Some(list) = beyond(torques, "N·m") {
        doubts.push(format!(
            "u goes beyond the limits of the robot: {list}. Are the unit of u and the order of the joints those of the \
             robot?"
        ));
    }
}

/// `joint 3 reaches 3.1 of 2.9 rad, joint 5 reaches 2 of 1.5 rad`. `None` without any.
fn beyond(joints: impl Iterator<Item = (usize, Reached)>, unit: &str) -> Option<String> {
    let of_joint = |(joint, Reached { value, limit }): (usize, Reached)| {
        format!("joint {} reaches {} of {} {unit}", joint + 1, digits(value), digits(limit))
    };
    let list: Vec<String> = joints.map(of_joint).collect();
    (!list.is_empty()).then(|| list.join(", "))
}

fn of_unexplained(channels: &[Channel], doubts: &mut Vec<String>) {
    let largest = channels.iter().map(|channel| channel.deviation_nm).fold(0.0, f64::max);
    for channel in channels {
        let Some(explained) = channel.explained else { continue };
        let left_nm = channel.deviation_nm * (1.0 - explained).sqrt();
        let is_noise = left_nm < NOISE * largest;
        if explained < LEAST_EXPLAINED || (explained < USUALLY_EXPLAINED && !is_noise) {
            let (joint, percent) = (channel.column + 1, 100.0 * explained);
            doubts.push(format!(
                "the arm explains {percent:.0} % of the variance of u of joint {joint}: are the columns, the units of \
                 angles and the zero positions those of the robot?"
            ));
        }
    }
}

fn of_layout(found: &Comparison, doubts: &mut Vec<String>) {
    let layout = &found.layout;
    let positions: Vec<usize> = layout.positions.iter().map(|(column, _)| *column).collect();
    if positions == layout.torques {
        doubts.extend(
            moved(&positions).map(|order| format!("joints look exchanged: {order} of q and u")),
        );
        return;
    }
    for (name, other, columns) in [("q", "u", &positions), ("u", "q", &layout.torques)] {
        let Some(order) = moved(columns) else { continue };
        doubts.push(match found.ties.is_exchange_tied {
            true => format!(
                "columns of {name} or of {other} look exchanged: {order}. The torques do not tell of which"
            ),
            false => format!("columns of {name} look exchanged: {order} of {name}"),
        });
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

fn of_signs(found: &Comparison, doubts: &mut Vec<String>) {
    let Comparison { layout, channels, ties, .. } = found;
    for (joint, torque) in layout.torques.iter().enumerate() {
        let sign = channels.iter().find(|channel| channel.column == *torque);
        let is_turned = sign.and_then(|channel| channel.sign) == Some(-1);
        let is_tied = ties.signs.contains(&joint);
        let number = joint + 1;
        match (layout.has_declared_sign(joint), is_turned) {
            (false, true) => doubts.push(format!(
                "joint {number} seems to turn the other way than in the robot's description: q and u have the other sign"
            )),
            (false, false) => {
                doubts.push(format!("q of joint {number} seems to have the other sign"));
            }
            (true, true) if is_tied => doubts.push(format!(
                "u or q of joint {number} seems to have the other sign. The torques do not tell which"
            )),
            (true, true) => {
                doubts.push(format!("u of joint {number} seems to have the other sign"));
            }
            (true, false) => {}
        }
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
fn of_rates(channels: &[Channel], doubts: &mut Vec<String>) -> Vec<usize> {
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
    let rate = range(factors);
    doubts.push(format!(
        "u of {joints} fits the arm's weight but not its accelerations: with {rate} times the rate of the rows it \
         would. Look at columns.time, units.time and rate_hz"
    ));
    found.iter().map(|channel| channel.column).collect()
}

/// `other_rates` are columns whose scale is that of another rate.
fn of_scales(
    channels: &[Channel],
    other_rates: &[usize],
    purpose: Purpose,
    doubts: &mut Vec<String>,
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
    for (name, _) in UNITS {
        let found = || odd.iter().filter(|(unit, ..)| *unit == Some(name));
        if let Some(joints) = named(found().map(|(_, channel, _)| *channel)) {
            let sizes = found().map(|(.., size)| *size);
            let range = range(sizes);
            doubts
                .push(format!("u of {joints} is {range} times the arm's torque: is it in {name}?"));
        }
    }
    let unnamed = || odd.iter().filter(|(unit, ..)| unit.is_none());
    if let Some(joints) = named(unnamed().map(|(_, channel, _)| *channel)) {
        let (times, gains) = (range(unnamed().map(|(.., size)| *size)), unnamed());
        let gains: Vec<String> = gains.map(|(.., size)| digits(1.0 / size)).collect();
        let (field, gains) = (purpose.gains(), gains.join(", "));
        doubts.push(if looks_like_a_load(channels) {
            format!(
                "u of {joints} is {times} times the arm's torque, and more so towards the hand: does it carry a load \
                 that the robot's description lacks? Otherwise {field} of {gains} would fit"
            )
        } else {
            format!(
                "u of {joints} is {times} times the arm's torque: a motor's current, another unit, a load, or a wrong \
                 rate of the rows? If it is a current, {field} of {gains} would fit"
            )
        });
    }
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
    doubts: &mut Vec<String>,
) {
    let known = || channels.iter().filter(|channel| !other_rates.contains(&channel.column));
    let of =
        |carries: bool| named(known().filter(|channel| channel.carries_weight == Some(carries)));
    match (of(true), of(false)) {
        (Some(with), Some(without)) => doubts
            .push(format!("u of {with} carries the arm's weight, and u of {without} does not")),
        (None, Some(joints)) if matches!(purpose, Purpose::Identification { .. }) => {
            doubts.push(format!(
                "u of {joints} comes without the arm's weight: an identification needs torques that carry it"
            ));
        }
        _ => {}
    }
    for channel in known() {
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
fn of_delays(channels: &[Channel], period_s: f64, purpose: Purpose, doubts: &mut Vec<String>) {
    let is_doubtful = |delay: &Measurement| {
        let allowed = 0.6 * period_s + CLEAR * delay.deviation;
        delay.value.abs() > allowed && !purpose.finds_delay(delay)
    };
    let late = || {
        let delayed = |channel: &Channel| channel.delay_s.filter(is_doubtful);
        channels.iter().filter_map(move |channel| Some((channel, delayed(channel)?)))
    };
    for (word, sign) in [("later", 1.0), ("earlier", -1.0)] {
        let found = || late().filter(|(_, delay)| delay.value * sign > 0.0);
        if let Some(joints) = named(found().map(|(channel, _)| channel)) {
            let range = range(found().map(|(_, delay)| 1e3 * delay.value.abs()));
            doubts.push(format!("u of {joints} seems to be recorded {range} ms {word} than q"));
        }
    }
}

/// `joints 1, 2 and 5`. `None` without any.
fn named<'a>(channels: impl Iterator<Item = &'a Channel>) -> Option<String> {
    joints(channels.map(|channel| channel.column + 1))
}
