//! Recordings, and the motions in them without noise.

use std::ops::Range;

use series::LowPass;

use crate::IdentificationError;
use crate::horizons::HORIZONS_S;
use crate::saturation::Saturation;

/// Torques and positions of an arm at even times.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// A name for reports and errors.
    pub name: String,
    /// Samples per second.
    pub rate_hz: f64,
    /// Positions `[sample][joint]`, rad, before the sample's torque acts.
    pub q: Vec<Vec<f64>>,
    /// Torques that act on the joints, gravity included, `[sample][joint]`, N·m.
    pub u: Vec<Vec<f64>>,
}

/// A recording after a low-pass without delay.
pub(crate) struct Motion {
    pub(crate) name: String,
    pub(crate) rate_hz: f64,
    pub(crate) joints: usize,
    /// Smooth positions, velocities and accelerations, `[sample][joint]`, rad and seconds.
    pub(crate) q: Vec<Vec<f64>>,
    pub(crate) qd: Vec<Vec<f64>>,
    pub(crate) qdd: Vec<Vec<f64>>,
    /// Smooth torques, `[sample][joint]`, N·m. Those of a joint with cuts are averages.
    pub(crate) u: Vec<Vec<f64>>,
    /// Torques as they were recorded, `[sample][joint]`, N·m.
    pub(crate) recorded_u: Vec<Vec<f64>>,
    /// The levels at which the recorded torque of each joint is cut off.
    pub(crate) saturation: Vec<Saturation>,
    smoothing: Smoothing,
}

/// The smoothing of torques.
#[derive(Clone)]
struct Smoothing {
    filter: LowPass,
    /// The joints whose torques are cut off, and the samples before and after each that are averaged.
    cut: Vec<usize>,
    averaged: usize,
}

impl Smoothing {
    /// Smooths `rows`, `[sample][joint]`.
    fn of(&self, rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut smooth = self.filter.apply_to_columns(rows);
        for (sample, row) in smooth.iter_mut().enumerate() {
            let last = (sample + self.averaged).min(rows.len() - 1);
            let near = &rows[sample.saturating_sub(self.averaged)..=last];
            for joint in &self.cut {
                let sum: f64 = near.iter().map(|row| row[*joint]).sum();
                row[*joint] = sum / near.len() as f64;
            }
        }
        smooth
    }
}

/// The ends of a recording that a low-pass and differences leave uncertain, s.
pub(crate) const UNCERTAIN_S: f64 = 0.25;

/// The derivative of tanh(ratio) by the logarithm of the bend's speed, where the ratio is that of a
/// velocity to this speed.
pub(crate) fn slope_of_bend(ratio: f64) -> f64 {
    -ratio / ratio.cosh().powi(2)
}

/// Torques of a joint with cuts are averaged over this time, s. The low-pass would spread a cut: half a
/// period of its edge away, 7 % of a step are left.
const AVERAGED_S: f64 = 0.04;

impl Motion {
    /// The motion of an arm whose drives have these limits, N·m.
    ///
    /// # Errors
    /// See [`IdentificationError`].
    pub(crate) fn new(
        recording: &Recording,
        limits_nm: &[f64],
        low_pass_hz: f64,
    ) -> Result<Self, IdentificationError> {
        let Recording { name, rate_hz, q, u } = recording;
        let joints = limits_nm.len();
        check(recording, joints)?;
        let filter =
            LowPass::new(low_pass_hz, *rate_hz).ok_or_else(|| IdentificationError::LowPass {
                recording: name.clone(),
                low_pass_hz,
                rate_hz: *rate_hz,
                below_hz: 0.5 * rate_hz,
            })?;
        let smooth_q = filter.apply_to_columns(q);
        let qd = slopes(&smooth_q, *rate_hz);
        let qdd = slopes(&qd, *rate_hz);
        let moves = moves(&qd, joints);
        let column = |joint: usize| -> Vec<f64> { u.iter().map(|row| row[joint]).collect() };
        let saturation: Vec<Saturation> = (0..joints)
            .map(|joint| Saturation::of(&column(joint), &moves, limits_nm[joint]))
            .collect();
        let smoothing = Smoothing {
            filter,
            cut: (0..joints).filter(|joint| saturation[*joint].has_level()).collect(),
            averaged: whole(0.5 * AVERAGED_S * rate_hz).max(1),
        };
        Ok(Self {
            name: name.clone(),
            rate_hz: *rate_hz,
            joints,
            q: smooth_q,
            qd,
            qdd,
            u: smoothing.of(u),
            recorded_u: u.clone(),
            saturation,
            smoothing,
        })
    }

