//! Torques that stand at their highest or lowest value, as those that a sensor, a drive or a log cuts
//! off.
//!
//! A level where torques are cut off has many samples, and next to none lie just beside it. The peaks
//! of waves have samples beside them, also after rounding. Torques that are held at several levels,
//! such as pulses, are no sign of a cut.

use std::ops::Range;

/// A level has at least this share of the samples, and at least this number of them. A controller may
/// reach its limit for a moment.
const LEAST_SHARE: f64 = 0.03;
const LEAST_SAMPLES: usize = 25;

/// Samples are at a level within this share of the range of a channel. The low-pass of an import
/// leaves less of a cut after ten samples.
const TOLERANCE: f64 = 1e-4;

/// The band below a level that must be almost empty, as a share of the range: of a channel, and of
/// one whose values repeat because they are rounded.
const BAND: f64 = 0.01;
const BAND_OF_REPEATED: f64 = 0.05;

/// A level has at least this many times the samples of the band. A rounded sine has as many in both.
const TIMES: usize = 3;

/// Values overshoot a level after a low-pass by less than this share of the range.
const OVERSHOOT: f64 = 0.1;

/// A level so near to the limit of the joint's drive is that of the drive, as a share of the limit.
const LIMIT_TOLERANCE: f64 = 5e-3;

/// A channel with fewer different values is too coarse to tell.
const LEAST_VALUES: usize = 16;

/// The levels at which a channel of torques is cut off, N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Saturation {
    pub(crate) lowest_nm: Option<f64>,
    pub(crate) highest_nm: Option<f64>,
    tolerance_nm: f64,
}

impl Saturation {
    /// Finds the levels of a channel. Samples at which the arm does not move are no evidence, because
    /// its torque stands still then. A drive at its limit, ± `limit_nm`, has the torque that is
    /// recorded.
    pub(crate) fn of(torques: &[f64], moves: &[bool], limit_nm: f64) -> Self {
        let moving = torques.iter().zip(moves).filter(|(_, moves)| **moves);
        let mut sorted: Vec<f64> = moving.map(|(torque, _)| *torque).collect();
        sorted.sort_by(f64::total_cmp);
        let [lowest, .., highest] = sorted.as_slice() else { return Self::default() };
        let range = highest - lowest;
        let inner = lowest + OVERSHOOT * range..highest - OVERSHOOT * range;
        let mut values = sorted.clone();
        values.dedup();
        if values.len() < LEAST_VALUES || !range.is_finite() {
            return Self::default();
        }
        let repeated = share_repeated(torques, &inner);
        if repeated > 0.5 {
            return Self::default();
        }
        let least_band = if repeated > 0.05 { BAND_OF_REPEATED } else { BAND };
        let resolution = range / (values.len() - 1) as f64;
        let band = (least_band * range).max(3.5 * resolution);
        let tolerance_nm = TOLERANCE * range;
        let is_of_sensor =
            |level: &f64| (level.abs() - limit_nm).abs() > LIMIT_TOLERANCE * limit_nm;
        let highest_nm = highest_level(&sorted, tolerance_nm, band, &inner).filter(is_of_sensor);
        let turned: Vec<f64> = sorted.iter().rev().map(|torque| -torque).collect();
        let inner = -inner.end..-inner.start;
        let lowest_nm = highest_level(&turned, tolerance_nm, band, &inner).map(|level| -level);
        let lowest_nm = lowest_nm.filter(is_of_sensor);
        Self { lowest_nm, highest_nm, tolerance_nm }
    }

    /// Whether a torque is at the lowest level, or below it.
    pub(crate) fn is_lowest(&self, torque: f64) -> bool {
        self.lowest_nm.is_some_and(|level| torque <= level + self.tolerance_nm)
    }

    /// Whether a torque is at the highest level, or above it.
    pub(crate) fn is_highest(&self, torque: f64) -> bool {
        self.highest_nm.is_some_and(|level| torque >= level - self.tolerance_nm)
    }

