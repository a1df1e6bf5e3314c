//! Refuses steps of a position that no joint can make in the time between two rows: an angle that
//! wraps at π, a row of zeros, a spike of one sample.
//!
//! A step is compared with the velocity limit. It is then compared with its surroundings, so that
//! late timestamps, coarse or noisy encoders, positions that are logged more often than they are
//! measured, and motions beyond the limit are not taken for jumps.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use spec::{ImportSpec, MAX_JOINTS};

use crate::error::{Place, RowError};
use crate::recording::rounded;
use crate::samples::{Sample, VelocityLimit, velocity_limits};

/// Steps up to this size are never jumps, rad: the resolution of a coarse encoder (2.8°), or noise
/// that a fast log shows between two rows.
const SMALLEST_JUMP_RAD: f64 = 0.05;

/// The part of `position_noise_rad` that a step may have in addition: seven standard deviations of
/// the difference of two positions.
const NOISES: f64 = 10.0;

/// The part of the median second difference that a step may have. In white noise of deviation σ the
/// median is 1.65 σ, so this is nine standard deviations of the difference of two positions. The
/// median of a few rows may be half of that.
const ROUGHNESSES: f64 = 8.0;

/// The largest step that the roughness of a recording excuses, rad: the one of the largest
/// `position_noise_rad`.
const ROUGHEST_RAD: f64 = NOISES * spec::MAX_POSITION_NOISE_RAD;

/// A motion beyond the limit goes on for several rows. Up to this part of the limit, a step of
/// which a neighbour has a third is such a motion.
const FASTEST: f64 = 5.0;
const CARRIED: f64 = 1.0 / 3.0;

/// Number of rows before and after a step within which a position may be held.
const REACH: usize = 128;

/// Number of rows before and after a step that tell the period and the roughness.
const SURROUNDINGS: usize = 32;

/// The smallest number of second differences that tell the roughness.
const FEWEST_DIFFERENCES: usize = 6;

/// The positions of a recording, around the row that is compared with the one before.
pub(crate) struct Jumps {
    joints: Vec<Joint>,
    allowance_rad: f64,
    max_hold_s: f64,
    has_times: bool,
    rows: VecDeque<Row>,
    /// Index of the next row to compare with the one before.
    next: usize,
}

struct Joint {
    column: String,
    /// Index of the position among the values of a sample.
    channel: usize,
    limit: VelocityLimit,
}

struct Row {
    time_s: f64,
    place: Place,
    positions: [f64; MAX_JOINTS],
}

impl Jumps {
    pub fn new(spec: &ImportSpec) -> Self {
        let first = spec.columns.u.len();
        let columns = (first..).zip(&spec.columns.q);
        let joint = |((channel, column), limit): ((usize, &String), VelocityLimit)| Joint {
            column: column.clone(),
            channel,
            limit,
        };
        Self {
            joints: columns.zip(velocity_limits(spec)).map(joint).collect(),
            allowance_rad: SMALLEST_JUMP_RAD.max(NOISES * spec.position_noise_rad),
            max_hold_s: spec.max_gap_s,
            has_times: spec.columns.time.is_some(),
            rows: VecDeque::new(),
            next: 1,
        }
    }

    /// Takes the next row of the recording.
    ///
    /// # Errors
    /// When an earlier row cannot follow the one before it.
    pub fn accept(&mut self, sample: &Sample) -> Result<(), RowError> {
        let mut positions = [0.0; MAX_JOINTS];
        for (position, joint) in positions.iter_mut().zip(&self.joints) {
            *position = sample.values[joint.channel];
        }
        self.rows.push_back(Row { time_s: sample.time_s, place: sample.place, positions });
        if self.rows.len() <= self.next + REACH {
            return Ok(());
        }
        self.compare_next()?;
        if self.next > REACH {
            self.rows.pop_front();
            self.next -= 1;
        }
        Ok(())
    }

    /// Compares the last rows of the recording, and forgets it.
    ///
    /// # Errors
    /// Like [`Self::accept`].
    pub fn finish(&mut self) -> Result<(), RowError> {
        while self.next < self.rows.len() {
            self.compare_next()?;
        }
        self.clear();
        Ok(())
    }

    fn clear(&mut self) {
        self.rows.clear();
        self.next = 1;
    }

    fn compare_next(&mut self) -> Result<(), RowError> {
        let at = self.next;
        self.next += 1;
        for joint in 0..self.joints.len() {
            if let Err(error) = self.compare(at, joint) {
                // Later rows are of no interest.
                self.clear();
                return Err(error);
            }
        }
        Ok(())
    }

    /// Compares a position with the one of the row before.
    fn compare(&self, at: usize, joint: usize) -> Result<(), RowError> {
        let limit = self.joints[joint].limit.rad_s;
        let step = self.step(at, joint).abs();
        let elapsed = self.rows[at].time_s - self.rows[at - 1].time_s;
        if step <= self.allowance_rad + limit * elapsed {
            return Ok(());
        }
        let way = limit * elapsed.max(self.period(at)).max(self.held(at, joint));
        let allowance = self.allowance_rad.max(self.roughness(at, joint));
        if step <= allowance + way || self.is_carried(at, joint, allowance + FASTEST * way) {
            return Ok(());
        }
        Err(self.refused(at, joint, allowance + way))
    }