    /// The smooth torques of Coulomb friction of 1 N·m, `[sample][joint]`. Friction changes
    /// within a sample where a joint turns back, and the low-pass of the torques spreads that.
    pub(crate) fn coulomb(&self, bends_rad_s: &[f64]) -> Vec<Vec<f64>> {
        self.of_ratios(bends_rad_s, f64::tanh)
    }

    /// The derivatives of [`Motion::coulomb`] by the logarithms of the bends' speeds.
    pub(crate) fn slopes_of_bends(&self, bends_rad_s: &[f64]) -> Vec<Vec<f64>> {
        self.of_ratios(bends_rad_s, slope_of_bend)
    }

    /// Smooth torques that follow from the ratio of each joint's velocity to the speed of its bend.
    fn of_ratios(&self, bends_rad_s: &[f64], torque: fn(f64) -> f64) -> Vec<Vec<f64>> {
        let of_row = |row: &Vec<f64>| {
            row.iter().zip(bends_rad_s).map(|(qd, speed)| torque(qd / speed)).collect()
        };
        self.smoothing.of(&self.qd.iter().map(of_row).collect::<Vec<Vec<f64>>>())
    }

    /// The smooth torques of each joint `later_s` after a sample, N·m.
    pub(crate) fn later_u(&self, sample: usize, later_s: f64) -> Vec<f64> {
        later(&self.u, sample, later_s * self.rate_hz)
    }

    /// The recorded torques `later_s` after each of `samples` from `start` on, `[sample, joint]`, N·m.
    pub(crate) fn later_recorded_u(&self, start: usize, samples: usize, later_s: f64) -> Vec<f64> {
        (start..start + samples)
            .flat_map(|sample| later(&self.recorded_u, sample, later_s * self.rate_hz))
            .collect()
    }

    /// The motion of these samples.
    pub(crate) fn part(&self, samples: Range<usize>) -> Self {
        let of = |rows: &[Vec<f64>]| rows[samples.clone()].to_vec();
        Self {
            name: self.name.clone(),
            q: of(&self.q),
            qd: of(&self.qd),
            qdd: of(&self.qdd),
            u: of(&self.u),
            recorded_u: of(&self.recorded_u),
            saturation: self.saturation.clone(),
            smoothing: self.smoothing.clone(),
            ..*self
        }
    }

    /// Whether the recorded torque of a joint is cut off at a sample.
    pub(crate) fn is_cut(&self, joint: usize, sample: usize) -> bool {
        self.saturation[joint].cuts(self.recorded_u[sample][joint])
    }

    /// The samples of a joint whose smooth torque is not that of the joint, because the recorded one is
    /// cut off there or near. Empty if nothing is cut off.
    pub(crate) fn near_cuts(&self, joint: usize) -> Vec<bool> {
        if !self.saturation[joint].has_level() {
            return Vec::new();
        }
        // As much again, because noise decides close to the level what is cut.
        let spread = 2 * self.smoothing.averaged;
        let mut near = vec![false; self.samples()];
        for sample in (0..self.samples()).filter(|sample| self.is_cut(joint, *sample)) {
            let last = (sample + spread).min(self.samples() - 1);
            near[sample.saturating_sub(spread)..=last].fill(true);
        }
        near
    }

    /// Its length, s.
    pub(crate) fn seconds(&self) -> f64 {
        self.samples() as f64 / self.rate_hz
    }

    pub(crate) fn samples(&self) -> usize {
        self.q.len()
    }