    /// Whether a torque is cut off.
    pub(crate) fn cuts(&self, torque: f64) -> bool {
        self.is_lowest(torque) || self.is_highest(torque)
    }

    pub(crate) const fn has_level(&self) -> bool {
        self.lowest_nm.is_some() || self.highest_nm.is_some()
    }
}

/// The share of values within `inner` that repeat the value before.
fn share_repeated(values: &[f64], inner: &Range<f64>) -> f64 {
    let pairs = values.windows(2).filter(|pair| inner.contains(&pair[1]));
    let repeated = pairs.clone().filter(|pair| pair[0] == pair[1]).count();
    repeated as f64 / pairs.count().max(1) as f64
}

/// The level at the top of rising values, if they have one. No other value has nearly as many samples,
/// neither one within `inner` nor 0, where idle joints rest.
fn highest_level(sorted: &[f64], tolerance: f64, band: f64, inner: &Range<f64>) -> Option<f64> {
    let before = |value: f64| sorted.partition_point(|other| *other < value);
    let until = |value: f64| sorted.partition_point(|other| *other <= value);
    let (level, at_level) = fullest(sorted, until(inner.end)..sorted.len(), tolerance)?;
    let least = (LEAST_SHARE * sorted.len() as f64).max(LEAST_SAMPLES as f64);
    let above = sorted.len() - until(level + tolerance);
    let below = before(level - tolerance) - until(level - tolerance - band);
    let at_zero = until(tolerance) - before(-tolerance);
    let within = fullest(sorted, until(inner.start)..until(inner.end), tolerance);
    let elsewhere = within.map_or(0, |(_, samples)| samples);
    let others = above.max(below).max(at_zero).max(elsewhere);
    (at_level as f64 >= least && TIMES * others <= at_level).then_some(level)
}

