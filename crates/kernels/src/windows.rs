//! The windows of a series that a convolution reads.

/// The windows of a kernel in series `[channel, sample]`. Window j at tap t is sample `first + step
/// j + t`, or 0 beyond the ends.
#[derive(Clone, Copy)]
pub(super) struct Windows {
    pub channels: usize,
    /// Samples of the series.
    pub samples: usize,
    pub taps: usize,
    pub first: isize,
    pub step: usize,
    /// Number of windows.
    pub count: usize,
}

/// The samples of a few trajectories, arranged so that the windows of a channel and tap lie side by
/// side. The windows of the next trajectory begin [`Windows::length`] later.
///
/// There is a row for each channel and each remainder of the tap by the step. A tap begins a sample
/// later than the tap one step before it, so that no sample is stored twice.
pub(super) struct Seen<'a> {
    pub values: &'a [f32],
    /// Elements of a row.
    pub row: usize,
}

impl Windows {
    /// Number of channels times taps.
    pub fn rows(&self) -> usize {
        self.channels * self.taps
    }

    /// Distance from one trajectory's windows to the next one's.
    pub fn length(&self) -> usize {
        self.count + self.taps.saturating_sub(1) / self.step
    }

    /// Rows of [`Seen`] for each channel. Without taps there is one row, which is not used.
    fn phases(&self) -> usize {
        self.step.min(self.taps).max(1)
    }

    /// Offsets in [`Seen`] of the windows of each channel and tap.
    pub fn offsets(&self, row: usize) -> Vec<usize> {
        (0..self.rows())
            .map(|index| {
                let (channel, tap) = (index / self.taps, index % self.taps);
                (channel * self.phases() + tap % self.step) * row + tap / self.step
            })
            .collect()
    }

    /// Arranges the trajectories of `series`. Where the arrangement equals the series, nothing is
    /// copied to `scratch`.
    pub fn see<'a>(&self, series: &'a [f32], scratch: &'a mut Vec<f32>) -> Seen<'a> {
        let of_one = self.channels * self.samples;
        let same = self.taps == 1 && self.first == 0 && self.step == 1;
        if same && self.count == self.samples && series.len() == of_one {
            return Seen { values: series, row: self.samples };
        }
        let length = self.length();
        let row = series.len() / of_one * length;
        scratch.resize(self.channels * self.phases() * row, 0.0);
        for (trajectory, series) in series.chunks_exact(of_one).enumerate() {
            let rows = scratch.chunks_exact_mut(self.phases() * row);
            for (rows, series) in rows.zip(series.chunks_exact(self.samples)) {
                for (phase, row) in rows.chunks_exact_mut(row).enumerate() {
                    self.write_row(series, phase, &mut row[trajectory * length..][..length]);
                }
            }
        }
        Seen { values: scratch, row }
    }

    /// Writes every step-th sample from `first + phase` on.
    fn write_row(&self, series: &[f32], phase: usize, row: &mut [f32]) {
        let offset = self.first + phase.cast_signed();
        let before = if offset < 0 { offset.unsigned_abs().div_ceil(self.step) } else { 0 };
        let before = before.min(row.len());
        // The first sample inside the series.
        let start = (offset + (before * self.step).cast_signed()).unsigned_abs();
        let inside = self.samples.saturating_sub(start).div_ceil(self.step);
        let (zeros, rest) = row.split_at_mut(before);
        let (inside, after) = rest.split_at_mut(inside.min(rest.len()));
        zeros.fill(0.0);
        after.fill(0.0);
        if self.step == 1 {
            inside.copy_from_slice(&series[start.min(self.samples)..][..inside.len()]);
        } else {
            let seen = series.iter().skip(start).step_by(self.step);
            for (value, &seen) in inside.iter_mut().zip(seen) {
                *value = seen;
            }
        }
    }
}
