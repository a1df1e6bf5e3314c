//! Cuts the samples of a recording into trajectories.

use std::collections::VecDeque;

use spec::{ImportSpec, Split};

use crate::samples::Sample;

/// The collected samples of a recording's next trajectory.
#[derive(Debug)]
pub(crate) struct Window {
    samples: VecDeque<Sample>,
    length: usize,
    stride: u64,
    /// Number of samples until the next trajectory begins.
    skip: u64,
    /// Number of samples of the recording so far.
    seen: u64,
    trajectories: u64,
}

impl Window {
    pub fn new(spec: &ImportSpec) -> Self {
        let stride = match spec.split {
            // A recording with another length is refused at its end.
            Split::Whole => u64::MAX,
            Split::Windows { stride } => u64::from(stride),
        };
        let length = spec.samples as usize;
        let samples = VecDeque::with_capacity(length);
        Self { samples, length, stride, skip: 0, seen: 0, trajectories: 0 }
    }

    /// Adds a sample. Returns true when a trajectory is complete; [`Self::trajectory`] then has it.
    pub fn push(&mut self, sample: Sample) -> bool {
        if self.is_whole() {
            self.move_on();
        }
        self.seen += 1;
        if self.skip > 0 {
            self.skip -= 1;
            return false;
        }
        self.samples.push_back(sample);
        self.trajectories += u64::from(self.is_whole());
        self.is_whole()
    }

    pub fn trajectory(&self) -> &VecDeque<Sample> {
        &self.samples
    }

    /// Number of samples that are not part of any trajectory.
    pub fn dropped(&self) -> u64 {
        let length = self.length as u64;
        let covered = match self.trajectories.checked_sub(1) {
            None => 0,
            Some(before) => before.saturating_mul(self.stride.min(length)) + length,
        };
        self.seen - covered
    }

    pub const fn trajectories(&self) -> u64 {
        self.trajectories
    }

    /// Clears the window for another recording.
    pub fn clear(&mut self) {
        self.samples.clear();
        (self.skip, self.seen, self.trajectories) = (0, 0, 0);
    }

    fn is_whole(&self) -> bool {
        self.samples.len() == self.length
    }

    fn move_on(&mut self) {
        let length = self.length as u64;
        self.skip = self.stride.saturating_sub(length);
        let gone = usize::try_from(self.stride).unwrap_or(usize::MAX).min(self.length);
        self.samples.drain(..gone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Place;
    use crate::rows::MAX_CHANNELS;

    /// First rows of the trajectories that `count` samples give, and the number of dropped samples.
    fn cut(count: u64, length: usize, stride: u64) -> (Vec<u64>, u64) {
        let samples = VecDeque::new();
        let mut window = Window { samples, length, stride, skip: 0, seen: 0, trajectories: 0 };
        let mut firsts = Vec::new();
        for row in 0..count {
            let place = Place::Row(row + 1);
            if window.push(Sample { time_s: 0.0, row, place, values: [0.0; MAX_CHANNELS] }) {
                assert_eq!(window.trajectory().len(), length);
                assert_eq!(window.trajectory()[length - 1].row, row);
                firsts.push(window.trajectory()[0].row);
            }
        }
        assert_eq!(window.trajectories(), firsts.len() as u64);
        (firsts, window.dropped())
    }

    #[test]
    fn windows_follow_each_other_by_their_stride() {
        assert_eq!(cut(11, 4, 4), (vec![0, 4], 3));
        assert_eq!(cut(12, 4, 4), (vec![0, 4, 8], 0));
        assert_eq!(cut(11, 4, 2), (vec![0, 2, 4, 6], 1));
        assert_eq!(cut(11, 4, 6), (vec![0, 6], 3));
        assert_eq!(cut(3, 4, 4), (vec![], 3));
    }

    #[test]
    fn a_whole_recording_is_one_window() {
        assert_eq!(cut(4, 4, u64::MAX), (vec![0], 0));
        assert_eq!(cut(9, 4, u64::MAX), (vec![0], 5));
    }
}