/// The middle of the interval of ± `tolerance` that has most of the values at `places`, and the number
/// of these.
fn fullest(sorted: &[f64], places: Range<usize>, tolerance: f64) -> Option<(f64, usize)> {
    let values = &sorted[places];
    let mut best: Option<(f64, usize)> = None;
    let mut last = 0;
    for (first, value) in values.iter().enumerate() {
        while last < values.len() && values[last] <= value + 2.0 * tolerance {
            last += 1;
        }
        let count = last - first;
        if best.is_none_or(|(_, most)| count > most) {
            best = Some((values[first + count / 2], count));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use series::LowPass;

    use super::*;

    const RATE_HZ: f64 = 125.0;

    /// 40 s of a sum of sines of about ± 2.
    fn waves() -> Vec<f64> {
        let of = |time: f64| {
            (1..=5).map(|n| (TAU * 0.1 * f64::from(n) * time + f64::from(n * n)).sin()).sum::<f64>()
        };
        (0..5000).map(|sample| 0.7 * of(f64::from(sample) / RATE_HZ)).collect()
    }

    fn of(values: &[f64]) -> Saturation {
        Saturation::of(values, &vec![true; values.len()], 100.0)
    }

    fn assert_near(level: Option<f64>, expected: f64) {
        let level = level.unwrap();
        assert!((level - expected).abs() < 2e-3, "{level} {expected}");
    }

    #[test]
    fn torques_are_cut_off_above_below_or_on_both_sides() {
        for limit in [0.2, 0.6, 1.2] {
            let both: Vec<f64> = waves().iter().map(|u| u.clamp(-limit, limit)).collect();
            let found = of(&both);
            assert_near(found.highest_nm, limit);
            assert_near(found.lowest_nm, -limit);
            let above: Vec<f64> = waves().iter().map(|u| u.min(limit)).collect();
            let found = of(&above);
            assert_near(found.highest_nm, limit);
            assert_eq!(found.lowest_nm, None);
            let below: Vec<f64> = waves().iter().map(|u| u.max(-limit)).collect();
            let found = of(&below);
            assert_near(found.lowest_nm, -limit);
            assert_eq!(found.highest_nm, None);
            let cut = below.iter().filter(|u| found.cuts(**u)).count();
            let lower = waves().iter().filter(|u| **u <= -limit).count();
            assert!(cut.abs_diff(lower) < 10, "{cut} {lower}");
        }
    }

    #[test]
    fn a_cut_shows_after_a_low_pass_and_after_rounding() {
        let cut: Vec<f64> = waves().iter().map(|u| u.clamp(-0.8, 0.8)).collect();
        let filtered = LowPass::new(0.4 * RATE_HZ, RATE_HZ).unwrap().apply(&cut).unwrap();
        let found = of(&filtered);
        assert_near(found.highest_nm, 0.8);
        assert_near(found.lowest_nm, -0.8);
        let rounded: Vec<f64> = cut.iter().map(|u| (u * 200.0).round() / 200.0).collect();
        assert_near(of(&rounded).highest_nm, 0.8);
        let stored: Vec<f64> = cut.iter().map(|u| (u * 1e7).round() / 1e7).collect();
        assert_near(of(&stored).lowest_nm, -0.8);
    }

    #[test]
    fn waves_have_no_level_however_they_are_rounded() {
        let sine: Vec<f64> =
            (0..5000).map(|sample| (TAU * 0.1 * f64::from(sample) / RATE_HZ).sin()).collect();
        for wave in [waves(), sine] {
            assert!(!of(&wave).has_level());
            for steps in [2.0, 5.0, 10.0, 13.0, 40.0, 100.0, 333.0, 1000.0, 1e4] {
                let rounded: Vec<f64> = wave.iter().map(|u| (u * steps).round() / steps).collect();
                assert!(!of(&rounded).has_level(), "{steps}: {:?}", of(&rounded));
            }
        }
        assert!(!of(&[0.4; 5000]).has_level());
        assert!(!of(&[]).has_level());
    }

    #[test]
    fn a_drive_at_its_limit_cuts_nothing_off() {
        let cut: Vec<f64> = waves().iter().map(|u| u.clamp(-0.8, 0.5)).collect();
        let found = Saturation::of(&cut, &[true; 5000], 0.8);
        assert_eq!(found.lowest_nm, None);
        assert_near(found.highest_nm, 0.5);
    }

    #[test]
    fn a_limit_that_is_reached_rarely_is_no_level() {
        let highest = waves().into_iter().fold(f64::MIN, f64::max);
        let cut: Vec<f64> = waves().iter().map(|u| u.min(0.98 * highest)).collect();
        assert!(!of(&cut).has_level());
    }

    #[test]
    fn held_torques_and_those_of_an_arm_at_rest_are_no_level() {
        let both_ways = [0.0, 1.0, 0.0, -0.7, 0.0, 1.4, 0.0, -0.3];
        let one_way = both_ways.map(f64::abs);
        let pulses = |levels: &[f64], ramp: f64| -> Vec<f64> {
            let at = |sample: usize| {
                let (pulse, share) = (sample / 125, (sample % 125) as f64 / 125.0);
                let [now, next] = [pulse, pulse + 1].map(|pulse| levels[pulse % levels.len()]);
                now + (next - now) * ((share - 1.0 + ramp) / ramp).clamp(0.0, 1.0)
            };
            (0..5000).map(at).collect()
        };
        for ramp in [0.01, 0.1, 0.4] {
            for levels in [both_ways, one_way] {
                let found = of(&pulses(&levels, ramp));
                assert!(!found.has_level(), "{ramp}: {found:?}");
            }
        }
        let at_rest = [vec![5.0; 1000], waves()].concat();
        let moves: Vec<bool> = (0..6000).map(|sample| sample >= 1000).collect();
        assert!(!Saturation::of(&at_rest, &moves, 100.0).has_level());
    }
}
