//! References: joint motions that controllers follow, drawn per trajectory.

use std::f64::consts::TAU;

use serde::Serialize;
use simd::{F64Array, Lanes};
use spec::{Family, MAX_JOINTS, MoveProfile};

use crate::Joints;
use crate::hand_path::HandPath;

/// The reference of one trajectory. Times are from the start of the motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Reference {
    /// A Fourier series of each joint.
    Fourier(FourierSeries),
    /// Moves from posture to posture.
    PointToPoint(PointToPointMoves),
    /// A motion past postures.
    ViaPoints(ViaPoints),
    /// The joints' motion for a path of the hand.
    HandPath(Box<HandPath>),
}

/// r(t) = offset + Σ (sine_k sin 2πkft + cosine_k cos 2πkft), k = 1, 2, ..
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FourierSeries {
    /// f, Hz.
    pub frequency_hz: f64,
    /// rad.
    pub offset_rad: Joints<f64>,
    /// The coefficients of each k, from 1.
    pub harmonics: Vec<Harmonic>,
}

/// The coefficients of a frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Harmonic {
    /// rad.
    pub sine_rad: Joints<f64>,
    /// rad.
    pub cosine_rad: Joints<f64>,
}

/// Move k leads from posture k to k + 1. It starts at k periods and takes `moving` of a period.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PointToPointMoves {
    /// Time between two starts, s.
    pub period_s: f64,
    /// Share of a period.
    pub moving: f64,
    /// The course of every move.
    pub profile: MoveProfile,
    /// rad.
    pub postures_rad: Vec<Joints<f64>>,
}

/// The uniform cubic B-spline with the postures as control points. From k periods to k + 1 it
/// depends on the postures k to k + 3.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViaPoints {
    /// Time between two knots, s.
    pub period_s: f64,
    /// rad.
    pub postures_rad: Vec<Joints<f64>>,
}

/// A reference and its derivatives at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReferenceState {
    /// rad.
    pub r: Joints<f64>,
    /// rad/s.
    pub rd: Joints<f64>,
    /// rad/s².
    pub rdd: Joints<f64>,
}

impl Reference {
    /// The family of this reference.
    pub fn family(&self) -> Family {
        match self {
            Self::Fourier(_) => Family::Fourier,
            Self::PointToPoint(_) => Family::PointToPoint,
            Self::ViaPoints(_) => Family::ViaPoints,
            Self::HandPath(_) => Family::HandPaths,
        }
    }

    /// The reference at time `t` from the start of the motion, s.
    #[inline(always)]
    pub fn at(&self, t: f64) -> ReferenceState {
        match self {
            Self::Fourier(series) => series.at(t),
            Self::PointToPoint(moves) => moves.at(t),
            Self::ViaPoints(spline) => spline.at(t),
            Self::HandPath(path) => path.at(t),
        }
    }
}

impl ReferenceState {
    #[inline(always)]
    pub(crate) fn from_padded(
        joints: usize,
        r: [f64; MAX_JOINTS],
        rd: [f64; MAX_JOINTS],
        rdd: [f64; MAX_JOINTS],
    ) -> Self {
        Self {
            r: Joints::from_padded(joints, r),
            rd: Joints::from_padded(joints, rd),
            rdd: Joints::from_padded(joints, rdd),
        }
    }
}

const ZERO: [f64; MAX_JOINTS] = [0.0; MAX_JOINTS];

impl FourierSeries {
    #[inline(always)]
    pub(crate) fn at(&self, t: f64) -> ReferenceState {
        let (mut r, mut rd, mut rdd) = (*self.offset_rad.padded(), ZERO, ZERO);
        let turn = sin_cos(TAU * self.frequency_hz * t);
        let (mut sin, mut cos) = turn;
        for number in 0..self.harmonics.len() {
            let w = TAU * self.frequency_hz * (number + 1) as f64;
            let harmonic = &self.harmonics[number];
            let (sine, cosine) = (harmonic.sine_rad.padded(), harmonic.cosine_rad.padded());
            for joint in 0..MAX_JOINTS {
                let (a, b) = (sine[joint], cosine[joint]);
                let (value, slope) = (a * sin + b * cos, a * cos - b * sin);
                r[joint] += value;
                rd[joint] += w * slope;
                rdd[joint] -= w * w * value;
            }
            (sin, cos) = (sin * turn.1 + cos * turn.0, cos * turn.1 - sin * turn.0);
        }
        ReferenceState::from_padded(self.offset_rad.len(), r, rd, rdd)
    }
}

/// Sine and cosine with the same bits on every machine.
#[inline(always)]
pub(crate) fn sin_cos(angle: f64) -> (f64, f64) {
    let (sin, cos) = F64Array::<1>::splat(angle).sin_cos();
    (sin.lane(0), cos.lane(0))
}

