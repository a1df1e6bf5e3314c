//! A channel of torques beside the torques of the joint that it belongs to.

use nalgebra::DVector;
use rayon::prelude::*;
use wire::{ChannelCheck, Measurement};

use super::delay::{self, Unknown};
use super::layout::Layout;
use super::regression::{Fit, LEAST_SHARE, Regression};
use super::rows::{GRAVITY, JointRows, REST, States};
use crate::arm::Prior;
use crate::torques::samples_alike;

/// A joint that moves less says nothing, because its friction may hold any torque, rad.
const LEAST_RANGE_RAD: f64 = 0.03;

/// A number is told if it is so many standard deviations from 0.
const CLEAR: f64 = 5.0;

/// Gravity is told if the other answer costs this much more: a likelihood of 3000 to 1.
const CLEAR_COST: f64 = 8.0;

/// The largest standard deviation of a share of gravity that is told.
const LARGEST_DEVIATION: f64 = 0.2;

/// A channel is its joint's position, in rad or degrees, if it differs from it by less than this share
/// of the position's standard deviation. A commanded position is a little ahead.
const LARGEST_DIFFERENCE: f64 = 0.15;

/// The findings about a column of torques.
#[derive(Clone)]
pub struct Channel {
    /// The column, as declared.
    pub column: usize,
    pub delay_s: Option<Measurement>,
    pub sign: Option<i8>,
    pub scale: Option<Measurement>,
    /// Recorded torque per torque of the arm against gravity, and per the rest of it.
    pub of_weight: Option<Measurement>,
    pub of_rest: Option<Measurement>,
    pub carries_weight: Option<bool>,
    pub gravity: Option<Measurement>,
    pub explained: Option<f64>,
    /// Standard deviation of the torque.
    pub deviation_nm: f64,
    pub is_constant: bool,
    /// Whether it has the joint's position in rad or degrees in the place of torques.
    pub is_position: bool,
    unseen: Vec<String>,
}

/// Whether the delay of a channel is sought. Torques that are cut off are known at their own times
/// only.
#[derive(Clone, Copy)]
enum Delay {
    Sought,
    NotSought,
}

/// The better of two regressions: the torques carry the arm's weight, or not.
struct Compared {
    regression: Regression,
    fit: Fit,
    /// How much more the other one costs. Above 0 if the torques carry the weight.
    in_favour_of_weight: f64,
    /// Standard deviation of the torque.
    deviation_nm: f64,
    /// The share of its variance that is left.
    left: f64,
}

impl Channel {
    /// All channels, in the order of their columns.
    pub fn all(arm: &Prior, states: &States<'_>, layout: &Layout) -> Vec<Self> {
        let joints = layout.torques.len();
        if !states.are_enough() {
            let unseen = "no recording is long enough".to_owned();
            return (0..joints).map(|column| Self::unseen(column, unseen.clone())).collect();
        }
        let columns = states.columns(arm, layout);
        let mut channels: Vec<Self> = (0..joints)
            .into_par_iter()
            .map(|joint| {
                let (column, position) = (layout.torques[joint], layout.positions[joint].0);
                let range_rad = states.range_rad(position);
                if range_rad < LEAST_RANGE_RAD {
                    let moves = format!("the joint moves by {:.2}° only", range_rad.to_degrees());
                    return Self::unseen(column, moves);
                }
                let Some(places) = states.without_cuts(column) else {
                    return Self::of(&columns[joint], column, states, Delay::Sought);
                };
                let kept = states.kept(&places);
                if !kept.are_enough() {
                    let cut = "the torque is cut off nearly everywhere".to_owned();
                    return Self::unseen(column, cut);
                }
                Self::of(&columns[joint].kept(&places), column, &kept, Delay::NotSought)
            })
            .collect();
        channels.sort_by_key(|channel| channel.column);
        for channel in &mut channels {
            channel.is_position = !channel.fits() && is_position(states, channel.column);
        }
        channels
    }

