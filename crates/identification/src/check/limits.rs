//! How far motions and torques go beyond the limits of a description.

use spec::{JointDescription, RobotDescription};

use crate::motion::Motion;

/// A smoothed value of a recording, and the limit of the description that it is nearest to.
#[derive(Clone, Debug)]
pub struct Reached {
    pub value: f64,
    pub limit: f64,
    /// The recording with the value, and the seconds since its beginning.
    recording: String,
    time_s: f64,
}

impl Reached {
    /// How much the value is of its limit.
    pub const fn share(&self) -> f64 {
        self.value.abs() / self.limit.abs()
    }

    /// `12.3 s into a.csv`.
    pub fn place(&self) -> String {
        let Self { recording, time_s, .. } = self;
        let recording = if recording.is_empty() { "the recording" } else { recording };
        format!("{time_s:.1} s into {recording}")
    }
}

/// The farthest that a joint goes towards its limits, after the low-pass: noise and short peaks do not
/// count.
pub struct Farthest {
    /// rad; the side on which the position goes further beyond its limit.
    pub position: Reached,
    /// The same in rad, above 0 beyond the limit.
    pub beyond_rad: f64,
    /// rad/s.
    pub speed: Reached,
    /// N·m.
    pub torque: Reached,
}

impl Farthest {
    /// The farthest of each joint. Empty without motions.
    pub fn of(description: &RobotDescription, motions: &[Motion]) -> Vec<Self> {
        if motions.is_empty() {
            return Vec::new();
        }
        let joints = description.joints.iter().enumerate();
        joints.map(|(joint, limits)| Self::of_joint(limits, joint, motions)).collect()
    }

    fn of_joint(limits: &JointDescription, joint: usize, motions: &[Motion]) -> Self {
        let farthest = |rows: fn(&Motion) -> &[Vec<f64>], limit: f64, key: fn(f64) -> f64| {
            farthest(motions, rows, joint, limit, key)
        };
        let lowest = farthest(|motion| &motion.q, limits.position_rad.min, |q| -q);
        let highest = farthest(|motion| &motion.q, limits.position_rad.max, |q| q);
        let (below, above) = (lowest.limit - lowest.value, highest.value - highest.limit);
        let (position, beyond_rad) = if below > above { (lowest, below) } else { (highest, above) };
        let size = |farthest: Reached| Reached { value: farthest.value.abs(), ..farthest };
        Self {
            position,
            beyond_rad,
            speed: size(farthest(|motion| &motion.qd, limits.velocity_rad_s, f64::abs)),
            torque: size(farthest(|motion| &motion.u, limits.torque_nm, f64::abs)),
        }
    }
}

/// The value of a joint with the largest key. Rows at the ends that the low-pass leaves uncertain do not
/// count.
fn farthest(
    motions: &[Motion],
    rows: fn(&Motion) -> &[Vec<f64>],
    joint: usize,
    limit: f64,
    key: fn(f64) -> f64,
) -> Reached {
    let mut best = (f64::NEG_INFINITY, 0.0, 0, 0);
    for (at, motion) in motions.iter().enumerate() {
        let uncertain = motion.uncertain();
        let known = uncertain..motion.samples().saturating_sub(uncertain);
        for sample in known {
            let value = rows(motion)[sample][joint];
            if key(value) > best.0 {
                best = (key(value), value, at, sample);
            }
        }
    }
    let (_, value, at, sample) = best;
    let motion = &motions[at];
    let time_s = sample as f64 / motion.rate_hz;
    Reached { value, limit, recording: motion.name.clone(), time_s }
}