impl PointToPointMoves {
    #[inline(always)]
    fn at(&self, t: f64) -> ReferenceState {
        let (k, since) = part(t, self.period_s, self.postures_rad.len() - 2);
        let duration = self.moving * self.period_s;
        let [s, sd, sdd] = course(self.profile, (since / duration).min(1.0));
        let (from, to) = (self.postures_rad[k].padded(), self.postures_rad[k + 1].padded());
        let (mut r, mut rd, mut rdd) = (ZERO, ZERO, ZERO);
        for joint in 0..MAX_JOINTS {
            let distance = to[joint] - from[joint];
            r[joint] = from[joint] + s * distance;
            rd[joint] = sd * distance / duration;
            rdd[joint] = sdd * distance / (duration * duration);
        }
        ReferenceState::from_padded(self.postures_rad[k].len(), r, rd, rdd)
    }
}

/// The period at time `t`, at most `last`, and the time since it began.
#[inline(always)]
fn part(t: f64, period_s: f64, last: usize) -> (usize, f64) {
    let k = whole(t / period_s).min(last);
    (k, t - k as f64 * period_s)
}

/// The whole part of a number that is not negative.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checks bound durations and the number of postures"
)]
pub(crate) fn whole(number: f64) -> usize {
    number as usize
}

/// The share of a move's distance at the share `s` of its time, and its derivatives by `s`.
#[inline(always)]
fn course(profile: MoveProfile, s: f64) -> [f64; 3] {
    match profile {
        MoveProfile::MinimumJerk => [
            s * s * s * (10.0 + s * (6.0 * s - 15.0)),
            30.0 * s * s * (1.0 + s * (s - 2.0)),
            60.0 * s * (1.0 + s * (2.0 * s - 3.0)),
        ],
        // The speed rises to 1.5 within a third.
        MoveProfile::Trapezoid if s < 1.0 / 3.0 => [2.25 * s * s, 4.5 * s, 4.5],
        MoveProfile::Trapezoid if s <= 2.0 / 3.0 => [1.5 * s - 0.25, 1.5, 0.0],
        MoveProfile::Trapezoid if s < 1.0 => {
            let left = 1.0 - s;
            [1.0 - 2.25 * left * left, 4.5 * left, -4.5]
        }
        MoveProfile::Trapezoid => [1.0, 0.0, 0.0],
    }
}

/// The largest derivative of [`course`] by the share of time.
pub(crate) fn largest_speed(profile: MoveProfile) -> f64 {
    match profile {
        MoveProfile::MinimumJerk => 1.875,
        MoveProfile::Trapezoid => 1.5,
    }
}

impl ViaPoints {
    #[inline(always)]
    fn at(&self, t: f64) -> ReferenceState {
        let (k, since) = part(t, self.period_s, self.postures_rad.len() - 4);
        let s = since / self.period_s;
        let left = 1.0 - s;
        let value = [
            left * left * left,
            4.0 + s * s * (3.0 * s - 6.0),
            1.0 + 3.0 * s * (1.0 + s * (1.0 - s)),
            s * s * s,
        ];
        let slope = [-left * left, s * (3.0 * s - 4.0), 1.0 + s * (2.0 - 3.0 * s), s * s];
        let curvature = [left, 3.0 * s - 2.0, 1.0 - 3.0 * s, s];
        let postures = &self.postures_rad[k..k + 4];
        let (speed, acceleration) = (0.5 / self.period_s, 1.0 / (self.period_s * self.period_s));
        ReferenceState::from_padded(
            postures[0].len(),
            weighted(postures, value, 1.0 / 6.0),
            weighted(postures, slope, speed),
            weighted(postures, curvature, acceleration),
        )
    }
}