    /// Samples at each end that the low-pass and differences leave uncertain.
    pub(crate) fn uncertain(&self) -> usize {
        self.samples_in(UNCERTAIN_S).max(2)
    }

    /// The number of samples in `seconds`.
    pub(crate) fn samples_in(&self, seconds: f64) -> usize {
        whole(seconds * self.rate_hz)
    }
}

/// The nearest whole number, at least 0.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rounded, not negative, and as small as a recording"
)]
pub(crate) fn whole(number: f64) -> usize {
    number.round().max(0.0) as usize
}

/// The row a number of samples after another, by the cubic through the four rows around it. Beyond
/// the ends are the rows of the ends.
#[expect(clippy::cast_precision_loss, reason = "an index of a recording")]
fn later(rows: &[Vec<f64>], sample: usize, later: f64) -> Vec<f64> {
    let last = rows.len() - 1;
    let place = (sample as f64 + later).clamp(0.0, last as f64);
    let (at, share) = (whole(place.floor()), place.fract());
    if share == 0.0 {
        return rows[at].clone();
    }
    let weights = [
        -share * (share - 1.0) * (share - 2.0) / 6.0,
        (share + 1.0) * (share - 1.0) * (share - 2.0) / 2.0,
        -(share + 1.0) * share * (share - 2.0) / 2.0,
        (share + 1.0) * share * (share - 1.0) / 6.0,
    ];
    let row = |offset: usize| &rows[(at + offset).saturating_sub(1).min(last)];
    (0..rows[at].len())
        .map(|joint| (0..4).zip(weights).map(|(offset, weight)| weight * row(offset)[joint]).sum())
        .collect()
}

/// Whether a joint moves at each sample, faster than a hundredth of its highest speed.
fn moves(qd: &[Vec<f64>], joints: usize) -> Vec<bool> {
    const LEAST: f64 = 0.01;

    let speed = |row: &Vec<f64>, joint: usize| row[joint].abs();
    let fastest: Vec<f64> = (0..joints)
        .map(|joint| qd.iter().map(|row| speed(row, joint)).fold(0.0, f64::max))
        .collect();
    let moves = |row: &Vec<f64>| {
        let mut joints = fastest.iter().enumerate();
        joints.any(|(joint, fastest)| speed(row, joint) > LEAST * fastest)
    };
    qd.iter().map(moves).collect()
}

/// Central differences; one-sided at the ends.
fn slopes(rows: &[Vec<f64>], rate_hz: f64) -> Vec<Vec<f64>> {
    let last = rows.len() - 1;
    let slope = |k: usize| -> Vec<f64> {
        let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
        let factor = rate_hz / (after - before) as f64;
        rows[after]
            .iter()
            .zip(&rows[before])
            .map(|(after, before)| (after - before) * factor)
            .collect()
    };
    (0..rows.len()).map(slope).collect()
}

fn check(recording: &Recording, joints: usize) -> Result<(), IdentificationError> {
    let Recording { name, rate_hz, q, u } = recording;
    for (column, rows) in [("q", q), ("u", u)] {
        for (sample, row) in rows.iter().enumerate() {
            if row.len() != joints {
                let (recording, found) = (name.clone(), row.len());
                return Err(IdentificationError::Joints { recording, found, allowed: joints });
            }
            if let Some(joint) = row.iter().position(|value| !value.is_finite()) {
                let (recording, joint) = (name.clone(), joint + 1);
                return Err(IdentificationError::NotFinite { recording, column, joint, sample });
            }
        }
    }
    if q.len() != u.len() {
        let (recording, q, u) = (name.clone(), q.len(), u.len());
        return Err(IdentificationError::Lengths { recording, q, u });
    }
    let samples = q.len();
    let seconds = samples as f64 / rate_hz;
    let least_s = 2.0 * HORIZONS_S[HORIZONS_S.len() - 1];
    if seconds.is_nan() || seconds < least_s {
        return Err(IdentificationError::Short { recording: name.clone(), seconds, least_s });
    }
    Ok(())
}
