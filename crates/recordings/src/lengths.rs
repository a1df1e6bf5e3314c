//! The lengths and the rates of a file's recordings.

use serde::Serialize;
use series::median;

/// A recording's length and rate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordingLength {
    /// Its name in the file; empty if the file names none.
    pub name: String,
    /// Rows of the file.
    pub rows: u64,
    /// Time from its first row to its last, s.
    pub seconds: f64,
    /// Rows per second, by the median of the periods; `None` with one row.
    pub median_rate_hz: Option<f64>,
    /// Samples at the dataset's rate.
    pub samples: u64,
}

/// The lengths of recordings.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Lengths {
    /// The first recordings, at most [`Self::MOST`].
    pub recordings: Vec<RecordingLength>,
    /// The number of samples of the shortest recording.
    pub fewest_samples: u64,
    /// The number of samples of the longest recording.
    pub most_samples: u64,
}

impl Lengths {
    /// The largest number of recordings that are kept.
    pub const MOST: usize = 1000;

    pub(crate) fn add(&mut self, length: RecordingLength) {
        let samples = length.samples;
        self.most_samples = self.most_samples.max(samples);
        self.fewest_samples = match self.recordings.as_slice() {
            [] => samples,
            _ => self.fewest_samples.min(samples),
        };
        if self.recordings.len() < Self::MOST {
            self.recordings.push(length);
        }
    }
}

/// Periods of a recording. Of more than [`Self::MOST`], a part is kept evenly.
#[derive(Debug)]
pub(crate) struct Periods {
    kept: Vec<f64>,
    seen: u64,
    /// Every so many periods one is kept.
    stride: u64,
}

impl Default for Periods {
    fn default() -> Self {
        Self { kept: Vec::new(), seen: 0, stride: 1 }
    }
}

impl Periods {
    const MOST: usize = 4096;

    pub fn add(&mut self, period_s: f64) {
        if self.seen.is_multiple_of(self.stride) {
            if self.kept.len() == Self::MOST {
                let mut number = 0_usize;
                self.kept.retain(|_| {
                    number += 1;
                    number % 2 == 1
                });
                self.stride *= 2;
            }
            // The number of kept periods is even, so this one also fits the longer stride.
            self.kept.push(period_s);
        }
        self.seen += 1;
    }

    /// The median; `None` without periods.
    pub fn median_s(&self) -> Option<f64> {
        (!self.kept.is_empty()).then(|| median(self.kept.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_many_periods_needs_few_of_them() {
        let mut periods = Periods::default();
        assert_eq!(periods.median_s(), None);
        for number in 0..100_000_u32 {
            periods.add(if number % 5 == 0 { 1.0 } else { 0.002 });
        }
        assert_eq!(periods.median_s(), Some(0.002));
        assert!(periods.kept.len() <= Periods::MOST, "{}", periods.kept.len());
    }
}
