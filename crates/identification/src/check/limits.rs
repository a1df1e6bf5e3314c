//! How far motions and torques go beyond the limits of a description.

use spec::{JointDescription, RobotDescription};

use crate::motion::Motion;

/// A smoothed value of a recording, and the limit of the description that it is nearest to.
#[derive(Clone, Copy)]
pub struct Reached {
    pub value: f64,
    pub limit: f64,
}

impl Reached {
    /// How much the value is of its limit.
    pub const fn share(self) -> f64 {
        self.value.abs() / self.limit.abs()
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
        let positions = || known(motions, |motion| &motion.q).map(|row| row[joint]);
        let [lowest, highest] = [
            Reached {
                value: positions().fold(f64::INFINITY, f64::min),
                limit: limits.position_rad.min,
            },
            Reached {
                value: positions().fold(f64::NEG_INFINITY, f64::max),
                limit: limits.position_rad.max,
            },
        ];
        let (below, above) = (lowest.limit - lowest.value, highest.value - highest.limit);
        let (position, beyond_rad) = if below > above { (lowest, below) } else { (highest, above) };
        let largest = |rows: fn(&Motion) -> &[Vec<f64>], limit: f64| {
            let sizes = known(motions, rows).map(|row| row[joint].abs());
            Reached { value: sizes.fold(0.0, f64::max), limit }
        };
        Self {
            position,
            beyond_rad,
            speed: largest(|motion| &motion.qd, limits.velocity_rad_s),
            torque: largest(|motion| &motion.u, limits.torque_nm),
        }
    }
}

/// The rows of motions, but for those at the ends that the low-pass leaves uncertain.
fn known(motions: &[Motion], rows: fn(&Motion) -> &[Vec<f64>]) -> impl Iterator<Item = &Vec<f64>> {
    motions.iter().flat_map(move |motion| {
        let uncertain = motion.uncertain();
        rows(motion).iter().take(motion.samples().saturating_sub(uncertain)).skip(uncertain)
    })
}