/// `scale` times the sum of four postures with weights.
#[inline(always)]
fn weighted(postures: &[Joints<f64>], weights: [f64; 4], scale: f64) -> [f64; MAX_JOINTS] {
    let mut sums = ZERO;
    for posture in 0..4 {
        let values = postures[posture].padded();
        for joint in 0..MAX_JOINTS {
            sums[joint] += values[joint] * weights[posture];
        }
    }
    for joint in 0..MAX_JOINTS {
        sums[joint] *= scale;
    }
    sums
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use spec::Range;

    use super::*;
    use crate::draws::{Draws, Purpose};
    use crate::planner::polynomials;
    use crate::room::{Limits, Room};

    fn room() -> Room {
        let limits = |joint: usize| Limits {
            least: -2.0 - joint as f64,
            center: 0.3 * joint as f64,
            most: 2.5,
            speed: 1.0 + 0.5 * joint as f64,
        };
        Room { limits: Joints::from_fn(3, limits) }
    }

    /// A reference of each family that lasts 20 s.
    fn references(seed: u64, share: f64) -> Vec<Reference> {
        let frequency_hz = spec::Frequency::Fixed(0.4);
        let (reach, speed) = (0.6, Range::new(share, share));
        let fourier =
            spec::FourierSeries { frequency_hz: frequency_hz.clone(), harmonics: 5, reach, speed };
        let moves = |profile| spec::PointToPointMoves {
            frequency_hz: frequency_hz.clone(),
            profile,
            moving: 0.7,
            reach,
            speed,
        };
        let spline = spec::ViaPoints { frequency_hz: frequency_hz.clone(), reach, speed };
        let draws = || Draws::new(seed, 0, Purpose::Reference, 1);
        let room = room();
        vec![
            room.draw_fourier(&fourier, 0.4, &mut draws()),
            room.draw_moves(&moves(MoveProfile::MinimumJerk), 0.4, 20.0, &mut draws()),
            room.draw_moves(&moves(MoveProfile::Trapezoid), 0.4, 20.0, &mut draws()),
            room.draw_spline(&spline, 0.4, 20.0, &mut draws()),
        ]
    }

    proptest! {
        #[test]
        fn references_stay_within_their_reach_and_their_speed(seed in 0u64..1000, share in 0.01..1.0) {
            for reference in references(seed, share) {
                for instant in 0..2000 {
                    let state = reference.at(f64::from(instant) * 0.01);
                    for (joint, limits) in room().limits.iter().enumerate() {
                        let room = limits.within(0.6);
                        let wide = 0.005 * (room.max - room.min);
                        let r = state.r[joint];
                        prop_assert!(room.min - wide <= r && r <= room.max + wide, "{joint}: {r}");
                        let fastest = 1.005 * share * limits.speed;
                        prop_assert!(state.rd[joint].abs() <= fastest, "{joint}");
                    }
                }
            }
        }

        #[test]
        fn velocities_and_accelerations_are_derivatives(seed in 0u64..1000, t in 0.01..19.9) {
            const STEP: f64 = 1e-4;
            for reference in references(seed, 0.5) {
                let [before, now, after] = [-STEP, 0.0, STEP].map(|step| reference.at(t + step));
                for joint in 0..3 {
                    let slope = (after.r[joint] - before.r[joint]) / (2.0 * STEP);
                    prop_assert!((slope - now.rd[joint]).abs() < 2e-3, "velocity {slope}");
                    // The acceleration of a trapezoid jumps.
                    if !matches!(&reference, Reference::PointToPoint(moves) if moves.profile == MoveProfile::Trapezoid) {
                        let slope = (after.rd[joint] - before.rd[joint]) / (2.0 * STEP);
                        prop_assert!((slope - now.rdd[joint]).abs() < 2e-2, "acceleration {slope}");
                    }
                }
            }
        }
    }

    #[test]
    fn interpolation_between_samples_is_close_to_the_reference() {
        let period_s = 1.0 / 60.0;
        for reference in references(7, 0.5) {
            for sample in 0..600 {
                let [from, to] =
                    [sample, sample + 1].map(|sample| reference.at(f64::from(sample) * period_s));
                let powers = polynomials(period_s, &from, &to);
                for joint in 0..3 {
                    let at = |s: f64| powers.iter().rev().fold(0.0, |sum, c| sum * s + c[joint]);
                    assert!((at(0.0) - from.r[joint]).abs() < 1e-12);
                    assert!((at(1.0) - to.r[joint]).abs() < 1e-12);
                    let exact = reference.at((f64::from(sample) + 0.5) * period_s);
                    // Where a trapezoid's acceleration jumps, the polynomial is smoother.
                    let tolerance = match &reference {
                        Reference::PointToPoint(_) => 3e-4,
                        _ => 1e-7,
                    };
                    assert!((at(0.5) - exact.r[joint]).abs() < tolerance);
                }
            }
        }
    }

    #[test]
    fn moves_rest_at_their_postures() {
        for reference in &references(3, 0.5)[1..3] {
            let Reference::PointToPoint(moves) = reference else { panic!("{reference:?}") };
            for (k, posture) in moves.postures_rad.iter().enumerate().take(8) {
                let state = reference.at(k as f64 * moves.period_s + 1e-12);
                assert!(state.rd.iter().all(|speed| speed.abs() < 1e-9));
                for joint in 0..3 {
                    assert!((state.r[joint] - posture[joint]).abs() < 1e-9);
                }
                let resting = reference.at((k as f64 + 0.9) * moves.period_s);
                assert_eq!(resting.rd[0], 0.0);
            }
        }
    }
}