    fn position(&self, at: usize, joint: usize) -> f64 {
        self.rows[at].positions[joint]
    }

    fn step(&self, at: usize, joint: usize) -> f64 {
        self.position(at, joint) - self.position(at - 1, joint)
    }

    /// The mean period around a row. Rows that waited in a buffer have times that are too close.
    #[expect(clippy::cast_precision_loss, reason = "a few rows")]
    fn period(&self, at: usize) -> f64 {
        let first = at.saturating_sub(SURROUNDINGS);
        let last = (at + SURROUNDINGS).min(self.rows.len() - 1);
        (self.rows[last].time_s - self.rows[first].time_s) / (last - first) as f64
    }

    /// The time that a position may have been on its way if it is logged more often than it is
    /// measured: it then stays the same for several rows, before the step and after it.
    fn held(&self, at: usize, joint: usize) -> f64 {
        let is_held = |row: &usize| self.position(*row, joint) == self.position(*row - 1, joint);
        let first = at - 1 - (1..at).rev().take_while(is_held).count();
        let last = at + (at + 1..self.rows.len()).take_while(is_held).count();
        if first + 1 == at || last == at {
            return 0.0;
        }
        let before = self.rows[at].time_s - self.rows[first].time_s;
        // The recording may end before the next measurement.
        let after = self.rows.get(last + 1).map_or(f64::INFINITY, |row| row.time_s);
        let after = after - self.rows[at].time_s;
        // Measurements do not come in even intervals, either.
        (2.0 * before.min(after)).min(self.max_hold_s)
    }

    /// The step that the noise of the recording explains, before the step or after it, whichever is
    /// smaller: the noise of a spike is on one side alone.
    fn roughness(&self, at: usize, joint: usize) -> f64 {
        let first = at.saturating_sub(SURROUNDINGS);
        let last = (at + SURROUNDINGS).min(self.rows.len());
        let sides = [first..at, at..last];
        let medians = sides.into_iter().filter_map(|rows| {
            let steps: Vec<f64> = rows.skip(1).map(|row| self.step(row, joint)).collect();
            let mut differences: Vec<f64> =
                steps.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
            differences.sort_by(f64::total_cmp);
            (differences.len() >= FEWEST_DIFFERENCES).then(|| differences[differences.len() / 2])
        });
        let smaller = medians.min_by(f64::total_cmp).unwrap_or(0.0);
        (ROUGHNESSES * smaller).min(ROUGHEST_RAD)
    }

    /// Whether a step is part of a motion that is faster than the limit.
    fn is_carried(&self, at: usize, joint: usize, most: f64) -> bool {
        let step = self.step(at, joint);
        let before = (at > 1).then(|| self.step(at - 1, joint));
        let after = (at + 1 < self.rows.len()).then(|| self.step(at + 1, joint));
        let neighbours = [before, after].into_iter().flatten();
        step.abs() <= most && neighbours.map(|other| other / step).any(|share| share >= CARRIED)
    }

    fn refused(&self, at: usize, joint: usize, possible: f64) -> RowError {
        let (before, row) = (&self.rows[at - 1], &self.rows[at]);
        let elapsed = row.time_s - before.time_s;
        let step = self.step(at, joint);
        let Joint { column, limit: VelocityLimit { rad_s, source }, .. } = &self.joints[joint];
        let found = format!(
            "{} rad, and {} rad in {}, {} s before, which is {} rad/s",
            rounded(self.position(at, joint)),
            rounded(self.position(at - 1, joint)),
            before.place,
            rounded(elapsed),
            rounded(step / elapsed),
        );
        let mut allowed = format!("{rad_s} rad/s between two rows ({source})");
        allowed.push_str(&self.explanation(at, joint, possible));
        RowError::value(row.place, column, found, allowed)
    }

    /// Names the likely cause of a step, and a remedy if there is one.
    fn explanation(&self, at: usize, joint: usize, possible: f64) -> String {
        let (before, row) = (&self.rows[at - 1], &self.rows[at]);
        if (self.step(at, joint).abs() - TAU).abs() <= possible {
            return "; this looks like an angle that wraps: \"unwrap\": true makes it continuous"
                .to_owned();
        }
        let joints = self.joints.len();
        let is_zero = |row: &&Row| joints > 1 && row.positions[..joints].iter().all(|q| *q == 0.0);
        if let Some(zeros) = [row, before].into_iter().find(is_zero) {
            return format!(
                "; all positions of {} are 0, as if the robot had not answered: leave it out",
                zeros.place
            );
        }
        if let Some(after) = self.rows.get(at + 1) {
            let position = self.position(at + 1, joint);
            if (position - self.position(at - 1, joint)).abs() <= possible {
                return format!(
                    "; {} has {} rad again, so this is a spike: leave the row out",
                    after.place,
                    rounded(position)
                );
            }
        }
        let times = if self.has_times { "units.time" } else { "rate_hz" };
        format!(
            "; if this is a motion, check {times}, or widen ranges.qd_rad_s; otherwise let another \
             recording begin here"
        )
    }
}