    /// Whether the arm's torque is about as large as the channel. Some joint has a torque in N·m that is
    /// about its position in rad.
    fn fits(&self) -> bool {
        self.scale.is_some_and(|scale| (0.5..2.0).contains(&scale.value))
    }

    /// Recorded torque per torque of the arm without its weight, if that is clearly above 0.
    pub fn clear_rest(&self) -> Option<f64> {
        let rest = self.of_rest.filter(is_clear)?;
        Some(rest.value).filter(|value| *value > 0.0)
    }

    pub fn report(&self) -> ChannelCheck {
        let Self { delay_s, sign, scale, carries_weight, gravity, explained, .. } = *self;
        let joint = u32::try_from(self.column + 1).unwrap_or(u32::MAX);
        let unseen = (!self.unseen.is_empty()).then(|| self.unseen.join("; "));
        ChannelCheck { joint, delay_s, sign, scale, carries_weight, gravity, explained, unseen }
    }

    fn unseen(column: usize, why: String) -> Self {
        Self {
            column,
            delay_s: None,
            sign: None,
            scale: None,
            of_weight: None,
            of_rest: None,
            carries_weight: None,
            gravity: None,
            explained: None,
            deviation_nm: 0.0,
            is_constant: false,
            is_position: false,
            unseen: vec![why],
        }
    }

    fn of(columns: &JointRows, column: usize, states: &States<'_>, delay: Delay) -> Self {
        let torques = states.torques(column, 0.0);
        let mean_square = torques.norm_squared() / torques.len() as f64;
        if torques.variance() <= 1e-12 * mean_square.max(1e-12) {
            let constant = Self::unseen(column, "the torque is constant".to_owned());
            return Self { is_constant: true, ..constant };
        }
        let singular = || Self::unseen(column, "its regression is singular".to_owned());
        let Some(first) = Compared::new(columns, &torques, states) else { return singular() };
        let costs = |compared: &Compared, later_s: f64| {
            let shifted = states.torques(column, later_s);
            compared.fit.cost(&compared.regression.moments(&shifted))
        };
        if matches!(delay, Delay::NotSought) {
            return first.channel(column, Err(Unknown::Cut));
        }
        // Only near its delay a channel has little noise, which tells the delay well.
        let near_s = delay::nearest_s(|later_s| costs(&first, later_s));
        let torques = states.torques(column, near_s);
        let Some(again) = Compared::new(columns, &torques, states) else { return singular() };
        let delay = delay::find(|later_s| costs(&again, later_s), states.period_s());
        let compared = if delay.is_ok() { again } else { first };
        compared.channel(column, delay)
    }
}

impl Compared {
    fn new(columns: &JointRows, torques: &DVector<f64>, states: &States<'_>) -> Option<Self> {
        let fitted = |gravity: f64| {
            let regression = Regression::new(columns.design(gravity), gravity);
            let moments = regression.moments(torques);
            let fit = regression.fit(&moments, 4.0)?;
            let residuals = torques - &regression.design * &fit.coefficients;
            let alike = samples_alike(residuals.as_slice(), &states.begins, &[]);
            let fit = regression.fit(&moments, alike)?;
            Some((regression, fit, alike))
        };
        let (with, without) = (fitted(1.0)?, fitted(0.0)?);
        // Both are judged by the same number of independent rows.
        let count = torques.len() as f64 / with.2.max(without.2);
        let least = LEAST_SHARE * torques.variance() * torques.len() as f64;
        let cost = |fit: &Fit, offence: f64| {
            0.5 * count * fit.left.max(least).ln() + fit.distance + 0.5 * offence
        };
        let of_with = cost(&with.1, with.1.square_of_difference());
        let of_without = cost(&without.1, without.1.square_of_weight());
        let in_favour_of_weight = of_without - of_with;
        let (regression, fit, _) = if in_favour_of_weight >= 0.0 { with } else { without };
        let left = fit.left / (torques.variance() * torques.len() as f64);
        let deviation_nm = torques.variance().sqrt();
        Some(Self { regression, fit, in_favour_of_weight, deviation_nm, left })
    }

