//! References: joint motions that controllers follow, drawn per trajectory.
//!
//! The controller's planner evaluates a reference at every sample. In between it interpolates with
//! the polynomial of degree 5 that has the same positions, velocities and accelerations at both
//! samples. So a reference costs little, whatever the rate of the controller.

use std::f64::consts::TAU;

use serde::Serialize;
use simd::{F64Array, Lanes};
use spec::{Family, MoveProfile, Range};

use crate::Joints;
use crate::draws::Draws;
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
    pub fn at(&self, t: f64) -> ReferenceState {
        match self {
            Self::Fourier(series) => series.at(t),
            Self::PointToPoint(moves) => moves.at(t),
            Self::ViaPoints(spline) => spline.at(t),
            Self::HandPath(path) => path.at(t),
        }
    }
}

impl FourierSeries {
    fn at(&self, t: f64) -> ReferenceState {
        let joints = self.offset_rad.len();
        let zero = Joints::splat(joints, 0.0);
        let mut state = ReferenceState { r: self.offset_rad, rd: zero, rdd: zero };
        let turn = sin_cos(TAU * self.frequency_hz * t);
        let (mut sin, mut cos) = turn;
        for (number, harmonic) in (1..).zip(&self.harmonics) {
            let w = TAU * self.frequency_hz * f64::from(number);
            for joint in 0..joints {
                let (a, b) = (harmonic.sine_rad[joint], harmonic.cosine_rad[joint]);
                let (value, slope) = (a * sin + b * cos, a * cos - b * sin);
                state.r[joint] += value;
                state.rd[joint] += w * slope;
                state.rdd[joint] -= w * w * value;
            }
            (sin, cos) = (sin * turn.1 + cos * turn.0, cos * turn.1 - sin * turn.0);
        }
        state
    }
}

/// Sine and cosine with the same bits on every machine.
pub(crate) fn sin_cos(angle: f64) -> (f64, f64) {
    let (sin, cos) = F64Array::<1>::splat(angle).sin_cos();
    (sin.lane(0), cos.lane(0))
}

impl PointToPointMoves {
    fn at(&self, t: f64) -> ReferenceState {
        let (k, since) = part(t, self.period_s, self.postures_rad.len() - 2);
        let duration = self.moving * self.period_s;
        let [s, sd, sdd] = course(self.profile, (since / duration).min(1.0));
        let (from, to) = (&self.postures_rad[k], &self.postures_rad[k + 1]);
        let distance = |joint: usize| to[joint] - from[joint];
        let joints = from.len();
        ReferenceState {
            r: Joints::from_fn(joints, |joint| from[joint] + s * distance(joint)),
            rd: Joints::from_fn(joints, |joint| sd * distance(joint) / duration),
            rdd: Joints::from_fn(joints, |joint| sdd * distance(joint) / (duration * duration)),
        }
    }
}

/// The period at time `t`, at most `last`, and the time since it began.
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
fn largest_speed(profile: MoveProfile) -> f64 {
    match profile {
        MoveProfile::MinimumJerk => 1.875,
        MoveProfile::Trapezoid => 1.5,
    }
}

impl ViaPoints {
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
        let joints = postures[0].len();
        let sum = |weights: [f64; 4], scale: f64| {
            Joints::from_fn(joints, |joint| {
                let terms = postures.iter().zip(weights);
                scale * terms.map(|(posture, weight)| posture[joint] * weight).sum::<f64>()
            })
        };
        ReferenceState {
            r: sum(value, 1.0 / 6.0),
            rd: sum(slope, 0.5 / self.period_s),
            rdd: sum(curvature, 1.0 / (self.period_s * self.period_s)),
        }
    }
}

/// The limits that the references of an arm keep.
pub(crate) struct Room {
    /// Those of each joint.
    pub(crate) limits: Joints<Limits>,
}

/// The limits of a joint.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Limits {
    /// rad.
    pub(crate) least: f64,
    /// rad.
    pub(crate) center: f64,
    /// rad.
    pub(crate) most: f64,
    /// rad/s.
    pub(crate) speed: f64,
}

impl Limits {
    /// The share `reach` of the range on both sides of the center.
    pub(crate) fn within(&self, reach: f64) -> Range {
        Range::new(
            self.center - reach * (self.center - self.least),
            self.center + reach * (self.most - self.center),
        )
    }
}

