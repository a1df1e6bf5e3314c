//! Parts of recordings. They are compared one by one, because a mistake may be in one file only, or
//! begin in the middle of another.

use std::ops::Range;

use crate::motion::{Motion, whole};

/// A longer recording has several parts, s. This is enough for delays to a fraction of a
/// millisecond.
const LONGEST_S: f64 = 180.0;

/// Shorter recordings share a part, s: they show too little of signs and delays alone.
const LEAST_S: f64 = 15.0;

/// With more seconds than that of so many shortest parts, all parts are longer.
const MOST: f64 = 20.0;

/// Samples of one recording or of several.
#[derive(Debug, Default, PartialEq)]
pub struct Part(Vec<(usize, Range<usize>)>);

impl Part {
    /// All samples of motions, in at most 20 parts and one more for each 3 minutes.
    pub fn all(motions: &[Motion]) -> Vec<Self> {
        let lengths: Vec<(usize, f64)> =
            motions.iter().map(|motion| (motion.samples(), motion.seconds())).collect();
        of_lengths(&lengths)
    }

    pub fn motions(&self, all: &[Motion]) -> Vec<Motion> {
        self.0.iter().map(|(at, samples)| all[*at].part(samples.clone())).collect()
    }

    /// `a.csv`, `a.csv, 180 to 360 s`, or `a.csv to d.csv`. Seconds count from the beginning of the
    /// recording.
    pub fn name(&self, all: &[Motion]) -> String {
        let [(first, samples), .., (last, _)] = self.0.as_slice() else {
            let Some((at, samples)) = self.0.first() else { return String::new() };
            let motion = &all[*at];
            if samples.len() == motion.samples() {
                return motion.name.clone();
            }
            let [from, to] =
                [samples.start, samples.end].map(|sample| sample as f64 / motion.rate_hz);
            let separator = if motion.name.is_empty() { "" } else { ", " };
            return format!("{}{separator}{from:.0} to {to:.0} s", motion.name);
        };
        debug_assert_eq!(samples.start, 0, "only whole recordings share a part");
        format!("{} to {}", all[*first].name, all[*last].name)
    }
}

/// The parts of recordings with these samples and seconds.
fn of_lengths(lengths: &[(usize, f64)]) -> Vec<Part> {
    let total_s: f64 = lengths.iter().map(|(_, seconds)| seconds).sum();
    let least_s = LEAST_S.max(total_s / MOST);
    let longest_s = LONGEST_S.max(least_s);
    let mut parts = Vec::new();
    let (mut shared, mut shared_s) = (Part::default(), 0.0);
    for (at, &(samples, seconds)) in lengths.iter().enumerate() {
        if seconds < least_s {
            shared.0.push((at, 0..samples));
            shared_s += seconds;
            if shared_s >= least_s {
                parts.push(std::mem::take(&mut shared));
                shared_s = 0.0;
            }
            continue;
        }
        let count = whole((seconds / longest_s).ceil()).max(1);
        let border = |part: usize| samples * part / count;
        parts.extend((0..count).map(|part| Part(vec![(at, border(part)..border(part + 1))])));
    }
    if !shared.0.is_empty() {
        parts.push(shared);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The parts of recordings of so many seconds at 100 Hz.
    fn parts(seconds: &[u32]) -> Vec<Vec<(usize, Range<usize>)>> {
        let lengths: Vec<(usize, f64)> = seconds
            .iter()
            .map(|&seconds| (usize::try_from(100 * seconds).unwrap(), f64::from(seconds)))
            .collect();
        of_lengths(&lengths).into_iter().map(|Part(samples)| samples).collect()
    }

    #[test]
    fn long_recordings_are_cut_evenly_and_short_ones_share_a_part() {
        assert_eq!(parts(&[40]), [[(0, 0..4000)]]);
        assert_eq!(
            parts(&[400, 20]),
            [[(0, 0..13_333)], [(0, 13_333..26_666)], [(0, 26_666..40_000)], [(1, 0..2000)]]
        );
        let short = parts(&[8, 60, 8, 5]);
        assert_eq!(short[0], [(1, 0..6000)]);
        assert_eq!(short[1], [(0, 0..800), (2, 0..800)]);
        assert_eq!(short[2], [(3, 0..500)]);
        assert_eq!(parts(&[]), Vec::<Vec<_>>::new());
    }

    #[test]
    fn the_parts_of_many_recordings_are_few_and_have_every_sample() {
        for seconds in [vec![5; 3000], vec![36_000], vec![40; 500], vec![7, 9000, 300, 60]] {
            let found = parts(&seconds);
            assert!(found.len() <= 41, "{}", found.len());
            let samples: usize = found.iter().flatten().map(|(_, samples)| samples.len()).sum();
            assert_eq!(samples, 100 * seconds.iter().sum::<u32>() as usize);
        }
    }
}