    /// The findings of the regression about the channel.
    fn channel(&self, column: usize, delay: Result<Measurement, Unknown>) -> Channel {
        let fit = &self.fit;
        let [weight, rest] = [GRAVITY, REST].map(|column| fit.measurement(column));
        let gravity = Some(fit.share_of_weight())
            .filter(|share| is_clear(&rest) && share.deviation < LARGEST_DEVIATION);
        let is_plausible = |allowed: std::ops::Range<f64>| {
            gravity.is_none_or(|share| allowed.contains(&share.value))
        };
        // Without the weight, it must be clear that the weight would be seen.
        let would_be_seen = 0.5 * rest.value.abs() > 3.0 * weight.deviation;
        let carries_weight = if self.in_favour_of_weight > CLEAR_COST
            && is_clear(&weight)
            && is_plausible(0.5..f64::INFINITY)
        {
            Some(true)
        } else if self.in_favour_of_weight < -CLEAR_COST
            && is_clear(&rest)
            && would_be_seen
            && is_plausible(-0.5..0.5)
        {
            Some(false)
        } else {
            None
        };
        let scale = match carries_weight {
            Some(true) => fit.common_scale(),
            Some(false) => fit.scale_without_weight(),
            None => rest,
        };
        let scale = Some(scale).filter(is_clear);
        // Friction and elastic gears have delays of their own.
        let delay = if scale.is_some() { delay } else { Err(Unknown::Flat) };
        let by_arm = scale.map(|scale| sign_of(scale.value));
        let friction = self.regression.friction(fit);
        let by_friction = is_clear(&friction).then(|| sign_of(friction.value));
        let mut unseen = Vec::new();
        let sign = match (by_arm, by_friction) {
            (Some(a), Some(b)) if a != b => {
                unseen.push("the sign: friction has another one than the arm's torque".to_owned());
                None
            }
            (by_arm, by_friction) => by_arm.or(by_friction),
        };
        if scale.is_none() {
            unseen.push("the scale: the arm's torque hardly shows".to_owned());
        }
        if carries_weight.is_none() {
            unseen.push("gravity: the motion or the torques show too little of it".to_owned());
        }
        match delay {
            Ok(_) => {}
            Err(Unknown::Flat) => {
                unseen.push("the delay: the arm's torque changes too slowly".to_owned())
            }
            Err(Unknown::Ambiguous) => {
                unseen.push("the delay: more than one fits".to_owned());
            }
            Err(Unknown::Cut) => {
                unseen.push("the delay: torques are cut off".to_owned());
            }
            Err(Unknown::Beyond) => {
                let most_ms = delay::LARGEST_S * 1e3;
                unseen.push(format!("the delay: none within {most_ms} ms fits"));
            }
        }
        Channel {
            column,
            delay_s: delay.ok(),
            sign,
            scale,
            of_weight: Some(weight),
            of_rest: Some(rest),
            carries_weight,
            gravity,
            deviation_nm: self.deviation_nm,
            explained: Some((1.0 - self.left).clamp(0.0, 1.0)),
            is_constant: false,
            is_position: false,
            unseen,
        }
    }
}

/// Whether a column of u is that of q, in rad or degrees.
fn is_position(states: &States<'_>, column: usize) -> bool {
    let (torques, positions) = (states.torques(column, 0.0), states.positions(column));
    states.range_rad(column) >= LEAST_RANGE_RAD
        && [1.0, 1.0_f64.to_degrees()].into_iter().any(|per_rad| {
            let difference = &torques - &positions * per_rad;
            let mean_square = difference.norm_squared() / difference.len() as f64;
            mean_square.sqrt() < LARGEST_DIFFERENCE * per_rad * positions.variance().sqrt()
        })
}

/// Whether a number is not 0.
fn is_clear(number: &Measurement) -> bool {
    number.value.abs() > CLEAR * number.deviation
}

fn sign_of(value: f64) -> i8 {
    if value < 0.0 { -1 } else { 1 }
}
