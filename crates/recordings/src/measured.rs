//! The beginning of a file's recordings as they were measured, at the times of its rows.

use crate::samples::Sample;

/// A recording before it is resampled and cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Its name in the file; empty if the file names none.
    pub name: String,
    /// Its rows. Their times rise.
    pub rows: Vec<MeasuredRow>,
}

/// A row of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredRow {
    /// Seconds from an arbitrary origin.
    pub time_s: f64,
    /// The position of each joint, rad.
    pub q: Vec<f64>,
    /// The torque of each joint, N·m.
    pub u: Vec<f64>,
}

/// Keeps rows until there are enough.
pub(crate) struct Keeper {
    joints: usize,
    /// Seconds that are left of [`Keeper::MOST_S`] at the beginning of the last recording.
    left_s: f64,
    left_rows: usize,
    recordings: Vec<Measured>,
    /// Whether rows belong to the last of the recordings.
    keeps: bool,
}

impl Keeper {
    /// The most that is kept: three minutes.
    pub const MOST_S: f64 = 180.0;
    /// The most rows that are kept: three minutes at 2 kHz.
    const MOST_ROWS: usize = 360_000;

    /// Keeps [`Self::MOST_S`].
    pub fn new(joints: usize) -> Self {
        Self::of_most(joints, Self::MOST_S, Self::MOST_ROWS)
    }

    /// Keeps everything.
    pub fn of_all(joints: usize) -> Self {
        Self::of_most(joints, f64::INFINITY, usize::MAX)
    }

    fn of_most(joints: usize, left_s: f64, left_rows: usize) -> Self {
        Self { joints, left_s, left_rows, recordings: Vec::new(), keeps: false }
    }

    /// A recording begins.
    pub fn begin(&mut self, name: Option<&str>) {
        if let Some(last) = self.recordings.last().filter(|_| self.keeps) {
            self.left_s -= last.seconds();
        }
        self.keeps = self.left_s > 0.0 && self.left_rows > 0;
        if self.keeps {
            let name = name.unwrap_or_default().to_owned();
            self.recordings.push(Measured { name, rows: Vec::new() });
        }
    }

    /// The next sample of the recording.
    pub fn keep(&mut self, sample: &Sample) {
        let Some(recording) = self.recordings.last_mut().filter(|_| self.keeps) else { return };
        let first_s = recording.rows.first().map_or(sample.time_s, |row| row.time_s);
        if sample.time_s - first_s > self.left_s || self.left_rows == 0 {
            return;
        }
        let (u, rest) = sample.values.split_at(self.joints);
        let row =
            MeasuredRow { time_s: sample.time_s, q: rest[..self.joints].to_vec(), u: u.to_vec() };
        recording.rows.push(row);
        self.left_rows -= 1;
    }

    /// All recordings with two rows at least.
    pub fn recordings(mut self) -> Vec<Measured> {
        self.recordings.retain(|recording| recording.rows.len() > 1);
        self.recordings
    }
}

impl Measured {
    fn seconds(&self) -> f64 {
        match (self.rows.first(), self.rows.last()) {
            (Some(first), Some(last)) => last.time_s - first.time_s,
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Place;
    use crate::rows::MAX_CHANNELS;

    fn sample(time_s: f64) -> Sample {
        let mut values = [0.0; MAX_CHANNELS];
        values[..4].copy_from_slice(&[1.0, 2.0, time_s, 4.0]);
        Sample { time_s, row: 0, place: Place::Row(1), values }
    }

    #[test]
    fn three_minutes_are_kept_over_all_recordings() {
        let mut keeper = Keeper::new(2);
        for (name, seconds) in [("a", 100), ("b", 200), ("c", 200)] {
            keeper.begin(Some(name));
            for second in 0..=seconds {
                keeper.keep(&sample(f64::from(second)));
            }
        }
        let kept = keeper.recordings();
        let lengths: Vec<(&str, usize)> =
            kept.iter().map(|it| (it.name.as_str(), it.rows.len())).collect();
        assert_eq!(lengths, [("a", 101), ("b", 81)]);
        let expected = MeasuredRow { time_s: 80.0, q: vec![80.0, 4.0], u: vec![1.0, 2.0] };
        assert_eq!(kept[1].rows[80], expected);
    }

    #[test]
    fn a_recording_of_one_row_shows_no_motion() {
        let mut keeper = Keeper::new(2);
        keeper.begin(None);
        keeper.keep(&sample(0.0));
        assert_eq!(keeper.recordings(), []);
    }
}