impl Room {
    pub(crate) fn draw_fourier(
        &self,
        spec: &spec::FourierSeries,
        frequency_hz: f64,
        draws: &mut Draws,
    ) -> Reference {
        /// Instants per period of the highest harmonic at which extremes are sought. They may be
        /// missed by half a percent.
        const INSTANTS: u32 = 32;
        const UNIT: Range = Range::new(-1.0, 1.0);

        let joints = self.limits.len();
        let share = draws.uniform(spec.speed);
        let mut harmonics = Vec::new();
        for number in 1..=spec.harmonics {
            let mut draw = || draws.uniform(UNIT) / f64::from(number);
            harmonics.push(Harmonic {
                sine_rad: Joints::from_fn(joints, |_| draw()),
                cosine_rad: Joints::from_fn(joints, |_| draw()),
            });
        }
        let zero = Joints::splat(joints, 0.0);
        let mut series = FourierSeries { frequency_hz, offset_rad: zero, harmonics };
        let (mut least, mut most, mut fastest) = (zero, zero, zero);
        let instants = INSTANTS * spec.harmonics;
        for instant in 0..instants {
            let state = series.at(f64::from(instant) / f64::from(instants) / frequency_hz);
            for joint in 0..joints {
                least[joint] = least[joint].min(state.r[joint]);
                most[joint] = most[joint].max(state.r[joint]);
                fastest[joint] = fastest[joint].max(state.rd[joint].abs());
            }
        }
        for (joint, limits) in self.limits.iter().enumerate() {
            let room = limits.within(spec.reach);
            let narrow = (room.max - room.min) / (most[joint] - least[joint]);
            let slow = share * limits.speed / fastest[joint];
            let scale = draws.uniform(Range::new(0.5, 1.0)) * narrow.min(slow);
            for harmonic in &mut series.harmonics {
                harmonic.sine_rad[joint] *= scale;
                harmonic.cosine_rad[joint] *= scale;
            }
            let free = Range::new(room.min - scale * least[joint], room.max - scale * most[joint]);
            series.offset_rad[joint] = draws.uniform(free);
        }
        Reference::Fourier(series)
    }

    pub(crate) fn draw_moves(
        &self,
        spec: &spec::PointToPointMoves,
        frequency_hz: f64,
        duration_s: f64,
        draws: &mut Draws,
    ) -> Reference {
        let period_s = 1.0 / frequency_hz;
        let share = draws.uniform(spec.speed);
        let longest_s = share * spec.moving * period_s / largest_speed(spec.profile);
        let count = whole(duration_s / period_s) + 2;
        Reference::PointToPoint(PointToPointMoves {
            period_s,
            moving: spec.moving,
            profile: spec.profile,
            postures_rad: self.draw_postures(count, spec.reach, longest_s, draws),
        })
    }

    pub(crate) fn draw_spline(
        &self,
        spec: &spec::ViaPoints,
        frequency_hz: f64,
        duration_s: f64,
        draws: &mut Draws,
    ) -> Reference {
        let period_s = 1.0 / frequency_hz;
        // A B-spline is never faster than its control points.
        let longest_s = draws.uniform(spec.speed) * period_s;
        let count = whole(duration_s / period_s) + 5;
        Reference::ViaPoints(ViaPoints {
            period_s,
            postures_rad: self.draw_postures(count, spec.reach, longest_s, draws),
        })
    }

    /// Postures whose joints are at most as far from those before as they move in `longest_s` at
    /// their largest speed.
    fn draw_postures(
        &self,
        count: usize,
        reach: f64,
        longest_s: f64,
        draws: &mut Draws,
    ) -> Vec<Joints<f64>> {
        let mut postures: Vec<Joints<f64>> = Vec::with_capacity(count);
        for _ in 0..count {
            let before = postures.last().copied();
            let posture = self.limits.iter().enumerate().map(|(joint, limits)| {
                let drawn = draws.uniform(limits.within(reach));
                let Some(before) = before else { return drawn };
                let furthest = longest_s * limits.speed;
                before[joint] + (drawn - before[joint]).clamp(-furthest, furthest)
            });
            postures.push(posture.collect());
        }
        postures
    }
}

/// The polynomial of degree 5 between two consecutive samples, in powers of the share of the
/// sampling period that has passed. It has the states at both.
pub(crate) fn polynomial(
    period_s: f64,
    joint: usize,
    from: &ReferenceState,
    to: &ReferenceState,
) -> [f64; 6] {
    let h = period_s;
    let (v0, v1) = (h * from.rd[joint], h * to.rd[joint]);
    let (a0, a1) = (0.5 * h * h * from.rdd[joint], 0.5 * h * h * to.rdd[joint]);
    let change = to.r[joint] - from.r[joint];
    [
        from.r[joint],
        v0,
        a0,
        10.0 * change - 6.0 * v0 - 4.0 * v1 - 3.0 * a0 + a1,
        -15.0 * change + 8.0 * v0 + 7.0 * v1 + 3.0 * a0 - 2.0 * a1,
        6.0 * change - 3.0 * v0 - 3.0 * v1 - a0 + a1,
    ]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::draws::Purpose;

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
                for joint in 0..3 {
                    let coefficients = polynomial(period_s, joint, &from, &to);
                    let at = |s: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c);
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
